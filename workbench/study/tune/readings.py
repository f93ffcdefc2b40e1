"""Requirements as functions of a linear model [A B; C D], with their derivatives by it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.matrices import resolvent
from workbench.core.values.modal import at_rest, uncertainty
from workbench.core.values.poles import natural_frequency_hz
from workbench.core.values.sine_curve import SineCurve
from workbench.loops.loop.request import openings
from workbench.study.requirements.base import Limited, Requirement, convert
from workbench.study.requirements.curves import sine_curve
from workbench.study.requirements.margins import (
    DelayMargin,
    DiskMarginRequirement,
    GainMargin,
    PeakSensitivity,
    PhaseMargin,
)
from workbench.study.requirements.models import Damping, PoleFrequency, StabilityRequirement
from workbench.study.requirements.norms import H2Norm, HInfinityNorm, TransferNorm, numbers_of
from workbench.study.requirements.response import Bandwidth, Gain, Mask, OfResponse, Phase
from workbench.study.tune.family import Member

__all__ = ["Distance", "closed_poles", "is_linear", "readings", "scale_of"]

_DENSE = 30  # frequencies per decade that are looked at, besides those around the poles
_FINER = 5  # rounds in which the neighbourhood of a peak is divided by eight
_FLAT = 1e-9  # relative: a maximum that rises by less is rounding
_MOST = 8  # peaks that are followed
_LOW = 0.5  # peaks below this part of the largest one are left out
_DB = 20.0 / math.log(10.0)
_UNITS = {"dB": 6.0, "deg": 45.0}  # what a requirement counts in: the margins of the textbooks, not their limits
_NONE = {"1": 0.1, "1/s": 1.0}  # likewise where the limit is 0


@dataclass(frozen=True, eq=False)
class Distance:
    """A number at one place.

    Attributes:
        value: in its own unit; of a requirement with limits at each place, the distance inside of them.
        weight: derivative by M = [A B; C D], shape as M.
        place: a frequency [Hz] or a pole [1/s].
    """

    value: float
    weight: Floats
    place: complex


def scale_of(limit: Mapping[str, float | bool | str], unit: str | None) -> float:
    """Return the unit in which the distance from a limit counts: a margin of 1 is one limit, of 6 dB or of 45 deg.

    Args:
        limit: as in `Compliance`.
        unit: of it.
    """
    numbers = [abs(x) for n, x in limit.items() if isinstance(x, int | float) and (n != "equal" or len(limit) == 1)]
    return _UNITS.get(unit or "1") or min((x for x in numbers if x > 0.0), default=_NONE.get(unit or "1", 1.0))


def is_linear(requirement: Requirement, command: str, options: Mapping[str, object]) -> bool:
    """Return whether a requirement is a function of a linear model with known derivatives.

    Args:
        requirement: of a study.
        command: of its analysis.
        options: of that.
    """
    measured = command == "loop" and ("amplitude" in options or getattr(requirement, "source", None) == "measured")
    if command == "loop":  # of several places the disk margins are those of all, which µ tells
        places: Any = options.get("open", "")
        measured = measured or places == "all" or len(openings(places)) > 1
    return command in ("lin", "loop") and type(requirement) in _READERS and not measured and "over" not in options


def readings(requirement: Requirement, member: Member) -> list[Distance]:
    """Return the distances inside the limits, negative outside, at every place that counts.

    Args:
        requirement: that `is_linear`.
        member: model of its analysis; for a margin the loop transfer for negative feedback.

    Raises:
        InputError: no such input or output.
    """
    reader = _READERS[type(requirement)]
    if not isinstance(requirement, Limited):
        return list(reader(requirement, member))
    unit = requirement.units[0]
    own = requirement.unit or unit
    low, high, equal = ((None if x is None else convert(float(x), own, unit, requirement.name)) for x in (
        requirement.min, requirement.max, requirement.equal))  # fmt: skip
    if isinstance(requirement, Bandwidth) and equal is None:
        return _within(requirement, member, low, high)
    width = requirement.tolerance if requirement.relative is None else requirement.relative * abs(equal or 0.0)
    result, sense = [], _SENSES.get(type(requirement), 0.0)
    found = list(reader(requirement, member))
    if not found and sense < 0.0:  # without a crossing a margin is infinite
        found = [Distance(math.inf, np.zeros((len(member.left), member.right.shape[1])), math.inf)]
    extreme = max(found, key=lambda r: sense * r.value, default=None)
    for r in found:
        if low is not None and (sense <= 0.0 or r is extreme):
            result.append(Distance(r.value - low, r.weight, r.place))
        if high is not None and (sense >= 0.0 or r is extreme):
            result.append(Distance(high - r.value, -r.weight, r.place))
        if equal is not None and (sense == 0.0 or r is extreme):
            side = math.copysign(1.0, r.value - equal)
            result.append(Distance(float(width or 0.0) - abs(r.value - equal), -side * r.weight, r.place))
    return result


def _of_poles(
    member: Member, value: Callable[[complex], tuple[float, complex]], band: Sequence[float] | None = None
) -> Iterator[Distance]:
    """Yield a number of each pole.

    Args:
        member: the model.
        value: pole → the number f and c, where df = Re(c dλ).
        band: natural frequencies that count [Hz]; None: all but integrators.
    """
    poles, left, right = member.poles
    still = np.abs(poles) <= uncertainty(member.system.A, poles, left, right) if len(poles) else ()
    low, high = band or (0.0, math.inf)
    rows, columns = len(member.left), member.right.shape[1]
    for k, pole in enumerate(poles.tolist()):
        hz = float(natural_frequency_hz(pole))
        if not still[k] and pole.imag >= 0.0 and low <= hz <= high:
            number, c = value(pole)
            weight = np.zeros((rows, columns))
            weight[: len(poles), : len(poles)] = np.real(c * np.outer(left[:, k].conj(), right[:, k]))
            yield Distance(number, weight, pole)


def closed_poles(member: Member, *, loop: bool) -> list[Distance]:
    """Return the real parts of the poles, integrators left out [1/s].

    Args:
        member: the model.
        loop: whether it is a loop transfer L, and the poles are those of 1/(1 + L).
    """
    if not loop:
        return list(_of_poles(member, _real_part))
    a, b, c, d = member.system.A, member.system.B, member.system.C, member.system.D
    into, out = b / (1.0 + d[0, 0]), c / (1.0 + d[0, 0])
    n = len(a)
    closed = Member(Linear(a - into @ c, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0))), np.zeros((n, 0)),
                    np.zeros((0, n)), {}, {})  # fmt: skip
    above, beside = np.vstack([np.eye(n), -into.T]), np.hstack([np.eye(n), -out.T])
    return [Distance(r.value, above @ r.weight @ beside, r.place) for r in _of_poles(closed, _real_part)]


def _real_part(pole: complex) -> tuple[float, complex]:
    """Return the real part, and c of `of_poles`."""
    return pole.real, 1.0


def _damping(pole: complex) -> tuple[float, complex]:
    size = abs(pole)
    a, b = -(pole.imag**2) / size**3, pole.real * pole.imag / size**3
    return -pole.real / size, complex(a, -b)


def _frequency(pole: complex) -> tuple[float, complex]:
    return abs(pole) / (2.0 * math.pi), pole.conjugate() / abs(pole) / (2.0 * math.pi)


# -- frequency responses ---------------------------------------------------------------------------


def _rank_one(member: Member, hz: float, out: Complex, into: Complex) -> Floats:
    """Return the derivative of Re(outᴴ G into) by M, where out holds the factor of a complex function."""
    a, b, c = member.system.A, member.system.B, member.system.C
    if math.isinf(hz):
        x, y = np.zeros(len(a), dtype=np.complex128), np.zeros(len(a), dtype=np.complex128)
    else:
        s = member.system.at_frequency(hz)
        x = resolvent(a, (b @ into)[:, None], s)[0, :, 0]
        y = resolvent(a.T, (c.T @ out.conj())[:, None], s)[0, :, 0]
    return np.real(np.outer(np.concatenate([y, out.conj()]), np.concatenate([x, into])))


def _of_value(member: Member, hz: float, c: complex, row: int = 0, column: int = 0) -> Floats:
    """Return the derivative of a function f of G at a frequency, df = Re(c dG)."""
    q, m = member.system.D.shape
    out, into = np.zeros(q, dtype=np.complex128), np.zeros(m, dtype=np.complex128)
    out[row], into[column] = np.conj(c), 1.0
    return _rank_one(member, hz, out, into)


def _grid(system: Linear) -> Floats:
    """Return frequencies around the poles, rising [Hz]."""
    poles = system.poles
    rates = natural_frequency_hz(poles[~at_rest(system.A, poles)])
    ends = (float(rates.min()) / 100.0, float(rates.max()) * 100.0) if len(rates) else (0.01, 100.0)
    broad = np.geomspace(ends[0], ends[1], int(_DENSE * math.log10(ends[1] / ends[0])))
    near = np.concatenate([rates * factor for factor in (0.97, 1.0, 1.03)])
    return np.unique(np.concatenate([broad, near[(near > ends[0]) & (near < ends[1])]]))


def _peaks(size: Callable[[Floats], Floats], grid: Floats, ends: Sequence[float] = ()) -> list[tuple[float, float]]:
    """Return (frequency, value) of the local maxima of a positive function, the ends included, largest first."""
    values = np.nan_to_num(size(grid), nan=0.0, posinf=0.0)
    grid, values = _uneven(grid, values)
    beside = np.maximum(values[:-2], values[2:])
    inner = np.flatnonzero((values[1:-1] > beside) & (values[1:-1] > _LOW * values.max(initial=0.0))) + 1
    inner = inner[np.argsort(-values[inner])[:_MOST]]
    low, top, high = grid[inner - 1], grid[inner], grid[inner + 1]
    for _ in range(_FINER if len(inner) else 0):
        parts = np.linspace(0.0, 1.0, 9)
        fine = np.exp(np.log(low)[:, None] * (1.0 - parts) + np.log(high)[:, None] * parts)
        best = np.argmax(np.nan_to_num(size(fine.ravel()), nan=-np.inf).reshape(fine.shape), axis=1)
        rows = np.arange(len(fine))
        low, top, high = fine[rows, np.maximum(best - 1, 0)], fine[rows, best], fine[rows, np.minimum(best + 1, 8)]
    top = np.where(np.nan_to_num(size(top)) < values[inner], grid[inner], top)  # a peak narrower than the parts stays
    places = np.concatenate([top, list(ends), grid[[0, -1]]])
    found = np.nan_to_num(size(places), nan=-np.inf)
    order = [k for k in np.argsort(-found) if found[k] > _LOW * found.max()]
    return [(float(places[k]), float(found[k])) for k in order]


def _uneven(grid: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the points whose value differs from that of the one kept before, so that no neighbours are equal.

    Grids may hold a frequency twice but for rounding: of two such points none would be higher than both its neighbours.
    """
    kept = [0]
    for k, value in enumerate(values.tolist()):
        if abs(value - values[kept[-1]]) > _FLAT * max(value, values[kept[-1]]):
            kept.append(k)
    kept = kept if kept[-1] == len(grid) - 1 else [*kept, len(grid) - 1]
    return grid[kept], values[kept]


