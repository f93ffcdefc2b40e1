"""Fit a rational model to a measured frequency response.

What no smooth response explains is noise: its size follows from what the fit leaves, and its course over frequency from
the scatter between neighbours. With σ = r s(f), s given and r unknown but for a least value, minus twice the logarithm
of the likelihood of N real numbers and the Bayesian criterion of f fitted ones are

    N log r² + 2 Σ log s² + S/r² + f log N · N/(N − f − 2),        S = Σ 2 |misfit|²/s²,    r² = S/N or the least value.

The last factor counts that r is not known: without it, orders that leave hardly a number free win by chance (C. M.
Hurvich and C.-L. Tsai, Biometrika 76, 1989, for Akaike's criterion; here of Schwarz's). Noise in proportion to the gain
and noise of a size that the scatter shows are both tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.response import Response
from workbench.data.bla.result import BlaResult
from workbench.errors import InputError
from workbench.identification.fit.matrix import Points, StateSpaceFit, fitted_matrix
from workbench.identification.fit.rational import Rational, fitted
from workbench.identification.fit.reading import Measured, measured
from workbench.identification.fit.request import Fit
from workbench.identification.fit.result import FitResult
from workbench.jobs.job import Job
from workbench.response.nfr.result import NfrResult

if TYPE_CHECKING:
    from control import FrequencyResponseData

__all__ = ["run"]

_BESIDE = 2  # neighbours on either side, through which a cubic predicts a value
_FLOORS = 10.0 ** np.arange(-8.0, 2.0, 0.5)  # squares of noise that stays, over that of the largest gain


def judged(tried: Sequence[Rational | StateSpaceFit], points: Points, floor: Floats) -> tuple[Floats, Floats]:
    """Return the criterion of each order, the size of the noise being unknown, and that size over σ.

    Args:
        tried: one for each order.
        points: with s as σ.
        floor: shape (k,), no σ is below.
    """
    count = 2.0 * len(points.s)
    squares, fitted = (np.array([getattr(fit, name) for fit in tried]) for name in ("cost", "freedom"))
    squares = 2.0 * squares
    least = float(np.max((floor / points.sigma) ** 2))
    size = np.maximum(squares / count, least)
    spare = count - fitted - 2.0
    penalty = np.where(spare > 0.0, fitted * np.log(count) * count / np.maximum(spare, 1.0), np.inf)
    criterion = count * np.log(size) + 2.0 * np.sum(np.log(points.sigma**2)) + squares / size + penalty
    scale = np.sqrt(np.maximum(squares / np.maximum(count - fitted, 1.0), least))
    return criterion, scale


def course(frequency_hz: Floats, value: Complex) -> Floats | None:
    """Return the size of the noise over frequency, up to a factor, shape (k,), from the scatter of neighbours.

    s² = |G|² + c, with c such that the scatter varies least over frequency: the logarithm of what a cubic through the
    neighbours leaves, over what noise of that course would leave.

    Args:
        frequency_hz: shape (k,), rising.
        value: shape (k,).

    Returns:
        None: there are too few values, or noise is in proportion to the gain.
    """
    k = len(value)
    if k < 4 * _BESIDE:
        return None
    x, left, weight = np.log(frequency_hz), [], []
    for at in range(_BESIDE, k - _BESIDE):
        beside = np.r_[at - _BESIDE : at, at + 1 : at + 1 + _BESIDE]
        row = np.zeros(k)
        row[at], row[beside] = 1.0, -_through(x[beside] - x[at])
        left.append(abs(row @ value) ** 2)
        weight.append(row**2)
    squares = np.abs(value) ** 2
    scatter, expected = np.log(np.array(left) + 1e-300), np.array(weight)
    floors = np.append(0.0, _FLOORS * squares.max())
    varies = [float(np.var(scatter - np.log(expected @ (squares + c)))) for c in floors]
    best = int(np.argmin(varies))
    return None if best == 0 else np.asarray(np.sqrt(squares + floors[best]))


def _through(x: Floats) -> Floats:
    """Return the weights of values at x in the value at 0 of the polynomial through them (Lagrange)."""
    return np.array([np.prod([b / (b - a) for b in np.delete(x, j)]) for j, a in enumerate(x)])


_CIRCLE = np.sqrt(-np.log(0.05))  # radius of the 95 % circle over σ of a complex normal error
_LEAST = 1e-6  # of the largest gain: no response is known better
_EVEN = 2.0 * np.log(20.0)  # criteria nearer than this are even: the odds are below 20 to 1
_ENOUGH = 10  # numbers beyond those fitted: with fewer the size of noise is known to no better than half of itself


def run(
    response: Response | NfrResult | BlaResult | FrequencyResponseData | str | Path, request: Fit, job: Job
) -> FitResult:
    """Fit a model; see `Fit`."""
    source = measured(response, request)
    data = _data(source, request)
    p, m = len(source.outputs), len(source.inputs)
    most = (2 * len(data.f) - p * m) // (p + m) - 1
    if most < 0:
        raise InputError(f"{source.model}: the response has {len(data.f)} points with a value, too few to fit")
    if request.order != "auto" and request.order > most:
        raise InputError(f"order {request.order} is too high: {len(data.f)} points allow {most}")
    orders = range(min(request.max_order, most) + 1) if request.order == "auto" else (request.order,)
    result = _chosen(data, orders, request, job)
    best, criterion = result.best, result.criterion
    A, B, C, D = best.matrices if source.dt == 0.0 else _sampled(best.matrices, source.dt)
    amplitudes = {curve.amplitude for curve in source.curves}
    return FitResult(
        A=A, B=B, C=C, D=D, dt=source.dt, state_names=tuple(f"x{k + 1}" for k in range(best.order)),
        input_names=source.inputs, output_names=source.outputs, units=source.units,
        model=source.model, order=best.order, order_reason=_reason(criterion, best.order, request),
        order_criterion=criterion if request.order == "auto" else np.zeros(0), delay=request.delay,
        amplitude=amplitudes.pop() if len(amplitudes) == 1 else None, frequency_hz=data.f, measured=data.value,
        sigma=result.sigma, pole_spread=best.pole_spread(), of_output=data.points.row,
        of_input=data.points.column, notes=(*_notes(source, best, criterion, request), *_noise_notes(result, data)),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _BestOrder:
    """The best order.

    Attributes:
        best: its fit, with the errors that are known of the values.
        criterion: shape (o,), of each order.
        sigma: shape (k,), standard deviation of the values.
        free: numbers left to chance.
    """

    best: Rational | StateSpaceFit
    criterion: Floats
    sigma: Floats
    free: float


def _chosen(data: _Data, orders: Sequence[int], request: Fit, job: Job) -> _BestOrder:
    """Return the order of the least criterion; where errors are not known, with the course of noise of the least."""
    courses = [data.points] if data.known else [data.points, *_scattered(data)]
    result: list[_BestOrder] = []
    for part, points in enumerate(courses, 1):
        tried: list[Rational | StateSpaceFit] = []
        job.stage(part, len(courses))
        for n in orders:
            tried.append(_fitted(points, n, request))
            job.done(f"order {n}", len(tried), len(orders))
        result.append(_of_course(tried, points, data))
    return min(result, key=lambda one: float(np.min(one.criterion)))


def _of_course(tried: Sequence[Rational | StateSpaceFit], points: Points, data: _Data) -> _BestOrder:
    """Return the best of several orders with one course of the noise."""
    count = 2.0 * len(points.s)
    if data.known:
        # The misfits of real and imaginary parts over their σ/√2 have χ² of 2 k numbers.
        criterion = np.array([2.0 * r.cost + r.freedom * np.log(count) for r in tried])
        best = tried[int(np.argmin(criterion))]
        return _BestOrder(best, criterion, points.sigma, count - best.freedom)
    criterion, scales = judged(tried, points, data.points.sigma)
    place = int(np.argmin(criterion))
    scale, best = float(scales[place]), tried[place]
    own = replace(best, cost=best.cost / scale**2, covariance=best.covariance * scale**2)
    return _BestOrder(own, criterion, scale * points.sigma, count - best.freedom)


def _scattered(data: _Data) -> Iterator[Points]:
    """Yield the points of a single channel with noise of another course than the gain's, where neighbours show one."""
    points = data.points
    if points.shape == (1, 1):
        result = course(data.f, points.value)
        if result is not None:
            yield replace(points, sigma=result * float(np.median(points.sigma / result)))


