"""All kinds of blocks by name, and the reading of one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.core.records.option import options_of
from workbench.core.records.parsing import toml_value
from workbench.core.records.plug_ins import ExtensibleTable
from workbench.errors import InputError, WorkbenchError, suggest
from workbench.system.block_table.base import Block
from workbench.system.block_table.choices import Friction, Lookup, Lookup2d, Maximum, Minimum, Product, Switch
from workbench.system.block_table.limits import (
    Backlash,
    DeadBand,
    Integrator,
    Pi,
    Pid,
    Quantiser,
    RateLimiter,
    Relay,
    Saturation,
)
from workbench.system.block_table.linear import (
    Biquad,
    Delay,
    DiscreteTransfer,
    LeadLag,
    Notch,
    TransferFunction,
    VariableDelay,
    ZeroOrderHold,
)
from workbench.system.block_table.pilots import CrossoverPilot, NealSmithPilot

__all__ = ["BLOCKS", "block_of", "block_table", "entry_of", "sample_of"]

# In the order of lists and palettes.
_OWN: Mapping[str, type[Block]] = {
    kind.kind: kind
    for kind in (
        Saturation, DeadBand, RateLimiter, Backlash, Relay, Quantiser, Integrator, Pi, Pid, TransferFunction, LeadLag,
        Notch, Biquad, Product, Minimum, Maximum, Switch, Friction, Lookup, Lookup2d, Delay, VariableDelay,
        ZeroOrderHold, DiscreteTransfer, CrossoverPilot, NealSmithPilot,
    )
}  # fmt: skip


def _wrong(name: str, held: Any) -> str:  # noqa: ANN401 - whatever a plug-in has
    if not (isinstance(held, type) and issubclass(held, Block)):
        return "is not a block, see workbench.system.block_table.base.Block"
    if held.kind != name:
        return f"its kind is '{held.kind}'; give both the same name"
    sample: Any = held
    sample(**held.sample)  # lists and palettes show it
    return ""


BLOCKS: ExtensibleTable[type[Block]] = ExtensibleTable("blocks", _OWN, _wrong)


def block_of(kind: str, parameters: Mapping[str, Any]) -> Block:
    """Return a block.

    Args:
        kind: a name in `BLOCKS`.
        parameters: parameters by name.

    Raises:
        InputError: unknown kind or parameter (near names are in the message), a parameter that is missing or out of
            its range.
    """
    result = BLOCKS.get(str(kind))
    if result is None:
        raise InputError(f"block '{kind}' is unknown; {suggest(str(kind), BLOCKS)}")
    known = {d.name: d for d in options_of(result)}
    for name in parameters:
        if name not in known:
            raise InputError(f"{kind}: parameter '{name}' is unknown; {suggest(str(name), known)}")
    for name, declared in known.items():
        if declared.required and name not in parameters:
            raise InputError(f"{kind}: parameter '{name}' is missing")
    made: Any = result
    package = BLOCKS.package_of(str(kind))
    return _of_plug_in(package, made, parameters) if package else made(**parameters)


def _of_plug_in(package: str, made: Any, parameters: Mapping[str, Any]) -> Block:  # noqa: ANN401 - a class
    """Return a block of another package.

    Raises:
        InputError: its own, or what else is wrong with it: it is not the linear system that its matrices should be.
    """
    whose = f"{made.kind}: the block of the package {package}"
    try:
        block: Block = made(**parameters)
        a, b, c, d = (np.asarray(matrix).shape for matrix in tuple(block.matrices() or ())[:4])
    except WorkbenchError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a foreign block raises
        raise InputError(f"{whose} failed: {type(error).__name__}: {error}") from None
    n, m = len(block.states), len(block.inputs)
    if (a, b, c, d) != ((n, n), (n, m), (1, n), (1, m)):
        raise InputError(
            f"{whose}: its matrices have the shapes {a}, {b}, {c}, {d}, which do not fit {n} states, {m} inputs and an "
            "output"
        )
    return block


def sample_of(kind: str) -> Block:
    """Return a block to begin with: parameters at their default, those that have to be given as in its sample.

    Args:
        kind: a name in `BLOCKS`.
    """
    return block_of(kind, BLOCKS[kind].sample)


def entry_of(kind: str) -> str:
    """Return such a block as an entry of a system file; parameters without a number as default are left out.

    Args:
        kind: a name in `BLOCKS`.
    """
    block = sample_of(kind)
    values = {d.name: getattr(block, d.name) for d in options_of(type(block))}
    shown = {n: v for n, v in values.items() if v is not None and v not in (math.inf, -math.inf)}
    return toml_value({"block": kind, **shown})


def block_table(block: Block) -> dict[str, Any]:
    """Return a block as a table of a system file holds it: its kind, and the parameters that are not at their default.

    Args:
        block: any.
    """
    return {"block": block.kind, **block.given}
