"""What a check gets to see: one interface of one FMU, and how it is excited."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model.described_model import DescribedModel
from workbench.model.operating_point import bias_of
from workbench.session.base import Recorded, Session
from workbench.session.fmu import FmuSession
from workbench.signals.kinds import Constant, Signal, Sine

__all__ = ["CheckedFmu", "Trajectory", "same_bits"]

_SHARE = 0.05  # of an input's size: far enough to move the model, near enough to stay where it was made for
_STEPS = 500  # of a test run at most
_POINTS = 50  # of a test run at which values are compared
_SPAN = 1.0  # [s] of a test run where the FMU names neither stop time nor step
_MOST_NAMES = 400
_PERIODS = 3.0  # of a sine in a test run


@dataclass(frozen=True)
class Trajectory:
    """What a test run gave.

    Attributes:
        time: shape (n,) [s].
        values: shape (n, k), one column for each observed variable.
    """

    time: Floats
    values: Floats

    @property
    def scale(self) -> Floats:
        """Range of each column; where it does not move 0. Shape (k,)."""
        if not self.values.size:
            return np.zeros(self.values.shape[1])
        ranges = np.ptp(self.values, axis=0)
        # What is below rounding of the values themselves is not movement.
        result: Floats = np.where(ranges > 1e-12 * np.abs(self.values).max(axis=0), ranges, 0.0)
        return result


def same_bits(a: Trajectory, b: Trajectory) -> bool:
    """Whether two runs agree to the last bit."""
    return a.time.tobytes() == b.time.tobytes() and a.values.tobytes() == b.values.tobytes()


@dataclass(frozen=True)
class CheckedFmu:
    """One interface of one FMU.

    Test runs begin at the start time of the FMU's default experiment and take its stop time, at most 500
    communication steps. The step is what the user or the default experiment names, else 1/500 of the run; where no stop
    time is named either, the run takes 1 s.

    Attributes:
        model: opened with the interface.
        shorten: factor on the length of test runs, for FMUs that fail later on.
        refine: so many steps are made of a natural one, for FMUs that diverge with it.
        observed: variables that are compared; empty: all of `names`.
    """

    model: DescribedModel
    shorten: float = 1.0
    refine: int = 1
    observed: tuple[str, ...] = ()

    # -- time -----------------------------------------------------------------------------

    @cached_property
    def start(self) -> float:
        """When test runs begin [s]."""
        return self.model.start_time

    @property
    def own_step(self) -> float | None:
        """The communication step that the user or the FMU names [s]; None: nobody does."""
        return self.model.recipe.step or self.model.description.experiment.step

    @cached_property
    def _whole(self) -> float:
        stop = self.model.description.experiment.stop_time
        if stop is not None and stop > self.start:
            return stop - self.start
        return _SPAN if self.own_step is None else _STEPS * self.own_step

    @property
    def step(self) -> float:
        """The communication step of test runs [s]: the natural one, unless that is refined."""
        return (self.own_step or self._whole / _STEPS) / self.refine

    @cached_property
    def steps(self) -> int:
        """Communication steps of a test run."""
        whole = min(_STEPS, round(self._whole / self.step))
        return max(4, round(self.shorten * whole))

    @property
    def experiment(self) -> float:
        """Length of the default experiment, or of what stands for it [s]; test runs may be shorter."""
        return self._whole

    @property
    def span(self) -> float:
        """Length of a test run [s]."""
        return self.steps * self.step

    def points(self, start: float | None = None, step: float | None = None) -> Floats:
        """Return where a test run is observed: whole steps after the start, shape (n,) [s]."""
        begin, h = self.start if start is None else start, step or self.step
        stride = max(1, self.steps // _POINTS)
        return begin + h * np.arange(stride, self.steps + 1, stride, dtype=np.float64)

    # -- variables ------------------------------------------------------------------------

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The observed variables: outputs and, where the file names them, states."""
        if self.observed:
            return self.observed
        known = {v.name for v in self.model.description.variables}
        result = [v.name for v in self.model.outputs if v.is_number]
        result += [v.name for v in self.model.states if v.name in known]
        if not result:
            result = [
                v.name
                for v in self.model.description.variables
                if v.causality == "local" and v.type in FLOAT_TYPES and not v.alias_of
            ]
        return tuple(dict.fromkeys(result))[:_MOST_NAMES]

    @cached_property
    def inputs(self) -> dict[str, tuple[float, float]]:
        """Continuous inputs → (middle, amplitude) of what excites them."""
        return {v.name: _room(v, self._start_of(v)) for v in self.model.inputs if v.is_continuous_input}

    def _start_of(self, variable: Variable) -> float:
        recipe = self.model.recipe
        given = self.model.start_values.get(variable.name, variable.start)
        return float(given or 0.0) + float(recipe.bias.get(variable.name, 0.0))

    def constants(self, share: float = 1.0) -> dict[str, Constant]:
        """Return inputs that jump once, by `share` of the amplitude, and stay there."""
        return {n: Constant(middle + share * a - bias_of(self.model, n)) for n, (middle, a) in self.inputs.items()}

    def sines(self, share: float = 1.0) -> dict[str, Sine]:
        """Return inputs that swing, each with a frequency of its own, three periods or more in a test run.

        Args:
            share: of the amplitude; beyond 1 as far as the inputs' limits allow.
        """
        return {
            n: Sine(
                amplitude=math.copysign(min(abs(share) * a, max(a, self._limits[n])), share),
                frequency=(_PERIODS + 0.37 * i) / self.span,
                offset=middle - bias_of(self.model, n),
                start=self.start,
            )
            for i, (n, (middle, a)) in enumerate(self.inputs.items())
        }

    @cached_property
    def _limits(self) -> dict[str, float]:
        """How far each input may go from its middle."""
        room = {}
        for v in self.model.inputs:
            if v.name in self.inputs:
                middle = self.inputs[v.name][0]
                low = -math.inf if v.minimum is None else v.minimum
                high = math.inf if v.maximum is None else v.maximum
                room[v.name] = min(middle - low, high - middle)
        return room

    # -- runs -----------------------------------------------------------------------------

    def open(self, *, start: float | None = None, step: float | None = None) -> FmuSession:
        """Return a session at the start of a test run, with the natural step unless told otherwise."""
        begin = self.start if start is None else start
        return self.model.open_session(start_time=begin, step=(step or self.step) if self.is_cs else None)

    @property
    def is_cs(self) -> bool:
        """Whether the FMU integrates itself."""
        return self.model.interface == "cs"

    def run(
        self, signals: Mapping[str, Signal], *, start: float | None = None, step: float | None = None,
        points: Floats | None = None,
    ) -> Trajectory:  # fmt: skip
        """Return a test run in a session of its own.

        Args:
            signals: forced inputs.
            start: [s] in place of the default.
            step: communication step [s] in place of the natural one; the points stay.
            points: in place of `points()` [s].

        Raises:
            FmuError, SimulationError: it cannot be run.
        """
        with self.open(start=start, step=step) as session:
            return self.observe(session, signals, self.points(start) if points is None else points)

    def observe(self, session: Session, signals: Mapping[str, Signal], points: Floats) -> Trajectory:
        """Advance a session over `points`; return the right limits there."""
        record = session.advance(float(points[-1]), signals=signals, record=self.names, points=points)
        return _at(record, self.names, points)

    def shortened(self, factor: float) -> CheckedFmu:
        """Return the same with shorter test runs."""
        return replace(self, shorten=self.shorten * factor)


def _at(record: Recorded, names: tuple[str, ...], points: Floats) -> Trajectory:
    """Return the last rows at the points; what is not finite is an error, whoever computed it."""
    rows = np.searchsorted(record.time, points, side="right") - 1
    values = np.column_stack([record.values[n][rows] for n in names]) if names else np.empty((len(points), 0))
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        raise SimulationError(f"{names[column]} is not a finite number", time=float(points[row]))
    return Trajectory(points, values)


def _room(variable: Variable, start: float) -> tuple[float, float]:
    """Return middle and amplitude of what excites an input: a twentieth of its size, within its limits."""
    size = max(abs(start), variable.nominal or 0.0) or 1.0
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    if low > high:
        raise FmuError(f"{variable.name}: its minimum {low:g} is larger than its maximum {high:g}")
    amplitude = min(_SHARE * size, 0.25 * (high - low))
    return min(max(start, low + amplitude), high - amplitude), amplitude