def _noise_notes(result: _BestOrder, data: _Data) -> Iterator[str]:
    """Yield what the order and the errors rest on where the response comes without errors."""
    if data.known:
        yield from data.bare
        return
    part = 100.0 * float(np.median(result.sigma / np.abs(data.value)))
    if result.free < _ENOUGH:
        yield (
            f"no errors of the response are given, and {result.free:.0f} numbers beyond those fitted do not tell noise "
            "from dynamics: the order rests on no error (give errors, or the order)"
        )
    elif np.allclose(result.sigma, data.points.sigma):
        yield f"no errors of the response are given; beyond the accuracy of {part:.2g} % it shows no noise"
    else:
        yield (
            f"no errors of the response are given: order and errors rest on the scatter about the model, {part:.2g} % "
            "of the gain (median)"
        )
    near = np.flatnonzero(result.criterion - np.min(result.criterion) < _EVEN)
    near = near[near != np.argmin(result.criterion)]
    if len(near):
        orders = ", ".join(str(n) for n in near)
        yield f"order {orders} explains the values about as well; without errors they do not tell which: give errors"


@dataclass(frozen=True, eq=False)
class _Data:
    """What is fitted.

    Attributes:
        f: shape (k,) [Hz].
        value: shape (k,), as measured.
        points: the same without the known delay.
        known: whether there are errors.
        bare: words about each channel with values that have none.
    """

    f: Floats
    value: Complex
    points: Points
    known: bool
    bare: tuple[str, ...]


