"""Whether an instance offers exact derivatives, and how the slopes along a run are found."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.kernel.native_slopes import NativeSparsity, Pattern, pattern_of

__all__ = ["columns_pattern", "newton_note", "newton_sparsity", "slopes_pattern", "why_not_exact"]

SLOW = 300  # states; from here on somebody wants to know why it takes so long
LARGE = 64  # states; a dense Newton matrix of fewer is as fast
NARROW = 4  # a band must be so many times smaller than the matrix

_FUNCTIONS = {2: "fmi2GetDirectionalDerivative", 3: "fmi3GetDirectionalDerivative"}


def why_not_exact(instance: Instance) -> str:
    """Return why exact derivatives, forward or adjoint, are not offered; empty if they are.

    Args:
        instance: of model exchange.
    """
    description = instance.description
    claims = instance.capabilities
    if not (claims.directional_derivatives or claims.adjoint_derivatives):
        return f"{description.model_name} offers no directional derivatives"
    if len(description.derivatives) != instance.nx:
        return f"{description.model_name} does not name the derivatives of its states"
    return ""


def slopes_pattern(instance: Instance, recorded: Sequence[Variable]) -> Pattern:
    """Return how the slopes of derivatives and recorded variables along a run are to be found, as declared.

    Args:
        instance: of model exchange.
        recorded: what the run records.
    """
    description, n = instance.description, instance.nx
    if not _names_states(description):
        return pattern_of([None], n)
    rows = (*description.derivatives, *recorded)
    pattern = pattern_of(_states_of(description, rows), n)
    if len(instance.parts) > 1 or instance.wiring is not None:
        return pattern  # the kernel asks one FMU only
    function = _FUNCTIONS.get(instance.parts[0].version, "")
    smooth = all(v.causality == "output" and v.type in FLOAT_TYPES and v.variability == "continuous" for v in recorded)
    # The kernel takes one number a value reference: no arrays.
    scalar = instance.capabilities.directional_derivatives and not description.shapes
    if not (smooth and scalar) or why_not_exact(instance) or not instance.parts[0].library.address(function):
        return pattern
    references = np.array([v.value_reference for v in description.states], dtype=np.uint32)[pattern.members]
    return replace(pattern, references=(references, np.array([v.value_reference for v in rows], dtype=np.uint32)))


# Of the descriptions used last: a model opens many sessions.
_known: deque[tuple[ModelDescription, NativeSparsity | None]] = deque(maxlen=4)


def newton_sparsity(description: ModelDescription) -> NativeSparsity | None:
    """Return where the Jacobian of a large model may differ from zero, as declared; None: a dense one is not slower.

    Args:
        description: of an FMU or a system.
    """
    for other, result in tuple(_known):
        if other is description:
            return result
    made = _newton_sparsity(description)
    _known.append((description, made))
    return made


def _newton_sparsity(description: ModelDescription) -> NativeSparsity | None:
    n = len(description.states)
    depends = _states_of(description, description.derivatives) if n >= LARGE and _names_states(description) else [None]
    if None in depends:
        return None
    result = NativeSparsity(pattern_of(depends, n))
    return result if NARROW * (2 * result.below + result.above + 1) <= n else None


def newton_note(description: ModelDescription) -> str:
    """Return a remark on the Newton matrix of `gear`; empty where the model is small.

    Args:
        description: of an FMU or a system.
    """
    n = description.state_count
    result = newton_sparsity(description)
    if result is not None:
        width = result.below + result.above + 1
        return f"gear: banded Newton matrix, {width} diagonals for {n} states, by {result.groups} evaluations"
    if n < SLOW:
        return ""
    if any(v.dependencies is None for v in description.derivatives):
        return f"gear: dense Newton matrix of {n} states, which is slow: the FMU does not declare what they depend on"
    return f"gear: dense Newton matrix of {n} states, which is slow: what is declared of them makes no narrow band"


def columns_pattern(instance: Instance, columns: Sequence[Variable], rows: Sequence[Variable]) -> Pattern | None:
    """Return which columns of a large model can be moved at once, as declared; None: each is moved by itself.

    Args:
        instance: of model exchange.
        columns: states and inputs.
        rows: derivatives and outputs.
    """
    description = instance.description
    if len(columns) < LARGE or not _names_states(description) or description.shapes:
        return None
    number = {v.name: i for i, v in enumerate(columns)}
    depends = [_behind(v, number) for v in rows]
    if None in depends:
        return None
    result = pattern_of(depends, len(columns))
    return result if 2 * len(result.ends) < len(columns) else None


def _names_states(description: ModelDescription) -> bool:
    """Whether a model names its states and their derivatives, which FMI 1.0 leaves out."""
    return len(description.derivatives) == len(description.states) == description.state_count


def _states_of(description: ModelDescription, rows: Sequence[Variable]) -> list[list[int] | None]:
    """Return on which states each variable depends; None: it is not declared."""
    if description.shapes:
        return [None]
    number = {v.name: i for i, v in enumerate(description.states)}
    return [_behind(v, number) for v in rows]


def _behind(variable: Variable, number: Mapping[str, int]) -> list[int] | None:
    """Return on which of the numbered variables another depends; None: it is not declared."""
    if variable.name in number:
        return [number[variable.name]]
    if variable.dependencies is None:
        return None
    return [number[name] for name in variable.dependencies if name in number]