def _singular(requirement: TransferNorm, member: Member) -> Iterator[Distance]:
    """Yield the singular values at the peaks of the largest one."""
    system = member.system
    columns = numbers_of("input", requirement.inputs, system.input_names)
    rows = numbers_of("output", requirement.outputs, system.output_names)

    def transfer(f: Floats) -> Complex:
        return system.response(f)[:, rows][:, :, columns]

    def largest(f: Floats) -> Floats:
        g = transfer(f)
        bad = ~np.isfinite(g).all(axis=(1, 2))
        g[bad] = 0.0
        return np.where(bad, np.nan, np.linalg.svd(g, compute_uv=False)[:, 0])

    q, m = system.D.shape
    for hz, peak in _peaks(largest, _grid(system), (0.0, math.inf)):
        u, s, vh = np.linalg.svd(transfer(np.array([hz]))[0])
        for k in range(len(s)):
            if s[k] > 0.8 * peak:
                out, into = np.zeros(q, dtype=np.complex128), np.zeros(m, dtype=np.complex128)
                out[rows], into[columns] = u[:, k], vh[k].conj()
                yield Distance(float(s[k]), _rank_one(member, hz, out, into), hz)


def _variance(requirement: TransferNorm, member: Member) -> Iterator[Distance]:
    from scipy.linalg import solve_continuous_lyapunov  # noqa: PLC0415 - slow to import

    part = requirement.part(member.system)
    seen, moved = (
        solve_continuous_lyapunov(a, -w) for a, w in ((part.A.T, part.C.T @ part.C), (part.A, part.B @ part.B.T))
    )
    norm = math.sqrt(max(float(np.trace(part.C @ moved @ part.C.T)), 1e-300))
    n = len(part.A)
    columns = numbers_of("input", requirement.inputs, member.system.input_names)
    rows = numbers_of("output", requirement.outputs, member.system.output_names)
    weight = np.zeros((len(member.left), member.right.shape[1]))
    weight[:n, :n] = seen @ moved / norm
    weight[:n, [n + k for k in columns]] = seen @ part.B / norm
    weight[[n + k for k in rows], :n] = part.C @ moved / norm
    yield Distance(norm if not np.any(part.D) else math.inf, weight, 1.0)


