"""The best linear approximation from records of several realisations and periods.

With U and Y the discrete Fourier transforms of realisation m and period p at an excited line (Pintelon & Schoukens, 2nd
ed., section 4.3.1, the robust method):

    G(m) = mean over p of Y / U,      G = mean over m of G(m)
    σ²   = Σ |G(m) − G|² / (M (M − 1))                   of G: noise and distortion together
    σₙ²  = Σ Σ |Y/U − G(m)|² / (M² P (P − 1))            of G: noise alone
    σₛ²  = M (σ² − σₙ²)                                   distortion of one realisation, over the input

|G − G₀|²/σ² of complex normal errors has Fisher's distribution with 2 and 2 (M − 1) degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from workbench.analysis.bla.design import Lines
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["Approximation", "approximate"]

Complex = NDArray[np.complex128]

_CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Approximation:
    """The best linear approximation at one power.

    Attributes:
        response: shape (k,), at the excited lines.
        error: shape (k,), radius of the 95 % circle around it.
        noise: shape (k,), standard deviation of the response of one realisation by noise.
        distortion: shape (k,), by nonlinear distortion.
        output: root mean square of the output about its mean.
        linear: of its part that the approximation gives.
        noise_rms: of what changes from period to period.
        distortion_rms: of what the approximation leaves at excited lines, without noise.
        odd_rms, even_rms: of what appears at odd and even lines that are not excited, within the band.
        offset: mean of the output over realisations, less that at rest: even distortion, too.
    """

    response: Complex
    error: Floats
    noise: Floats
    distortion: Floats
    output: float
    linear: float
    noise_rms: float
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
        InputError: fewer than two realisations or periods, or no input at a line.
    """
    M, P, N = u.shape
    if M < 2 or P < 2:
        raise InputError(f"at least two realisations and two periods are needed, not {M} and {P}")
    U, Y = (np.fft.rfft(s, axis=2) / N for s in (u, y))
    at = lines.excited
    if np.min(np.abs(U[:, :, at])) <= 1e-9 * np.max(np.abs(U[:, :, at])):
        raise InputError("the input has no power at a line: the period or the lines are others than said")
    every = Y[:, :, at] / U[:, :, at]
    each = every.mean(axis=1)
    response = each.mean(axis=0)
    total = np.sum(np.abs(each - response) ** 2, axis=0) / (M * (M - 1))
    noise = np.sum(np.abs(every - each[:, None]) ** 2, axis=(0, 1)) / (M**2 * P * (P - 1))
    distortion = np.maximum(M * (total - noise), 0.0)
    size = np.sqrt(total * stats.f.ppf(_CONFIDENCE, 2, 2 * (M - 1)))
    spread = np.var(Y, axis=1, ddof=1)  # of one period, (M, N/2 + 1)
    power = np.mean(np.abs(U[:, :, at]) ** 2, axis=(0, 1))
    mean = Y.mean(axis=1)

    def quiet(which: NDArray[np.intp]) -> float:
        """Return the root mean square at lines, noise taken off."""
        left = np.mean(np.abs(mean[:, which]) ** 2 - spread[:, which] / P, axis=0)
        return float(np.sqrt(2.0 * max(float(left.sum()), 0.0)))

    return Approximation(
        response=response,
        error=size,
        noise=np.sqrt(M * noise),
        distortion=np.sqrt(distortion),
        output=float(np.sqrt(np.mean(np.var(y, axis=2)))),
        linear=float(np.sqrt(2.0 * np.sum(np.abs(response) ** 2 * power))),
        noise_rms=float(np.sqrt(2.0 * np.sum(spread[:, 1:].mean(axis=0)))),
        distortion_rms=float(np.sqrt(2.0 * np.sum(distortion * power))),
        odd_rms=quiet(lines.odd),
        even_rms=quiet(lines.even),
        offset=float(np.mean(y)) - rest,
    )
