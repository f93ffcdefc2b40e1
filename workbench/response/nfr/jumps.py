"""Signs, in a nonlinear frequency response, that there is a second stable one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from workbench.response.nfr.curve import STEEPER
from workbench.response.nfr.point import NfrPoint
from workbench.response.nfr.prior_knowledge import LinearStart

__all__ = [
    "ANOTHER",
    "MISSED",
    "another",
    "disagreements",
    "jumps",
    "may_jump",
    "solved",
    "stepped_over",
    "unseen_peaks",
]

# What notes say of stable responses that were not measured; the page looks for it.
ANOTHER, MISSED = "another stable", "there is a stable response"

# A change between neighbouring frequencies this large, and `STEEPER` times the changes beside it, is a jump.
_LARGE = 0.5

_AFRESH = "on one side there are probably two stable responses"
_CARRIED = "the one that the sweep followed ends there; points in between were measured on the way"
# Interface → what shows the others.
_OTHERS = {"me": "`branches` shows all", "cs": "sweeps with `carry`, one rising and one falling, show both"}

# A linear response does not jump; one this much distorted may.
_DISTORTED = 0.005

# Two measurements of one point that differ by more than this, and by more than so many times their errors, are two
# responses.
_APART, _ERRORS = 0.05, 3.0

# A response may fold back where it departs from the linear one by more than this, and is distorted by so much.
_BENT, _BENDS = 0.03, 3e-4
_MEMORY = 0.5


def jumps(row: Sequence[NfrPoint], *, carried: bool = False, interface: str = "me") -> list[str]:
    """Return a line for each place where the response jumps from one frequency to the next.

    A branch of periodic responses that folds back ends there, and the model goes to another branch, which must have
    been stable before the jump, too. Seen from four points on; only where the output is distorted.

    Args:
        row: points of one amplitude, rising in frequency.
        carried: whether the state was kept from one to the next; then those that have not settled count, too, as far
            as their errors allow: while it jumps, and beside that, hardly any settles.
        interface: of the model.
    """
    good = [p for p in row if p.response and (p.status == "settled" or (carried and _is_known(p)))]
    changes = [_apart(a, b) for a, b in pairwise(good)]
    result = []
    for i, change in enumerate(changes):
        beside = [changes[k] for k in (i - 1, i + 1) if 0 <= k < len(changes)]
        low, high = good[i], good[i + 1]
        if change < _LARGE or len(beside) < 1 or len(good) < 4 or change < STEEPER * max(beside):
            continue
        if change <= (low.error or 0.0) + (high.error or 0.0):
            continue
        if max(_distortion(low), _distortion(high)) >= _DISTORTED:
            where = f"between {low.frequency:.6g} and {high.frequency:.6g} Hz, amplitude {low.amplitude:g}"
            gains = f"from gain {abs(low.response or 0.0):.4g} to {abs(high.response or 0.0):.4g}"
            why = _CARRIED if carried else _AFRESH
            result.append(f"{where}, the response jumps {gains}: {why}; {_OTHERS[interface]}")
    return result


def _is_known(point: NfrPoint) -> bool:
    return point.error is not None and point.error < _LARGE


def disagreements(
    points: Mapping[tuple[float, float], NfrPoint], before: Mapping[tuple[float, float], NfrPoint]
) -> list[str]:
    """Return a line if points settled at another response in an earlier run.

    Args:
        points: by amplitude and frequency.
        before: of the earlier run, likewise.
    """
    both = [(p, before[key]) for key, p in points.items() if key in before]
    differ = [(new, old) for new, old in both if new.status == old.status == "settled" and _contradict(new, old)]
    if not differ:
        return []
    new, old = differ[0]
    others = f" and {len(differ) - 1} more" if len(differ) > 1 else ""
    where = f"{new.frequency:.6g} Hz, amplitude {new.amplitude:g}{others}"
    gains = f"{abs(new.response or 0.0):.4g} in this run, {abs(old.response or 0.0):.4g} in the earlier one"
    return [f"{where}: two stable responses: gain {gains}"]


def _contradict(new: NfrPoint, old: NfrPoint) -> bool:
    """Whether two measurements of one point are two responses."""
    errors = (new.error or 0.0) + (old.error or 0.0)
    return _apart(new, old) > max(_APART, _ERRORS * errors)


def _apart(a: NfrPoint, b: NfrPoint) -> float:
    """Return by how much two responses differ, relative to the larger one."""
    first, second = a.response or 0.0, b.response or 0.0
    largest = max(abs(first), abs(second))
    return abs(first - second) / largest if largest > 0.0 else 0.0


def _distortion(point: NfrPoint) -> float:
    return (point.certificate.thd or 0.0) if point.certificate is not None else 0.0


def solved(row: Sequence[NfrPoint]) -> bool:
    """Return whether responses of one amplitude were solved for, so that others can be.

    Args:
        row: points of one amplitude.
    """
    return sum(p.certificate is not None and p.certificate.method == "solved" for p in row) >= _FEWEST


def unseen_peaks(frequencies: Sequence[float], linear: LinearStart | None) -> list[float]:
    """Return resonances of the linear model that a sweep steps over [Hz]: the states move more there than elsewhere.

    Args:
        frequencies: of the sweep [Hz].
        linear: the linear model where its points start.
    """
    if linear is None or len(linear.dx0) == 0:
        return []
    poles = np.linalg.eigvals(linear.part.A) if linear.modes is None else linear.modes.poles
    light = poles[(poles.imag > 0.0) & (np.abs(poles.real) < _LIGHT * np.abs(poles))]
    peaks: dict[float, float] = {}
    for f in (np.abs(light) / (2.0 * math.pi)).tolist():
        away = np.abs(np.log(np.array(frequencies) / f))
        there, here = linear.forced(f), linear.forced(frequencies[int(np.argmin(away))])
        if away.min() < math.log(_NEAR) and there is not None and here is not None:
            moves = np.abs(here.states)
            peaks[f] = float(np.max(np.abs(there.states)[moves > 0.0] / moves[moves > 0.0], initial=0.0))
    return sorted(f for f, higher in peaks.items() if higher > _HIGHER)[:_MOST_PEAKS]


def stepped_over(row: Sequence[NfrPoint], between: Sequence[NfrPoint]) -> list[str]:
    """Return a line for each peak of the gain that was measured between the points of a sweep.

    Args:
        row: points of one amplitude, rising in frequency.
        between: others of that amplitude, at resonances of the linear model.
    """
    good = [p for p in row if p.response is not None]
    result = []
    for low, high in pairwise(good):
        inside = [p for p in between if low.frequency < p.frequency < high.frequency and p.response is not None]
        top = max(inside, key=_size, default=None)
        beside = max(_size(low), _size(high))
        if top is not None and _size(top) > (_PEAKS + (top.error or 0.0)) * beside:
            where = f"between {low.frequency:.6g} and {high.frequency:.6g} Hz, amplitude {top.amplitude:g}"
            gains = f"{_gain(top)} at {top.frequency:.4g} Hz, {_gain(low)} and {_gain(high)} at the points beside"
            result.append(
                f"{where}, the gain peaks: {gains}; for the peak itself give a smaller `ratio`, or frequencies there"
            )
    return result


def may_jump(row: Sequence[NfrPoint], linear: LinearStart | None) -> bool:
    """Return whether the responses of one amplitude are nonlinear enough for a second one to be worth a look.

    Args:
        row: points of one amplitude.
        linear: the linear model where they start.
    """
    if linear is None or max(map(_distortion, row), default=0.0) < _BENDS:
        return False
    return any(_bent(p, linear) > _BENT and _remembers(p) for p in row)


_FEWEST = 3  # points
_PEAKS = 1.01  # a gain that is larger than those beside it by less is no peak

# A resonance is light below this damping ratio, and beside the sweep up to this factor of frequency. It has been
# stepped over where the states move more than so many times as far as at the next point; so many are looked at.
_LIGHT, _NEAR, _HIGHER, _MOST_PEAKS = 0.25, 2.0, 1.1, 4


def _remembers(point: NfrPoint) -> bool:
    """Whether a deviation may outlive a period: without that, every period leads to the same response."""
    if point.certificate is None or point.certificate.method != "solved":
        return True
    return max(map(abs, point.certificate.multipliers), default=0.0) > _MEMORY


def _bent(point: NfrPoint, linear: LinearStart) -> float:
    forced = linear.forced(point.frequency)
    if forced is None or point.response is None:
        return 0.0
    largest = max(abs(forced.response), abs(point.response))
    return abs(abs(forced.response) - abs(point.response)) / largest if largest > 0.0 else 0.0


def another(points: Mapping[tuple[float, float], NfrPoint], second: Sequence[NfrPoint], output: str) -> list[str]:
    """Return a line if there are other stable responses than those measured.

    Args:
        points: measured, by amplitude and frequency.
        second: others at the same frequencies and amplitudes.
        output: name of the output.
    """
    beside: dict[tuple[float, float], NfrPoint] = {}
    missed: dict[tuple[float, float], NfrPoint] = {}
    for p in second:
        mine = points.get((p.amplitude, p.frequency))
        unknown = mine is None or (mine.response is not None and mine.error is None)
        if p.stable and mine is not None and not unknown and (mine.response is None or _contradict(p, mine)):
            (missed if mine.response is None else beside).setdefault((p.amplitude, p.frequency), p)
    result = []
    if beside:
        key, other = min(beside.items())
        span = f"{key[1]:.6g}" if len(beside) == 1 else f"{key[1]:.6g} … {max(f for _, f in beside):.6g}"
        gains = f"gain {_gain(other)} besides {_gain(points[key])} of {output}"
        what = f"{span} Hz, amplitude {key[0]:g}: there is {ANOTHER} response, {gains} at {key[1]:.6g} Hz"
        result.append(f"{what}; which one is reached depends on the start; `branches` shows all")
    for (amplitude, frequency), other in sorted(missed.items()):
        where = f"{frequency:.6g} Hz, amplitude {amplitude:g}"
        result.append(f"{where}: {MISSED} of gain {_gain(other)} of {output}; `branches` shows it")
    return result


def _size(point: NfrPoint) -> float:
    return abs(point.response or 0.0)


def _gain(point: NfrPoint) -> str:
    return f"{_size(point):.4g}"
