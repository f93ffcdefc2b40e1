"""The periodic answer behind periods that still hold a transient.

A linear model that is forced with a period of N samples answers y(n) = y*(n) + C Aⁿ e: its periodic answer, and what is
left of the way there. From one period to the next y* stays, so y(n + N) − y(n) = C Aⁿ (Aᴺ − I) e is the record of a
free motion whatever the forcing, with the same A in all realisations. The shifts of its Hankel matrix give C and A
(S. Y. Kung's realisation); over all periods e is found by least squares beside the mean period, which is y*. The number
of modes is the one with the least Bayesian criterion, and directions of e that do not stand out of the noise stay in.
An integrator moves the mean alone, which no period tells from y*.

That a transient decays is also what tells it from noise: where differences of periods, the estimated transient taken
off, become smaller in time, the periods have not settled, and what may be left follows from how slowly they do.

Source: R. Pintelon and J. Schoukens, System Identification, 2nd ed., sections 6.7.3 and 7.2 (periodic data with
transients; here their poles are estimated, so that damping may be so light that no polynomial over neighbouring lines
follows it); S. Y. Kung, 12th Asilomar Conf. on Circuits, Systems and Computers, 1978.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats

__all__ = ["MATTERS", "Steady", "steady"]

_MOST_MODES = 20  # looked for together, in all realisations
_ROWS, _COLUMNS = 200, 2000  # of the Hankel matrix at most: a tenth of a second; twice as many hold no more circles
_GROWTH = 1e3  # a motion that grows by more within the record is another one's ending
_CLEAR = 0.999  # of the noise's distribution lies below what a direction of the transient has to have
_SEGMENTS = 8  # of the differences, whose powers tell whether they decay
_ROUNDING = 1e-13  # of the largest value
MATTERS = 1e-3  # of the output: a transient below it does not matter; more of it, and of noise, is told


@dataclass(frozen=True, eq=False)
class Steady:
    """Periods without the transient.

    Attributes:
        periods: shape (M, P, N), the estimated transient taken off.
        modes: number of modes of the transient.
        removed: root mean square of what was taken off.
        wait: periods after which it would be below a thousandth of the output; infinite: it does not decay.
        unsettled: root mean square of what may be left of the transient in the mean period; 0: what changes from period
            to period does not decay.
        variance: shape (N/2 + 1,), of the mean spectrum of a realisation by the estimate of its transient.
    """

    periods: Floats
    modes: int
    removed: float
    wait: float
    unsettled: float
    variance: Floats


def steady(periods: Floats) -> Steady:
    """Return periods without their transient.

    Args:
        periods: shape (M, P, N): realisations, periods of each one after the other, samples; P is 2 or more.
    """
    M, P, N = periods.shape
    changes = np.diff(periods, axis=1).reshape(M, -1)
    none = Steady(periods, 0, 0.0, 0.0, 0.0, np.zeros(N // 2 + 1))
    if np.max(np.abs(changes)) <= _ROUNDING * np.max(np.abs(periods)):
        return none
    with one_thread():
        best, least = none, np.inf
        for modes, course in _courses(changes, P * N):
            found, criterion = _without(periods, course, modes)
            if criterion < least:
                best, least = found, criterion
    return replace(best, unsettled=_unsettled(best.periods))


def _courses(changes: Floats, length: int) -> Iterator[tuple[int, Floats]]:
    """Yield numbers of modes and the free motions that so many have, shape (length, modes).

    Args:
        changes: shape (M, T), free motions.
        length: of the record.
    """
    yield 0, np.zeros((length, 0))
    M, T = changes.shape
    rows = min(T // 2, _ROWS)
    begins = np.arange(0, T - rows, max(1, M * (T - rows) // _COLUMNS))
    hankel = np.hstack([row[begins + np.arange(rows + 1)[:, None]] for row in changes])
    left = np.linalg.svd(hankel, full_matrices=False)[0]
    # A quarter of the numbers at most are spent on the transient.
    for modes in range(1, min(_MOST_MODES, rows // 2, left.shape[1], M * T // (4 * (M + 1))) + 1):
        part = left[:, :modes]
        course = _powers(part[0], np.linalg.lstsq(part[:-1], part[1:], rcond=None)[0], length)
        if np.isfinite(course).all() and np.max(np.abs(course)) <= _GROWTH * np.max(np.abs(course[: length // 8 + 1])):
            yield modes, course


def _powers(row: Floats, A: Floats, length: int) -> Floats:
    """Return row·Aⁿ for n = 0 … length − 1, shape (length, modes), by doubling."""
    found, power = row[None], A
    with np.errstate(over="ignore", invalid="ignore"):
        while len(found) < length:
            found, power = np.vstack([found, found @ power]), power @ power
    return found[:length]


def _without(periods: Floats, course: Floats, modes: int) -> tuple[Steady, float]:
    """Return the periods without the transient that follows best, and the Bayesian criterion of so many modes."""
    M, P, N = periods.shape
    about = (periods - periods.mean(axis=1, keepdims=True)).reshape(M, -1).T
    # Directions of equal size in the record, by how much of each the mean period does not take.
    whole = np.linalg.qr(course)[0]
    moving = whole.reshape(P, N, modes)
    u, s, v = np.linalg.svd((moving - moving.mean(axis=0)).reshape(P * N, modes), full_matrices=False)
    parts = u.T @ about
    count = M * (P - 1) * N
    size = float(np.max(np.abs(periods)))
    left = max(float(np.sum(about**2) - np.sum(parts**2)), count * (_ROUNDING * size) ** 2)
    noise = left / max(count - modes * M, 1)
    clear = (np.sum(parts**2, axis=1) > noise * stats.chi2.ppf(_CLEAR, M)) & (s > _ROUNDING)
    turned = whole @ v[clear].T / s[clear]
    transient = (turned @ parts[clear]).T.reshape(periods.shape)
    spectrum = np.fft.rfft(turned.reshape(P, N, -1).mean(axis=0), axis=0) / N
    found = Steady(
        periods - transient, modes, float(np.sqrt(np.mean(transient**2))),
        _wait(transient, float(np.std(periods))), 0.0, noise * np.sum(np.abs(spectrum) ** 2, axis=1),
    )  # fmt: skip
    return found, count * float(np.log(left / count)) + modes * (M + 1) * float(np.log(count))


def _wait(transient: Floats, size: float) -> float:
    """Return how many periods a transient takes to fall below a thousandth of the output.

    Args:
        transient: shape (M, P, N).
        size: root mean square of the output.
    """
    first, last = (float(np.sqrt(np.mean(transient[:, p] ** 2))) for p in (0, -1))
    if last <= MATTERS * size:
        return 0.0
    if last >= first:
        return float(np.inf)
    return float((transient.shape[1] - 1) * np.log(last / (MATTERS * size)) / np.log(first / last))


def _unsettled(periods: Floats) -> float:
    """Return the root mean square of what may be left of a transient in the mean period; 0: changes do not decay.

    The logarithm of the changes' power falls along a line that all realisations have in common but for its height.
    """
    M, P, _ = periods.shape
    changes = np.diff(periods, axis=1)
    size = float(np.sqrt(0.5 * np.mean(changes**2)))
    pieces = np.array_split(changes.reshape(M, -1), _SEGMENTS, axis=1)
    power = np.array([np.mean(piece**2, axis=1) for piece in pieces]).T
    if size <= _ROUNDING * np.max(np.abs(periods)) or np.min(power) <= 0.0:
        return 0.0
    time = (np.arange(_SEGMENTS) - 0.5 * (_SEGMENTS - 1)) * (P - 1) / _SEGMENTS  # in periods
    height = np.log(power) - np.log(power).mean(axis=1, keepdims=True)
    slope = float(height.sum(axis=0) @ time / (M * time @ time))
    free = M * (_SEGMENTS - 1) - 1
    error = float(np.sqrt(np.sum((height - slope * time) ** 2) / free / (M * time @ time)))
    if slope >= -error * stats.t.ppf(_CLEAR, free):
        return 0.0
    # The amplitude falls by this factor in a period; changes that go on so add up to the rest of the way.
    return size / (1.0 - float(np.exp(0.5 * slope)))
