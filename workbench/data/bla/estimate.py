"""The best linear approximation from records of several realisations and periods.

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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from workbench.core.values.arrays import Complex, Floats
from workbench.data.bla.design import Lines
from workbench.data.bla.transient import steady
from workbench.errors import InputError

__all__ = ["Approximation", "approximate", "response_of"]


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
    size = np.sqrt(total * stats.f.ppf(_CONFIDENCE, 2, 2 * freedom)) + exact
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
