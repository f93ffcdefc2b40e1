"""A linear model that was identified from recorded data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import unheld
from workbench.core.values.poles import pole_keys
from workbench.errors import InputError
from workbench.identification.identified.recursion import march, march_one

if TYPE_CHECKING:
    import control

__all__ = ["IdentifiedModel", "NoiseModel", "numden"]


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseModel(RecordPart):
    """A disturbance v with poles of its own: z(k + 1) = A z(k) + K e(k), v(k) = C z(k) + e(k).

    Attributes:
        A: shape (d, d).
        K: shape (d, p).
        C: shape (p, d).
    """

    A: Floats = field(metadata=entry(dims=("noise_state", "noise_state")))
    K: Floats = field(metadata=entry(dims=("noise_state", "output_names")))
    C: Floats = field(metadata=entry(dims=("output_names", "noise_state")))

    def __post_init__(self) -> None:
        """Give matrices without rows their shape back, which JSON does not keep."""
        d = len(self.A)
        shapes = {"A": (d, d), "K": (d, -1 if d else 0), "C": (len(self.C), d)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64).reshape(shape))

    @property
    def poles(self) -> Complex:
        """Eigenvalues of A, shape (d,)."""
        return np.linalg.eigvals(self.A).astype(np.complex128)


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedModel(Linear):
    """A discrete state-space model in innovation form.

    x(k + 1) = A x(k) + B (u(k) − u0) + K e(k), y(k) = y0 + C x(k) + D (u(k) − u0) + e(k), u held from sample to sample.

    Attributes:
        K: shape (n, p), gain of the one-step predictor; zero where the data hold no noise.
        x0: shape (n,), state at the first sample of the data it was identified from.
        u0, y0: shape (m,), (p,), operating point that was taken off the data [units of the channels].
        covariance: shape (p, p), of the innovations e.
        state_names: x1, x2, …: the states have no meaning of their own.
        input_units, output_units: None where not known.
        delay: samples per input, shape (m,); the last sum(delay) states are these delays, so that A, B, C, D are the
            whole model.
        name: name of the model or file the data come from.
        notes: what else should be known, one line each.
        noise: the disturbance, where it has poles of its own: C z(k) stands in y beside e, and K is zero; None: K says
            all.
        spread: shape (n² + n m + p n + p m, f), a factor S of the covariance S Sᵀ of the entries of A, B, C and D, by
            rows, of the model without its delays; None: not known.
    """

    K: Floats = field(metadata=entry(dims=("state_names", "output_names")))
    x0: Floats = field(metadata=entry(dims=("state_names",)))
    u0: Floats = field(metadata=entry(dims=("input_names",)))
    y0: Floats = field(metadata=entry(dims=("output_names",)))
    covariance: Floats = field(metadata=entry(dims=("output_names", "output_names")))
    input_units: tuple[str | None, ...]
    output_units: tuple[str | None, ...]
    delay: tuple[int, ...] = ()
    name: str = "identified"
    notes: tuple[str, ...] = ()
    noise: NoiseModel | None = field(default=None, metadata=entry(key="noise_model"))
    spread: Floats | None = field(default=None, metadata=entry(key="parameter_spread", dims=("entry", "direction")))

    _WHAT, _COMMAND = "an identified model", "identify"

    def __post_init__(self) -> None:
        """Name the states, and say all units in one place."""
        units = zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=False)
        object.__setattr__(self, "state_names", tuple(f"x{k + 1}" for k in range(self.order)))
        object.__setattr__(self, "units", dict(units))
        super().__post_init__()

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def has_noise_model(self) -> bool:
        """Whether the prediction is more than the simulation."""
        return self.noise is not None or bool(np.any(self.K))

    def innovations(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Return A, B, C, D and K of plant and disturbance together, the states of the disturbance last."""
        if self.noise is None:
            return self.A, self.B, self.C, self.D, self.K
        n, d = self.order, len(self.noise.A)
        A = np.zeros((n + d, n + d))
        A[:n, :n], A[n:, n:] = self.A, self.noise.A
        B, K = np.vstack([self.B, np.zeros((d, self.B.shape[1]))]), np.vstack([self.K, self.noise.K])
        return A, B, np.hstack([self.C, self.noise.C]), self.D, K

    @property
    def zeros(self) -> Complex:
        """Transmission zeros, finite ones, shape (k,); a model with more outputs than inputs has mostly none."""
        return self.invariant_zeros

    def numden(self) -> NumDen:
        """Return numerators and the common denominator in falling powers of z (of s where dt is 0).

        High orders are better kept as a state space: the coefficients of a polynomial lose digits as its order grows.
        """
        return numden(self.A, self.B, self.C, self.D)

    def to_ss(self) -> control.StateSpace:
        """Return the model for python-control; dots in names, which it forbids, become underscores."""
        return self.to_state_space(name=self.name)

    def continuous(self) -> IdentifiedModel:
        """Return the continuous model that gives the same samples under a held input (dt = 0).

        The principal logarithm of [A B; 0 I] / dt (Van Loan 1978). A delay is left out and noted, and there is no
        gain K: the noise of a sampled model has no unique continuous counterpart.

        Raises:
            InputError: a pole at 0 or on the negative real axis has no real logarithm; the model is continuous already.
        """
        if self.dt == 0.0:
            raise InputError("the model is continuous already")
        core = self.undelayed()
        A, B = unheld(core.A, core.B, self.dt)
        gone = [f"{n}: {d * self.dt:g} s" for n, d in zip(self.input_names, self.delay, strict=False) if d]
        note = (f"the continuous model leaves out the delay of {', '.join(gone)}",) if gone else ()
        return replace(
            core, A=A, B=B, K=np.zeros_like(core.K), noise=None, spread=None, dt=0.0, notes=(*self.notes, *note)
        )

    def undelayed(self) -> IdentifiedModel:
        """Return the model without its delays, which are its last states."""
        chain = sum(self.delay)
        if chain == 0:
            return self
        n = self.order - chain
        last, B, D = n, self.B[:n].copy(), self.D.copy()
        for j, d in enumerate(self.delay):
            if d:  # the oldest sample of the chain drives the model
                B[:, j], D[:, j] = self.A[:n, last + d - 1], self.C[:, last + d - 1]
                last += d
        return replace(self, A=self.A[:n, :n], B=B, C=self.C[:, :n], D=D, K=self.K[:n], x0=self.x0[:n], delay=())

    def simulate(self, u: Floats, x0: Floats | None = None) -> Floats:
        """Return the output without noise, shape (N, p).

        Args:
            u: shape (N, m), [units of the inputs].
            x0: shape (n,), state at the first sample; None: at rest at the operating point. `initial_state` finds
                the one that fits a record best; the field x0 is that of the record identified from.

        Raises:
            InputError: wrong number of columns, or the model is continuous.
        """
        du = self._inputs(u)
        start = np.zeros(self.order) if x0 is None else np.asarray(x0, dtype=np.float64)
        states, _ = march_one(du @ self.B.T, self.A, start)
        output: Floats = self.y0 + states @ self.C.T + du @ self.D.T
        return output

    def predict(self, u: Floats, y: Floats, steps: int = 1, x0: Floats | None = None) -> Floats:
        """Return the output predicted from what was measured up to `steps` samples before, shape (N, p).

        Inputs are known up to the sample itself. The first samples rest on the initial state only.

        Args:
            u: shape (N, m), [units of the inputs].
            y: shape (N, p), [units of the outputs].
            steps: ≥ 1.
            x0: shape (n,), or (n + d,) with the states of the disturbance; None: the one that makes the one-step
                prediction fit best.

        Raises:
            InputError: wrong number of columns or rows, steps < 1, or the model is continuous.
        """
        if steps < 1:
            raise InputError(f"steps must be 1 or more, not {steps}")
        du, dy = self._inputs(u), self._outputs(y, len(u))
        A, B, C, D, K = self.innovations()
        start = np.zeros(len(A))
        given = self.initial_state(u, y, predicting=True) if x0 is None else np.asarray(x0, dtype=np.float64)
        start[: len(given)] = given
        driven = du @ (B - K @ D).T + dy @ K.T
        states, _ = march_one(driven, A - K @ C, start)
        for _ in range(steps - 1):
            states[1:] = states[:-1] @ A.T + du[:-1] @ B.T
            states[0] = start
        output: Floats = self.y0 + states @ C.T + du @ D.T
        return output

    def initial_state(self, u: Floats, y: Floats, *, predicting: bool = False) -> Floats:
        """Return the state at the first sample with which the model fits a record best, shape (n,).

        For the prediction the states of a disturbance with poles of its own follow, shape (n + d,).

        Args:
            u: shape (N, m).
            y: shape (N, p).
            predicting: fit the one-step prediction instead of the simulation.

        Raises:
            InputError: wrong number of columns or rows, or the model is continuous.
        """
        dy = self._outputs(y, len(u))
        A, _, C, _, K = self.innovations() if predicting else (self.A, self.B, self.C, self.D, self.K)
        zero = np.zeros(len(A))
        rest = self.predict(u, y, x0=zero) if predicting else self.simulate(u, x0=zero)
        free, _ = march(np.zeros((len(dy), len(C), len(A))), A - K @ C if predicting else A, C)
        left = dy + self.y0 - rest
        rows = free.reshape(dy.size, len(A))
        good = np.isfinite(rows).all(axis=1) & np.isfinite(left).reshape(-1)
        result = np.linalg.lstsq(rows[good], left.reshape(-1)[good], rcond=1e-12)[0]
        return np.asarray(result, dtype=np.float64)

    def named(
        self,
        *,
        input_names: Sequence[str] | None = None,
        output_names: Sequence[str] | None = None,
        input_units: Sequence[str | None] | None = None,
        output_units: Sequence[str | None] | None = None,
        name: str | None = None,
        u0: Floats | None = None,
        y0: Floats | None = None,
    ) -> IdentifiedModel:
        """Return the model with names, units or an operating point; what is None stays.

        Args:
            input_names: shape (m,).
            output_names: shape (p,).
            input_units: shape (m,).
            output_units: shape (p,).
            name: name of the model.
            u0: shape (m,), what was taken off the inputs before.
            y0: shape (p,), what was taken off the outputs before.

        Raises:
            InputError: another number of names than channels.
        """
        given: dict[str, Any] = {
            "input_names": input_names, "output_names": output_names, "input_units": input_units,
            "output_units": output_units,
        }  # fmt: skip
        given = {key: tuple(value) for key, value in given.items() if value is not None}
        for key, point in (("u0", u0), ("y0", y0)):
            if point is not None:
                given[key] = np.asarray(point, dtype=np.float64)
        for key, value in given.items():
            wanted = len(getattr(self, key))
            if len(value) != wanted:
                raise InputError(f"{key}: {wanted} are needed, not {len(value)}")
        return replace(self, name=self.name if name is None else name, **given)

    def derived(self) -> dict[str, Any]:
        """Return the poles."""
        return {"poles": self.poles, **pole_keys(self.poles, self.dt)}

    def _inputs(self, u: Floats) -> Floats:
        if self.dt == 0.0:
            raise InputError("a continuous model is not simulated sample by sample; use the discrete one")
        given = np.asarray(u, dtype=np.float64)
        return _columns(given, len(self.u0), "u") - self.u0

    def _outputs(self, y: Floats, samples: int) -> Floats:
        given = _columns(np.asarray(y, dtype=np.float64), len(self.y0), "y")
        if len(given) != samples:
            raise InputError(f"u has {samples} samples, y {len(given)}")
        return given - self.y0


