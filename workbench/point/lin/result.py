"""What a linearisation found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.large import is_large, poles_about
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import resolvent
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import pole_keys
from workbench.show.result import Result

__all__ = ["DelayFreePart", "Doubt", "Intersample", "LinResult", "Zero"]

# Between samples: an interval's begin and end, by the names of the linear model around it.
_OUTPUTS_OF_STATES = entry(dims=("intervals", 2, "output_names", "state_names"))
_OUTPUTS_OF_INPUTS = entry(dims=("intervals", 2, "output_names", "input_names"))


@dataclass(frozen=True)
class Doubt(RecordPart):
    """An entry that should not be trusted blindly.

    Attributes:
        row: derivative or output, by its state's or its own name.
        column: state or input.
        value: what stands in the matrix.
        other: what the check found; None where it found no number.
        reason: in one line.
        about: "value": how large it is; "effect": whether there is any; "kink": it is that of one side, as it should.
    """

    row: str
    column: str
    value: float
    other: float | None
    reason: str
    about: str = "value"


@dataclass(frozen=True)
class Zero(RecordPart):
    """A row or column that is zero, and why.

    Attributes:
        kind: "input", "output", "state" (its column) or "rate" (its row).
        name: variable.
        reason: in one line.
    """

    kind: str
    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Intersample(RecordPart):
    """Outputs within one period of a discrete model, and what inputs do within it.

    Attributes:
        tau: shape (k + 1,), times since the sample [s]; the last is the period.
        C: shape (k, 2, q, n), output at the beginning (right limit) and end (left limit) of each interval.
        D: shape (k, 2, q, m), likewise, the input held.
        sampled: the input acts at sample instants only, so that a continuous input gives the same.
        nodes: shape (p,), times since the sample [s]: those at which it acts, or between which a continuous input is
            a straight line; empty: it acts at the sample only, or that is not known.
        B_nodes: shape (p, n, m), state one period later by the input's value at each node.
        D_nodes: shape (p, k, 2, q, m), outputs likewise.
        smooth: nothing samples between every second one of `tau`, which lie at equal distances, as do `nodes` of a
            continuous input: what is straight there between neighbours is wrong by a fourth of what it is wrong by
            between every second.
    """

    tau: Floats
    C: Floats = field(metadata=_OUTPUTS_OF_STATES)
    D: Floats = field(metadata=_OUTPUTS_OF_INPUTS)
    sampled: bool
    nodes: Floats = field(default_factory=lambda: np.zeros(0))
    B_nodes: Floats = field(
        default_factory=lambda: np.zeros((0, 0, 0)), metadata=entry(dims=("nodes", "state_names", "input_names"))
    )
    D_nodes: Floats = field(
        default_factory=lambda: np.zeros((0, 0, 2, 0, 0)),
        metadata=entry(dims=("nodes", "intervals", 2, "output_names", "input_names")),
    )
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class DelayFreePart(RecordPart):
    """A linear model without its transport delays: their outputs are its last inputs, their inputs its last outputs.

    Attributes:
        A: shape (n, n).
        B: shape (n, m + k).
        C: shape (q + k, n).
        D: shape (q + k, m + k).
        times: of the k delays [s].
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    times: Floats

    def response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the frequency response with the delays in place, shape (k, q, m).

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        result, k = Linear(self.A, self.B, self.C, self.D).response(f), len(self.times)
        turned = np.exp(-2j * np.pi * np.where(np.isinf(f), 0.0, f)[:, None] * self.times)[:, :, None]
        inside = np.eye(k) - turned * result[:, -k:, -k:]
        closed = result[:, :-k, :-k] + result[:, :-k, -k:] @ np.linalg.solve(inside, turned * result[:, -k:, :-k])
        return np.asarray(closed, dtype=np.complex128)

    def negated(self) -> DelayFreePart:
        """Return the model with its inputs turned over, those from the delays as they are."""
        return self.scaled(-1.0)

    def scaled(self, factor: float) -> DelayFreePart:
        """Return the model with a factor on its inputs, those from the delays as they are.

        Args:
            factor: the same for all.
        """
        turned = np.ones(self.D.shape[1])
        turned[: -len(self.times)] = factor
        return replace(self, B=self.B * turned, D=self.D * turned)


