"""Fit a rational model to a measured frequency response."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from workbench.analysis.bla.result import BlaResult
from workbench.analysis.experiment.formats import read_columns
from workbench.analysis.fit.rational import Rational, fitted
from workbench.analysis.fit.request import Fit
from workbench.analysis.fit.result import FitResult
from workbench.analysis.nfr.result import NfrResult
from workbench.core.job import Job
from workbench.core.record import read_json
from workbench.core.response import Response
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["run"]

Complex = NDArray[np.complex128]

_CIRCLE = 1.7308  # radius of the 95 % circle over σ of a complex normal error: √(−ln 0.05)
_LEAST = 1e-6  # of the largest gain: no response is known better


@dataclass(frozen=True, eq=False)
class _Measured:
    """A response to fit.

    Attributes:
        curve: frequency, values, errors, names.
        model: name of what was measured.
        dt: of the sampled model [s]; 0: continuous.
    """

    curve: Response
    model: str
    dt: float


def run(response: Response | NfrResult | BlaResult | str | Path, asked: Fit, job: Job) -> FitResult:
    """Fit a model; see `Fit`."""
    measured = _measured(response, asked)
    curve = measured.curve
    good = np.isfinite(curve.value) & (np.abs(curve.value) > 0.0) & (curve.frequency_hz > 0.0)
    if measured.dt > 0.0:
        good &= curve.frequency_hz < 0.4999 / measured.dt
    f, value = curve.frequency_hz[good], curve.value[good]
    error = np.zeros(len(f)) if curve.error is None else np.nan_to_num(curve.error[good], nan=0.0)
    sigma = np.abs(value) * np.hypot(error / _CIRCLE, asked.accuracy)
    sigma = np.maximum(sigma, _LEAST * np.abs(value).max(initial=0.0))
    plain = value * np.exp(2j * np.pi * f * asked.delay)
    s = _laplace(f, measured.dt)
    most = (2 * len(f) - 1) // 2 - 1
    if most < 0:
        raise InputError(f"{measured.model}: the response has {len(f)} points with a value, too few to fit")
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
    A, B, C, D = best.matrices if measured.dt == 0.0 else _sampled(best.matrices, measured.dt)
    return FitResult(
        A=A, B=B, C=C, D=D, dt=measured.dt, state_names=tuple(f"x{k + 1}" for k in range(best.order)),
        input_names=(curve.input or "u",), output_names=(curve.output or "y",),
        units={curve.input or "u": curve.input_unit, curve.output or "y": curve.output_unit},
        model=measured.model, order=best.order, order_reason=_reason(criterion, best.order, asked),
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


# -- where a response comes from -------------------------------------------------------------------


def _measured(response: Response | NfrResult | BlaResult | str | Path, asked: Fit) -> _Measured:
    found: Any = _file(response) if isinstance(response, str | Path) else response
    if isinstance(found, NfrResult):
        return _Measured(found.curve(asked.amplitude), found.model, 0.0)
    if isinstance(found, BlaResult):
        return _Measured(found.curve(_power(found, asked.amplitude)), found.model, found.dt)
    if asked.amplitude is not None:
        raise InputError("amplitude: the response has one only")
    name = Path(response).name if isinstance(response, str | Path) else found.output or "response"
    return _Measured(found, name, 0.0)


def _power(found: BlaResult, rms: float | None) -> int:
    if rms is None and len(found.rms) == 1:
        return 0
    near = [k for k, value in enumerate(found.rms) if rms is not None and abs(value - rms) <= 1e-9 * abs(value)]
    if not near:
        known = ", ".join(f"{value:g}" for value in found.rms)
        raise InputError(
            f"amplitude: {'none is given' if rms is None else f'{rms:g} was not measured'}; there are {known}"
        )
    return near[0]


def _file(path: str | Path) -> Response | NfrResult | BlaResult:
    if Path(path).suffix.lower() != ".json":
        return _table(path)
    data = read_json(path)
    kind = BlaResult if "rms" in data else NfrResult
    try:
        return kind.from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _table(path: str | Path) -> Response:
    """Return the response in a table: frequency [Hz], gain or gain_db, phase [deg]."""
    table = read_columns(path)
    columns = {name.casefold(): column for name, column in zip(table.names, table.values.T, strict=True)}
    frequency = next((columns[n] for n in ("frequency", "frequency_hz", "f") if n in columns), None)
    phase = next((columns[n] for n in ("phase", "phase_deg") if n in columns), None)
    gain = columns.get("gain")
    if gain is None and "gain_db" in columns:
        gain = 10.0 ** (columns["gain_db"] / 20.0)
    if frequency is None or phase is None or gain is None:
        raise InputError(f"{path}: columns frequency [Hz], gain or gain_db, and phase [deg] are needed")
    order = np.argsort(frequency)
    value = gain * np.exp(1j * np.radians(phase))
    if np.any(np.diff(frequency[order]) <= 0.0):
        raise InputError(f"{path}: a frequency is given more than once; fit one amplitude at a time")
    return Response(frequency[order], value[order])
