"""The page of a nonlinear frequency response."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.core.records.names_in_text import unit_of_ratio
from workbench.response.branches.page import branches_table, folds_table, jumping
from workbench.response.nfr.curve import DROP_DB, fall_of, peak_of
from workbench.response.nfr.features import LAG_DEG
from workbench.response.nfr.jumps import ANOTHER, MISSED
from workbench.response.nfr.result import MISSING, NfrResult, percent
from workbench.response.nfr.settling import NO_EFFECT
from workbench.response.periodic.stability import NEUTRAL
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number, sentence
from workbench.show.verdicts import Verdict

__all__ = ["nfr_page"]

_SMALL = 0.01  # errors that say that amplitudes agree
_NOTHING = 1e-6  # of the output's amplitude: a mean below it is rounding
_UNKNOWN = "averaged, error unknown"
_MEANING = {
    _UNKNOWN: "not settled, error unknown: the value may be far off",
    "averaged": "not settled: the value is only as accurate as its error",
    "settled": "solved for, or no longer changing from period to period",
    NO_EFFECT: "the input does not move the output, or only by rounding errors",
}


def nfr_page(result: NfrResult, *, offset: bool = False) -> Page:
    """Return the page of a frequency response: verdicts, pictures, values at each amplitude.

    Args:
        result: what to report.
        offset: whether the output's mean is drawn too.
    """
    sections = [_values(result, i) for i in range(result.amplitude.size)]
    return Page(
        title=f"Frequency response of {result.model}: {result.input} → {result.output}",
        lead=_lead(result),
        facts={
            "input": bracketed(result.input, result.input_unit),
            "output": bracketed(result.output, result.output_unit),
            "amplitudes": ", ".join(f"{a:g}" for a in result.amplitude) + behind(result.input_unit),
            "frequencies": _range(result),
        },
        sections=[
            Section("Gain and phase", figures=[(partial(result.plot, offset=offset), _caption(result))]),
            _summary(result),
            *_branches(result),
            Section("Values", parts=[s for s in sections if any(t.rows for t in s.tables)], folded=True),
        ],
        summary=_verdicts(result),
        notes=result.warnings,
        kind="nfr",
    )


def _caption(result: NfrResult) -> str:
    """Return what the marks of the picture mean, as far as there are any."""
    idle = result.gain == 0.0
    marks = {
        "circles: settled": np.any(~result.averaged & ~idle & np.isfinite(result.gain)),
        "triangles: averaged": np.any(result.averaged & ~idle),
        "crosses on the lower edge: failed": bool(result.failed),
        "triangles downwards: no effect": np.any(idle),
        "bars: the error": np.any(np.isfinite(result.error) & (result.error > 0.0)),
    }
    return sentence("; ".join(words for words, shown in marks.items() if shown) or "nothing was measured")


def _branches(result: NfrResult) -> list[Section]:
    """Return the sections of the branches, where they were asked for."""
    tables = {}
    if result.branches:
        tables["Branches"] = branches_table(result.branches, "frequency", "Hz")
    if result.folds:
        tables["Folds and bifurcations"] = folds_table(result.folds)
    return [Section(title, tables=[table]) for title, table in tables.items()]


def _range(result: NfrResult) -> str:
    f = result.frequency_hz
    return f"{len(f)}, from {f[0]:g} to {f[-1]:g} Hz" if len(f) > 1 else f"{f[0]:g} Hz"


def _lead(result: NfrResult) -> str:
    parts = [f"{counted(result.response.size, 'point')} at {counted(result.amplitude.size, 'amplitude')}."]
    spread = _spread(result)
    if _agree(result):
        parts.append("The amplitudes agree within their errors: it is linear here.")
    elif np.isfinite(spread):
        parts.append(f"Between the amplitudes it differs by {spread:.3g} dB at most.")
    return " ".join(parts)


def _agree(result: NfrResult) -> bool:
    """Whether the responses at all amplitudes are the same, as far as their errors tell; unknown errors do not."""
    apart = np.abs(result.response - result.response[:1])
    allowed = result.error * result.gain + (result.error * result.gain)[:1]
    small = np.max(result.error, initial=0.0) < _SMALL  # nan is not
    return len(result.amplitude) > 1 and bool(small and np.all(apart <= allowed))


def _summary(result: NfrResult) -> Section:
    """Return bandwidth and highest gain at each amplitude: measured, or as the points enclose them.

    Above a resonance, and across a jump, the fall from the lowest frequency is not a bandwidth.
    """
    measured = {one.amplitude: one for one in result.features}
    drop = result.features[0].drop_db if measured else DROP_DB
    headings = (
        bracketed("amplitude", result.input_unit),
        f"−{drop:g} dB from {result.frequency_hz[0]:.4g} Hz [Hz]",
        "−90° [Hz]",
        "highest gain [dB]",
        "at [Hz]",
    )
    rows = []
    words = [f"amplitude {one.amplitude:g}: {one.remark}" for one in result.features if one.remark]
    for i, amplitude in enumerate(result.amplitude.tolist()):
        curve = _enclosed(result, i)
        one = measured.get(amplitude)
        if one is not None:
            lag = _with_error(one.lag_hz, one.lag_error_hz) if one.lag_hz is not None else curve[1]
            curve = (_with_error(one.bandwidth_hz, one.bandwidth_error_hz), lag, *curve[2:])
            if one.resonance_hz is not None:
                gain = _with_error(one.resonance_gain_db, one.resonance_error_db)
                curve = (*curve[:2], gain, f"{one.resonance_hz:.5g}")
        rows.append((f"{amplitude:g}", *curve))
    if any(row[3].startswith("≥") for row in rows):
        words.append("≥: between these frequencies the gain may be higher; `bandwidth` measures there.")
    if not measured:
        words += filter(None, (_passed(result, i) for i in range(result.amplitude.size)))
    if _others(result):
        words.append("Of the responses measured; another stable response, told in a note, may have a higher gain.")
    words += _limit(result)
    return Section("Bandwidth and highest gain", paragraphs=words, tables=[PageTable(headings, rows, right=range(5))])


def _passed(result: NfrResult, i: int) -> str:
    """Return between which points the gain falls where that is not a bandwidth, and why it is not; "": it is one."""
    good = np.isfinite(result.gain_db[i])
    f, gain_db = result.frequency_hz[good], result.gain_db[i][good]
    peak, fall = peak_of(f, gain_db), fall_of(f, gain_db, result.error[i][good])
    resonant = peak is not None and peak.above_db > DROP_DB
    if fall is None or not (fall.cliff or resonant):
        return ""
    why = "above a resonance" if resonant else "so steeply that it may jump"
    level = f"−{DROP_DB:g} dB from {f[0]:.4g} Hz"
    where = f"between {fall.low:.5g} and {fall.high:.5g} Hz"
    return f"Amplitude {result.amplitude[i]:g}: the gain passes {level} {where}, {why}: that is not a bandwidth."


def _others(result: NfrResult) -> list[str]:
    """Return the notes that there are other stable responses than those measured."""
    return [note for note in result.warnings if ANOTHER in note or MISSED in note]


def _enclosed(result: NfrResult, i: int) -> tuple[str, str, str, str]:
    """Return what the points of one amplitude say: the fall of gain and phase, the highest gain and where it is."""
    good = np.isfinite(result.gain_db[i])
    f, gain_db, phase = result.frequency_hz[good], result.gain_db[i][good], result.phase_deg[i][good]
    if not f.size:
        return ("–",) * 4
    peak, fall = peak_of(f, gain_db), fall_of(f, gain_db, result.error[i][good])
    resonant = peak is not None and peak.above_db > DROP_DB
    known = fall is not None and not fall.cliff and not resonant
    late = np.flatnonzero(phase <= LAG_DEG)
    lag = int(late[0]) if late.size else 0
    hidden = None if peak is None else peak.between
    return (
        f"{fall.low:.5g} … {fall.high:.5g}" if fall is not None and known else "–",
        f"{f[lag - 1]:.5g} … {f[lag]:.5g}" if lag else "–",
        f"{'≥ ' if hidden else ''}{np.max(gain_db):.2f}",
        f"{f[np.argmax(gain_db)]:.5g}" if hidden is None else f"{hidden[0]:.5g} … {hidden[1]:.5g}",
    )


def _with_error(value: float | None, error: float | None) -> str:
    """Return a value to the digit that its error leaves: "2.7843 ± 0.0001"."""
    if value is None or error is None:
        return "–"
    digits = min(max(-math.floor(math.log10(error)), 0), 6) if error > 0.0 else 6
    return f"{value:.{digits}f} ± {error:.1g}"


def _limit(result: NfrResult) -> list[str]:
    """Return at which amplitude the bandwidth falls below the wanted one, in a sentence; none: nobody asked."""
    limit = result.amplitude_limit
    if limit is None:
        return []
    level = f"−{limit.drop_db:g} dB from the gain at {result.frequency_hz[0]:.4g} Hz"
    what = f"the bandwidth ({level}) falls below {limit.bandwidth_hz:g} Hz"
    if limit.amplitude is None:
        return [sentence(f"no amplitude is known at which {what}: {limit.remark}")]
    value = _with_error(limit.amplitude, limit.error)
    return [
        sentence(f"at amplitude {value}{behind(result.input_unit)} {what}{f': {limit.remark}' if limit.remark else ''}")
    ]


def _spread(result: NfrResult) -> float:
    """Return the largest difference of the gain between amplitudes [dB]; NaN where there is one amplitude only."""
    both = result.gain_db[:, np.all(np.isfinite(result.gain_db), axis=0)]
    return float(np.max(np.ptp(both, axis=0))) if len(both) > 1 and both.size else float("nan")


def _verdicts(result: NfrResult) -> list[Verdict]:
    idle = result.gain == 0.0
    words = np.where(idle, NO_EFFECT, np.array(result.status, dtype=object))
    words[(words == "averaged") & np.isnan(result.error)] = _UNKNOWN
    counts = Counter(words.ravel().tolist())
    verdicts = [
        Verdict(word.partition(",")[0], f"{counted(counts[word], 'point')}: {meaning}")
        for word, meaning in _MEANING.items()
        if counts[word]
    ]
    # What is measured is only one of the responses; which one, the start decides.
    verdicts += [Verdict("watch", note.partition(";")[0]) for note in _others(result)]
    reasons = Counter(f.reason for f in result.failed if f.reason != MISSING)
    missing = sum(f.reason == MISSING for f in result.failed)
    if missing:
        verdicts.append(
            Verdict("skipped", f"{counted(missing, 'point')}, which the sweep had not reached when it was stopped")
        )
    first = {f.reason: f for f in reversed(result.failed)}
    verdicts += [
        Verdict("failed", f"{counted(n, 'point')}, the first at {first[why].frequency_hz:.5g} Hz: {why}")
        for why, n in reasons.items()
    ]
    folds = [f for f in result.folds if f.kind == "fold"]
    for amplitude in sorted({f.amplitude for f in folds}):
        verdict = jumping([f.frequency_hz for f in folds if f.amplitude == amplitude], "Hz")
        verdicts.append(replace(verdict, text=f"at amplitude {amplitude:g}{behind(result.input_unit)} {verdict.text}"))
    return verdicts


def _values(result: NfrResult, i: int) -> Section:
    unit = result.input_unit
    ratio = bracketed("gain", unit_of_ratio(result.output_unit, unit))
    offset = bracketed("offset", result.output_unit)
    headings = ("frequency [Hz]", ratio, "gain [dB]", "phase [deg]", "error [%]", offset, "THD [%]")
    columns = ((result.gain, ".5g"), (result.gain_db, ".3f"), (result.phase_deg, ".2f"))
    rows = [
        (
            f"{f:.5g}",
            *(number(float(c[i, j]), form) for c, form in columns),
            _error(result, i, j),
            offset_words(result, i, j),
            _thd(float(result.thd[i, j]), float(result.error[i, j])),
            str(result.periods[i, j]),
            NO_EFFECT if result.gain[i, j] == 0.0 else result.status[i][j],
        )
        for j, f in enumerate(result.frequency_hz.tolist())
        if not _is_missing(result, i, j)
    ]
    table = PageTable((*headings, "periods", "status"), rows, verdict=8, right=range(8))
    return Section(f"Amplitude {result.amplitude[i]:g}{behind(unit)}", tables=[table])


def _thd(thd: float, error: float) -> str:
    """Return the distortion [%]: what is left of a transient is wrong in it as it is in the response."""
    return f"<{percent(thd + error)}" if thd <= error else number(100.0 * thd, ".3g")


def _error(result: NfrResult, i: int, j: int) -> str:
    """Return the error [%]; a dash where there is no value that it could be of."""
    error = float(result.error[i, j])
    if np.isnan(error) and result.gain[i, j] > 0.0:
        return "unknown"
    return percent(error) if np.isfinite(error) else number(error)


def offset_words(result: NfrResult, i: int, j: int) -> str:
    """Return the mean of the output; below what the error leaves open, and far below its motion, that is all it is.

    Where a multiplier is that of an integrator, the motion is periodic about any mean.

    Args:
        result: of the measurement.
        i: number of the amplitude.
        j: number of the frequency.
    """
    certificate = result.certificates[i][j]
    if certificate is not None and any(abs(mu - 1.0) <= NEUTRAL for mu in certificate.multipliers):
        return "any"
    offset, motion = float(result.offset[i, j]), float(result.gain[i, j] * result.amplitude[i])
    least = max(float(result.error[i, j]), _NOTHING) * motion
    return f"<{least:.1g}" if abs(offset) < least else number(offset, ".4g")


def _is_missing(result: NfrResult, i: int, j: int) -> bool:
    where = (result.amplitude[i], result.frequency_hz[j])
    return any(f.reason == MISSING and (f.amplitude, f.frequency_hz) == where for f in result.failed)