@dataclass(frozen=True, eq=False, kw_only=True)
class LinResult(Linear, Result):
    """A linear model and how it was made; of a discrete one the input is held from sample to sample.

    Attributes:
        model, interface: what was linearised.
        method: name in `workbench.point.lin.linearise.METHODS`.
        why: why this method.
        operating_point: where the model was linearised.
        zeros: rows and columns that are zero, each with its reason.
        doubts: entries that are not certain, each with its reason.
        notes: what else should be known, one line each.
        calls: how often the model was evaluated, by kind.
        intersample: outputs between the samples, where they are known.
        refused: inputs that are left out → why.
        holds_to_hz: up to there the samples of a discrete model, joined by straight lines, show the response to a sine
            within 5 % [Hz]; None: not known, or of no meaning.
        about_hz: of a large sparse model only the poles nearest to this frequency are shown [Hz].
        delayed: the model with its transport delays taken out, whose frequency response is exact; A, B, C and D have
            Padé approximations. None: there are none.
        delay_poles: with transport delays, the rightmost poles with the delays as they are, shape (k,) [1/s]; `poles`
            are those of the Padé approximations.
        delay_poles_complete_to: real part right of which `delay_poles` are proved to be all [1/s]; None: nothing is
            proved, or there are no delays.
    """

    _page = "workbench.point.lin.page:lin_page"
    _picture = "workbench.point.lin.picture:plot_lin"

    model: str
    interface: str
    method: str
    why: str
    dt: float
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    operating_point: OperatingPoint
    zeros: tuple[Zero, ...] = field(default=(), metadata=entry(key="zero_rows_and_columns"))
    doubts: tuple[Doubt, ...] = field(default=(), metadata=entry(key="doubtful"))
    notes: tuple[str, ...] = ()
    calls: Mapping[str, int] = field(default_factory=dict)
    intersample: Intersample | None = None
    refused: Mapping[str, str] = field(default_factory=dict)
    holds_to_hz: float | None = None
    about_hz: float = 0.0
    delayed: DelayFreePart | None = None
    delay_poles: Complex = field(default_factory=lambda: np.zeros(0, dtype=np.complex128))
    delay_poles_complete_to: float | None = None

    _WHAT, _COMMAND = "a linear model", "lin"

    def response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the frequency response, shape (k, q, m); that of transport delays is exact.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        return super().response(frequency_hz) if self.delayed is None else self.delayed.response(frequency_hz)

    def negated(self) -> LinResult:
        """Return the model with its inputs turned over."""
        delayed = None if self.delayed is None else self.delayed.negated()
        return replace(self, B=-self.B, D=-self.D, delayed=delayed)

    @property
    def without_effect(self) -> tuple[tuple[str, str], ...]:
        """Inputs and outputs between which nothing acts, as far as that is known."""
        unknown = {(d.column, d.row) for d in self.doubts if d.about == "effect"}
        return tuple(pair for pair in super().without_effect if pair not in unknown)

    @property
    def states(self) -> dict[str, int]:
        """State of the model → its row in A; those of Padé approximations are left out."""
        return {n: i for i, n in enumerate(self.state_names) if n in self.operating_point.x}

    @property
    def shows_all_poles(self) -> bool:
        """Whether `shown_poles` are all: not of a sparse model of more than 1,000 states, where that takes too long."""
        return not is_large(self.A, self.dt)

    @cached_property
    def shown_poles(self) -> Complex:
        """All poles, or those of a large model nearest to `about_hz`, shape (k,) [1/s]; `poles` are always all."""
        if self.shows_all_poles or self.about_hz == 0.0:
            return self.slowest_poles
        return poles_about(self.A, self.about_hz)

    def fundamental(self, frequency_hz: Floats) -> Complex:
        """Return what a frequency response measured with sines would show, shape (k, q, m).

        For a continuous model this is `response`. For a discrete one the output between the samples is taken into
        account, and what a sine that is not held does within the period: known by `nodes`, else estimated by taking
        the hold out. Where it is known that the motion is smooth, straight lines over every second node tell how
        wrong those over every one are (Richardson's extrapolation): what is left falls with the fourth power of their
        distance.

        Args:
            frequency_hz: shape (k,) [Hz].
        """
        if self.dt == 0.0 or self.intersample is None:
            return self.response(frequency_hz)
        return np.array([self._fundamental(f) for f in np.asarray(frequency_hz)], dtype=np.complex128)

    def _fundamental(self, frequency: float) -> Complex:
        between, s = self.intersample, 2j * np.pi * frequency
        if between is None:
            return np.asarray(self.response(np.array([frequency]))[0])
        B, D, held = self._acting(between, s)
        m = len(self.input_names)
        state = resolvent(self.A, np.hstack(B), self.at_frequency(frequency))[0]
        y = [between.C @ state[:, i * m : (i + 1) * m] + through for i, through in enumerate(D)]
        if between.smooth:
            middle = 0.5 * (y[-1][::2, 0] + y[-1][1::2, 1])
            y = [y[0], y[-1].copy()]
            y[1][::2, 1], y[1][1::2, 0] = middle, middle
        first, last = _weights(between.tau, s)
        total = [np.einsum("k,kqm->qm", first, v[:, 0]) + np.einsum("k,kqm->qm", last, v[:, 1]) for v in y]
        best = total[0] + (total[0] - total[-1]) / 3.0
        return np.asarray(best / self.dt / held, dtype=np.complex128)

    def _acting(self, between: Intersample, s: complex) -> tuple[list[Complex], list[Complex], complex]:
        """Return B and D of a sine as it acts, and what is to be divided by.

        Of a continuous sine along smooth nodes there are two of each: straight over each node, and over every second.
        """
        if not len(between.nodes):
            held = 1.0 if between.sampled else complex((1.0 - np.exp(-s * self.dt)) / (s * self.dt))
            return [self.B.astype(np.complex128)], [between.D.astype(np.complex128)], held
        shapes = [np.exp(s * between.nodes)]
        if between.smooth and not between.sampled:
            wide = shapes[0].copy()
            wide[1::2] = 0.5 * (wide[:-2:2] + wide[2::2])
            shapes.append(wide)
        B, D = ([np.tensordot(shape, t, 1) for shape in shapes] for t in (between.B_nodes, between.D_nodes))
        return B, D, 1.0

    @property
    def complete(self) -> bool:
        """Whether no input was left out."""
        return not self.refused

    def because(self, why: str) -> LinResult:
        """Return the same result with the reason for its method.

        Args:
            why: in one line.
        """
        return replace(self, why=why)

    def derived(self) -> dict[str, Any]:
        """Return the poles, and the point by the names it has beside matrices.

        Keys:
            poles: pairs.
            all_poles: whether `poles` are all: of a sparse model of more than 1,000 states they are
                those nearest to this frequency [Hz].
            natural_frequency_hz, damping, damped_frequency_hz: of each pole; `null`: a delay, or no
                damping ratio at 0.
            x0, u0, y0, discrete0, dx0, time: the point.
        """
        point = self.operating_point
        at = {"x0": point.x, "u0": point.u, "y0": point.y, "discrete0": point.discrete, "dx0": point.dx}
        poles = {"poles": self.shown_poles, "all_poles": self.shows_all_poles}
        return {**poles, **pole_keys(self.shown_poles, self.dt), **at, "time": point.time}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the point from files of earlier versions, too."""
        if "A" not in data:
            raise KeyError("A")
        return {**data, "operating_point": OperatingPoint.from_dict(data)}

    def rows(self) -> Iterator[list[Any]]:
        """Yield one row for each entry of a matrix: matrix, row, column, value."""
        yield ["matrix", "row", "column", "value"]
        yield from self.entries()

    def entries(self) -> Iterator[list[Any]]:
        """Yield matrix, row, column and value of every entry."""
        sides = {"A": (self.state_names, self.state_names), "B": (self.state_names, self.input_names)}
        sides |= {"C": (self.output_names, self.state_names), "D": (self.output_names, self.input_names)}
        for matrix, (left, top) in sides.items():
            table = getattr(self, matrix)
            yield from ([matrix, a, b, table[i, j]] for i, a in enumerate(left) for j, b in enumerate(top))


def _weights(tau: Floats, s: complex) -> tuple[Complex, Complex]:
    """Return the weights of both ends of each interval in ∫ y e^(−sτ) dτ, y linear in between."""
    h = np.diff(tau)
    z = s * h
    e0, e1 = np.exp(-s * tau[:-1]), np.exp(-s * tau[1:])
    small = np.abs(z) < 1e-4
    safe = np.where(small, 1.0, z)
    last = np.where(small, e1 * h / 2.0, h * (e0 - e1 * (1.0 + safe)) / safe**2)
    both = np.where(small, (e0 + e1) * h / 2.0, h * (e0 - e1) / safe)
    return both - last, last
