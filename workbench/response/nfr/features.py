"""Bandwidth, lag, resonance and the amplitude that a bandwidth allows: measured between the points of the grid."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels
from workbench.errors import WorkbenchError
from workbench.response.nfr.curve import DROP_DB, fall_of
from workbench.response.nfr.point import NfrPoint

__all__ = ["LAG_DEG", "AmplitudeLimit", "CurveFeatures", "amplitude_limit", "features_of"]

Measure = Callable[[float, float], NfrPoint]  # of a frequency [Hz] and an amplitude

LAG_DEG = -90.0

# What is sought is a root over a logarithm: so fine; and not sought further where it is that near, in errors.
_FINE, _NEAR = 1e-7, 0.1
_PEAK_WIDTH = 1e-4  # of the logarithm of a resonance's frequency
_SLOPE_WIDTH = 5e-3  # of the logarithm: points nearer than this say less of the slope than their errors do
_SURE = 3.0  # errors by which both sides of a jump are off the level


@dataclass(frozen=True)
class CurveFeatures:
    """Where the gain at one amplitude has fallen, and where it is highest.

    Attributes:
        amplitude: [unit of the input].
        drop_db: by how much the gain has fallen at the bandwidth, from that at the lowest frequency [dB].
        bandwidth_hz: where it first falls by so much [Hz]; None: see `remark`.
        bandwidth_error_hz: what the errors of the points make of it, with 95 % confidence [Hz].
        lag_hz: where the phase first lags by 90° [Hz]; None: not inside the band, or it could not be measured.
        lag_error_hz: what the errors of the points make of it, with 95 % confidence [Hz].
        resonance_hz: where the gain is highest [Hz]; None: at an end of the band, or it could not be measured.
        resonance_gain_db: the gain there [dB].
        resonance_error_db: of that gain, with 95 % confidence [dB].
        remark: why a number is missing, or what is to be known of one.
    """

    amplitude: float
    drop_db: float
    bandwidth_hz: float | None = None
    bandwidth_error_hz: float | None = None
    lag_hz: float | None = None
    lag_error_hz: float | None = None
    resonance_hz: float | None = None
    resonance_gain_db: float | None = None
    resonance_error_db: float | None = None
    remark: str = ""


@dataclass(frozen=True)
class AmplitudeLimit:
    """The amplitude at which the bandwidth falls below a wanted one.

    Attributes:
        bandwidth_hz: the wanted one [Hz].
        drop_db: by how much the gain has fallen at a bandwidth [dB].
        amplitude: [unit of the input]; None: see `remark`.
        error: what the errors of the points make of it, with 95 % confidence [unit of the input].
        remark: why it is missing, or what is to be known of it.
    """

    bandwidth_hz: float
    drop_db: float
    amplitude: float | None = None
    error: float | None = None
    remark: str = ""


class _UnmeasuredError(WorkbenchError):
    """A point that is needed has no value, or an unknown error."""


def features_of(row: Sequence[NfrPoint], drop_db: float, measure: Measure) -> CurveFeatures:
    """Return bandwidth, lag and resonance at one amplitude.

    The bandwidth is the root of gain(f) − gain(f₀) + drop over log f by Brent's method, the lag that of phase(f) + 90°,
    the resonance a maximum by bounded search; each of their steps is a measured point.

    Args:
        row: points at this amplitude, of rising frequency.
        drop_db: that a bandwidth is defined by [dB].
        measure: a point.
    """
    known = [p for p in row if _is_known(p)]
    result = CurveFeatures(row[0].amplitude, drop_db)
    if len(known) < 2:
        return replace(result, remark="fewer than two points have a value and an error")
    remarks = []
    try:
        frequency, error, remark = _bandwidth(known, drop_db, measure)
        result = replace(result, bandwidth_hz=frequency, bandwidth_error_hz=error)
        remarks.append(remark)
    except _UnmeasuredError as failure:
        remarks.append(f"bandwidth: {failure}")
    try:
        lag_hz, lag_error_hz, remark = _lag(known, measure)
        result = replace(result, lag_hz=lag_hz, lag_error_hz=lag_error_hz)
        remarks.append(f"−90°: {remark}" if remark else "")
    except _UnmeasuredError as failure:
        remarks.append(f"−90°: {failure}")
    try:
        peak = _resonance(known, measure)
        if peak is not None:
            gain_db, error_db = _gain_db(peak), _error_db(peak)
            result = replace(
                result, resonance_hz=peak.frequency, resonance_gain_db=gain_db, resonance_error_db=error_db
            )
            above = gain_db - _gain_db(known[0])
            if result.bandwidth_hz is not None and result.bandwidth_hz > peak.frequency and above > DROP_DB:
                where = f"{peak.frequency:.4g} Hz, {above:.3g} dB above the gain at {known[0].frequency:.4g} Hz"
                remarks.append(f"the gain falls behind a resonance ({where}): that is not a bandwidth")
    except _UnmeasuredError as failure:
        remarks.append(f"resonance: {failure}")
    return replace(result, remark="; ".join(filter(None, remarks)))


def amplitude_limit(
    rows: Sequence[Sequence[NfrPoint]], wanted: float, drop_db: float, measure: Measure
) -> AmplitudeLimit:
    """Return the amplitude at which the bandwidth falls below a wanted one, between those measured.

    Root of gain(f, a) − gain(f₀, a) + drop over log a at the wanted frequency f; that the gain does not fall so far at
    a lower frequency already is seen at those of the grid.

    Args:
        rows: points at each amplitude, of rising frequency; amplitudes rise, too.
        wanted: least bandwidth [Hz], inside the band.
        drop_db: that a bandwidth is defined by [dB].
        measure: a point.
    """
    asked, (low, high) = AmplitudeLimit(wanted, drop_db), (rows[0][0].amplitude, rows[-1][0].amplitude)
    lowest = rows[0][0].frequency

    def above(log_a: float) -> tuple[float, float]:
        a = math.exp(log_a)
        return _above(measure(wanted, a), measure(lowest, a), drop_db)

    try:
        logs = [math.log(row[0].amplitude) for row in rows]
        values = [above(x)[0] for x in logs]
        at = next((k for k in range(1, len(logs)) if values[k - 1] > 0.0 >= values[k]), None)
        if at is None:
            side = "above" if values[0] > 0.0 else "below"
            return replace(asked, remark=f"it is {side} {wanted:g} Hz at all amplitudes from {low:g} to {high:g}")
        root, width, remark = _root(above, logs[at - 1], logs[at])
        a = math.exp(root)
        levels = {
            p.frequency: _above(measure(p.frequency, a), measure(lowest, a), drop_db)
            for p in rows[0]
            if p.frequency < wanted
        }
        dips = [f for f, (level, error) in levels.items() if level < -error]
    except _UnmeasuredError as failure:
        return replace(asked, remark=str(failure))
    if dips:
        return replace(asked, remark=f"at amplitude {a:.4g} the gain has fallen so far at {dips[0]:g} Hz already")
    return replace(asked, amplitude=a, error=a * width, remark=remark)


def _bandwidth(row: Sequence[NfrPoint], drop_db: float, measure: Measure) -> tuple[float | None, float | None, str]:
    f, gain_db, error = (
        np.array(x, dtype=np.float64) for x in zip(*((p.frequency, _gain_db(p), p.error) for p in row), strict=True)
    )
    fall = fall_of(f, gain_db + (drop_db - DROP_DB) * (f > f[0]), error)
    if fall is None:
        margin = gain_db - gain_db[0] + drop_db - _in_db(error) - _in_db(error)[0]
        surely = "" if np.all(margin[1:] > 0.0) else "surely "
        return None, None, f"the gain does not {surely}fall by {drop_db:g} dB up to {f[-1]:g} Hz"
    first, a = row[0], row[0].amplitude

    def above(log_f: float) -> tuple[float, float]:
        return _above(measure(math.exp(log_f), a), first, drop_db)

    root, width, remark = _root(above, math.log(fall.low), math.log(fall.high))
    return math.exp(root), math.exp(root) * width, remark


def _in_db(error: Floats) -> Floats:
    """Return relative errors of gains in dB."""
    return np.asarray(20.0 * np.log10(1.0 + error), dtype=np.float64)


def _lag(row: Sequence[NfrPoint], measure: Measure) -> tuple[float | None, float | None, str]:
    phase = np.unwrap([_phase_deg(p) for p in row], period=360.0)
    late = np.flatnonzero(phase <= LAG_DEG)
    if not (late.size and late[0]):
        return None, None, ""
    k, a = int(late[0]), row[0].amplitude
    middle = 0.5 * (phase[k - 1] + phase[k])

    def above(log_f: float) -> tuple[float, float]:
        point = _checked(measure(math.exp(log_f), a))
        turned = _phase_deg(point) - LAG_DEG
        error = math.degrees(math.asin(point.error or 0.0))
        return turned - 360.0 * round((turned + LAG_DEG - middle) / 360.0), error

    root, width, remark = _root(above, math.log(row[k - 1].frequency), math.log(row[k].frequency), unit="°")
    return math.exp(root), math.exp(root) * width, remark


def _resonance(row: Sequence[NfrPoint], measure: Measure) -> NfrPoint | None:
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to import

    k = max(range(len(row)), key=lambda i: _gain_db(row[i])) if row else 0
    if not 0 < k < len(row) - 1 or _gain_db(row[k]) - _gain_db(row[0]) <= _error_db(row[k]) + _error_db(row[0]):
        return None
    a, (low, high) = row[k].amplitude, (math.log(row[k - 1].frequency), math.log(row[k + 1].frequency))
    tried = [row[k]]

    def loss(x: float) -> float:
        tried.append(_checked(measure(math.exp(x), a)))
        return -_gain_db(tried[-1])

    minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": _PEAK_WIDTH})
    return max(tried, key=_gain_db)


def _root(
    above: Callable[[float], tuple[float, float]], low: float, high: float, *, unit: str = " dB"
) -> tuple[float, float, str]:
    """Return where a function falls through zero, the error of that, and a remark where it jumps there.

    Args:
        above: of x: value and error, in the unit.
        low: of x, before it.
        high: of x, behind it.
        unit: of the function, with a blank before it.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import

    seen: dict[float, tuple[float, float]] = {}

    def value(x: float) -> float:
        seen[x] = above(x)
        level, error = seen[x]
        return 0.0 if abs(level) < _NEAR * error else level

    root = float(brentq(value, low, high, xtol=_FINE, rtol=_FINE))
    left = max(x for x in seen if seen[x][0] > 0.0)
    right = min(x for x in seen if seen[x][0] <= 0.0)
    if right - left < 10.0 * _FINE and all(abs(seen[x][0]) > _SURE * seen[x][1] + 1e-3 for x in (left, right)):
        jump = f"it jumps there, by {seen[left][0] - seen[right][0]:.3g}{unit}"
        return root, right - left, jump
    far = [x for x in seen if abs(x - root) >= _SLOPE_WIDTH] or [low, high]
    other = min(far, key=lambda x: abs(x - root))
    slope = abs(seen[other][0] - seen[root][0]) / abs(other - root)
    return root, (seen[root][1] + abs(seen[root][0])) / slope, ""


def _is_known(point: NfrPoint) -> bool:
    return point.response is not None and abs(point.response) > 0.0 and point.error is not None and point.error < 1.0


def _checked(point: NfrPoint) -> NfrPoint:
    if not _is_known(point):
        at = f"{point.frequency:.5g} Hz, amplitude {point.amplitude:.5g}"
        raise _UnmeasuredError(f"not known: at {at} {point.reason or 'the error is not known'}")
    return point


def _above(point: NfrPoint, first: NfrPoint, drop_db: float) -> tuple[float, float]:
    """Return by how much a point lies above the level of the bandwidth, and the error of that [dB]."""
    for p in (point, first):
        _checked(p)
    return _gain_db(point) - _gain_db(first) + drop_db, _error_db(point) + _error_db(first)


def _gain_db(point: NfrPoint) -> float:
    return float(decibels(point.response or 0.0))


def _phase_deg(point: NfrPoint) -> float:
    return math.degrees(cmath.phase(point.response or 0.0))


def _error_db(point: NfrPoint) -> float:
    """Return by how much the gain may be lower than it was measured [dB], the larger of both sides."""
    return -float(decibels(1.0 - (point.error or 0.0)))
