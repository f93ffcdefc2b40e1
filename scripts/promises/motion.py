"""Measure whether the motion that a frequency response reports is the one that the model reaches.

Oscillators with restitution at one or two walls, elastic stops, a dead zone, backlash, a relay with hysteresis, or a
hardening spring, which has two stable motions; FMUs, most built from Modelica, and blocks of a system. The truth is an
own simulation from the operating point, exact between events: each piece is linear, x(t) = e^(At)·x(0) with the sine
among its states, and the instant at which a piece ends is solved for. It runs until the motion repeats, every period or
every few, or for hundreds of periods. The spring is integrated by a Runge-Kutta method of order 8. Where the mass comes
to rest against a wall, by bounces without end, there is no truth, and the case is counted apart.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import control
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import workbench as wb
from workbench.build.fmu import build_fmu
from workbench.fmi.platforms import host

Many = NDArray[np.float64]

# -- the truth ----------------------------------------------------------------------------------------------------

_ROWS = 128  # per period, between which the begin of an event is looked for
_MOST_EVENTS = 60  # in a period: more is a mass that comes to rest against a wall
_PERIODS, _MEASURED = 800, 400  # at most, and of an irregular motion
_LONGEST, _ALIKE = 16, 1e-9  # order of a subharmonic, and how well it repeats


class RestsError(Exception):
    """The mass comes to rest against a wall."""


@dataclass(frozen=True)
class Guard:
    """Where a piece of the motion ends: row·z rises through 0. Then z is multiplied by `reset`."""

    row: Many
    to: int
    reset: Many | None = None


@dataclass
class Pieces:
    """A motion of linear pieces, ż = A·z; the last states are sin ωt, cos ωt and 1, the first one is the output."""

    matrices: Sequence[Many]
    guards: Sequence[Sequence[Guard]]
    period: float
    z: Many
    mode: int = 0
    events: int = 0

    @cached_property
    def powers(self) -> list[Many]:
        """e^(At) at each row of a period."""
        found = []
        for a in self.matrices:
            step, rows = expm(a * self.period / _ROWS), [np.eye(len(a))]
            for _ in range(_ROWS):
                rows.append(step @ rows[-1])
            found.append(np.array(rows))
        return found

    def over(self, *, measured: bool = False) -> complex:
        """Run one period; return the fundamental of the output where it is measured."""
        left, begin, found, events = self.period, 0.0, 0.0j, 0
        self.z[-3:-1] = 0.0, 1.0  # rounding does not add up
        while left > 0.0:
            span, guard = self._until(left)
            if measured:
                found += np.exp(-2j * math.pi * begin / self.period) * self._fourier(span)
            self.z = self._after(span, self.z)
            left, begin = left - span, begin + span
            if guard is None:
                break
            events += 1
            if events > _MOST_EVENTS or (guard.reset is not None and span < 1e-3 * self.period):
                raise RestsError
            self.z = self.z if guard.reset is None else guard.reset @ self.z
            self.mode = guard.to
        self.events += events
        return 2j * found / self.period

    def _after(self, t: float, z: Many) -> Many:
        """Return the state a time later: from the row before it by Taylor's series."""
        k = min(int(t / self.period * _ROWS), _ROWS)
        found: Many = self.powers[self.mode][k] @ z
        term = found
        a = self.matrices[self.mode] * (t - k * self.period / _ROWS)
        for n in range(1, 100):
            term = a @ term / n
            found = found + term
            if np.abs(term).max() <= 1e-17 * np.abs(found).max():
                break
        return found

    def _until(self, left: float) -> tuple[float, Guard | None]:
        """Return how long the present piece lasts, at most what is left, and what ends it."""
        rows = self.powers[self.mode] @ self.z
        first, which = left, None
        for guard in self.guards[self.mode]:
            values: Many = rows @ guard.row
            rises = np.flatnonzero((values[1:] > 0.0) & (values[:-1] <= 1e-13))
            if len(rises):
                at = self._crossing(rows[rises[0]], guard.row) + rises[0] * self.period / _ROWS
                if at < first:
                    first, which = at, guard
        return first, which

    def _crossing(self, z: Many, row: Many) -> float:
        """Return when row·z rises through 0 within a row."""
        a, low, high = self.matrices[self.mode], 0.0, self.period / _ROWS
        if row @ z > -1e-13:  # it has just been there: the next time
            low = 1e-3 * high
        t = 0.5 * (low + high)
        for _ in range(60):
            at = self._after(t, z)
            value, slope = float(row @ at), float(row @ a @ at)
            low, high = (low, t) if value > 0.0 else (t, high)
            near = t - value / slope if slope > 0.0 else math.inf
            new = near if low < near < high else 0.5 * (low + high)
            if abs(new - t) <= 1e-13 * self.period:
                return float(new)
            t = new
        return t

    def _fourier(self, span: float) -> complex:
        """Return ∫ y·e^(−jωt) dt from here on."""
        n = len(self.z)
        turned = np.zeros((2 * n, 2 * n), dtype=np.complex128)
        turned[:n, :n] = self.matrices[self.mode] - 2j * math.pi / self.period * np.eye(n)
        turned[:n, n:] = np.eye(n)
        return complex((expm(turned * span)[:n, n:] @ self.z)[0])


