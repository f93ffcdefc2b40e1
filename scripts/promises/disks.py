"""Whether disk margins of several loops are those of python-control: random plants with controllers of several loops.

Each plant has two or three inputs and outputs and modes of 0.1 to 10 Hz with damping ratios of 1e-4 … 0.5; the
controller mixes all its outputs behind lags, a third of them with a direct part, a quarter of the loops are sampled.
All outputs of both are opened. The truth is `control.disk_margins` of the loop that is written down apart from the
workbench: on a grid that has the frequencies of all closed-loop poles, and finer and finer about its smallest values.
Of two loops the bound of µ is compared with µ itself at that frequency, the largest ρ(N diag(1, e^jφ)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import control
import numpy as np

import workbench as wb
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear

_GRID = 300  # frequencies over the decades of the poles, as somebody would choose them
_AGREES = 1e-4  # relative
_FOLLOWED, _ZOOMS, _ZOOM = 4, 6, 11  # smallest values, how often, and points each time


@dataclass(frozen=True, eq=False)
class DiskCase:
    """A plant in a loop with a controller.

    Attributes:
        plant, controller: u = -K y.
    """

    plant: Linear
    controller: Linear

    @classmethod
    def random(cls, random: np.random.Generator) -> DiskCase:
        """Return one whose closed loop is stable: its gains are halved until it is."""
        m, modes = int(random.integers(2, 4)), int(random.integers(1, 4))
        dt, direct = 0.02 if random.random() < 0.25 else 0.0, random.random() < 1.0 / 3.0
        omega, zeta = (np.exp(random.uniform(np.log(a), np.log(b), modes)) for a, b in ((0.6, 60.0), (1e-4, 0.5)))
        a, b, c = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, m)), np.zeros((m, 2 * modes))
        for k, (w, z) in enumerate(zip(omega, zeta, strict=True)):
            a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, w], [-w, -2.0 * z * w]]
        b[1::2], c[:, ::2] = omega[:, None] * random.standard_normal((modes, m)), random.standard_normal((m, modes))
        lag = np.exp(random.uniform(np.log(3.0), np.log(100.0), m))
        mixed, through = random.standard_normal((m, m)), random.standard_normal((m, m)) if direct else np.zeros((m, m))
        while True:
            parts = Linear(a, b, c, np.zeros((m, m))), Linear(-np.diag(lag), np.diag(lag), mixed, through)
            case = cls(*(p if dt == 0.0 else _held(p, dt) for p in parts))
            if case.closed_poles_inside():
                return case
            mixed, through = 0.5 * mixed, 0.5 * through

    def closed_poles_inside(self) -> bool:
        """Whether the closed loop is stable, by more than its damping of 1e-5."""
        poles = _closed(self.loop(), range(2 * len(self.plant.D)))[0]
        inner = np.log(poles) / self.plant.dt if self.plant.dt > 0.0 else poles
        return bool((inner.real < -1e-5 * np.abs(inner)).all())

    def loop(self) -> Linear:
        """Return L of all outputs of plant and controller: what comes back, with the sign turned."""
        p, k = self.plant, self.controller
        n, q, m = len(p.A), len(k.A), len(p.D)
        a = np.block([[p.A, np.zeros((n, q))], [np.zeros((q, n)), k.A]])
        b = np.block([[np.zeros((n, m)), p.B], [k.B, np.zeros((q, m))]])
        c = np.block([[p.C, np.zeros((m, q))], [np.zeros((m, n)), -k.C]])
        d = np.block([[np.zeros((m, m)), p.D], [-k.D, np.zeros((m, m))]])
        return Linear(a, b, c, d, dt=p.dt)

    def system(self) -> wb.Model:
        """Return the loop for the workbench."""
        m = len(self.plant.D)
        parts = {
            name: wb.LinearComponent(
                name=name, A=part.A, B=part.B, C=part.C, D=part.D, dt=part.dt, x0=np.zeros(len(part.A)),
                input_names=tuple(f"u{k + 1}" for k in range(m)), output_names=tuple(f"y{k + 1}" for k in range(m)),
                state_names=tuple(f"x{k + 1}" for k in range(len(part.A))),
            )
            for name, part in (("plant", self.plant), ("controller", self.controller))
        }  # fmt: skip
        wires = [
            *(wb.Connection(source=f"plant.y{k}", destination=f"controller.u{k}") for k in range(1, m + 1)),
            *(wb.Connection(source=f"controller.y{k}", destination=f"plant.u{k}", gain=-1.0) for k in range(1, m + 1)),
        ]
        return wb.connect(parts, wires, outputs={"y": "plant.y1"})

    def places(self) -> Iterator[tuple[str, str, tuple[int, ...]]]:
        """Yield what the workbench calls the places that are opened at the same time, and their numbers in `loop`."""
        m = len(self.plant.D)
        first, last = tuple(range(m)), tuple(range(m, 2 * m))
        yield "outputs of plant", "inputs of controller", first
        yield "outputs of controller", "inputs of plant", last
        yield "all at the same time", "all at the same time", (*first, *last)


def run(*, cases: int = 100, seed: int = 1) -> int:
    """Print how far disk margins are from those of python-control; return 1 if one is farther than 1e-4.

    Args:
        cases: systems.
        seed: of the first.
    """
    random = np.random.default_rng(seed)
    gaps, hidden, apart = list[float](), list[float](), list[float]()
    for number in range(cases):
        case = DiskCase.random(random)
        names = [f"{part}.y{k + 1}" for part in ("plant", "controller") for k in range(len(case.plant.D))]
        with case.system() as system:
            told = {d.where: d for d in wb.loop(system, names).disk_margins}
        for where, again, numbers in case.places():
            by_grid, truth, n = smallest(case.loop(), numbers)
            gaps += [told[name].alpha / truth - 1.0 for name in dict.fromkeys((where, again))]
            hidden.append(by_grid / truth - 1.0)
            if len(numbers) == 2:
                apart.append(truth * _largest_turned(n) / 2.0 - 1.0)
            if abs(gaps[-1]) > _AGREES:
                print(f"{number}, {where}: {told[where].alpha:.7g}, by python-control {truth:.7g}")
    far, missed = sum(abs(g) > _AGREES for g in gaps), [h for h in hidden if h > _AGREES]
    print(f"{far} of {len(gaps)} disk margins of {cases} systems differ by more than {_AGREES:g}: "
          f"by {min(gaps):.2g} to {max(gaps):.2g}")  # fmt: skip
    print(f"{len(missed)} of {len(hidden)} smallest values lay between the points of a grid of {_GRID}, "
          f"{sum(h > 0.1 for h in missed)} are 10 % larger on it, {max(missed, default=0.0):.0%} at most")  # fmt: skip
    print(f"of two loops µ is below its bound by {-min(apart, default=0.0):.2g} at most")
    return int(far > 0)


def smallest(loop: Linear, numbers: tuple[int, ...]) -> tuple[float, float, Complex]:
    """Return the smallest disk margin on a grid and of all, by python-control, and S - T where it is smallest.

    Args:
        loop: L of all places.
        numbers: of those that are opened; the others stay closed.
    """
    poles, part = _closed(loop, numbers)
    inner = np.log(poles.astype(np.complex128)) / loop.dt if loop.dt > 0.0 else poles
    sizes = np.abs(inner)[np.abs(inner) > 0.0]
    top = np.pi / loop.dt * (1.0 - 1e-9) if loop.dt > 0.0 else np.inf
    grid = np.geomspace(0.1 * sizes.min(), min(10.0 * sizes.max(), top), _GRID)
    system = control.ss(part.A, part.B, part.C, part.D, loop.dt)
    own = np.abs(inner.imag)
    more = [1e-6 * grid[0], *own[(own > 0.0) & (own < top)], top if np.isfinite(top) else 1e6 * grid[-1]]
    every = np.unique([*grid, *more])
    alpha = control.disk_margins(system, every, returnall=True)[0]
    at_grid = float(alpha[np.isin(every, grid)].min())
    low = [k for k in range(len(every)) if alpha[k] == alpha[max(k - 1, 0) : k + 2].min()]
    best, where = np.inf, 0.0
    for k in sorted(low, key=lambda k: float(alpha[k]))[:_FOLLOWED]:
        begin, end = every[max(k - 1, 0)], every[min(k + 1, len(every) - 1)]
        for _ in range(_ZOOMS):
            inside = np.linspace(begin, end, _ZOOM)
            found = control.disk_margins(system, inside, returnall=True)[0]
            i = int(found.argmin())
            begin, end = inside[max(i - 1, 0)], inside[min(i + 1, _ZOOM - 1)]
            if found[i] < best:
                best, where = float(found[i]), float(inside[i])
    response, one = part.response(np.array([where / (2.0 * np.pi)]))[0], np.eye(len(numbers), dtype=np.complex128)
    return at_grid, min(best, at_grid), np.asarray(2.0 * np.linalg.inv(one + response) - one, dtype=np.complex128)


def _closed(loop: Linear, numbers: range | tuple[int, ...]) -> tuple[Complex, Linear]:
    """Return the poles with all loops closed, and L of some places with the others closed."""
    some, rest = list(numbers), [k for k in range(len(loop.D)) if k not in numbers]
    back = np.linalg.inv(np.eye(len(rest)) + loop.D[np.ix_(rest, rest)])
    c, across = back @ loop.C[rest], back @ loop.D[np.ix_(rest, some)]
    part = Linear(
        loop.A - loop.B[:, rest] @ c, loop.B[:, some] - loop.B[:, rest] @ across,
        loop.C[some] - loop.D[np.ix_(some, rest)] @ c,
        loop.D[np.ix_(some, some)] - loop.D[np.ix_(some, rest)] @ across, dt=loop.dt,
    )  # fmt: skip
    whole = loop.A - loop.B @ np.linalg.solve(np.eye(len(loop.D)) + loop.D, loop.C)
    return np.linalg.eigvals(whole).astype(np.complex128), part


def _held(part: Linear, dt: float) -> Linear:
    """Return a part with its input held over a period."""
    made = control.c2d(control.ss(part.A, part.B, part.C, part.D), dt)
    return Linear(made.A, made.B, made.C, made.D, dt=dt)


def _largest_turned(n: Complex) -> float:
    """Return µ of a 2 × 2 matrix with two complex numbers."""
    low, high, best = 0.0, 2.0 * np.pi, 0.0
    for _ in range(_ZOOMS):
        phases: Floats = np.linspace(low, high, 181)
        sizes = [np.abs(np.linalg.eigvals(n * np.array([1.0, np.exp(1j * p)]))).max() for p in phases]
        k = int(np.argmax(sizes))
        best = max(best, float(sizes[k]))
        low, high = phases[max(k - 1, 0)], phases[min(k + 1, len(phases) - 1)]
    return best
