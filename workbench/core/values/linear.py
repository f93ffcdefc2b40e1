"""Linear models: matrices, names, where they hold, and what follows from them: one place for all analyses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.core.machine.blas import one_thread
from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.large import corners_hz, is_large, poles_about
from workbench.core.values.matrices import balance, held, is_sparse, light, product, resolvent, resolvents
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import continuous, growth_rates, vanished
from workbench.core.values.response import Response
from workbench.errors import InputError, SimulationError, suggest

if TYPE_CHECKING:
    from typing import Self

    import control

__all__ = ["NO_INPUT", "NO_RESPONSE", "Linear", "LinearPart"]

NO_INPUT = "no_input"  # of models without inputs, in python-control
_EPS = float(np.finfo(np.float64).eps)
NO_RESPONSE = 100.0  # what is below so many times its rounding bound is no response
_LOOKED_AT = 50  # frequencies that show whether an input has an effect
_SINGULAR = 1e-12  # 1 − gain·D below this: the loop has no solution
_ON_AXIS = 1e-7  # poles so near the imaginary axis, relative to their size (or to 1 rad/s), count as on it
_INFINITE = 1e12  # generalised eigenvalues beyond the largest pole times this are none


@dataclass(frozen=True, eq=False)
class Linear(RecordPart):
    """A linear model: dx/dt = A x + B u, y = C x + D u, or x(k+1) = A x(k) + B u(k) likewise.

    Vectors and numbers given for B, C and D become matrices of one column or row.

    Attributes:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (q, n).
        D: shape (q, m).
        dt: period [s]; 0: continuous.
        state_names, input_names, output_names: names of rows and columns; empty: not known.
        units: any of these names → unit, None where the model names none.
        operating_point: where the model was linearised, of which x, u and y are deviations; None: not known.

    Raises:
        InputError: matrices or names do not fit each other.
    """

    A: Floats = field(metadata=entry(dims=("state_names", "state_names")))
    B: Floats = field(metadata=entry(dims=("state_names", "input_names")))
    C: Floats = field(metadata=entry(dims=("output_names", "state_names")))
    D: Floats = field(metadata=entry(dims=("output_names", "input_names")))
    _: KW_ONLY
    dt: float = 0.0
    state_names: tuple[str, ...] = ()
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    units: Mapping[str, str | None] = field(default_factory=dict)
    operating_point: OperatingPoint | None = None

    def __post_init__(self) -> None:
        """Bring the matrices into shape, and compare names with them."""
        direct, n = np.asarray(self.D, dtype=np.float64), len(self.A)
        q, m = direct.shape if direct.ndim == 2 else (len(self.output_names) or 1, len(self.input_names) or 1)
        sizes = {"A": (n, n), "B": (n, m), "C": (q, n), "D": (q, m)}
        for name, shape in sizes.items():
            object.__setattr__(self, name, _shaped(getattr(self, name), shape, name))
        for kind, size in (("state", n), ("input", m), ("output", q)):
            names = getattr(self, f"{kind}_names")
            if names and len(names) != size:
                raise InputError(
                    f"{kind}_names: {len(names)} given ({', '.join(names)}), but the matrices have {size} {kind}"
                    f"{'' if size == 1 else 's'}"
                )

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: of a large sparse A its entries only."""
        state = dict(vars(self))
        if is_sparse(self.A):
            rows, columns = np.nonzero(self.A)
            state["A"] = (len(self.A), rows.astype(np.int32), columns.astype(np.int32), self.A[rows, columns])
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        if isinstance(state["A"], tuple):
            n, rows, columns, values = state["A"]
            full = np.zeros((n, n))
            full[rows, columns] = values
            state = {**state, "A": full}
        vars(self).update(state)

    @classmethod
    def from_state_space(cls, system: Any) -> Linear:  # noqa: ANN401 - python-control has no types
        """Return a linear model of python-control.

        Args:
            system: a `control.StateSpace`, or what has its attributes; a `control.TransferFunction` is realised first.

        Raises:
            InputError: it is discrete, and has no period; it is another kind of system, or cannot be realised.
        """
        if not hasattr(system, "A"):
            system = _realised(system)
        if system.dt is True:
            raise InputError("the StateSpace is discrete without a sample period: give it dt [s]")
        labels = (tuple(map(str, getattr(system, f"{kind}_labels", ()))) for kind in ("state", "input", "output"))
        states, inputs, outputs = labels
        return Linear(
            system.A, system.B, system.C, system.D, dt=float(system.dt or 0.0), state_names=states,
            input_names=inputs, output_names=outputs,
        )  # fmt: skip

    @cached_property
    def poles(self) -> Complex:
        """Eigenvalues of A, shape (n,) [1/s], discrete ones without unit.

        Raises:
            InputError: A holds values that are not finite.
        """
        if not np.isfinite(self.A).all():
            raise InputError("matrix A must hold finite numbers")
        with one_thread():  # others wait for each other on a machine that has other work
            return np.linalg.eigvals(self.A).astype(np.complex128)

    @cached_property
    def slowest_poles(self) -> Complex:
        """All poles; of a large sparse model those nearest to 0 only, which `large.py` finds, shape (k,)."""
        return poles_about(self.A, 0.0) if is_large(self.A, self.dt) else self.poles

    @cached_property
    def invariant_zeros(self) -> Complex:
        """Finite zeros, shape (k,) [1/s], of a discrete model without unit; mostly none with more outputs than inputs.

        They come from the system matrix, not from polynomials, whose coefficients lose all digits at higher orders.

        Source: A. Emami-Naeini and P. Van Dooren, Computation of zeros of linear multivariable systems, Automatica 18
        (1982); SLICOT routine AB08ND.

        Raises:
            SimulationError: they could not be computed.
        """
        n, (q, m) = len(self.A), self.D.shape
        if not n or not q or not m:
            return np.zeros(0, dtype=np.complex128)
        import slycot  # noqa: PLC0415  slow to import
        from scipy.linalg import eig  # noqa: PLC0415  slow to import

        even, _ = self.of_unit_size()
        try:
            result = slycot.ab08nd(n, m, q, even.A, even.B, even.C, even.D)
        except slycot.exceptions.SlycotError as error:
            raise SimulationError(f"zeros cannot be computed: {error}") from None
        count, pencil, mass = result[0], result[8], result[9]
        if not count:
            return np.zeros(0, dtype=np.complex128)
        return np.asarray(eig(pencil[:count, :count], mass[:count, :count], right=False), dtype=np.complex128)

    @property
    def continuous_poles(self) -> Complex:
        """Poles [1/s]; of a discrete model those that its samples show, without the ones at 0."""
        return continuous(self.poles[~vanished(self.poles, self.dt)], self.dt)

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie left of the imaginary axis, of a discrete model inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0 if self.dt > 0.0 else self.poles.real < 0.0))

    @property
    def highest_hz(self) -> float:
        """The Nyquist frequency; infinite for a continuous model [Hz]."""
        return 0.5 / self.dt if self.dt > 0.0 else math.inf

    def at_frequency(self, frequency_hz: ArrayLike) -> Complex:
        """Return s = j2πf or z = exp(j2πf·dt), shape (k,); at the Nyquist frequency exactly −1.

        Rounding there would look like a crossing of the real axis.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        s = np.asarray(2j * np.pi * f, dtype=np.complex128)
        return s if self.dt == 0.0 else np.where(f == self.highest_hz, -1.0, np.exp(s * self.dt))

    def states_at(self, frequency_hz: ArrayLike) -> Complex:
        """Return the response of the states, (sI − A)⁻¹ B, shape (k, n, m); NaN on a pole.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        return resolvent(self.A, self.B, self.at_frequency(frequency_hz))

    def response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the frequency response C (sI − A)⁻¹ B + D, shape (k, q, m); NaN on a pole, D at infinity.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        with np.errstate(all="ignore"):
            result = self.C @ resolvent(self.A, self.B, self.at_frequency(np.where(np.isinf(f), 0.0, f))) + self.D
        result[np.isinf(f)] = self.D
        return np.asarray(result, dtype=np.complex128)

    def rounding(self, frequency_hz: ArrayLike) -> Floats:
        """Return how large rounding alone may make the response, shape (k, q, m).

        The states X solve (sI − A) X = B but for a residual of ε(|s||X| + |A||X| + |B|), which reaches the outputs
        through C (sI − A)⁻¹; forming C X + D adds ε(|C||X| + |D|). Entry by entry, so that units do not matter.

        Args:
            frequency_hz: shape (k,), or one [Hz].

        Source: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 7.2.
        """
        s = self.at_frequency(frequency_hz)
        return self.rounding_with(s, *resolvents(self.A, self.B, self.C, s))

    def rounding_with(self, s: Complex, inputs_to_states: Complex, states_to_outputs: Complex) -> Floats:
        """Return `rounding` where what it needs is known.

        Args:
            s: points of the plane, shape (k,).
            inputs_to_states: (sI − A)⁻¹ B there, shape (k, n, m).
            states_to_outputs: (sI − Aᵀ)⁻¹ Cᵀ there, shape (k, n, q).
        """
        states, outputs = np.abs(inputs_to_states), np.abs(states_to_outputs).swapaxes(1, 2)
        residual = np.abs(s)[:, None, None] * states + product(abs(light(self.A)), states) + np.abs(self.B)
        return np.asarray(_EPS * (outputs @ residual + np.abs(self.C) @ states + np.abs(self.D)))

    def vanishes(self, frequency_hz: ArrayLike) -> NDArray[np.bool_]:
        """Return whether the response is zero, but for rounding, shape as that of `response`; False on a pole.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        value = self.response(frequency_hz)
        return np.asarray(np.abs(value) <= NO_RESPONSE * self.rounding(frequency_hz).reshape(value.shape))

    @property
    def without_effect(self) -> tuple[tuple[str, str], ...]:
        """Inputs and outputs between which the response vanishes at all frequencies around the poles.

        By name, u1, u2, … and y1, y2, … where they have none.
        """
        corners = corners_hz(self.slowest_poles, self.A, self.dt)
        low, high = (corners[0] / 10.0, corners[1] * 10.0) if corners else (0.1, 10.0)
        high = min(high, 0.99 * self.highest_hz)
        looked_at = np.geomspace(min(low, high / 100.0), high, _LOOKED_AT)
        nothing = self._all_vanish(looked_at[:: _LOOKED_AT // 2])  # a response at one of a few frequencies is one
        if nothing.any():
            nothing = self._all_vanish(looked_at)
        q, m = self.D.shape
        inputs = self.input_names or tuple(f"u{j + 1}" for j in range(m))
        outputs = self.output_names or tuple(f"y{i + 1}" for i in range(q))
        return tuple((inputs[j], outputs[i]) for i, j in zip(*np.nonzero(nothing), strict=True))

    def _all_vanish(self, frequency_hz: Floats) -> NDArray[np.bool_]:
        return np.asarray(self.vanishes(frequency_hz).reshape(len(frequency_hz), *self.D.shape).all(axis=0))

    def curve(self, input: int | str, output: int | str, frequencies: ArrayLike) -> Response:
        """Return the frequency response from one input to one output with its names and units.

        Where it is zero but for rounding it is 0.

        Args:
            input: name or number of the input.
            output: name or number of the output.
            frequencies: rising [Hz].

        Raises:
            InputError: no such input or output.

        Example:
        >>> import workbench as wb
        >>> plant = wb.Linear(
        ...     A=[[0.0, 1.0], [-4.0, -0.4]], B=[[0.0], [4.0]], C=[[1.0, 0.0]], D=[[0.0]],
        ...     input_names=("force",), output_names=("position",),
        ... )
        >>> curve = plant.curve("force", "position", [2.0 / 6.283185307])
        >>> curve.gain.round(3).tolist(), curve.phase_deg.round(3).tolist()
        ([5.0], [-90.0])
        """
        j, i = (_number_of(k, given, self) for k, given in (("input", input), ("output", output)))
        part, f = self.part(j, i), np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
        (source,), (target,) = part.input_names or ("",), part.output_names or ("",)
        return Response(
            f, np.where(part.vanishes(f), 0.0, part.response(f)), input=source, output=target,
            input_unit=self.units.get(source), output_unit=self.units.get(target),
        )  # fmt: skip

    def part(self, input: int = 0, output: int = 0, *, sign: float = 1.0) -> LinearPart:
        """Return what leads from one input to one output.

        Args:
            input: number of the input.
            output: number of the output.
            sign: factor of the input.
        """
        return LinearPart(
            self.A, sign * self.B[:, input], self.C[output], sign * self.D[output, input], dt=self.dt,
            state_names=self.state_names, input_names=self.input_names[input : input + 1],
            output_names=self.output_names[output : output + 1], units=self.units, operating_point=self.operating_point,
        )  # fmt: skip

    def with_feedback(self, gain: float, *, input: int = 0, output: int = 0) -> Linear:
        """Return the model with u = gain · y + what acts on u besides, for one input u and one output y.

        Args:
            gain: positive for positive feedback.
            input: number of u.
            output: number of y.

        Raises:
            InputError: 1 − gain·D is 0, so that the loop has no solution.
        """
        through = 1.0 - gain * float(self.D[output, input])
        if abs(through) < _SINGULAR:
            raise InputError(f"feedback gain {gain:g}: the direct path through the plant makes it infinite")
        k, c, row = gain / through, self.C[output], self.D[output]
        B, C, D = (self.B + k * np.outer(self.B[:, input], row), self.C + k * np.outer(self.D[:, input], c),
                   self.D + k * np.outer(self.D[:, input], row))  # fmt: skip
        # Without the differences of large numbers that a large direct path makes of these.
        B[:, input], C[output] = self.B[:, input] / through, c / through
        D[:, input], D[output] = self.D[:, input] / through, row / through
        A = self.A + k * np.outer(self.B[:, input], c)
        return self._with(A, B, C, D, self.dt)

    def sampled(self, dt: float) -> Linear:
        """Return the discrete model whose samples are those of this continuous one with its inputs held.

        Args:
            dt: period [s].
        """
        return self._with(*held(self.A, self.B, dt), self.C, self.D, dt)

    def _with(self, A: Floats, B: Floats, C: Floats, D: Floats, dt: float) -> Linear:
        return Linear(
            A, B, C, D, dt=dt, state_names=self.state_names, input_names=self.input_names,
            output_names=self.output_names, units=self.units, operating_point=self.operating_point,
        )  # fmt: skip

    def balanced(self) -> Self:
        """Return the model with its states in units that make rows and columns of A alike in size.

        The point, whose states are in the model's own units, is left out, and so are these units.
        """
        A, scale = balance(self.A)
        units = {n: self.units[n] for n in (*self.input_names, *self.output_names) if n in self.units}
        return replace(
            self, A=A, B=self.B / scale[:, None], C=self.C * scale, units=units, operating_point=None
        )  # fmt: skip

    def of_unit_size(self) -> tuple[Self, float]:
        """Return the balanced model with B and C of size 1, and the factor that this leaves out."""
        even = self.balanced()
        b, c = float(np.linalg.norm(even.B)) or 1.0, float(np.linalg.norm(even.C)) or 1.0
        return replace(even, B=even.B / b, C=even.C / c, D=even.D / (b * c)), b * c

    def to_state_space(self, *, name: str | None = None) -> control.StateSpace:
        """Return the model for python-control; dots in names, which it forbids, become underscores.

        Args:
            name: name of the state space.
        """
        import control as ct  # noqa: PLC0415  slow to import

        matrices, labels = self.for_control(name)
        return ct.StateSpace(*matrices, self.dt, **labels)

    def for_control(self, name: str | None) -> tuple[tuple[Floats, Floats, Floats, Floats], dict[str, Any]]:
        """Return A, B, C, D and the names as python-control's StateSpace takes them.

        It has no model without inputs: one is added, `NO_INPUT`, which does nothing.

        Args:
            name: name of the model.
        """
        B, D, inputs = self.B, self.D, self.input_names
        if not B.shape[1]:
            B, D, inputs = np.zeros((len(self.A), 1)), np.zeros((len(self.C), 1)), (NO_INPUT,)
        names = {"states": self.state_names, "inputs": inputs, "outputs": self.output_names}
        given: dict[str, Any] = {key: _undotted(value) for key, value in names.items() if value}
        return (self.A, B, self.C, D), {
            **given,
            "name": name and name.replace(".", "_"),
            "remove_useless_states": False,
        }


@dataclass(frozen=True, eq=False, init=False)
class LinearPart(Linear):
    """A linear model with one input and one output: the linear part of a loop, a transfer function.

    Its responses have no axes for inputs and outputs.
    """

    def __init__(
        self,
        A: Floats,
        B: Floats,
        C: Floats,
        D: Floats | float = 0.0,
        *,
        dt: float = 0.0,
        state_names: tuple[str, ...] = (),
        input_names: tuple[str, ...] = (),
        output_names: tuple[str, ...] = (),
        units: Mapping[str, str | None] | None = None,
        operating_point: OperatingPoint | None = None,
    ) -> None:
        direct = np.asarray(D, dtype=np.float64)
        if direct.size != 1:
            raise InputError(f"one input and one output are needed; D has {direct.size} entries")
        super().__init__(
            A, B, C, direct.reshape(1, 1), dt=dt, state_names=state_names, input_names=input_names,
            output_names=output_names, units=units or {}, operating_point=operating_point,
        )  # fmt: skip

    @classmethod
    def from_lin(cls, result: Linear, *, sign: float = 1.0) -> LinearPart:
        """Return the one input and the one output of a continuous linear model.

        Args:
            result: continuous, with one input and one output.
            sign: −1 where positive feedback closes the loop.

        Raises:
            InputError: discrete, or several inputs or outputs.
        """
        named = f"{model}: " if (model := getattr(result, "model", "")) else ""
        if result.dt > 0.0:
            raise InputError(f"{named}the linear part is sampled ({result.dt:g} s), but must be continuous")
        if result.D.shape != (1, 1):
            raise InputError(
                f"{named}{result.D.shape[1]} inputs and {result.D.shape[0]} outputs, but there must be one of each"
            )
        return result.part(sign=sign)

    @property
    def b(self) -> Floats:
        """The column of B, shape (n,)."""
        return np.asarray(self.B[:, 0])

    @property
    def c(self) -> Floats:
        """The row of C, shape (n,)."""
        return np.asarray(self.C[0])

    @property
    def d(self) -> float:
        """The direct part."""
        return float(self.D[0, 0])

    def states_at(self, frequency_hz: ArrayLike) -> Complex:
        """Return the response of the states, (sI − A)⁻¹ B, shape (k, n); NaN on a pole.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        return np.asarray(super().states_at(frequency_hz)[:, :, 0])

    def response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the frequency response, shape (k,); NaN on a pole, D at infinity.

        Args:
            frequency_hz: shape (k,), or one [Hz].
        """
        f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        with np.errstate(all="ignore"):
            result = self.states_at(np.where(np.isinf(f), 0.0, f)) @ self.c + self.d
        return np.asarray(np.where(np.isinf(f), self.d, result), dtype=np.complex128)

    def at(self, frequency_hz: float) -> complex:
        """Return the response at one frequency.

        Args:
            frequency_hz: [Hz]; infinite: the direct part.
        """
        return complex(self.response(frequency_hz)[0])

    def scaled(self, factor: float) -> Self:
        """Return the model times a factor, which its input takes.

        Args:
            factor: on B and D.
        """
        return replace(self, B=factor * self.B, D=factor * self.D)

    def negated(self) -> Self:
        """Return the model times −1."""
        return self.scaled(-1.0)

    def behind(self, first: LinearPart) -> LinearPart:
        """Return this model driven by the output of another; the states of the other come first.

        Args:
            first: the other.
        """
        n, m = len(first.A), len(self.A)
        A = np.block([[first.A, np.zeros((n, m))], [np.outer(self.b, first.c), self.A]])
        return LinearPart(
            A, np.concatenate([first.b, self.b * first.d]), np.concatenate([self.d * first.c, self.c]),
            self.d * first.d, dt=self.dt,
        )  # fmt: skip

    # -- closed by feedback ------------------------------------------------------------------------

    def solvable(self, gain: float) -> bool:
        """Whether y = C x + D u, u = gain·y has a solution.

        Args:
            gain: positive for positive feedback.
        """
        return abs(1.0 - gain * self.d) > _SINGULAR

    def closed(self, gain: float) -> Floats:
        """Return A + B g (1 − g D)⁻¹ C, the state matrix with u = g·y, shape (n, n).

        Args:
            gain: g; 1 − g·D must not be 0.
        """
        return np.asarray(self.A + gain / (1.0 - gain * self.d) * np.outer(self.b, self.c), dtype=np.float64)

    def poles_at(self, gain: float) -> Complex:
        """Return the poles with u = g·y, shape (n,) [1/s]; of a sampled system in z.

        Args:
            gain: g.
        """
        return np.linalg.eigvals(self.closed(gain)).astype(np.complex128)

    def growth(self, gain: float) -> float:
        """Return the growth rate of the slowest pole with u = g·y [1/s]; −inf without states.

        Args:
            gain: g.
        """
        return float(growth_rates(self.poles_at(gain), self.dt).max(initial=-np.inf))

    def complementary(self) -> LinearPart:
        """Return T = L/(1 + L) = 1 − S of this L.

        Raises:
            InputError: 1 + D is 0, so that the closed loop has no solution.
        """
        if not self.solvable(-1.0):
            raise InputError("the loop gain is -1 without any dynamics: the closed loop has no solution")
        return self.with_feedback(-1.0).part()

    def sensitivity(self) -> LinearPart:
        """Return S = 1/(1 + L) of this L, likewise."""
        closed = self.complementary()
        return replace(closed, C=-closed.C, D=np.array([[1.0 / (1.0 + self.d)]]))

    def closed_poles(self, gain: complex, frequency: float = 1.0) -> Complex:
        """Return the poles with u = −N y, a complex N realised as Re N + (Im N/ω) d/dt, which is N at ±jω.

        Args:
            gain: N.
            frequency: frequency at which a complex N is valid [Hz].
        """
        if gain.imag == 0.0 and self.solvable(-gain.real):
            return self.poles_at(-gain.real)
        from scipy.linalg import eig  # noqa: PLC0415  slow to import

        n, lead = len(self.A), gain.imag / (2.0 * math.pi * frequency)
        # Unknowns x, y, u: y = Cx + Du, lead·dy/dt = −u − Re(N) y.
        a, e = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
        a[:n, :n], a[:n, n + 1], e[:n, :n] = self.A, self.b, np.eye(n)
        a[n, :n], a[n, n], a[n, n + 1] = self.c, -1.0, self.d
        a[n + 1, n], a[n + 1, n + 1], e[n + 1, n] = -gain.real, -1.0, lead
        alpha, beta = eig(a, e, right=False, homogeneous_eigvals=True)
        bound = _INFINITE * max(1.0, float(np.abs(self.A).max(initial=0.0)))
        finite = np.abs(beta) * bound > np.abs(alpha)
        return np.asarray(alpha[finite] / beta[finite], dtype=np.complex128)

    def unstable(self, gain: complex, frequency: float = 1.0) -> int:
        """Return how many poles lie right of the imaginary axis with u = −N y.

        Those that rounding may have moved there from the axis do not count: several integrators in a chain, whose poles
        it moves by the root of its size.

        Args:
            gain: N.
            frequency: frequency at which a complex N is valid [Hz].
        """
        if gain.imag != 0.0 or not self.solvable(-gain.real):
            result = self.closed_poles(gain, frequency)
            return int(np.sum(result.real > _ON_AXIS * np.maximum(1.0, np.abs(result))))
        from workbench.core.values.modal import poles_of  # noqa: PLC0415  SciPy is slow to import

        poles = poles_of(self.closed(-gain.real))
        right = poles.value.real > np.maximum(poles.uncertain, _ON_AXIS * np.maximum(1.0, np.abs(poles.value)))
        return int(np.sum(np.where(poles.real, 1, 2)[right]))


def _undotted(names: tuple[str, ...]) -> list[str]:
    """Return names that python-control takes, still different from each other."""
    plain = [n.replace(".", "_") for n in names]
    return plain if len(set(plain)) == len(plain) else [n.replace(".", "__") for n in names]


def _shaped(value: ArrayLike, shape: tuple[int, int], name: str) -> Floats:
    result = np.asarray(value, dtype=np.float64)
    if result.shape != shape and (result.size != shape[0] * shape[1] or (result.ndim == 2 and result.size)):
        had = " × ".join(map(str, result.shape)) or "a single number"
        raise InputError(f"matrix {name} must be {shape[0]} × {shape[1]}, not {had}")
    return result.reshape(shape)


def _number_of(kind: str, given: int | str, model: Linear) -> int:
    names: tuple[str, ...] = getattr(model, f"{kind}_names")
    known = model.D.shape[kind == "input"]
    if isinstance(given, str):
        if given not in names:
            raise InputError(f"the linear model has no {kind} '{given}'; {suggest(given, names)}")
        return names.index(given)
    if not 0 <= given < known:
        raise InputError(f"the linear model has {known} {kind}s, numbered from 0, so {given} is out of range")
    return given


def _realised(system: Any) -> Any:  # noqa: ANN401 - python-control has no types
    import control  # noqa: PLC0415 - slow to import, and seldom needed

    if not isinstance(system, control.TransferFunction):
        kind = type(system).__name__
        raise InputError(f"{kind} is not a linear model: give a StateSpace or a TransferFunction of python-control")
    try:
        return control.ss(system)
    except (ValueError, TypeError, NotImplementedError) as error:
        raise InputError(f"the TransferFunction has no realisation in state space: {error}") from None
