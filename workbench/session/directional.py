"""Whether an instance offers exact derivatives, and how the slopes along a run are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.fmi.instance import Instance
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.kernel.native_slopes import Pattern, pattern_of
from workbench.session.stand import named_states

__all__ = ["slopes_pattern", "why_not_exact"]

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

    In systems of several parts each state is moved by itself: what connections pass on is not declared.

    Args:
        instance: of model exchange.
        recorded: what the run records.
    """
    description, n = instance.description, instance.nx
    single = len(instance.parts) == 1 and not (instance.wiring is not None and instance.wiring.connections)
    if not single or len(description.derivatives) != n or len(description.states) != n:
        return pattern_of([None], n)
    number = {v.name: i for i, v in enumerate(named_states(instance))}
    rows = (*description.derivatives, *recorded)
    depends = [None if description.shapes else _states_behind(v, number) for v in rows]
    pattern = pattern_of(depends, n)
    function = _FUNCTIONS.get(instance.parts[0].version, "")
    smooth = all(v.causality == "output" and v.type in FLOAT_TYPES and v.variability == "continuous" for v in recorded)
    # The kernel takes one number a value reference: no arrays.
    scalar = instance.capabilities.directional_derivatives and not description.shapes
    if not (smooth and scalar) or why_not_exact(instance) or not instance.parts[0].library.address(function):
        return pattern
    references = np.array([v.value_reference for v in description.states], dtype=np.uint32)[pattern.members]
    return replace(pattern, references=(references, np.array([v.value_reference for v in rows], dtype=np.uint32)))


def _states_behind(variable: Variable, number: dict[str, int]) -> list[int] | None:
    """Return on which states a variable depends; None: it is not declared."""
    if variable.name in number:
        return [number[variable.name]]
    if variable.dependencies is None:
        return None
    return [number[name] for name in variable.dependencies if name in number]
