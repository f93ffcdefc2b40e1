"""Are the directional derivatives the derivatives?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, SimulationError
from workbench.health.check.differences import EvaluationPoint, places
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.point.lin.task import pass_states

__all__ = ["directional"]

# Total width over size: where truncation and rounding of a central difference are alike (Nocedal and Wright,
# Numerical Optimization, 2nd ed., section 8.1), and eight times that.
_WIDTH = 2.0 * float(np.finfo(float).eps) ** (1.0 / 3.0)
_WIDER = 8.0
_SMOOTH = 1e-3  # both widths and both sides must agree so far, or there is a kink or a jump
_AGREE = 1e-2
_ROUNDING = 256.0 * float(np.finfo(float).eps)
_DIFFERENCES = "lin compares and reports this; use its method difference; trim uses differences by itself"


@dataclass
class _Tally:
    """Entries so far."""

    judged: int = 0
    skipped: int = 0
    wrong: int = 0
    worst: float = 0.0
    words: str = ""


@dataclass(frozen=True)
class _DerivativeColumn:
    """One column: what the FMU says, the differences (NaN where nothing can be told), and their rounding."""

    exact: Floats
    slope: Floats
    noise: Floats


def directional(subject: CheckedFmu) -> Answer:
    """Compare directional derivatives with central differences, entry by entry, at three points of a test run.

    For row i (derivative or output) and column j (state or continuous input) at total widths w and 8w, w = 2·ε^(1/3)
    of the column's size: D = (f(x + w/2) − f(x − w/2)) / w. Only where the model is smooth there can anything be
    told: both widths, and forward and backward differences, must agree within 0.1 %; kinks, steps and points where a
    `when` would fire are set aside. Broken: the FMU's derivative differs from D by more than 1 % and more
    than rounding, 256·ε·(|f_i| + Σ_j |J_ij|·size_j) / w. Not applicable: none claimed.
    """
    tally = _Tally()
    for place in places(subject):
        why = place.point.why_not_exact()
        if why:
            return Answer("not applicable", why, "lin uses differences")
        try:
            exact = place.point.jacobian()
        except (FmuError, SimulationError) as error:
            return Answer("broken", f"claimed, but {error}", _DIFFERENCES)
        _compare(place, _columns_of(place, exact), tally)
    return _judge(tally)


def _columns_of(place: EvaluationPoint, exact: Floats) -> Floats:
    """Return the columns that are states and continuous inputs."""
    n = len(place.point.states)
    pass_states(place.point, exact)
    fast = [n + i for i, v in enumerate(place.point.inputs) if v.is_continuous_input]
    return exact[:, [*range(n), *fast]]


def _compare(place: EvaluationPoint, exact: Floats, tally: _Tally) -> None:
    base = place.at(np.zeros(len(place.columns)))
    if base is None:
        return
    reach = np.abs(base) + np.abs(np.nan_to_num(exact)) @ place.sizes
    for j in place.chosen:
        width = _WIDTH * place.sizes[j]
        noise = _ROUNDING * reach / width
        slope = _slope(place, j, width, base, noise)
        if slope is not None:
            _count(place, j, _DerivativeColumn(exact[:, j], slope, noise), tally)


def _slope(place: EvaluationPoint, j: int, width: float, base: Floats, noise: Floats) -> Floats | None:
    """Return one column of differences, NaN where the model is not smooth; None: it cannot be evaluated."""
    sides = [place.along(j, sign * part * width / 2.0) for part in (1.0, _WIDER) for sign in (1.0, -1.0)]
    above, below, far_above, far_below = sides
    if above is None or below is None or far_above is None or far_below is None:
        return None
    slope = (above - below) / width
    wide = (far_above - far_below) / (_WIDER * width)
    forward, backward = (above - base) / (width / 2.0), (base - below) / (width / 2.0)
    size = np.maximum(np.abs(forward), np.abs(backward))
    smooth = (np.abs(slope - wide) <= _SMOOTH * np.maximum(np.abs(slope), np.abs(wide)) + noise) & (
        np.abs(forward - backward) <= _SMOOTH * size + 4.0 * noise
    )
    result: Floats = np.where(smooth, slope, np.nan)
    return result


def _count(place: EvaluationPoint, j: int, column: _DerivativeColumn, tally: _Tally) -> None:
    exact, slope, noise = column.exact, column.slope, column.noise
    judged = np.isfinite(slope)
    tally.judged += int(judged.sum())
    tally.skipped += int((~judged).sum())
    size = np.maximum(np.abs(exact), np.abs(slope))
    # A derivative that is not a number is as wrong as one can be.
    gap = np.where(np.isfinite(exact), np.abs(exact - slope), np.inf)
    wrong = judged & ~(gap <= _AGREE * size + 4.0 * noise)
    tally.wrong += int(wrong.sum())
    for i in np.flatnonzero(wrong):
        share = float(gap[i] / size[i]) if np.isfinite(gap[i]) else np.inf
        if share > tally.worst:
            tally.worst = share
            what = f"∂{place.rows[i].name}/∂{place.columns[j].name}"
            tally.words = f"{what} is {exact[i]:.6g} by the FMU, {slope[i]:.6g} by differences"


def _judge(tally: _Tally) -> Answer:
    numbers = {"judged": tally.judged, "skipped": tally.skipped, "wrong": tally.wrong}
    if not tally.judged:
        return Answer(
            "not applicable",
            "no entry could be judged: there is nothing to differentiate, or the model is nowhere smooth",
        )
    if not tally.wrong:
        aside = f", {tally.skipped} at kinks or steps set aside" if tally.skipped else ""
        return Answer("good", f"{tally.judged} entries at 3 points agree with differences{aside}", numbers=numbers)
    return Answer("broken", f"{tally.words} ({tally.wrong} of {tally.judged} entries wrong)", _DIFFERENCES, numbers)
