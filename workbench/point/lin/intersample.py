"""Between the samples of a model found from pulses: what the outputs do there, and how far the samples alone hold."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.point.lin.realisation import Realisation
from workbench.point.lin.result import Doubt, Intersample, LinResult

__all__ = ["held", "inside", "lines", "periods_needed"]

PARTS = 16  # of a period
ALLOWED = 0.05  # relative error of the response up to the frequency that is stated
# Of 1/period: so far parabolas hold that way (a mass above its resonance): πx/tan(πx) = 0.95 at x = 0.123.
SMOOTH = 0.123
_FAINT = 1e-5  # of the largest response: what lies below is compared with that, as noise is there
_GRID = 400
_LOWEST = 1e-4  # of 1/period


def lines(realised: Realisation, period: float, *, sampled: bool) -> Intersample:
    """Return outputs that are straight lines between two samples, from the right to the next left limit.

    Args:
        realised: the model.
        period: [s].
        sampled: the inputs act at the samples only.
    """
    C = np.stack([realised.C, realised.C @ realised.A])[None]
    # The left limit at the end still has the old input: D stays where outputs follow inputs at once.
    D = np.stack([realised.D, realised.C @ realised.B + realised.D])[None]
    return Intersample(np.array([0.0, period]), C, D, sampled=sampled)


def periods_needed(order: int) -> int:
    """Return how many periods the outputs must be watched in to tell the rows of C within them."""
    return max(40, 2 * order + 10)


def inside(realised: Realisation, answers: Floats, period: float, *, sampled: bool) -> Intersample:
    """Return the outputs within a period as a pulse at each input showed them.

    y(k h + τ) = C(τ) x(k) + D(τ) u(k): D(τ) is the answer within the first period, C(τ) the least-squares fit to
    the later ones, C(τ) A^(k−1) B.

    Args:
        realised: the model.
        answers: per unit of the inputs at the beginnings of the parts of the periods, shape (k, parts, q, m).
        period: [s].
        sampled: the inputs act at the samples only.
    """
    count, parts = answers.shape[:2]
    states, state = [], realised.B
    for _ in range(count - 1):
        states.append(state)
        state = realised.A @ state
    x = np.stack(states)  # (k - 1, n, m)
    regressors = np.moveaxis(x, 1, 2).reshape(
        (count - 1) * realised.B.shape[1], len(realised.A)
    )  # one row a period and input
    targets = np.moveaxis(answers[1:], 3, 1).reshape(len(regressors), -1)  # parts and outputs side by side
    rows = np.linalg.lstsq(regressors, targets, rcond=None)[0].T.reshape(parts, len(realised.D), len(realised.A))
    rows[0] = realised.C
    ends = np.concatenate([rows[1:], (realised.C @ realised.A)[None]])
    through = answers[0]
    last = np.concatenate([through[1:], (realised.C @ realised.B + realised.D)[None]])
    tau = period * np.arange(parts + 1) / parts
    return Intersample(tau, np.stack([rows, ends], axis=1), np.stack([through, last], axis=1), sampled=sampled)


def held(result: LinResult, joined: LinResult) -> tuple[float, tuple[Doubt, ...]]:
    """Return up to where samples joined by straight lines show the response to a sine within 5 % [Hz], and doubts.

    These are where that is less than half as far as for a mass, whose outputs are parabolas.

    Args:
        result: with its outputs between the samples.
        joined: the same with straight lines there.
    """
    f = np.geomspace(_LOWEST, 0.5, _GRID) / result.dt
    real, apparent = np.abs(result.fundamental(f)), np.abs(result.fundamental(f) - joined.fundamental(f))
    size = np.maximum(real, _FAINT * real.max(axis=0, initial=0.0))
    wrong = ~(apparent <= ALLOWED * size)  # (f, q, m); NaN is wrong
    to = np.where(wrong.any(axis=0), f[np.maximum(wrong.argmax(axis=0) - 1, 0)], f[-1])
    least = 0.5 * SMOOTH / result.dt
    doubts = tuple(
        Doubt(
            result.output_names[i],
            result.input_names[j],
            float(real[0, i, j]),
            None,
            f"it moves between the samples: joined by straight lines, they are wrong by 5 % above {to[i, j]:.3g} Hz; "
            f"poles beyond {0.5 / result.dt:.3g} Hz appear at lower frequencies; use a shorter period",
        )
        for i, j in np.argwhere(to < least)
    )
    return float(to.min(initial=f[-1])), doubts