@dataclass(frozen=True)
class Truth:
    """What the model comes to: the mean response over `order` periods; 0: it is irregular, known to `error`."""

    response: complex
    order: int
    error: float = 0.0
    events: float = 0.0


def reached(pieces: Pieces | Smooth, amplitude: float) -> Truth:
    """Return what a motion comes to.

    Raises:
        RestsError: it rests against a wall.
    """
    seen: list[Many] = []
    for k in range(_PERIODS):
        pieces.over()
        seen.append(np.append(pieces.z[:-3], 10.0 * pieces.mode))
        if k % 20 == 0 and k > 3 * _LONGEST:
            order = _order(np.array(seen[-3 * _LONGEST :]))
            if order:
                before = pieces.events
                mean = np.mean([pieces.over(measured=True) for _ in range(order)])
                return Truth(complex(mean) / amplitude, order, events=(pieces.events - before) / order)
    order = next((n for n, a in enumerate(_apart(np.array(seen[-3 * _LONGEST :])), start=1) if a < 1e3 * _ALIKE), 0)
    if order:  # but for what rounding leaves at the instants of the events
        return Truth(complex(np.mean([pieces.over(measured=True) for _ in range(order)])) / amplitude, order)
    values = np.array([pieces.over(measured=True) for _ in range(_MEASURED)]) / amplitude
    blocks = values.reshape(10, -1).mean(axis=1)
    error = 2.3 * float(np.sqrt(np.sum(np.abs(blocks - blocks.mean()) ** 2) / 90.0))
    return Truth(complex(values.mean()), 0, error)


def _apart(rows: Many) -> list[float]:
    """Return by how much states so many periods apart differ."""
    size = np.abs(rows).max(axis=0) + 1e-300
    return [float(np.max(np.abs(rows[n:] - rows[:-n])[-2 * n :] / size)) for n in range(1, _LONGEST + 1)]


def _order(rows: Many) -> int:
    """Return after how many periods the states repeat; 0: after none, or that is not clear yet."""
    apart = _apart(rows)
    order = next((n for n, a in enumerate(apart, start=1) if a < _ALIKE), 0)
    # What still alternates a little looks as if it repeated every second time.
    return 0 if any(a < 1e3 * _ALIKE for a in apart[: order - 1]) else order


# -- the oscillators ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Oscillator:
    """x″ = u − 2ζx′ − x − F: what it is, where it is forced [Hz], and how hard."""

    kind: str
    values: dict[str, float]
    frequency: float
    amplitude: float

    def pieces(self) -> Pieces | Smooth:
        """Return it as exact pieces at rest."""
        return KINDS[self.kind].pieces(self)

    def model(self, interface: str = "me", **options: object) -> wb.DescribedModel:
        """Return it as a model with input u and output y."""
        return KINDS[self.kind].model(self.values, interface)


@dataclass(frozen=True)
class Kind:
    """How the oscillators of a kind are made."""

    random: Callable[[np.random.Generator], dict[str, float]]
    pieces: Callable[[Oscillator], Pieces | Smooth]
    model: Callable[[dict[str, float], str], wb.DescribedModel]


def random_oscillator(kind: str, random: np.random.Generator) -> Oscillator:
    """Return one that reaches its gap, or nearly."""
    values = {"z": float(10.0 ** random.uniform(-2.0, -0.4)), **KINDS[kind].random(random)}
    w = float(10.0 ** random.uniform(-0.5, 0.7))
    gain = 1.0 / abs(1.0 - w * w + 2j * values["z"] * w)
    size = float(10.0 ** random.uniform(-0.4, 0.8)) * values["gap"]
    return Oscillator(kind, values, w / (2.0 * math.pi), size / gain)


