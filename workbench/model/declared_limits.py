"""Where what is asked leaves the limits that a model declares: its `min` and `max` hold for what users set, too."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from numbers import Real
from typing import Any

from workbench.core.records.option import EACH, DeclaredOption
from workbench.core.values.operating_point import OperatingPoint
from workbench.fmi.variable import Variable
from workbench.model.base import Model
from workbench.model.names import forced_inputs, variables_of
from workbench.model.operating_point import bias_of, centre_of, find_point
from workbench.signals.kinds import Prbs, Signal, Sine, levels_of

__all__ = ["beyond_limits"]

_ROUNDING = 1e-9  # relative: what a conversion of units costs


def beyond_limits(model: Model, options: Iterable[tuple[DeclaredOption, Any]], at: object) -> list[str]:
    """Return a note on each variable that is set or forced outside of its declared limits.

    Args:
        model: that declares them.
        options: of a request, each with its value, in the units of the variables.
        at: operating point that the request names.
    """
    limited = {v.name: v for v in model.inputs if v.minimum is not None or v.maximum is not None}
    reached: dict[str, list[float]] = {}
    if model.start_values:
        limited |= {name: v for name, v in variables_of(model).items() if name in model.start_values}
        _add(reached, limited, model.start_values)
    if any(v.causality == "input" for v in limited.values()):
        point = find_point(model, at)[0] if at is not None else model.at  # type: ignore[arg-type]
        for name, values in _asked(model, dict(options), limited, point):
            reached.setdefault(name, []).extend(values)
    return [words for name, values in reached.items() if (words := _words(limited[name], values))]


def _asked(
    model: Model, options: Mapping[DeclaredOption, Any], limited: Mapping[str, Variable], point: OperatingPoint | None
) -> Iterator[tuple[str, list[float]]]:
    named = {declared.name: value for declared, value in options.items()}
    for declared, value in options.items():
        of, forced = declared.option.of, named.get(declared.option.of)
        if isinstance(value, Mapping) and of == EACH and not declared.option.change:
            yield from _numbers(limited, value).items()
        elif isinstance(value, Mapping) and not of:
            signals = {n: s for n, s in value.items() if n in limited and isinstance(s, Signal | str)}
            for name, signal in forced_inputs(model, signals).items():
                yield name, [x + bias_of(model, name, point) for x in _levels(signal)]
        elif declared.name.startswith("amplitude") and isinstance(forced, str) and forced in limited:
            centre = point.u[forced] if point is not None and forced in point.u else centre_of(model, forced)
            size = max(_flat(value), default=0.0)
            yield forced, [centre + bias_of(model, forced, point) + x for x in (-size, size)]


def _add(reached: dict[str, list[float]], limited: Mapping[str, Variable], given: Mapping[str, Any]) -> None:
    for name, values in _numbers(limited, given).items():
        reached.setdefault(name, []).extend(values)


def _numbers(limited: Mapping[str, Variable], given: Mapping[str, Any]) -> dict[str, list[float]]:
    return {name: values for name, value in given.items() if name in limited and (values := _flat(value))}


def _flat(value: object) -> list[float]:
    """Return the numbers in a value or several."""
    items = value.tolist() if hasattr(value, "tolist") else value
    items = items if isinstance(items, list | tuple) else [items]
    return [float(x) for x in items if isinstance(x, Real) and math.isfinite(x)]


def _levels(signal: Signal) -> tuple[float, ...]:
    """Return values that a signal does not leave; empty: not known."""
    if isinstance(signal, Sine | Prbs):
        return signal.offset - abs(signal.amplitude), signal.offset + abs(signal.amplitude)
    return levels_of(signal)


def _words(variable: Variable, values: Iterable[float]) -> str:
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    slack = _ROUNDING * max([abs(x) for x in (low, high) if math.isfinite(x)], default=0.0)
    outside = [x for x in values if not low - slack <= x <= high + slack]
    if not outside:
        return ""
    worst = max(outside, key=lambda x: max(low - x, x - high))
    unit = f" {variable.unit}" if variable.unit not in (None, "", "1") else ""
    ends = (
        f"at least {low:g}" if math.isinf(high) else f"at most {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"
    )
    return f"{variable.name}: {worst:g}{unit} is outside of what the model declares, {ends}{unit}"
