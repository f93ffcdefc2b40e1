"""What is known of a model before its frequency response is measured: its linear model, and when it samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.calendar import PeriodsError
from workbench.core.values.eigenmodes import Eigenmodes
from workbench.core.values.linear import NO_RESPONSE, LinearPart
from workbench.core.values.matrices import held, resolvents
from workbench.errors import SimulationError, WorkbenchError
from workbench.model import Model
from workbench.model.sample_rates import sampled
from workbench.point.lin.linearise import plain
from workbench.point.lin.request import Lin
from workbench.point.lin.task import make_task
from workbench.response.periodic.monodromy import Factors
from workbench.session.point import ModelPoint

__all__ = [
    "DECAYED",
    "GONE",
    "GRID",
    "LinearSineResponse",
    "LinearStart",
    "Surroundings",
    "Twin",
    "quick",
    "surroundings",
]

# With more states the matrix exponentials of each point would cost more than its periods do; those by eigenvectors,
# found once a sweep, cost a few products of matrices.
_MANY_STATES, _MOST_STATES = 200, 1000

# What is left of a mode counts from here on; eigenvectors are worth some 1e-9.
GONE = 1e-30

# A run from the operating point is looked at so often, until so many time constants of the slowest mode have passed, or
# the most periods of a point.
GRID, DECAYED = 400, 5.0

# Events of the model that are looked for: one is enough to know that it is sampled.
_LOOK = 1


@dataclass(frozen=True, eq=False)
class LinearStart:
    """The linear model from the forced input to the output where runs start, ẋ = Ax + Bu + dx0, y = Cx + Du.

    Attributes:
        part: A, B, C, D; x and u are counted from the point.
        dx0: derivatives at the point itself, shape (n,); 0 at an equilibrium.
        smallest: sizes of the states below which errors of the integration do not shrink with them, shape (n,).
        quick: of a mode that decays faster than that nothing is left wherever one looks [1/s], see `quick`.
    """

    part: LinearPart
    dx0: Floats
    smallest: Floats
    quick: float = math.inf
    _forced: dict[float, LinearSineResponse] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def modes(self) -> Eigenmodes | None:
        """Poles and eigenvectors, as far as one sees them; None where poles coincide."""
        return Eigenmodes.of(self.part.A, self.quick, -math.log(GONE) * (GRID - 1) / DECAYED)

    @cached_property
    def rest(self) -> Floats:
        """Distance of the operating point from where the linear model rests, shape (n,)."""
        if not self.dx0.any():
            return np.zeros_like(self.dx0)
        result, *_ = np.linalg.lstsq(self.part.A, self.dx0, rcond=None)
        return np.asarray(result, dtype=np.float64)

    @property
    def at_rest(self) -> LinearStart:
        """The same about an equilibrium: what the input does, whatever the model does by itself."""
        return LinearStart(self.part, np.zeros_like(self.dx0), self.smallest, self.quick)

    def transition(self, period: float) -> tuple[Floats, Floats, Factors | None, Complex | None]:
        """Return e^(AT), what C makes of its integral over T [s], its factors and eigenvalues; None: not known."""
        if self.modes is None:
            phi, integral = held(self.part.A, np.eye(len(self.dx0)), period)
            return phi, self.part.c @ integral, None, None
        poles, vectors, inverse = self.modes.poles, self.modes.vectors, self.modes.inverse
        multipliers = np.exp((poles if poles.imag.any() else poles.real) * period)
        left = np.abs(multipliers) > GONE
        factors = vectors[:, left] * multipliers[left], inverse[left]
        with one_thread():
            phi, row = (factors[0] @ factors[1]).real, self.modes.held(self.part.c, period)
        return phi, row, None if left.all() and len(left) == len(phi) else factors, multipliers.astype(np.complex128)

    def forced(self, frequency: float) -> LinearSineResponse | None:
        """Return the linear model under a sine of 1; None where it has a pole at that very frequency.

        It is found once for the sweep's amplitudes, and for both the tolerance and the error of a point.

        Args:
            frequency: [Hz].
        """
        if frequency not in self._forced:
            try:
                with np.errstate(all="ignore"), one_thread():
                    result = LinearSineResponse.of(self, frequency)
            except (np.linalg.LinAlgError, ValueError, OverflowError):
                return None
            if not (np.isfinite(result.response) and np.isfinite(result.terms)):
                return None
            self._forced[frequency] = result
        return self._forced[frequency]

    def twin(self, frequency: float, amplitude: float, start: Floats | None = None) -> Twin | None:
        """Return the linear model forced as a point is; None where it has a pole at that very frequency.

        Args:
            frequency: [Hz].
            amplitude: [unit of the input].
            start: states where the sine begins, from the operating point, shape (n,); None: 0.
        """
        forced = self.forced(frequency)
        if forced is None:
            return None
        at, steady = np.zeros(len(self.dx0)) if start is None else start, amplitude * forced.states.imag
        rows, rest = forced.rows / amplitude, forced.rest
        return Twin(forced, _rows=rows, _x=at + rest - steady, _steady=steady - rest)


@dataclass(frozen=True, eq=False)
class LinearSineResponse:
    """The linear model under sin ωt.

    Attributes:
        response: output over input, complex.
        sensitivity: by how much the response changes, relative to itself, when all multipliers change by a
            small factor 1 + ε, divided by ε: |C(jωI − A)⁻²B| / (T·|G|); about 1/|1 − μ| near a resonance.
        vanishes: whether the response is zero, but for rounding.
        terms: what the response is the sum of, Σ|C(i)|·|X(i)| + |D|: much larger than it where they cancel.
        states: complex amplitudes X of the states, shape (n,).
        phi: e^(AT), shape (n, n).
        factors: see `VariationalEquation`.
        multipliers: eigenvalues of e^(AT) that are not zero but for rounding, and perhaps others; None: not known.
        rows: mean, in-phase and quadrature part that free states put into a period, shape (3, n).
        rest: distance of the operating point from where the linear model rests, shape (n,).
        smallest: what defects of the size of `LinearStart.smallest` in each period do to the output's fundamental.
    """

    response: complex
    sensitivity: float
    vanishes: bool
    terms: float
    states: Complex
    phi: Floats
    factors: Factors | None
    multipliers: Complex | None
    rows: Floats
    rest: Floats
    smallest: float

    @cached_property
    def memory(self) -> float:
        """For what part of a period the model remembers where it was, at most 1."""
        known = self.multipliers
        largest = float(np.linalg.norm(self.phi) if known is None else np.max(np.abs(known), initial=0.0))
        return 1.0 / max(1.0, -math.log(largest)) if largest > 0.0 else 0.0

    @classmethod
    def of(cls, start: LinearStart, frequency: float) -> LinearSineResponse:
        """Return that of a frequency [Hz]."""
        part, period = start.part, 1.0 / frequency
        n, at = len(part.A), part.at_frequency(frequency)
        if n == 0:
            none, flat = np.zeros(0), (np.zeros((0, 0)), None, None, np.zeros((3, 0)))
            return cls(complex(part.d), 0.0, part.d == 0.0, abs(part.d), none.astype(np.complex128), *flat, none, 0.0)
        states, outputs = resolvents(part.A, part.B, part.C, at)
        forced, reach = states[0, :, 0], outputs[0, :, 0]
        response = complex(part.c @ forced) + part.d
        phi, integral, factors, multipliers = start.transition(period)
        # 2/T ∫ C e^(At) e^(−jωt) dt; in-phase + j·quadrature is j times that.
        first = -2j / period * (reach.real @ phi + 1j * (reach.imag @ phi) - reach)
        rows = np.array([integral / period, first.real, first.imag])
        sensitivity = abs(complex(reach @ forced)) / (period * abs(response)) if response else math.inf
        terms = float(np.abs(part.c) @ np.abs(forced)) + abs(part.d)
        smallest = 2.0 / period * float(np.abs(reach) @ start.smallest)
        vanishes = abs(response) <= NO_RESPONSE * float(part.rounding_with(at, states, outputs)[0, 0, 0])
        return cls(
            response, sensitivity, vanishes, terms, forced, phi, factors, multipliers, rows, start.rest, smallest
        )


@dataclass(eq=False)
class Twin:
    """The linear model under the sine of one point, period by period.

    Its free response is x(k) = Φ^k·x(0) with Φ = e^(AT) and x(0) the distance from the periodic motion, and what
    it puts into the Fourier coefficients of period k is a fixed row times x(k).

    Attributes:
        forced: its response to the sine.
    """

    forced: LinearSineResponse
    _rows: Floats
    _x: Floats
    _steady: Floats
    _free: list[Floats] = field(default_factory=list)

    @property
    def periodic(self) -> Floats:
        """Where the periodic motion begins, from the operating point, shape (n,)."""
        return self._steady

    def free(self, count: int) -> Floats:
        """Return mean, in-phase and quadrature part of the transient over the input's amplitude, shape (count, 3)."""
        while len(self._free) < count:
            self._free.append(self._rows @ self._x)
            self._x = self.forced.phi @ self._x
        return np.array(self._free[:count]).reshape(count, 3)

    def end(self, count: int) -> Floats:
        """Return the states after `count` periods, from the operating point, shape (n,)."""
        self.free(count)
        return self._x + self._steady


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is known of a model where its runs start.

    Attributes:
        linear: the linear model from input to output; None: there is none.
        rates: sample periods [s], rising; none: it is continuous, or does not show any.
        notes: what is behind the rates, where that is not plain.
        own_step: of a co-simulation, for how long the output stands still between its own steps [s]; 0: it does not.
    """

    linear: LinearStart | None = None
    rates: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    own_step: float = 0.0


def quick(frequency: float, periods: int) -> float:
    """Return from which rate on nothing is left of a mode after a period, nor where a run is looked at first [1/s].

    Args:
        frequency: the highest of a sweep [Hz]; a resonance beside it is looked at up to twice that.
        periods: of the longest run.
    """
    return -math.log(GONE) * 2.0 * frequency * max(1.0, (GRID - 1) / periods)


def surroundings(model: Model, input: str, output: str, quick: float = math.inf) -> Surroundings:
    """Return what a model shows of itself where its runs start.

    There is no linear model for co-simulation (it shows no derivatives), for a sampled model (its multipliers are not
    those of its continuous states), for more than 1000 states, for more than 200 whose poles coincide, and where the
    model cannot be evaluated there.

    Args:
        model: it stays open.
        input: forced input.
        output: output, or a state.
        quick: see `LinearStart`.
    """
    if model.interface != "me":
        return _of_rates(model)
    try:
        with model.open_point() as point:
            ticks = len(point.ticks(_LOOK, np.inf)) > 0
            many = len(point.states) > _MOST_STATES
            result = None if ticks or many or point.why_not_exact() else _exact(point, input, output)
            dx0, smallest = point.at(point.x0, point.u0).dx, point.smallest
        if ticks or many:
            return _of_rates(model) if ticks else Surroundings()
        part = _difference(model, input, output) if result is None else result
    except PeriodsError:
        raise
    except WorkbenchError:
        return Surroundings()
    finite = all(np.isfinite(m).all() for m in (part.A, part.B, part.C, part.D, dx0))
    if not finite or len(dx0) != len(part.A):
        return Surroundings()
    linear = LinearStart(part, dx0, smallest, quick)
    return Surroundings(linear if len(dx0) <= _MANY_STATES or linear.modes is not None else None)


def _of_rates(model: Model) -> Surroundings:
    result = sampled(model)
    return Surroundings(rates=result.periods, notes=result.notes)


def _exact(point: ModelPoint, input: str, output: str) -> LinearPart | None:
    """Return the linear model from the FMU's directional derivatives; None where they fail, or miss input or output.

    They are not verified: the linear model counts only as far as it goes through the measured periods.
    """
    states, inputs, outputs = ([v.name for v in kind] for kind in (point.states, point.inputs, point.outputs))
    n = len(states)
    if input not in inputs or output not in (*states, *outputs):
        return None
    try:
        whole = point.jacobian()
    except SimulationError:
        return None
    column = n + inputs.index(input)
    state = np.eye(1, whole.shape[1], states.index(output) if output in states else 0)[0]
    row = whole[n + outputs.index(output)] if output in outputs else state
    return LinearPart(whole[:n, :n], whole[:n, column], row[:n], row[column])


def _difference(model: Model, input: str, output: str) -> LinearPart:
    """Return the linear model by differences."""
    return plain(make_task(model, Lin(inputs=[input], outputs=[output])), "difference").part()