def _data(source: Measured, request: Fit) -> _Data:
    """Return the points with a value of all channels, one channel after the other."""
    parts, bare, known = [], [], False
    for curve in source.curves:
        good = np.isfinite(curve.value) & (np.abs(curve.value) > 0.0) & (curve.frequency_hz > 0.0)
        if source.dt > 0.0:
            good &= curve.frequency_hz < 0.4999 / source.dt
        f, value = curve.frequency_hz[good], curve.value[good]
        error = np.full(len(f), np.nan) if curve.error is None else curve.error[good]
        sigma = np.abs(value) * np.hypot(np.nan_to_num(error, nan=0.0) / _CIRCLE, request.accuracy)
        sigma = np.maximum(sigma, _LEAST * np.abs(value).max(initial=0.0))
        if len(source.curves) > 1 and not len(f):
            raise InputError(f"{source.model}: no point from {curve.input} to {curve.output} has a value")
        known = known or bool(np.isfinite(error).any())
        if np.isnan(error).any():
            of = f" of the response from {curve.input} to {curve.output}" if len(source.curves) > 1 else ""
            at = "" if np.isnan(error).all() else f" at {np.count_nonzero(np.isnan(error))} of {len(f)} frequencies"
            bare.append(
                f"no error{of} is given{at}, and other values have theirs: the accuracy of "
                f"{100.0 * max(request.accuracy, _LEAST):.2g} % alone counts there (give errors, or a larger accuracy)"
            )
        place = source.outputs.index(curve.output or "y"), source.inputs.index(curve.input or "u")
        parts.append((f, value, sigma, *(np.full(len(f), number) for number in place)))
    f, value, sigma, row, column = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    plain = value * np.exp(2j * np.pi * f * request.delay)
    return _Data(f, value, Points(_laplace(f, source.dt), row, column, plain, sigma), known, tuple(bare))


def _fitted(points: Points, order: int, request: Fit) -> Rational | StateSpaceFit:
    if points.shape == (1, 1):
        return fitted(points.s, points.value, points.sigma, order, direct=request.feedthrough, stable=request.stable)
    return fitted_matrix(points, order, direct=request.feedthrough, stable=request.stable)


def _reason(criterion: Floats, order: int, request: Fit) -> str:
    if request.order != "auto":
        return "given"
    why = f"smallest Bayesian criterion among orders 0 to {len(criterion) - 1}"
    for n in (order - 1, order + 1):
        if 0 <= n < len(criterion):
            why += f"; order {n} would raise it by {criterion[n] - criterion[order]:.4g}"
    return why


def _notes(source: Measured, best: Rational | StateSpaceFit, criterion: Floats, request: Fit) -> tuple[str, ...]:
    notes = []
    # At several powers of the same input, there is one word for each.
    at = {(c.input, c.amplitude, c.input_unit) for c in source.curves if c.amplitude is not None}
    for name, amplitude, unit in sorted(at, key=str):
        of = f" of {name}" if len(source.curves) > 1 else ""
        notes.append(f"measured at {amplitude:.4g}{f' {unit}' if unit else ''}{of}: a linear model at this amplitude")
    if request.order == "auto" and best.order == len(criterion) - 1 > 0:
        notes.append(f"order {best.order} is the largest considered: allow more, or a larger misfit (accuracy)")
    if request.delay:
        notes.append(f"the delay of {request.delay:g} s is not in A, B, C and D")
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