def flow(o: Oscillator, spring: float, force: float, *, states: int = 2) -> Many:
    """Return A of x″ = u − 2ζx′ − spring·x + force."""
    a, w = np.zeros((states + 3, states + 3)), 2.0 * math.pi * o.frequency
    a[0, 1] = 1.0
    a[1, [0, 1, -3, -1]] = -spring, -2.0 * o.values["z"], o.amplitude, force
    a[-3, -2], a[-2, -3] = w, -w
    return a


def pieces(o: Oscillator, matrices: Sequence[Many], guards: Sequence[Sequence[Guard]], mode: int = 0) -> Pieces:
    """Return pieces that begin at rest."""
    z = np.zeros(len(matrices[0]))
    z[-2:] = 1.0
    return Pieces(matrices, guards, 1.0 / o.frequency, z, mode)


def row(n: int, **values: float) -> Many:
    """Return a row of z; x, v, b, one."""
    found = np.zeros(n)
    for name, value in values.items():
        found[{"x": 0, "v": 1, "b": 2, "one": -1}[name]] = value
    return found


def walls(o: Oscillator) -> Pieces:
    """One wall at gap, or two."""
    bounce = np.diag([1.0, -o.values["r"], 1.0, 1.0, 1.0])
    guards = [Guard(row(5, x=1.0, one=-o.values["gap"]), 0, bounce)]
    if "gap2" in o.values:
        guards.append(Guard(row(5, x=-1.0, one=-o.values["gap2"]), 0, bounce))
    return pieces(o, [flow(o, 1.0, 0.0)], [guards])


def between(o: Oscillator, spring: float, outside: float, gaps: tuple[float, float]) -> Pieces:
    """Two stiffnesses more beyond the gaps."""
    up, down = gaps
    matrices = [
        flow(o, spring, 0.0),
        flow(o, spring + outside, outside * up),
        flow(o, spring + outside, -outside * down),
    ]
    above, below = row(5, x=1.0, one=-up), row(5, x=-1.0, one=-down)
    guards = [[Guard(above, 1), Guard(below, 2)], [Guard(-above, 0)], [Guard(-below, 0)]]
    return pieces(o, matrices, guards)


def play(o: Oscillator) -> Pieces:
    """A spring behind a backlash with the state b."""
    h, k, lag = (o.values[n] for n in ("gap", "k", "lag"))
    matrices = []
    for side in (0.0, 1.0, -1.0):
        a = flow(o, 1.0, 0.0, states=3)
        a[1, 2] = -k
        if side:
            a[2, [0, 2, -1]] = 1.0 / lag, -1.0 / lag, -side * h / lag
        matrices.append(a)
    above, below = row(6, x=1.0, b=-1.0, one=-h), row(6, x=-1.0, b=1.0, one=-h)
    return pieces(o, matrices, [[Guard(above, 1), Guard(below, 2)], [Guard(-above, 0)], [Guard(-below, 0)]])


def switched(o: Oscillator) -> Pieces:
    """A relay with hysteresis pushes against the motion."""
    d, h = o.values["d"], o.values["gap"]
    on, off = row(5, x=1.0, one=-h), row(5, x=-1.0, one=-h)
    return pieces(o, [flow(o, 1.0, d), flow(o, 1.0, -d)], [[Guard(on, 1)], [Guard(off, 0)]])


class Smooth:
    """A mass on a hardening spring, integrated; it has what `reached` needs of `Pieces`."""

    mode, events = 0, 0

    def __init__(self, o: Oscillator) -> None:
        self.z, self._o = np.zeros(5), o

    def over(self, *, measured: bool = False) -> complex:
        """Run one period; return the fundamental of the output where it is measured."""
        w, z, cubic = 2.0 * math.pi * self._o.frequency, self._o.values["z"], self._o.values["cubic"]

        def slope(t: float, y: Many) -> list[float]:
            force = self._o.amplitude * math.sin(w * t) - 2.0 * z * y[1] - y[0] - cubic * y[0] ** 3
            return [y[1], force, y[0] * math.cos(w * t), -y[0] * math.sin(w * t)]

        begin, span = [*self.z[:2], 0.0, 0.0], (0.0, 2.0 * math.pi / w)
        self.z[:2], (real, imaginary) = np.split(
            solve_ivp(slope, span, begin, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1], 2
        )
        return 2j * complex(real, imaginary) / span[1] if measured else 0j