def _part(system: Linear) -> LinearPart:
    return LinearPart(system.A, system.B, system.C, system.D)


def _along(system: Linear, hz: float) -> complex:
    """Return dL by the frequency [1/Hz]."""
    s = system.at_frequency(hz)
    x = resolvent(system.A, system.B, s)[0]
    return complex(-2j * math.pi * (system.C @ resolvent(system.A, x, s)[0])[0, 0])


def _gain_margin(_: Requirement, member: Member) -> Iterator[Distance]:
    for crossing in member.margins.phase_crossovers:
        if crossing.factor > 1.0:
            hz = crossing.frequency_hz
            rate = _along(member.system, hz) if 0.0 < hz < math.inf else 0j
            c = complex(1.0, rate.real / rate.imag) if rate.imag != 0.0 else 1.0
            yield Distance(crossing.db, _of_value(member, hz, _DB * crossing.factor * c), hz)


def _gain_crossings(member: Member) -> Iterator[tuple[float, float, float, Floats, Floats]]:
    """Yield frequency, phase margin, delay, and the derivatives of phase [deg] and frequency [Hz]."""
    loop = _part(member.system)
    for crossing in member.margins.gain_crossovers:
        hz = crossing.frequency_hz
        value = loop.at(hz)
        u, rate = value / abs(value), _along(member.system, hz)
        radial, turn = (u.conjugate() * rate).real, (u.conjugate() * rate).imag
        if radial == 0.0:
            continue
        c = u.conjugate() * (-1j - turn / radial) / abs(value)  # of arg L at the crossing
        yield (
            hz, crossing.phase_margin_deg, crossing.delay_s, math.degrees(1.0) * _of_value(member, hz, c),
            _of_value(member, hz, -u.conjugate() / radial),
        )  # fmt: skip


