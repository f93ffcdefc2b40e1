"""What is searched for: parameters, initial values and sensors, each in a coordinate in which a step of 1 is large."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.responses import ResponseData
from workbench.model import DescribedModel, Model
from workbench.model.names import check_variables, variables_of

__all__ = ["FreeValue", "FreeValues", "quantities_of", "scaled"]

_DECADE = 10.0  # ratio of limits from which on a positive parameter is searched for by its logarithm
_INSIDE = 1e-6  # of the range: how far from a limit a search begins
_AROUND = 1.0  # coordinate: how far from the start value further searches begin, where there are no limits


@dataclass(frozen=True, kw_only=True)
class FreeValue:
    """One number that is estimated.

    Attributes:
        name: for people.
        kind: "parameter", "state" (initial value), "bias" or "scale" (of a sensor).
        target: its variable.
        data: number of the data that an initial value is of; None: all have the same.
        unit: of the value.
        start, low, high: of the value.
        log: whether the coordinate is the logarithm.
        size: value of a step of 1 in the coordinate, where that is not the logarithm.
    """

    name: str
    kind: str
    target: str
    data: int | None = None
    unit: str | None = None
    start: float
    low: float = -math.inf
    high: float = math.inf
    log: bool = False
    size: float = 1.0

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        if self.log:
            return math.log(value) if value > 0.0 else -math.inf
        return value / self.size

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        return math.exp(coordinate) if self.log else coordinate * self.size

    def slope(self, coordinate: float) -> float:
        """Return the derivative of the value by the coordinate."""
        return self.value(coordinate) if self.log else self.size


@dataclass(frozen=True)
class FreeValues(Sequence[FreeValue]):
    """All that is estimated, in the order of the coordinates z, shape (q,).

    Attributes:
        every: one for each coordinate.
    """

    every: tuple[FreeValue, ...]

    def __len__(self) -> int:
        return len(self.every)

    def __getitem__(self, index: int) -> FreeValue:  # type: ignore[override]
        return self.every[index]

    @property
    def start(self) -> Floats:
        """Coordinates at which the search begins, inside the limits."""
        low, high = self.limits
        span = np.where(np.isfinite(high - low), high - low, 1.0)
        z = np.array([q.coordinate(q.start) for q in self.every])
        return np.asarray(np.clip(z, low + _INSIDE * span, high - _INSIDE * span))

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates."""
        ends = [[q.coordinate(x) if math.isfinite(x) else x for x in (q.low, q.high)] for q in self.every]
        low, high = np.array(ends, dtype=np.float64).T
        return low, high

    def values(self, z: Floats) -> Floats:
        """Return the values at coordinates."""
        return np.array([q.value(x) for q, x in zip(self.every, z.tolist(), strict=True)])

    def slopes(self, z: Floats) -> Floats:
        """Return the derivatives of the values by the coordinates."""
        return np.array([q.slope(x) for q, x in zip(self.every, z.tolist(), strict=True)])

    def of(self, z: Floats, kind: str, data: int) -> dict[str, float]:
        """Return variable → value of one kind.

        Args:
            z: coordinates.
            kind: see `FreeValue`.
            data: number of the data that are played.
        """
        pairs = zip(self.every, z.tolist(), strict=True)
        return {q.target: q.value(x) for q, x in pairs if q.kind == kind and q.data in (None, data)}

    def further(self, count: int) -> Iterator[Floats]:
        """Yield other coordinates to begin at, from a Sobol' sequence within the limits.

        Args:
            count: how many.
        """
        from scipy.stats import qmc  # noqa: PLC0415 - slow to import, and seldom needed

        low, high = self.limits
        middle = self.start
        low, high = (np.where(np.isfinite(a), a, middle + s * _AROUND) for a, s in ((low, -1.0), (high, 1.0)))
        inside = _INSIDE * (high - low)
        for part in qmc.Sobol(len(self), seed=1).random(1 << (count - 1).bit_length())[:count] if count else ():
            yield np.clip(low + part * (high - low), low + inside, high - inside)


