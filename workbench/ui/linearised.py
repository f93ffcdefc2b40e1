"""A loop that is linearised for tuning: in a worker process, as its FMUs may crash; what comes back is numbers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from workbench.core.records.option import Option, options_of
from workbench.errors import InputError, SimulationError
from workbench.jobs.options import Limits
from workbench.model.loading import Loading

# As in `curves`: the page is there before numerics are.
if TYPE_CHECKING:
    from workbench.core.values.linear import LinearPart
    from workbench.core.values.margins import Margins
    from workbench.loops.loop.result import LinearLoop
    from workbench.loops.loop.tunable import TunableLoop
    from workbench.model import Model
    from workbench.system.description import Component

__all__ = ["LinearisedLoop", "linearised"]

_LIMITS = Limits(timeout=300.0)  # nobody waits longer at a slider


@dataclass(frozen=True, eq=False)
class LinearisedLoop:
    """A loop that is linearised.

    Attributes:
        parameters: of its blocks, ready for JSON.
        tunable: with its linear blocks taken out; None: it is linearised as a whole, `whole` is that.
        whole: linear model of the loop as it is; None: its blocks are taken out.
        why: why its blocks cannot be taken out; empty: they are.
    """

    parameters: tuple[Mapping[str, Any], ...]
    tunable: TunableLoop | None
    whole: LinearLoop | None = None
    why: str = ""

    def at(self, values: Mapping[str, float], gain: float) -> tuple[LinearPart, Margins]:
        """Return L and its margins with other parameters of linear blocks and a factor.

        Args:
            values: full name of a parameter → value.
            gain: the factor.
        """
        from workbench.loops.loop.margins import margins_of  # noqa: PLC0415 - as above
        from workbench.ui.loop import margins_at  # noqa: PLC0415

        if self.tunable is None:
            assert self.whole is not None  # noqa: S101 - one of the two
            return self.whole.transfer.scaled(gain), margins_at(self.whole, gain)
        transfer = self.tunable.loop(values).scaled(gain)
        return transfer, margins_of(transfer, peaks=False)

    def quick(self, name: str) -> bool:
        """Return whether another value of a parameter needs no other linearisation.

        Args:
            name: of the parameter.
        """
        return self.tunable is not None and name.rpartition(".")[0] in self.tunable.blocks


def linearised(path: str, where: str) -> LinearisedLoop:
    """Linearise a loop in a worker process.

    Args:
        path: of the system.
        where: see `loop`.

    Raises:
        InputError, SimulationError: see `loop`.
        LostError: the worker crashed or met its time limit.
    """
    from workbench.jobs.pool import Pool  # noqa: PLC0415 - as above
    from workbench.jobs.runner import Reply  # noqa: PLC0415
    from workbench.system.load import open_files  # noqa: PLC0415

    with open_files([path], Loading()) as models:
        recipe = next(iter(models.values())).recipe
        with Pool(recipe, jobs=1, limits=_LIMITS) as pool:
            (event,) = pool.run(_linearise, deque([where]))
    if not isinstance(event, Reply):
        raise event.error
    found: LinearisedLoop = event.value
    return found


def _linearise(model: Model, where: str) -> Iterator[LinearisedLoop]:
    """Linearise a loop in this process; the task of a worker."""
    from workbench.jobs.job import Job  # noqa: PLC0415
    from workbench.loops.loop.request import Loop  # noqa: PLC0415 - as above
    from workbench.loops.loop.run import run  # noqa: PLC0415
    from workbench.loops.loop.tunable import tunable_loop  # noqa: PLC0415
    from workbench.loops.opened_system import system_of  # noqa: PLC0415

    parameters = tuple(p for component in system_of(model, "tuning needs").components for p in _parameters(component))
    try:
        yield LinearisedLoop(parameters, tunable_loop(model, where, in_process=True))
    except (InputError, SimulationError) as error:
        whole = run(model, Loop(open=where), Job()).linear
        if whole is None:
            raise
        yield LinearisedLoop(parameters, None, whole, str(error))


def _parameters(component: Component) -> list[dict[str, Any]]:
    """Return the numbers that a component can be given, with the range that each may have."""
    from workbench.system.description import BlockComponent, GainComponent  # noqa: PLC0415 - as above

    own: list[tuple[str, Any, Option | None]]
    if isinstance(component, GainComponent):
        own = [("gain", component.gain, None)]
    elif isinstance(component, BlockComponent):
        block = component.block
        own = [(d.name, getattr(block, d.name), d.option) for d in options_of(type(block))]
    else:
        return []
    return [
        {
            "name": f"{component.name}.{name}", "component": component.name, "value": value,
            "kind": getattr(component, "kind", "gain"), "unit": "" if option is None else option.unit,
            "least": None if option is None else 0.0 if option.positive else option.least,
            "help": "" if option is None else option.help,
        }
        for name, value, option in own
        if isinstance(value, float) and math.isfinite(value) and name != "start"
    ]  # fmt: skip
