"""Read a linear state-space model: matrices, names and the point they belong to, checked before anything is built."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from workbench.core.records.record import read_json
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.errors import InputError

__all__ = ["StateSpaceFile", "matrices_of", "read_matrices"]


_REQUIRED = ("A", "B", "C", "D", "dt", "input_names", "output_names")
_KINDS = {"state": "x", "input": "u", "output": "y"}
_UNWRITABLE = re.compile(r"[\x00-\x1f\x7f]")  # FMI forbids tabs and line breaks, XML the rest
# What lies between the samples of a linearised model is compared with this, relative to its largest entry.
_HELD = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class StateSpaceFile(Linear):
    """A linear model about a point.

    Continuous (dt = 0): dx/dt = dx0 + A x + B (u − u0); discrete (dt > 0): x(k+1) = A x(k) + B (u(k) − u0).
    Both: y = y0 + C x + D (u − u0). The state is a deviation; it starts at x0.

    Attributes:
        u0: inputs at the point, shape (m,).
        y0: outputs at the point, shape (q,).
        x0: where the state starts, shape (n,).
        dx0: drift at the point, shape (n,) [unit of the state / s]; 0 for a discrete model.
        state_points: value of each state at the point in the original model, None where that is not told.
        units: name → unit.
        notes: what of the source is not in these matrices, one line each.
    """

    u0: Floats
    y0: Floats
    x0: Floats
    dx0: Floats
    state_points: tuple[float | None, ...]
    units: Mapping[str, str]
    notes: tuple[str, ...] = ()


def read_matrices(path: str | Path) -> StateSpaceFile:
    """Return the model in a JSON file that `workbench identify`, `workbench lin` or a script wrote.

    Args:
        path: of the file; the keys are those of :func:`matrices_of`.

    Raises:
        InputError: no such file, not JSON, a key that is missing or of the wrong shape, a value that is not finite.
    """
    data = read_json(path)
    try:
        return matrices_of(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def matrices_of(model: object) -> StateSpaceFile:
    """Return the matrices of a linear model, checked.

    Args:
        model: a mapping with A, B, C, D, dt, input_names and output_names, and optionally state_names, u0, y0, x0,
            dx0, input_units, output_units or units (name → unit); or what has a `to_dict` that gives one, such as
            the result of `lin` or an identified model; or a python-control StateSpace. u0 and y0 are lists or
            name → value. A list x0 is where the deviations start; a mapping x0 (as `lin` gives it) is the point
            that the states are deviations from, which then start at 0.

    Raises:
        InputError: no such model, a key that is missing or of the wrong shape, a value that is not finite, a name
            that is used twice.
    """
    data = _mapping(model)
    missing = [key for key in _REQUIRED if key not in data]
    if missing:
        raise InputError(f"this is not a linear model: {', '.join(missing)} missing{_hint(data)}")
    return _checked(data)


def _mapping(model: object) -> Mapping[str, Any]:
    result = model.to_dict() if hasattr(model, "to_dict") else model
    if not isinstance(result, Mapping):
        result = _of_control(model)
    inner = result.get("model")
    if "A" not in result and isinstance(inner, Mapping):
        return cast("Mapping[str, Any]", inner)
    return cast("Mapping[str, Any]", result)


def _of_control(model: object) -> Mapping[str, Any]:
    """Return a python-control StateSpace as a mapping; it is recognised by what it has."""
    labels = {"state_names": "state_labels", "input_names": "input_labels", "output_names": "output_labels"}
    if not all(hasattr(model, name) for name in (*"ABCD", "dt", *labels.values())):
        raise InputError(
            f"a linear model is needed, not {type(model).__name__}: a mapping with {', '.join(_REQUIRED)}, a result of "
            "lin, an identified model or a python-control StateSpace"
        )
    return vars(Linear.from_state_space(model))


def _hint(data: Mapping[str, Any]) -> str:
    if "points" in data:
        return " (it holds several models, one for each point: export one of them)"
    return f" (it has {', '.join(sorted(map(str, data))[:12])})" if data else ""


# -- checks ------------------------------------------------------------------------------------


def _checked(data: Mapping[str, Any]) -> StateSpaceFile:
    inputs, outputs = _names(data["input_names"], "input"), _names(data["output_names"], "output")
    n = _order(data["A"])
    states = _state_names(data.get("state_names"), n)
    x, u, y = ("state", n), ("input", len(inputs)), ("output", len(outputs))
    dt = _period(data["dt"])
    _refuse_twice((*inputs, *outputs), "input_names and output_names")
    start, points = _start(data, states)
    return StateSpaceFile(
        A=_matrix(data, "A", (x, x)),
        B=_matrix(data, "B", (x, u)),
        C=_matrix(data, "C", (y, x)),
        D=_matrix(data, "D", (y, u)),
        dt=dt,
        state_names=states,
        input_names=inputs,
        output_names=outputs,
        u0=_vector(data, "u0", inputs),
        y0=_vector(data, "y0", outputs),
        x0=start,
        dx0=_drift(data, states, dt),
        state_points=points,
        units=_units(data, inputs, outputs),
        notes=tuple(_notes(data, dt)),
    )


def _names(names: object, kind: str) -> tuple[str, ...]:
    if not isinstance(names, list | tuple) or not all(isinstance(n, str) for n in names):
        raise InputError(f"{kind}_names must be a list of texts")
    for name in names:
        if not name.strip() or _UNWRITABLE.search(name):
            raise InputError(f"{kind}_names: '{_UNWRITABLE.sub('?', name)}' cannot be a variable's name")
    _refuse_twice(names, f"{kind}_names")
    return tuple(names)


def _refuse_twice(names: Sequence[str], where: str) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: '{twice[0]}' appears twice; every variable of an FMU needs a unique name")


def _order(A: object) -> int:
    if not isinstance(A, list | tuple | np.ndarray):
        raise InputError("A must be a list of rows")
    return len(A)


def _state_names(names: object, n: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"{_KINDS['state']}[{i + 1}]" for i in range(n))
    result = _names(names, "state")
    if len(result) != n:
        raise InputError(f"A has {n} rows, state_names has {len(result)}")
    return result


def _period(dt: object) -> float:
    if isinstance(dt, bool) or not isinstance(dt, int | float) or not np.isfinite(dt) or dt < 0.0:
        raise InputError(
            f"dt must be a period in seconds, or 0 for a continuous model, not {json.dumps(dt, default=str)}"
        )
    return float(dt)


def _array(value: object, what: str) -> Floats:
    try:
        # None, which JSON has for a number that is not finite, becomes not-a-number here.
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{what} must hold numbers only, in rows of equal length") from None


def _matrix(data: Mapping[str, Any], name: str, sides: Sequence[tuple[str, int]]) -> Floats:
    """Return a matrix; `sides` says of its rows and of its columns what they stand for and how many there are."""
    result = _array(data[name], name)
    shape = (sides[0][1], sides[1][1])
    if result.size == 0 and 0 in shape:
        return np.zeros(shape)
    if result.shape != shape:
        wanted = f"{shape[0]} × {shape[1]}: a row for each {sides[0][0]}, a column for each {sides[1][0]}"
        raise InputError(f"{name} has the shape {_shape(result)}, but needs {wanted}")
    bad = np.argwhere(~np.isfinite(result))
    if len(bad):
        raise InputError(f"{name}: row {bad[0][0] + 1}, column {bad[0][1] + 1} is not a finite number")
    return result


def _shape(array: Floats) -> str:
    return " × ".join(map(str, array.shape)) or "of a single number"


def _vector(data: Mapping[str, Any], name: str, names: Sequence[str]) -> Floats:
    """Return a list of numbers, or the values by name; 0 where nothing is told."""
    value = data.get(name)
    if value is None:
        return np.zeros(len(names))
    if isinstance(value, Mapping):
        # A linearisation of some inputs tells the point of all.
        value = [value.get(n, 0.0) for n in names]
    result = _array(value, name)
    if result.shape != (len(names),):
        wanted = ", ".join(names)[:80]
        raise InputError(f"{name} has the shape {_shape(result)}, but needs {len(names)} numbers: {wanted}")
    bad = np.flatnonzero(~np.isfinite(result))
    if len(bad):
        raise InputError(f"{name}: the value of '{names[bad[0]]}' is not a finite number")
    return result


def _start(data: Mapping[str, Any], states: Sequence[str]) -> tuple[Floats, tuple[float | None, ...]]:
    """Return where the deviations start and, where it is told, the point that they deviate from."""
    if not isinstance(data.get("x0"), Mapping):
        return _vector(data, "x0", states), (None,) * len(states)
    points = {**data["x0"], **(data.get("discrete0") or {})}
    return np.zeros(len(states)), tuple(_point(points.get(name), name) for name in states)


def _point(value: object, name: str) -> float | None:
    if value is None or (isinstance(value, int | float) and np.isfinite(value)):
        return value
    raise InputError(f"x0: the value of '{name}' is not a finite number")


def _drift(data: Mapping[str, Any], states: Sequence[str], dt: float) -> Floats:
    return np.zeros(len(states)) if dt > 0.0 else _vector(data, "dx0", states)


def _units(data: Mapping[str, Any], inputs: Sequence[str], outputs: Sequence[str]) -> dict[str, str]:
    given = data.get("units") or {}
    if not isinstance(given, Mapping):
        raise InputError("units must give a unit to each name")
    result = dict(given)
    for key, names in (("input_units", inputs), ("output_units", outputs)):
        units = data.get(key) or [None] * len(names)
        if not isinstance(units, list | tuple) or len(units) != len(names):
            raise InputError(f"{key} must be a list of {len(names)} units")
        result.update({n: u for n, u in zip(names, units, strict=True) if u is not None})
    wrong = next((n for n, u in result.items() if u is not None and not isinstance(u, str)), None)
    if wrong is not None:
        raise InputError(f"units: the unit of '{wrong}' must be a text")
    return {n: u for n, u in result.items() if u}


# -- what is left out --------------------------------------------------------------------------


def _notes(data: Mapping[str, Any], dt: float) -> list[str]:
    notes = []
    if data.get("noise_model") or (data.get("K") is not None and np.any(np.array(data["K"], dtype=object))):
        notes.append("the noise model is left out: an FMU has no noise input")
    between = data.get("intersample")
    if dt > 0.0 and isinstance(between, Mapping):
        notes += _between(between, data)
    return notes


def _between(between: Mapping[str, Any], data: Mapping[str, Any]) -> list[str]:
    notes = []
    if not all(_constant(between.get(name, []), data[name]) for name in "CD"):
        notes.append("outputs that move between the samples in the original are held there")
    if between.get("sampled") is False:
        notes.append("inputs act at the samples only; in the original they act between them as well")
    return notes


def _constant(sequence: object, value: object) -> bool:
    result, expected = np.array(sequence, dtype=np.float64), np.array(value, dtype=np.float64)
    if result.size == 0 or expected.size == 0:
        return True
    return bool(np.abs(result - expected).max() <= _HELD * max(1.0, float(np.abs(expected).max())))