def quantities_of(model: Model, data: Sequence[Experiment], request: Calibrate) -> FreeValues:
    """Return what is estimated.

    Args:
        model: whose parameters.
        data: with initial values and sensors of their own.
        request: which.

    Raises:
        InputError: no such parameter, not a real number, a start value that is not known.
    """
    free: Mapping[str, tuple[float, float]] = request.free  # type: ignore[assignment]
    check_variables(model, free, "parameter", "variable", what="free", number=True)
    known = variables_of(model)
    result = [_parameter(model, known[name], *ends) for name, ends in free.items()]
    result += _states(model, data, known, request)
    outputs = {name for one in data for name in one.output_names}
    for kind, names, start in (("bias", request.biases, 0.0), ("scale", request.scales, 1.0)):
        check_variables(model, names, "variable", what=f"{kind} of a sensor")
        if missing := [name for name in names if name not in outputs]:
            raise InputError(f"{kind} of a sensor: '{missing[0]}' is not among the measured outputs")
        for name in names:
            size = _spread(data, name) if kind == "bias" else 1.0
            unit = known[name].unit if kind == "bias" else None
            result.append(
                FreeValue(name=f"{kind} of {name}", kind=kind, target=name, start=start, size=size, unit=unit)
            )
    return FreeValues(tuple(result))


def _parameter(model: Model, variable: Variable, low: float, high: float) -> FreeValue:
    name = variable.name
    if variable.causality == "input":
        raise InputError(f"free: '{name}' is an input; give its measured column, or set it (`start_values`)")
    if variable.type not in FLOAT_TYPES:
        raise InputError(f"free: '{name}' is of type {variable.type}; only real numbers can be estimated")
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name}: its parameters cannot be set, for it is not a file")
    given = model.start_values.get(name, variable.start)
    if not isinstance(given, int | float):
        raise InputError(f"free: '{name}' has no start value; give one by start_values")
    low, high = max(low, _or(variable.minimum, -math.inf)), min(high, _or(variable.maximum, math.inf))
    model.with_values({name: float(given)})  # refused now, not in the first run
    return scaled(name, variable, float(given), low, high)


def _or(value: float | None, other: float) -> float:
    return other if value is None else float(value)


def scaled(name: str, variable: Variable, start: float, low: float, high: float) -> FreeValue:
    """Return a parameter with its coordinate: its logarithm where it is positive and its limits are a decade apart.

    Args:
        name: for people.
        variable: that it is.
        start: where the search begins; the middle of the limits if it is outside of them.
        low: lower limit.
        high: upper limit.

    Raises:
        InputError: there is nothing between the limits.
    """
    if not low < high:
        raise InputError(f"free: {name}: the limits {low:g}:{high:g} leave nothing between them")
    log = (low > 0.0 and high >= _DECADE * low) or (low == 0.0 and start > 0.0 and math.isinf(high))
    if not low <= start <= high:
        start = math.sqrt(low * high) if log and math.isfinite(high) else 0.5 * (low + high)
        if not math.isfinite(start):
            raise InputError(f"free: {name}: its start value is outside its limits; give another by start_values")
    size = 0.5 * (high - low)
    if not math.isfinite(size):
        size = abs(start) or variable.nominal or 1.0
    return FreeValue(
        name=name, kind="parameter", target=variable.name, unit=variable.unit, start=start, low=low, high=high,
        log=log, size=size,
    )  # fmt: skip


def _states(
    model: Model, data: Sequence[Experiment], known: Mapping[str, Variable], request: Calibrate
) -> Iterator[FreeValue]:
    """Yield the initial values that are estimated: of each file its own."""
    ends: Mapping[str, tuple[float, float]] = request.states or {}
    if request.initial == "free":
        ends = {v.name: (-math.inf, math.inf) for v in model.states}
        if not ends:
            raise InputError(f"initial: {model.name} shows no states that could be estimated; use initial=rest")
    check_variables(model, ends, "state", what="states")
    for number, one in enumerate(data):
        if isinstance(one, ResponseData):
            continue
        for name, (low, high) in ends.items():
            variable = known[name]
            first = one.output_names.index(name) if name in one.output_names else None
            start = _first(one.y[:, first]) if first is not None else _standing(model, variable)
            size = variable.nominal or (_spread(data, name) if first is not None else abs(start)) or 1.0
            if math.isfinite(high - low):
                start, size = min(max(start, low), high), 0.5 * (high - low)
            label = f"{name} at the start" + (f" of {one.name}" if len(data) > 1 else "")
            yield FreeValue(
                name=label, kind="state", target=name, data=number, unit=variable.unit, start=start, low=low,
                high=high, size=size,
            )  # fmt: skip


def _standing(model: Model, variable: Variable) -> float:
    if model.at is not None and variable.name in model.at.x:
        return model.at.x[variable.name]
    given = model.start_values.get(variable.name, variable.start)
    return float(given) if isinstance(given, int | float) else 0.0


def _first(column: Floats) -> float:
    return float(column[np.isfinite(column)][0])


def _spread(data: Sequence[Experiment], name: str) -> float:
    columns = [one.y[:, one.output_names.index(name)] for one in data if name in one.output_names]
    return float(np.nanstd(np.concatenate(columns))) or 1.0
