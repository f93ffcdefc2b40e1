"""What is marked in a picture of a frequency response, and the one number that a list shows of a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels

# As in `curves`: the page is there before python-control is.
if TYPE_CHECKING:
    from workbench.core.values.margins import Margins
    from workbench.identification.calibrate.result import CalibrateResult
    from workbench.identification.fit.result import FitResult
    from workbench.identification.identify.result import IdentifyResult
    from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
    from workbench.loops.loop.result import LoopResult
    from workbench.point.lin.result import LinResult
    from workbench.point.trim.result import TrimResult
    from workbench.response.nfr.result import NfrResult
    from workbench.study.tune.result import TuneResult
    from workbench.ui.studies import StudyRecord

__all__ = ["brief_of", "margin_marks", "nfr_marks", "response_marks"]

_DROP = 20.0 * math.log10(math.sqrt(2.0))  # half the power [dB]
_FLAT = 1.0  # by so much the gain may change between its first two points where a bandwidth counts from it [dB]
_RESONANCE, _FALL = "resonance", "fall"
_PEAK = 0.5  # by so much a resonance rises out of its surroundings, at least [dB]


def response_marks(frequency_hz: Floats, value: Complex) -> list[dict[str, Any]]:
    """Return a resonance and where the gain falls by 3 dB: each has `what`, `hz`, `db` and `text`.

    Both are read from the points: the resonance is the one that rises most out of what is around it, also where a slope
    is higher elsewhere; the fall is a straight line between two.

    Args:
        frequency_hz: shape (n,) [Hz].
        value: shape (n,); NaN where there is none.
    """
    order = np.argsort(frequency_hz)
    gain = decibels(value[order])
    known = np.isfinite(gain) & (frequency_hz[order] > 0.0)
    hz, db = frequency_hz[order][known], gain[known]
    if len(hz) < 4:
        return []
    marks = []
    rises = _rises(db)
    top = int(np.argmax(rises))
    if rises[top] > _PEAK:
        text = f"{db[top]:.3g} dB at {hz[top]:.3g} Hz"
        marks.append({"what": _RESONANCE, "hz": float(hz[top]), "db": float(db[top]), "text": text})
    below = np.flatnonzero(db < db[0] - _DROP)
    if below.size and abs(db[1] - db[0]) < _FLAT:
        k = int(below[0])
        share = (db[k - 1] - db[0] + _DROP) / (db[k - 1] - db[k])
        at = math.exp(math.log(hz[k - 1]) + share * math.log(hz[k] / hz[k - 1]))
        marks.append({"what": _FALL, "hz": at, "db": float(db[0] - _DROP), "text": f"−3 dB at {at:.3g} Hz"})
    return marks


def nfr_marks(record: NfrResult, i: int) -> list[dict[str, Any]]:
    """Return the same of one amplitude; where the record has measured a bandwidth or a resonance, that is marked.

    Args:
        record: of the measurement.
        i: number of the amplitude.
    """
    marks = response_marks(record.frequency_hz, record.response[i])
    one = next((f for f in record.features if f.amplitude == record.amplitude[i]), None)
    if one is None:
        return marks
    result = [mark for mark in marks if mark["what"] == _RESONANCE]
    if one.resonance_hz is not None:
        # It is where the gain is highest; another peak, which stands out more, is marked as the points have it.
        result = [mark for mark in result if mark["db"] < np.nanmax(record.gain_db[i])]
        text = f"{one.resonance_gain_db:.4g} dB at {one.resonance_hz:.4g} Hz"
        result.append({"what": _RESONANCE, "hz": one.resonance_hz, "db": one.resonance_gain_db, "text": text})
    if one.bandwidth_hz is not None:
        lowest = float(record.gain_db[i][np.argmin(record.frequency_hz)])
        text = f"−{one.drop_db:g} dB at {one.bandwidth_hz:.4g} Hz"
        result.append({"what": _FALL, "hz": one.bandwidth_hz, "db": lowest - one.drop_db, "text": text})
    return result


def _rises(db: Floats) -> Floats:
    """Return by how much each point stands above the higher of the two valleys around it, shape (n,) [dB].

    A valley reaches to the next higher point, or to the end. At the ends, where nothing is known beyond, it is 0.
    """
    result = np.zeros_like(db)
    for k in range(1, len(db) - 1):
        higher = np.flatnonzero(db > db[k])
        left = int(max(higher[higher < k], default=-1)) + 1
        right = int(min(higher[higher > k], default=len(db)))
        result[k] = db[k] - max(db[left:k].min(initial=db[k]), db[k + 1 : right].min(initial=db[k]))
    return result


def margin_marks(margins: Margins) -> list[dict[str, Any]]:
    """Return the margins of a loop that is stable; `on` says in which picture: "gain" or "phase"."""
    if not margins.meaningful:
        return []
    marks: list[dict[str, Any]] = [
        {"hz": p.frequency_hz, "db": -p.db, "on": "gain", "text": f"gain margin {p.db:.3g} dB"}
        for p in margins.phase_crossovers
        if 0.0 < p.frequency_hz < math.inf
    ]
    marks += [
        {"hz": g.frequency_hz, "deg": (deg := g.phase_margin_deg), "on": "phase", "text": f"phase margin {deg:.3g}°"}
        for g in margins.gain_crossovers
    ]
    return marks


def brief_of(record: object) -> str:
    """Return the number by which a list tells a result from its neighbours; empty: its headline has to do.

    Args:
        record: any.
    """
    brief = _BRIEF.get(type(record).__name__)
    return "" if brief is None else "; ".join(list(brief(record))[:2])


def _nfr(record: NfrResult) -> Iterator[str]:
    marks = [mark for i in range(len(record.amplitude)) for mark in nfr_marks(record, i)]
    digits = 4 if record.features else 3
    falls = [mark["hz"] for mark in marks if mark["what"] == _FALL]
    peaks = [mark["db"] for mark in marks if mark["what"] == _RESONANCE]
    if falls:
        drop = record.features[0].drop_db if record.features else 3
        yield f"−{drop:g} dB at {_span([falls[0], falls[-1]], digits)} Hz"
    if peaks:
        yield f"peak {_span([peaks[0], peaks[-1]], digits)} dB"


def _span(ends: Sequence[float], digits: int) -> str:
    return " … ".join(dict.fromkeys(f"{x:.{digits}g}" for x in ends))


def _loop(record: LoopResult) -> Iterator[str]:
    if record.linear is None:
        return
    margins = record.linear.margins
    if not margins.meaningful:
        yield margins.verdict
        return
    if 0.0 < margins.gain_margin < math.inf:
        yield f"{margins.gain_margin_db:.3g} dB"
    if math.isfinite(margins.phase_margin_deg):
        yield f"{margins.phase_margin_deg:.3g}°"


def _limit_cycle(record: LimitCycleResult) -> Iterator[str]:
    for cycle in [c for c in record.limit_cycles if c.stable][-1:]:
        yield f"{cycle.frequency_hz:.3g} Hz, amplitude {cycle.amplitude:.3g}"


def _lin(record: LinResult) -> Iterator[str]:
    from workbench.core.values.poles import continuous, damping_ratio, natural_frequency_hz  # noqa: PLC0415 - as above

    poles = continuous(record.shown_poles, record.dt)
    beyond = int(np.sum(poles.real > 1e-9 * np.max(np.abs(poles), initial=0.0)))
    if beyond:
        yield f"{beyond} unstable poles" if beyond > 1 else "1 unstable pole"
    turning = poles[poles.imag > 0.0]
    if turning.size:
        least = turning[np.argmin(damping_ratio(turning))]
        yield f"damping {float(damping_ratio(least)):.3g} at {float(natural_frequency_hz(least)):.3g} Hz"


def _trim(record: TrimResult) -> Iterator[str]:
    yield "at rest" if record.converged else "no equilibrium"


def _identify(record: IdentifyResult) -> Iterator[str]:
    yield f"order {record.order}"
    if math.isfinite(record.fit_percent):
        yield f"fit {record.fit_percent:.3g} %"


def _fit(record: FitResult) -> Iterator[str]:
    yield f"order {record.order}"
    yield f"misfit at most {100.0 * float(np.max(record.misfit)):.2g} %"


def _study(record: StudyRecord) -> Iterator[str]:
    checked = record.result.checked
    if checked:
        yield f"{sum(c.finding.passed for c in checked)} of {len(checked)} met"


def _calibrate(record: CalibrateResult) -> Iterator[str]:
    for p in record.parameters:
        width = "" if p.low is None or p.high is None else f" ± {(p.high - p.low) / 2.0:.1g}"
        yield (
            " ".join(filter(None, [f"{p.name} = {p.value:.4g}{width}", p.unit]))
            if p.identifiable
            else f"{p.name} is not in the data"
        )


def _tune(record: TuneResult) -> Iterator[str]:
    yield f"{sum(r.passed for r in record.requirements)} of {len(record.requirements)} met"
    for p in record.parameters:
        yield f"{p.name} = {p.value:.4g}"


_BRIEF: Mapping[str, Callable[[Any], Iterator[str]]] = {
    "NfrResult": _nfr, "LoopResult": _loop, "LimitCycleResult": _limit_cycle, "LinResult": _lin, "TrimResult": _trim,
    "IdentifyResult": _identify, "FitResult": _fit, "StudyRecord": _study,
    "CalibrateResult": _calibrate, "TuneResult": _tune,
}  # fmt: skip
