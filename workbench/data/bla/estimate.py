"""The best linear approximation from records of several realisations and periods, transients taken off.

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

With U and Y the discrete Fourier transforms of realisation m and period p at an excited line, Ū and Ȳ their means over
the periods (Pintelon & Schoukens, 2nd ed., section 4.3.1, the robust method):

    G(m) = Ȳ / Ū,      G = mean over m of G(m)
    σ²   = Σ |G(m) − G|² / (M (M − 1))                       of G: noise and distortion together
    σₙ²  = Σ Σ |(Y − G(m) U) / Ū|² / (M² P (P − 1))          of G: noise alone, that of the input included
    σₛ²  = M (σ² − σₙ²)                                       distortion of one realisation, over the input

|G − G₀|²/σ² of complex normal errors has Fisher's distribution with 2 and 2 (M − 1) degrees of freedom.

One realisation alone (section 4.3.2, the fast method) tells as much where odd lines are left out at random: there the
output has noise and distortion only, as much as at excited lines near by. σ² |Ū|² is the mean of |Ȳ|² at the nearest
of them.

Periods that still hold a transient are freed of it before (`transient`); what that costs is noise, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.data.bla.design import Lines
from workbench.errors import InputError

__all__ = ["MATTERS", "Approximation", "approximate", "response_of", "steady"]

_MOST_MODES = 20  # looked for together, in all realisations
_ROWS, _COLUMNS = 200, 2000  # of the Hankel matrix at most: a tenth of a second; twice as many hold no more circles
_GROWTH = 1e3  # a motion that grows by more within the record is another one's ending
_CLEAR = 0.999  # of the noise's distribution lies below what a direction of the transient has to have
_SEGMENTS = 8  # of the differences, whose powers tell whether they decay
_SETTLED_ROUNDING = 1e-13  # of the largest value
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
    if np.max(np.abs(changes)) <= _SETTLED_ROUNDING * np.max(np.abs(periods)):
        return none
    with one_thread():
        best, least = none, np.inf
        for modes, course in _courses(changes, P * N):
            result, criterion = _without(periods, course, modes)
            if criterion < least:
                best, least = result, criterion
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
    result, power = row[None], A
    with np.errstate(over="ignore", invalid="ignore"):
        while len(result) < length:
            result, power = np.vstack([result, result @ power]), power @ power
    return result[:length]


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
    left = max(float(np.sum(about**2) - np.sum(parts**2)), count * (_SETTLED_ROUNDING * size) ** 2)
    noise = left / max(count - modes * M, 1)
    clear = (np.sum(parts**2, axis=1) > noise * special.chdtri(M, 1.0 - _CLEAR)) & (s > _SETTLED_ROUNDING)
    turned = whole @ v[clear].T / s[clear]
    transient = (turned @ parts[clear]).T.reshape(periods.shape)
    spectrum = np.fft.rfft(turned.reshape(P, N, -1).mean(axis=0), axis=0) / N
    result = Steady(
        periods - transient, modes, float(np.sqrt(np.mean(transient**2))),
        _wait(transient, float(np.std(periods))), 0.0, noise * np.sum(np.abs(spectrum) ** 2, axis=1),
    )  # fmt: skip
    return result, count * float(np.log(left / count)) + modes * (M + 1) * float(np.log(count))


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
    if size <= _SETTLED_ROUNDING * np.max(np.abs(periods)) or np.min(power) <= 0.0:
        return 0.0
    time = (np.arange(_SEGMENTS) - 0.5 * (_SEGMENTS - 1)) * (P - 1) / _SEGMENTS  # in periods
    height = np.log(power) - np.log(power).mean(axis=1, keepdims=True)
    slope = float(height.sum(axis=0) @ time / (M * time @ time))
    free = M * (_SEGMENTS - 1) - 1
    error = float(np.sqrt(np.sum((height - slope * time) ** 2) / free / (M * time @ time)))
    if slope >= -error * special.stdtrit(free, _CLEAR):
        return 0.0
    # The amplitude falls by this factor in a period; changes that go on so add up to the rest of the way.
    return size / (1.0 - float(np.exp(0.5 * slope)))


_CONFIDENCE = 0.95
_NEAR = 8  # lines left out whose mean is the level at an excited one
_ROUNDING = 1e-12  # of the largest output: what a line may be off by however exact the periods are


@dataclass(frozen=True, eq=False)
class Approximation:
    """The best linear approximation at one power.

    Attributes:
        response: shape (k,), at the excited lines.
        error: shape (k,), radius of the 95 % circle around it.
        integration: shape (k,), part of it that the integration makes.
        noise: shape (k,), standard deviation of the response of one realisation by noise.
        distortion: shape (k,), by nonlinear distortion.
        output: root mean square of the output about its mean.
        linear: of its part that the approximation gives.
        noise_rms: of what changes from period to period, the transient taken off.
        removed_rms: of the transient that was taken off.
        unsettled_rms: of what may be left of it.
        wait: how many periods later it would not matter.
        distortion_rms: of what the approximation leaves at excited lines, without noise.
        odd_rms, even_rms: of what appears at odd and even lines that are not excited, within the band.
        offset: mean of the output over realisations, less that at rest: even distortion, too.
    """

    response: Complex
    error: Floats
    integration: Floats
    noise: Floats
    distortion: Floats
    output: float
    linear: float
    noise_rms: float
    removed_rms: float
    unsettled_rms: float
    wait: float
    distortion_rms: float
    odd_rms: float
    even_rms: float
    offset: float


def approximate(u: Floats, y: Floats, lines: Lines, *, rest: float = 0.0) -> Approximation:
    """Return the best linear approximation.

    Args:
        u: inputs, shape (M, P, N): realisations, periods, samples of a period.
        y: outputs, likewise.
        lines: of the multisine, below N/2.
        rest: output at rest.

    Raises:
        InputError: fewer than two periods, no input at a line, or one realisation without odd lines left out.
    """
    M, P, N = u.shape
    if P < 2:
        raise InputError(f"at least two periods are needed, not {P}")
    if M < 2 and len(lines.odd) < 3:
        raise InputError(
            "one realisation of the phases tells distortion from the response only where odd lines are left out at "
            "random (random-odd); record several realisations"
        )
    given, answered = steady(u), steady(y)
    y = answered.periods
    U, Y = (np.fft.rfft(s.periods, axis=2) / N for s in (given, answered))
    at = lines.excited
    forced = U[:, :, at].mean(axis=1)
    if np.min(np.abs(forced)) <= 1e-9 * np.max(np.abs(forced)):
        raise InputError("the input has no power at a line: the period or the lines are others than said")
    each = Y[:, :, at].mean(axis=1) / forced
    response = each.mean(axis=0)
    left = (Y[:, :, at] - each[:, None] * U[:, :, at]) / forced[:, None]
    noise = np.sum(np.abs(left) ** 2, axis=(0, 1)) / (M**2 * P * (P - 1))
    noise = noise + np.mean(answered.variance[at] / np.abs(forced) ** 2, axis=0) / M
    if M > 1:
        total, freedom = np.sum(np.abs(each - response) ** 2, axis=0) / (M * (M - 1)), M - 1
    else:
        total, freedom = _left_out(Y[0].mean(axis=0), lines) / np.abs(forced[0]) ** 2, min(_NEAR, len(lines.odd))
    distortion = np.maximum(M * (total - noise), 0.0)
    exact = _ROUNDING * np.max(np.abs(y)) / np.min(np.abs(forced), axis=0)
    size = np.sqrt(total * special.fdtri(2, 2 * freedom, _CONFIDENCE)) + exact
    spread = np.var(Y, axis=1, ddof=1)  # of one period, (M, N/2 + 1)
    power = np.mean(np.abs(forced) ** 2, axis=0)
    mean = Y.mean(axis=1)

    def quiet(which: NDArray[np.intp]) -> float:
        """Return the root mean square at lines, noise taken off."""
        left = np.mean(np.abs(mean[:, which]) ** 2 - spread[:, which] / P, axis=0) - answered.variance[which]
        return float(np.sqrt(2.0 * max(float(left.sum()), 0.0)))

    return Approximation(
        response=response,
        error=size,
        integration=np.zeros(len(at)),
        noise=np.sqrt(M * noise),
        distortion=np.sqrt(distortion),
        output=float(np.sqrt(np.mean(np.var(y, axis=2)))),
        linear=float(np.sqrt(2.0 * np.sum(np.abs(response) ** 2 * power))),
        noise_rms=float(np.sqrt(2.0 * np.sum(spread[:, 1:].mean(axis=0)))),
        removed_rms=answered.removed,
        unsettled_rms=answered.unsettled,
        wait=answered.wait,
        distortion_rms=float(np.sqrt(2.0 * np.sum(distortion * power))),
        odd_rms=quiet(lines.odd),
        even_rms=quiet(lines.even),
        offset=float(np.mean(y)) - rest,
    )


def response_of(u: Floats, y: Floats, lines: Lines) -> Complex:
    """Return the response of one realisation at the excited lines, shape (k,), the transient taken off.

    Args:
        u: input, shape (P, N).
        y: output, likewise.
        lines: of the multisine.
    """
    U, Y = (np.fft.rfft(steady(s[None]).periods[0].mean(axis=0))[lines.excited] for s in (u, y))
    return np.asarray(Y / U, dtype=np.complex128)


def _left_out(mean: Complex, lines: Lines) -> Floats:
    """Return the mean power of the output at the odd lines that are left out nearest to each excited one, shape (k,).

    Args:
        mean: shape (N/2 + 1,), of the periods.
        lines: with odd ones that are not excited.
    """
    far = np.abs(lines.excited[:, None] - lines.odd)
    nearest = np.argsort(far, axis=1, kind="stable")[:, :_NEAR]
    return np.asarray(np.mean(np.abs(mean[lines.odd[nearest]]) ** 2, axis=1))