def spring(values: dict[str, float], interface: str) -> wb.DescribedModel:
    """Return the bundled oscillator with a hardening spring."""
    values = {"damping": 2.0 * values["z"], "cubic": values["cubic"]}
    return wb.load("fmu:Duffing", interface, tolerance=1e-8, start_values=values)


@cache
def built(name: str, body: str) -> str:
    """Return an FMU of Modelica."""
    folder = Path(tempfile.mkdtemp(prefix="coverage-motion-"))
    text = f"model {name}\n input Real u(start = 0);\n output Real y;\n{body}\nend {name};\n"
    (folder / f"{name}.mo").write_text(text, encoding="utf-8")
    build_fmu([folder / f"{name}.mo"], out=folder / f"{name}.fmu", platforms=[host()])
    return str(folder / f"{name}.fmu")


_STATES = "Real x(start = 0, fixed = true); Real v(start = 0, fixed = true);"
WALL = f"""parameter Real z = 0.1; parameter Real gap = 1; parameter Real r = 0.5; {_STATES}
equation
  der(x) = v; der(v) = u - 2*z*v - x; y = x;
  when x > gap then reinit(v, -r*pre(v)); end when;"""
TWO_WALLS = f"""parameter Real z = 0.1; parameter Real gap = 1; parameter Real gap2 = 1; parameter Real r = 0.5;
  {_STATES}
equation
  der(x) = v; der(v) = u - 2*z*v - x; y = x;
  when x > gap then reinit(v, -r*pre(v)); elsewhen x < -gap2 then reinit(v, -r*pre(v)); end when;"""
STOPS = f"""parameter Real z = 0.1; parameter Real gap = 1; parameter Real gap2 = 1; parameter Real k = 10; {_STATES}
equation
  der(x) = v; y = x;
  der(v) = u - 2*z*v - x - (if x > gap then k*(x - gap) elseif x < -gap2 then k*(x + gap2) else 0);"""


def fmu(name: str, body: str) -> Callable[[dict[str, float], str], wb.DescribedModel]:
    """Return what makes a model of an FMU."""
    return lambda values, interface: wb.load(built(name, body), interface, tolerance=1e-8, start_values=values)


def block(
    kind: str, of: Callable[[dict[str, float]], tuple[float, dict[str, float]]]
) -> Callable[..., wb.DescribedModel]:
    """Return what makes a model of a plant with a block in feedback from x."""

    def model(values: dict[str, float], _: str) -> wb.DescribedModel:
        spring, parameters = of(values)
        plant = control.ss([[0.0, 1.0], [-spring, -2.0 * values["z"]]], [[0.0, 0.0], [1.0, -1.0]], [[1.0, 0.0]], 0.0)
        b = wb.BlockComponent(name="b", kind=kind, parameters=parameters)
        wires = [("p.y", "b.u"), ("b.y", "p.u2")]
        return wb.connect({"p": plant, "b": b}, wires, inputs={"u": "p.u1"}, outputs={"y": "p.y"}, tolerance=1e-8)

    return model


def gap(random: np.random.Generator) -> float:
    """Return a gap."""
    return float(random.uniform(0.3, 1.5))


KINDS: dict[str, Kind] = {
    "wall": Kind(
        lambda r: {"gap": gap(r), "r": float(r.uniform(0.3, 0.95))}, walls, fmu("Wall", WALL)
    ),
    "two walls": Kind(
        lambda r: {"gap": gap(r), "gap2": gap(r), "r": float(r.uniform(0.3, 0.95))}, walls, fmu("TwoWalls", TWO_WALLS)
    ),
    "stops": Kind(
        lambda r: {"gap": gap(r), "gap2": gap(r), "k": float(10.0 ** r.uniform(0.0, 2.0))},
        lambda o: between(o, 1.0, o.values["k"], (o.values["gap"], o.values["gap2"])),
        fmu("Stops", STOPS),
    ),
    "dead zone": Kind(
        lambda r: {"gap": gap(r), "k": float(r.uniform(0.5, 4.0)), "centre": float(r.uniform(0.05, 0.5))},
        lambda o: between(o, o.values["centre"], o.values["k"], (o.values["gap"], o.values["gap"])),
        block("dead_band", lambda v: (v["centre"], {"lower": -v["gap"], "upper": v["gap"], "slope": v["k"]})),
    ),
    "backlash": Kind(
        lambda r: {"gap": gap(r), "k": float(10.0 ** r.uniform(-0.5, 1.0)), "lag": 0.02},
        play,
        block("backlash", lambda v: (1.0, {"half_width": v["gap"], "slope": v["k"], "lag": v["lag"]})),
    ),
    "relay": Kind(
        lambda r: {"gap": gap(r) / 3.0, "d": float(r.uniform(0.02, 0.5))},
        switched,
        block(
            "relay",
            lambda v: (1.0, {"lower": -v["d"], "upper": v["d"], "off_below": -v["gap"], "on_above": v["gap"]}),
        ),
    ),
    "spring": Kind(lambda r: {"gap": gap(r), "cubic": float(10.0 ** r.uniform(-1.0, 0.3))}, Smooth, spring),
}  # fmt: skip


