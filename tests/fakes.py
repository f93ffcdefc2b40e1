"""Models written in Python whose response is known exactly: what the analyses are tested on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.variable import Variable
from workbench.model import Model
from workbench.session import Recorded, Session, Snapshot
from workbench.signals.kinds import Signal, Sine

Rows = tuple[Floats, Floats, Floats]


def variable(name: str, unit: str | None = None) -> Variable:
    return Variable(name=name, type="Real", unit=unit, start=0.0)


class FakeModel(Model):
    """Opens sessions with a function; counts them."""

    def __init__(self, make: Callable[[], Session], *, interface: str = "me", output_unit: str | None = None) -> None:
        self.name = "Fake"
        self.interface = interface
        self.solver = "none" if interface == "me" else "fmu"
        self.inputs = (variable("u", "deg"), variable("unused"))
        self.outputs = (variable("y", output_unit),)
        self.parameters = (variable("k"),)
        self.states = (variable("x"),)
        self.notes = ()
        self.sessions = 0
        self._make = make

    def open_session(
        self, *, start_time: float | None = None, step: float | None = None, signals: Mapping[str, Signal] | None = None
    ) -> Session:
        self.sessions += 1
        return self._make()

    def close(self) -> None:
        return


class FakeSession(Session):
    """A session with rows at the points only; the subclass computes y and u there."""

    def __init__(self) -> None:
        self.time = 0.0

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        sine = signals["u"]
        assert isinstance(sine, Sine)
        inner = np.array([until]) if points is None else points
        time, y, u = self.rows(np.concatenate([[self.time], inner]), sine)
        self.time = until
        return Recorded(time, dict.fromkeys(record, y), {"u": u})

    def rows(self, time: Floats, sine: Sine) -> Rows:
        raise AssertionError("the subclass computes the rows")

    def values(self, names: Sequence[str]) -> dict[str, float]:
        return dict.fromkeys(names, 0.0)

    def snapshot(self) -> Snapshot:
        raise AssertionError("no analysis here needs one")

    def restore(self, snapshot: Snapshot) -> None:
        raise AssertionError("no analysis here needs one")

    def close(self) -> None:
        return


def forcing(time: Floats, sine: Sine) -> Floats:
    return sine.offset + sine.amplitude * np.sin(2.0 * np.pi * sine.frequency * (time - sine.start))


class LinearSession(FakeSession):
    """x' = A x + B u, y = C x + D u + offset under a sine, in closed form (A diagonalisable, no pole at ±jω)."""

    def __init__(self, a: Floats, b: Floats, c: Floats, d: float, *, offset: float = 0.0, noise: float = 0.0) -> None:
        super().__init__()
        self.poles, self.modes = np.linalg.eig(a)
        self.b = np.linalg.solve(self.modes, b.astype(complex))
        self.c = c @ self.modes
        self.d, self.offset, self.noise = d, offset, noise
        self.state = np.zeros(len(b), dtype=complex)
        self.random = np.random.default_rng(1)

    def rows(self, time: Floats, sine: Sine) -> Rows:
        omega = 2.0 * np.pi * sine.frequency
        angle = omega * (time - sine.start)
        # Response of the modes z' = p z + b sin: Im(b e^{jωt}/(jω − p)), conjugate parts kept apart.
        plus = self.b[:, None] * np.exp(1j * angle) / (1j * omega - self.poles)[:, None]
        minus = self.b[:, None] * np.exp(-1j * angle) / (-1j * omega - self.poles)[:, None]
        forced = sine.amplitude * (plus - minus) / 2j
        with np.errstate(over="ignore", invalid="ignore"):
            free = np.exp(np.outer(self.poles, time - time[0])) * (self.state - forced[:, 0])[:, None]
            z = forced + free
            y = (self.c @ z).real
        if not np.all(np.isfinite(y)):
            raise SimulationError("y is not finite", time=float(time[-1]))
        self.state = z[:, -1]
        u = forcing(time, sine)
        y = y + self.d * u + self.offset
        return time, y * (1.0 + self.noise * self.random.standard_normal(y.size)), u


