"""Fit a rational model to a measured frequency response."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from workbench.analysis.bla.result import BlaResult
from workbench.analysis.fit.rational import Rational, fitted
from workbench.analysis.fit.reading import measured
from workbench.analysis.fit.request import Fit
from workbench.analysis.fit.result import FitResult
from workbench.analysis.nfr.result import NfrResult
from workbench.core.job import Job
from workbench.core.response import Response
from workbench.errors import InputError
from workbench.session.base import Floats

if TYPE_CHECKING:
    from control import FrequencyResponseData

__all__ = ["run"]

Complex = NDArray[np.complex128]

_CIRCLE = 1.7308  # radius of the 95 % circle over σ of a complex normal error: √(−ln 0.05)
_LEAST = 1e-6  # of the largest gain: no response is known better


def run(
    response: Response | NfrResult | BlaResult | FrequencyResponseData | str | Path, asked: Fit, job: Job
) -> FitResult:
    """Fit a model; see `Fit`."""
    source = measured(response, asked)
    curve = source.curve
    good = np.isfinite(curve.value) & (np.abs(curve.value) > 0.0) & (curve.frequency_hz > 0.0)
    if source.dt > 0.0:
        good &= curve.frequency_hz < 0.4999 / source.dt
    f, value = curve.frequency_hz[good], curve.value[good]
    error = np.zeros(len(f)) if curve.error is None else np.nan_to_num(curve.error[good], nan=0.0)
    sigma = np.abs(value) * np.hypot(error / _CIRCLE, asked.accuracy)
    sigma = np.maximum(sigma, _LEAST * np.abs(value).max(initial=0.0))
    plain = value * np.exp(2j * np.pi * f * asked.delay)
    s = _laplace(f, source.dt)
    most = (2 * len(f) - 1) // 2 - 1
    if most < 0:
        raise InputError(f"{source.model}: the response has {len(f)} points with a value, too few to fit")
    if asked.order != "auto" and asked.order > most:
        raise InputError(f"order {asked.order} is too high: {len(f)} points allow {most}")
    orders = range(min(asked.max_order, most) + 1) if asked.order == "auto" else (asked.order,)
    tried: list[Rational] = []
    for n in orders:
        tried.append(fitted(s, plain, sigma, n, direct=asked.feedthrough, stable=asked.stable))
        job.done(f"order {n}", len(tried), len(orders))
    # The misfits of real and imaginary parts over their σ/√2 have χ² of 2 k numbers.
    criterion = np.array([2.0 * r.cost + len(r.theta) * np.log(2.0 * len(f)) for r in tried])
    best = tried[int(np.argmin(criterion))]
    A, B, C, D = best.matrices if source.dt == 0.0 else _sampled(best.matrices, source.dt)
    return FitResult(
        A=A, B=B, C=C, D=D, dt=source.dt, state_names=tuple(f"x{k + 1}" for k in range(best.order)),
        input_names=(curve.input or "u",), output_names=(curve.output or "y",),
        units={curve.input or "u": curve.input_unit, curve.output or "y": curve.output_unit},
        model=source.model, order=best.order, order_reason=_reason(criterion, best.order, asked),
        order_criterion=criterion if asked.order == "auto" else np.zeros(0), delay=asked.delay,
        amplitude=curve.amplitude, frequency_hz=f, measured=value, sigma=sigma, pole_spread=best.pole_spread(),
        notes=_notes(curve, best, criterion, asked),
    )  # fmt: skip


def _reason(criterion: Floats, order: int, asked: Fit) -> str:
    if asked.order != "auto":
        return "given"
    why = f"smallest Bayesian criterion among orders 0 to {len(criterion) - 1}"
    for n in (order - 1, order + 1):
        if 0 <= n < len(criterion):
            why += f"; order {n} would raise it by {criterion[n] - criterion[order]:.3g}"
    return why


def _notes(curve: Response, best: Rational, criterion: Floats, asked: Fit) -> tuple[str, ...]:
    notes = []
    if curve.amplitude is not None:
        unit = f" {curve.input_unit}" if curve.input_unit else ""
        notes.append(f"measured at {curve.amplitude:.4g}{unit}: a linear model at this amplitude")
    if asked.order == "auto" and best.order == len(criterion) - 1 > 0:
        notes.append(f"order {best.order} is the largest considered: allow more, or a larger misfit (accuracy)")
    if asked.delay:
        notes.append(f"the delay of {asked.delay:g} s is not in A, B, C and D")
    return tuple(notes)


def _laplace(f: Floats, dt: float) -> Complex:
    """Return s = jω, or of a sampled model (2/dt) (z − 1)/(z + 1), in which it is rational too."""
    if dt == 0.0:
        return np.asarray(2j * np.pi * f)
    return np.asarray(2j / dt * np.tan(np.pi * f * dt))


def _sampled(matrices: tuple[Floats, Floats, Floats, Floats], dt: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the sampled model whose response at z is that of the given one at (2/dt) (z − 1)/(z + 1)."""
    A, B, C, D = matrices
    n = len(A)
    inverse = scipy.linalg.inv(np.eye(n) - 0.5 * dt * A) if n else np.zeros((0, 0))
    root = np.sqrt(dt)
    return inverse @ (np.eye(n) + 0.5 * dt * A), root * inverse @ B, root * C @ inverse, D + 0.5 * dt * C @ inverse @ B
