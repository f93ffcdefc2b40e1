"""Signs, in a nonlinear frequency response, that there is a second stable one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from workbench.analysis.nfr.point import NfrPoint

__all__ = ["disagreements", "jumps"]

# A change between neighbouring frequencies this large, and this many times the changes beside it, is a jump.
_LARGE, _STEEPER = 0.5, 4.0

# A linear response does not jump; one this much distorted may.
_DISTORTED = 0.005

# Two measurements of one point that differ by more than this, and by more than so many times their errors, are two
# responses.
_APART, _ERRORS = 0.05, 3.0


def jumps(row: Sequence[NfrPoint]) -> list[str]:
    """Return a line for each place where the response jumps from one frequency to the next.

    A branch of periodic responses that folds back ends there, and the model goes to another branch, which must have
    been stable before the jump, too. Seen from four points on; only where the output is distorted.

    Args:
        row: points of one amplitude, rising in frequency.
    """
    good = [p for p in row if p.status == "settled" and p.response]
    changes = [_apart(a, b) for a, b in pairwise(good)]
    found = []
    for i, change in enumerate(changes):
        beside = [changes[k] for k in (i - 1, i + 1) if 0 <= k < len(changes)]
        low, high = good[i], good[i + 1]
        if change < _LARGE or len(beside) < 1 or len(good) < 4 or change < _STEEPER * max(beside):
            continue
        if max(_distortion(low), _distortion(high)) >= _DISTORTED:
            where = f"between {low.frequency:.6g} and {high.frequency:.6g} Hz, amplitude {low.amplitude:g}"
            gains = f"from gain {abs(low.response or 0.0):.4g} to {abs(high.response or 0.0):.4g}"
            found.append(
                f"{where}, the response jumps {gains}: on one side there are probably two stable responses; sweep both "
                "ways (--carry with --band LO:HI and HI:LO) to see both"
            )
    return found


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
    errors = (new.error or 0.0) + (old.error or 0.0)
    return _apart(new, old) > max(_APART, _ERRORS * errors)


def _apart(a: NfrPoint, b: NfrPoint) -> float:
    """Return by how much two responses differ, relative to the larger one."""
    first, second = a.response or 0.0, b.response or 0.0
    largest = max(abs(first), abs(second))
    return abs(first - second) / largest if largest > 0.0 else 0.0


def _distortion(point: NfrPoint) -> float:
    return (point.certificate.thd or 0.0) if point.certificate is not None else 0.0