def _columns(given: Floats, wanted: int, what: str) -> Floats:
    columns = given[:, None] if given.ndim == 1 and wanted == 1 else given
    if columns.ndim != 2 or columns.shape[1] != wanted:
        raise InputError(f"{what} must have shape (N, {wanted}), not {given.shape}")
    return columns


# -- numerator and denominator --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class NumDen:
    """A transfer matrix with a common denominator, coefficients of falling powers.

    Attributes:
        num: shape (p, m, n + 1).
        den: shape (n + 1,), first coefficient 1.
    """

    num: Floats
    den: Floats


def numden(A: Floats, B: Floats, C: Floats, D: Floats) -> NumDen:
    """Return numerators and denominator.

    The numerator is the product of the denominator and the series of Markov parameters D, C B, C A B, …, which
    breaks off after n + 1 coefficients (Kailath 1980, section 2.3).

    Args:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (p, n).
        D: shape (p, m).
    """
    n = len(A)
    den = np.real(np.poly(A)) if n else np.ones(1)
    markov, reach = [D], B
    for _ in range(n):
        markov.append(C @ reach)
        reach = A @ reach
    h = np.array(markov)
    num = np.array([np.tensordot(den[: k + 1], h[k::-1], 1) for k in range(n + 1)])
    return NumDen(np.moveaxis(num, 0, -1), den)
