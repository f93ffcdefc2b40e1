"""A loop with transport delays, as it is: stability by the argument principle, margins of the exact L(jω)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.margins import (
    BORDER,
    STABLE,
    UNKNOWN,
    UNSTABLE,
    GainCrossover,
    Margins,
    PhaseCrossover,
    disk_of,
)
from workbench.loops.loop.margins import withheld
from workbench.loops.loop.stability import ClosedLoopStability, words_of
from workbench.loops.nyquist.level_crossings import sign_changes
from workbench.point.lin.delay_roots import delay_roots, radius, stretches
from workbench.point.lin.result import DelayFreePart

__all__ = ["delayed_margins", "delayed_stability"]

_TURN = 0.5  # rad by which all delays together turn L from one frequency to the next, at most
_ENVELOPE = 0.5  # of |L| between two frequencies of the stretches, at least
_MOST = 200_000  # frequencies
_TURNS = 4.0 * math.pi  # of all delays, beyond where |L| stays below 1: the axis is crossed there, too
_BELOW = 1e-3  # of the slowest pole: below L goes as at 0
_ROUNDING = 1e-13  # of |L|: an imaginary part below this has no sign
_REAL = 1e-3  # of |L|: at a crossing of the real axis the imaginary part is far below, beside a pole it is not
_HIGHEST = 8  # maxima on the grid that are looked at closely


def delayed_stability(loop: DelayFreePart, transfer: LinearPart) -> ClosedLoopStability:
    """Return whether 1/(1 + L) is stable, with delays that are e^(−sT).

    Args:
        loop: L with its delays taken out.
        transfer: L with Padé approximations; its poles are where the search begins, no more.

    Raises:
        InputError: the closed loop has no solution.
    """
    near = transfer.sensitivity().poles if transfer.solvable(-1.0) else transfer.poles
    found, before = delay_roots(_closed(loop), near), delay_roots(loop, transfer.poles)
    right = found.roots[found.roots.real > 0.0]
    # A root that is found is a proof, whatever could be counted; with none, only the count is.
    known = np.abs(right.real) > 1e-7 * np.abs(right)
    unstable = found.right.number > 0.0 or bool(known.any() and not found.border)
    verdict = UNSTABLE if unstable else BORDER if found.border else STABLE if found.right.number == 0.0 else UNKNOWN
    many = found.right.number if math.isfinite(found.right.number) else float(len(right))
    bad = right if unstable else found.roots[:1]
    if verdict == UNKNOWN:
        words = f"whether the closed loop is stable is not known: {found.right.why}"
    elif unstable and not math.isfinite(found.right.number) and found.right.why and not len(right):
        words = f"the closed loop is unstable: {found.right.why}; the margins are then meaningless"
    else:
        words = f"{words_of(verdict, found.roots, bad, before.roots, 0.0)} (with the delays as they are)"
    opened = before.right.number if math.isfinite(before.right.number) else float(np.sum(before.roots.real > 0.0))
    return ClosedLoopStability(verdict, found.roots, int(opened), int(many), words)


def _closed(loop: DelayFreePart) -> DelayFreePart:
    whole = Linear(loop.A, loop.B, loop.C, loop.D).with_feedback(-1.0)
    return DelayFreePart(whole.A, whole.B, whole.C, whole.D, loop.times)


@dataclass(frozen=True)
class _DelayedCurve:
    """L on the imaginary axis.

    Attributes:
        loop: it.
        hz: frequencies between which L changes little, rising [Hz].
        end: largest |L| at infinite frequency.
    """

    loop: DelayFreePart
    hz: Floats
    end: float

    def response(self, hz: Floats) -> Complex:
        """Return L, shape (k,); NaN on a pole."""
        with np.errstate(all="ignore"):
            return np.asarray(self.loop.response(hz)[:, 0, 0], dtype=np.complex128)

    def at(self, hz: float) -> complex:
        """Return L at one frequency [Hz]."""
        return complex(self.response(np.array([hz]))[0])


def delayed_margins(loop: DelayFreePart, stability: ClosedLoopStability) -> Margins:
    """Return the margins of L with delays that are e^(−sT).

    L is followed from stretch to stretch, each so short that neither a pole of the open or closed loop nor a delay can
    turn it unseen (see `delay_roots`), up to where |L| stays below 1 for good (Perron's bound) and two turns further.
    Where |L| is below its value at the nearest crossing of the axis, the delays' turns do not matter.

    Args:
        loop: L with its delays taken out.
        stability: of the closed loop.
    """
    curve = _curve(loop, stability)
    if curve is None:
        why = "it takes too many frequencies to follow the delays up to where they do no more"
        return withheld(replace(stability, verdict=UNKNOWN, words=f"{stability.words}; {why}"))
    gain = sign_changes(lambda f: np.log(np.abs(curve.response(f))), np.log(curve.hz))
    inner = stability.verdict not in (BORDER, UNKNOWN)
    peaks = {
        "s": lambda v: 1.0 / np.abs(1.0 + v),
        "t": lambda v: np.abs(v / (1.0 + v)),
        "d": lambda v: np.abs((1.0 - v) / (1.0 + v)),
    }  # fmt: skip
    at = {name: _peak(curve, size) if inner else (math.nan, math.nan) for name, size in peaks.items()}
    return Margins(
        verdict=stability.verdict,
        words=stability.words,
        phase_crossovers=tuple(_phase_crossovers(curve)),
        gain_crossovers=tuple(GainCrossover.of(f, curve.at(f)) for f in gain),
        disk=disk_of(*at["d"]) if stability.stable else None,
        peak_sensitivity=math.inf if stability.verdict == BORDER else at["s"][0],
        peak_sensitivity_hz=at["s"][1],
        peak_complementary=math.inf if stability.verdict == BORDER else at["t"][0],
        peak_complementary_hz=at["t"][1],
        direct=curve.end,
    )


def _curve(loop: DelayFreePart, stability: ClosedLoopStability) -> _DelayedCurve | None:
    """Return L at frequencies that show all it does; None: they would be too many."""
    closed = _closed(loop)
    # The opened connection is one more delay, of 0 s and any phase: beyond that radius no phase closes the loop.
    whole = replace(loop, times=np.concatenate([[0.0], loop.times]))
    tops = [r for r in (radius(whole), radius(closed), radius(loop)) if math.isfinite(r)]
    if not tops:
        return None
    turn = 1.0 / max(float(loop.times.sum()), 1e-300)
    top = max(tops) + _TURNS * turn
    coarse = _union([stretches(part, top, math.inf) for part in (loop, closed)], top)
    sizes = np.abs(np.concatenate([np.linalg.eigvals(loop.A), stability.poles]))
    sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
    slowest = min(float(sizes.min(initial=math.inf)), top)
    if coarse is None:
        return None
    first = _from(coarse, _BELOW * slowest, slowest)
    curve = _DelayedCurve(loop, first / (2.0 * math.pi), _end(loop))
    size = np.abs(curve.response(curve.hz))
    level = 1.0
    for _ in range(2):  # up to where |L| is 1; then to where it is that of the crossing of the axis found last
        large = first[~(size < _ENVELOPE * level)]
        high = min(top, (float(large[-1]) if len(large) else 0.0) + _TURNS * turn)
        if high > _MOST * _TURN * turn:
            return None
        fine = np.arange(_TURN * turn, high, _TURN * turn)
        curve = _DelayedCurve(loop, np.union1d(first, fine[fine > first[0]]) / (2.0 * math.pi), curve.end)
        value = curve.response(curve.hz)
        crossed = (np.diff(np.sign(value.imag)) != 0) & (value[:-1].real < 0.0) & (np.abs(value[:-1]) < 1.0)
        level = float(np.abs(value[:-1][crossed]).max(initial=0.0)) or level
    return curve


def _union(ends: Sequence[Floats], top: float) -> Floats | None:
    """Return all frequencies; None: the stretches do not reach the last."""
    if any(e[-1] < top * (1.0 - 1e-9) for e in ends):
        return None
    return np.unique(np.concatenate(ends))


def _from(omega: Floats, low: float, slowest: float) -> Floats:
    """Return frequencies from `low` on, with some up to the slowest pole."""
    return np.union1d(omega[omega >= low], np.geomspace(low, slowest, 40))


def _end(loop: DelayFreePart) -> float:
    """Return the largest |L| at infinite frequency, where delays turn as they like."""
    d, k = np.abs(loop.D), len(loop.times)
    if not math.isfinite(radius(loop)):
        return float(d[0, 0])
    passed = np.linalg.solve(np.eye(k) - d[1:, 1:], d[1:, :1])
    return float((d[:1, :1] + d[:1, 1:] @ passed)[0, 0])


def _phase_crossovers(curve: _DelayedCurve) -> list[PhaseCrossover]:
    def imaginary(f: Floats) -> Floats:
        value = curve.response(f)
        size = np.abs(value)
        there = ~(np.abs(value.imag) <= _ROUNDING * size)
        return np.divide(value.imag, size, out=np.zeros(len(size)), where=there)

    result = []
    for f in sign_changes(imaginary, np.log(curve.hz)):
        value = curve.at(f)
        if _negative(value) and abs(value.imag) < _REAL * abs(value):
            upwards = curve.at(f * (1.0 + 1e-6)).imag > curve.at(f * (1.0 - 1e-6)).imag
            result.append(PhaseCrossover(f, 1.0 / abs(value), upwards))
    first = curve.at(0.0)
    if _negative(first):
        result.insert(0, PhaseCrossover(0.0, 1.0 / abs(first)))
    direct = float(curve.loop.D[0, 0])
    if curve.end > max(direct, 0.0):  # a chain of crossings with gains that tend to this
        result.append(PhaseCrossover(math.inf, 1.0 / curve.end))
    return result


def _negative(value: complex) -> bool:
    return bool(np.isfinite(value)) and value.real < 0.0 and 1e-15 < abs(value) < 1e15


def _peak(curve: _DelayedCurve, size: Callable[[Complex], Floats]) -> tuple[float, float]:
    """Return the largest size of what is made of L, and where [Hz]."""

    def of(f: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return np.nan_to_num(size(curve.response(f)), nan=-np.inf, posinf=np.inf)

    hz, here = curve.hz, of(curve.hz)
    with np.errstate(all="ignore"):  # in the chain at infinite frequency every phase of L is met
        last = float(size(np.array([-curve.end + 0j]))[0]) if curve.end < 1.0 else -math.inf
    best = max((float(here.max()), float(hz[here.argmax()])), (float(of(np.zeros(1))[0]), 0.0), (last, math.inf))
    inner = np.flatnonzero((here[1:-1] >= here[:-2]) & (here[1:-1] >= here[2:])) + 1
    for k in inner[np.argsort(-here[inner])][:_HIGHEST].tolist():
        bounds = (math.log(hz[k - 1]), math.log(hz[k + 1]))
        found = minimize_scalar(
            lambda t: -of(np.exp([t]))[0], bounds=bounds, method="bounded", options={"xatol": 1e-12}
        )
        best = max(best, (-float(found.fun), math.exp(float(found.x))))
    return best