def _phase_margin(_: Requirement, member: Member) -> Iterator[Distance]:
    # Of a stable loop: a lead leads to the border as a lag does.
    for hz, margin, _delay, phase, _f in _gain_crossings(member):
        yield Distance(abs(margin), math.copysign(1.0, margin) * phase, hz)


def _delay_margin(_: Requirement, member: Member) -> Iterator[Distance]:
    if member.margins.direct >= 1.0:
        yield Distance(0.0, np.zeros((len(member.left), member.right.shape[1])), math.inf)
    for hz, _margin, delay, phase, moved in _gain_crossings(member):
        yield Distance(delay, phase / 360.0 / hz - delay / hz * moved, hz)


def _sensitivity(_: Requirement, member: Member) -> Iterator[Distance]:
    loop = _part(member.system)
    for hz, size in _peaks(lambda f: 1.0 / np.abs(1.0 + loop.response(f)), _closed_grid(loop), (math.inf,)):
        s = 1.0 / (1.0 + loop.at(hz))
        yield Distance(size, _of_value(member, hz, -np.conj(s) / abs(s) * s * s), hz)


def _disk_margin(_: Requirement, member: Member) -> Iterator[Distance]:
    loop = _part(member.system)

    def size(f: Floats) -> Floats:
        value = loop.response(f)
        return np.asarray(np.abs((1.0 - value) / (1.0 + value)))

    for hz, largest in _peaks(size, _closed_grid(loop), (math.inf,)):
        value = loop.at(hz)
        x = (1.0 - value) / (1.0 + value)
        c = np.conj(x) / abs(x) * -2.0 / (1.0 + value) ** 2
        yield Distance(2.0 / largest, _of_value(member, hz, -2.0 / largest**2 * c), hz)