# -- measured, and compared -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """What is reported of one oscillator, and what it does."""

    oscillator: Oscillator
    truth: Truth | None
    status: str
    response: complex
    error: float
    reached: str | None
    why: str
    seconds: float

    @property
    def verdict(self) -> str:
        """In a word or two; those that begin with "wrong" are."""
        if self.truth is None:
            return "no truth: it rests against a wall"
        if self.status == "failed":
            return "failed, with a reason"
        if not math.isfinite(self.error) or (self.status == "averaged" and self.reached is None):
            return "said not to be known"
        size = abs(self.truth.response)
        off = abs(self.response - self.truth.response) / size
        allowed = self.error + self.truth.error / size
        if self.status == "settled":
            if self.truth.order != 1:
                return "wrong: settled, and the motion is another"
            return "settled, right" if off <= allowed else f"wrong: settled, {'' if off < 0.05 else 'far '}off"
        return "averaged, within its error" if off <= allowed else "averaged, beyond its error"


def truth_of(o: Oscillator) -> Truth | None:
    """Return what it does; None: it rests against a wall."""
    with suppress(RestsError):
        return reached(o.pieces(), o.amplitude)
    return None


def measure(o: Oscillator, truth: Truth | None, interface: str = "me", **options: object) -> Trial:
    """Return what is reported of an oscillator beside what it does."""
    begin = time.process_time()
    with o.model(interface) as model:
        found = wb.nfr(
            model, "u", "y", frequencies=[o.frequency], amplitudes=[o.amplitude], in_process=True, drift_check=False,
            **options,  # type: ignore[arg-type]
        )  # fmt: skip
    certificate = found.certificates[0][0]
    why = "; ".join([*found.warnings, *(f.reason for f in found.failed)])
    return Trial(
        o, truth, found.status[0][0], complex(found.response[0, 0]), float(found.error[0, 0]),
        None if certificate is None else certificate.reached, why, time.process_time() - begin,
    )  # fmt: skip


def oscillators(count: int, seed: int, kinds: Sequence[str] = tuple(KINDS)) -> Iterator[Oscillator]:
    """Yield random oscillators of each kind."""
    random = np.random.default_rng(seed)
    for kind in kinds:
        yield from (random_oscillator(kind, random) for _ in range(count))


def lines(found: Sequence[Trial]) -> Iterator[str]:
    """Yield the table: how often each verdict was given to each kind."""
    for kind in dict.fromkeys(t.oscillator.kind for t in found):
        of = Counter(t.verdict for t in found if t.oscillator.kind == kind)
        yield f"{kind:>10}: " + "; ".join(f"{n} {verdict}" for verdict, n in of.most_common())
    for t in found:
        if "wrong" in t.verdict or "beyond" in t.verdict:
            yield f"{t.verdict}: {t.oscillator}: {t.truth}, reported {t.response} ± {t.error}"


def good(found: Sequence[Trial]) -> bool:
    """Return whether no settled point is wrong, and 95 % of the averages that state an error are within it."""
    of = Counter(t.verdict for t in found)
    beyond, within = of["averaged, beyond its error"], of["averaged, within its error"]
    return beyond <= 0.05 * (beyond + within) and not any(v.startswith("wrong") for v in of)


def run(*, cases: int = 30, seed: int = 1, method: str = "auto", interface: str = "me", max_periods: int = 20) -> int:
    """Return 1 if something reported is wrong.

    Args:
        cases: oscillators of each kind.
        seed: of the first.
        method: auto, or settle: waited for, not solved for.
        interface: me, or cs: as FMUs for co-simulation, where there is one.
        max_periods: waited for at most.
    """
    how = {"method": method, "max_periods": max_periods}
    found = [measure(x, truth_of(x), interface, **how) for x in oscillators(cases, seed)]
    print("\n".join(lines(found)))
    return int(not good(found))