def linear(
    a: Sequence[Sequence[float]],
    b: Sequence[float],
    c: Sequence[float],
    d: float = 0.0,
    *,
    offset: float = 0.0,
    noise: float = 0.0,
) -> FakeModel:
    arrays = (np.array(a, dtype=float), np.array(b, dtype=float), np.array(c, dtype=float))
    return FakeModel(lambda: LinearSession(*arrays, d, offset=offset, noise=noise))


def lag(tau: float) -> FakeModel:
    return linear([[-1.0 / tau]], [1.0 / tau], [1.0])


def oscillator(mass: float = 1.0, damping: float = 10.0, stiffness: float = 1e4) -> FakeModel:
    return linear([[0.0, 1.0], [-stiffness / mass, -damping / mass]], [0.0, 1.0 / mass], [1.0, 0.0])


class EulerOscillator(FakeSession):
    """Mass, spring and damper integrated by explicit Euler at the communication step, input held (co-simulation)."""

    def __init__(self, damping: float = 10.0, stiffness: float = 1e4) -> None:
        super().__init__()
        self.damping, self.stiffness = damping, stiffness
        self.x = self.v = 0.0
        self.steps = 0

    def rows(self, time: Floats, sine: Sine) -> Rows:
        held = forcing(time, sine)
        y = [self.x]
        x, v = self.x, self.v
        for h, u in zip(np.diff(time).tolist(), held[:-1].tolist(), strict=True):
            x, v = x + h * v, v + h * (u - self.damping * v - self.stiffness * x)
            if abs(x) > 1e100:
                raise SimulationError("y is not finite", time=float(time[-1]))
            y.append(x)
        self.x, self.v = x, v
        self.steps += len(y) - 1
        # Left limit (old input) and right limit (new input) at each communication point.
        return np.repeat(time, 2)[1:], np.repeat(np.array(y), 2)[1:], np.repeat(held, 2)[:-1]


class DeadTimeSession(FakeSession):
    """y(t) = u(t − dead_time), zero before."""

    def __init__(self, dead_time: float) -> None:
        super().__init__()
        self.dead_time = dead_time

    def rows(self, time: Floats, sine: Sine) -> Rows:
        late = forcing(time - self.dead_time, sine)
        y = np.where(time - self.dead_time >= 0.0, late, 0.0)
        return time, y, forcing(time, sine)


class StaticSession(FakeSession):
    """y = f(u)."""

    def __init__(self, function: Callable[[Floats], Floats]) -> None:
        super().__init__()
        self.function = function

    def rows(self, time: Floats, sine: Sine) -> Rows:
        u = forcing(time, sine)
        return time, self.function(u), u


class SampledSession(FakeSession):
    """Sum of quantisers, each sampling u with a period of its own; the rows have both limits at each sample."""

    def __init__(self, quantisers: Sequence[tuple[float, float]]) -> None:
        super().__init__()
        self.quantisers = quantisers  # (sample period [s], resolution)

    def rows(self, time: Floats, sine: Sine) -> Rows:
        begin, end = time[0], time[-1]
        events = np.concatenate([self._samples(p, begin, end) for p, _ in self.quantisers])
        rows = np.sort(np.concatenate([time, np.repeat(events, 2)]))
        right = np.concatenate([[True], np.diff(rows) == 0.0])  # the second of two equal rows
        y = np.zeros(rows.size)
        for period, resolution in self.quantisers:
            # Left limit of an event: the sample before it.
            index = np.floor(rows / period + np.where(right, 1e-9, -1e-9))
            u = forcing(np.maximum(index, 0.0) * period, sine)
            y += resolution * np.floor(u / resolution + 0.5)
        return rows, y, forcing(rows, sine)

    @staticmethod
    def _samples(period: float, begin: float, end: float) -> Floats:
        first, last = np.floor(begin / period + 1e-9) + 1, np.ceil(end / period - 1e-9) - 1
        samples: NDArray[np.float64] = np.arange(first, last + 1) * period
        return samples