def _closed_grid(loop: LinearPart) -> Floats:
    return np.union1d(_grid(loop), _grid(loop.sensitivity()))


def _places(requirement: OfResponse, system: Linear) -> tuple[int, int]:
    wanted = (("output", requirement.output, system.output_names), ("input", requirement.input, system.input_names))
    row, column = (numbers_of(what, None if name is None else [name], names)[0] for what, name, names in wanted)
    return row, column


def _derivative(member: Member, hz: float, place: tuple[int, int], quantity: str) -> Floats:
    value = complex(member.system.response(hz)[0][place]) or 1e-300
    return _of_value(member, hz, (_DB if quantity == "gain" else -1j * math.degrees(1.0)) / value, *place)


def _curve(member: Member, at: Sequence[float], place: tuple[int, int], quantity: str) -> tuple[Floats, Floats]:
    """Return frequencies and gain [dB] or phase [deg]."""
    f = np.union1d(_grid(member.system), _sines(member, place).grid(at))
    return f, _of_curve(member, f, place, quantity)


@lru_cache(maxsize=32)
def _sines(member: Member, place: tuple[int, int]) -> SineCurve:
    """Return the response of one entry, with the poles and zeros that turn it."""
    system, (row, column) = member.system, place
    poles = system.poles[~at_rest(system.A, system.poles)]
    return sine_curve(
        system, lambda f: system.response(f)[:, row, column], poles=poles.tolist(), row=row, column=column
    )


def _of_curve(member: Member, f: Floats, place: tuple[int, int], quantity: str) -> Floats:
    sines = _sines(member, place)
    return sines.gain(f) if quantity == "gain" else sines.phase(f)


def _at_frequency(requirement: Requirement, member: Member) -> Iterator[Distance]:
    assert isinstance(requirement, Gain | Phase)  # noqa: S101 - by `_READERS`
    place, hz = _places(requirement, member.system), requirement.frequency
    f, curve = _curve(member, [hz], place, requirement.quantity)
    value = float(curve[np.searchsorted(f, hz)])
    yield Distance(value, _derivative(member, hz, place, requirement.quantity), hz)


def _mask(requirement: Requirement, member: Member) -> Iterator[Distance]:
    assert isinstance(requirement, Mask)  # noqa: S101 - by `_READERS`
    place = _places(requirement, member.system)
    f = _sines(member, place).grid(requirement.corners)
    for corners, sign in ((requirement.upper, -1.0), (requirement.lower, 1.0)):
        if corners:
            inside = f[(f >= corners[0][0] * (1.0 - 1e-12)) & (f <= corners[-1][0] * (1.0 + 1e-12))]
            yield from _least(member, inside, place, requirement.quantity, partial(_inside, corners, sign))


def _inside(corners: Sequence[Sequence[float]], sign: float, f: Floats) -> tuple[Floats, float]:
    """Return the level of a mask, and +1 where the curve is to be above it, −1 where below."""
    x, y = np.log([c[0] for c in corners]), [c[1] for c in corners]
    return np.interp(np.log(f), x, y), sign


def _least(
    member: Member, f: Floats, place: tuple[int, int], quantity: str, level: Callable[[Floats], tuple[Any, float]]
) -> Iterator[Distance]:
    """Yield where the distance of a curve from a level is least among its neighbours.

    Args:
        member: the model.
        f: frequencies, rising [Hz].
        place: output and input.
        quantity: gain or phase.
        level: frequencies → level, and +1 where the curve is to be above it, −1 where below.
    """

    def distance(f: Floats) -> Floats:
        wall, sign = level(f)
        return np.asarray(sign * (_of_curve(member, f, place, quantity) - wall))

    f = _sines(member, place).refined(f, distance)  # a smaller one lies between the neighbours of each least distance
    values, least = _with_least(distance(f))
    for k in least:
        weight = level(f)[1] * _derivative(member, float(f[k]), place, quantity)
        yield Distance(float(values[k]), weight, float(f[k]))


def _with_least(margin: Floats) -> tuple[Floats, list[int]]:
    """Return distances, and where they are least among their neighbours."""
    padded = np.concatenate([[math.inf], margin, [math.inf]])
    return margin, np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:])).tolist()


def _above(requirement: Bandwidth, member: Member, hz: float) -> list[Distance]:
    """Return by how much a curve lies above the level whose crossing is the bandwidth, where that is least up to hz.

    The first crossing jumps where a dip touches the level; the least distance does not. It counts as a part of hz, as
    many of it as the distance has units (6 dB, 45 deg).
    """
    place, quantity = _places(requirement, member.system), requirement.criterion
    grid = np.union1d(_grid(member.system), _sines(member, place).grid(()))
    first = min(float(grid[0]), hz / 100.0)
    free = quantity == "gain" and requirement.reference is None
    drop = requirement.angle if quantity == "phase" else (requirement.reference or 0.0) - requirement.drop
    level = drop + (float(_of_curve(member, np.array([first]), place, quantity)[0]) if free else 0.0)
    f = np.unique(np.concatenate([np.geomspace(2.0 * first, hz, _DENSE), grid[(grid > 2.0 * first) & (grid < hz)]]))
    part = hz / _UNITS["deg" if quantity == "phase" else "dB"]
    own = _derivative(member, first, place, quantity) if free else 0.0
    found = _least(member, f, place, quantity, lambda _: (level, 1.0))
    return [Distance(part * r.value, part * (r.weight - own), r.place) for r in found]


def _within(requirement: Bandwidth, member: Member, low: float | None, high: float | None) -> list[Distance]:
    """Return the distances inside the limits of a bandwidth: above the level up to the lower, below it by the upper."""
    result = [] if low is None else _above(requirement, member, low)
    if high is not None:
        least = min(_above(requirement, member, high), key=lambda r: r.value)
        result.append(Distance(-least.value, -least.weight, least.place))
    return result


def _bandwidth(requirement: Requirement, member: Member) -> Iterator[Distance]:
    assert isinstance(requirement, Bandwidth)  # noqa: S101 - by `_READERS`
    place, quantity = _places(requirement, member.system), requirement.criterion
    f, curve = _curve(member, (), place, quantity)
    free = quantity == "gain" and requirement.reference is None
    level = requirement.angle if quantity == "phase" else (
        float(curve[0]) if requirement.reference is None else requirement.reference) - requirement.drop  # fmt: skip
    below = np.flatnonzero(curve <= level)
    if not len(below) or below[0] == 0:
        value = float(f[0] if len(below) else f[-1])
        yield Distance(value, np.zeros((len(member.left), member.right.shape[1])), value)
        return
    k, first = int(below[0]), float(f[0])
    for _ in range(3):  # the straight line of the study, between points that draw closer: it tends to the crossing
        fine = np.geomspace(f[k - 1], f[k], 21)
        curve = _of_curve(member, fine, place, quantity)
        f, k = fine, max(1, int(np.argmax(curve <= level)) or 20)
    rate = (curve[k] - curve[k - 1]) / math.log(f[k] / f[k - 1])
    hz = float(f[k - 1] * math.exp((level - curve[k - 1]) / rate))
    change = _derivative(member, hz, place, quantity)
    if free:
        change = change - _derivative(member, first, place, quantity)
    yield Distance(hz, -hz / rate * change, hz)


_READERS: Mapping[type[Requirement], Callable[..., Iterator[Distance]]] = {
    StabilityRequirement: lambda requirement, member: _of_poles(member, _real_part, requirement.band),
    Damping: lambda requirement, member: _of_poles(member, _damping, requirement.band),
    PoleFrequency: lambda requirement, member: _of_poles(member, _frequency, requirement.band),
    GainMargin: _gain_margin,
    PhaseMargin: _phase_margin,
    DelayMargin: _delay_margin,
    DiskMarginRequirement: _disk_margin,
    PeakSensitivity: _sensitivity,
    HInfinityNorm: _singular,
    H2Norm: _variance,
    Gain: _at_frequency,
    Phase: _at_frequency,
    Mask: _mask,
    Bandwidth: _bandwidth,
}

# Which of its readings a requirement's number is, where it is one of them: the least, or the largest. Its limit on that
# side counts at every reading, as each may become that one; the limit on the other side, and `equal`, only there.
_SENSES: Mapping[type[Requirement], float] = {
    GainMargin: -1.0, PhaseMargin: -1.0, DelayMargin: -1.0, DiskMarginRequirement: -1.0,
    PeakSensitivity: 1.0, HInfinityNorm: 1.0,
}  # fmt: skip
