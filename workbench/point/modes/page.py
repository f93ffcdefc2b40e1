"""The page of modes over a parameter: a flutter diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.point.modes.mode import Mode
from workbench.point.modes.result import ModeSet, ModesResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number, sentence
from workbench.show.verdicts import Verdict

__all__ = ["modes_page"]

_KINDS = {
    "real axis": "meet on the real axis (a pair becomes two real poles, or the reverse)",
    "unclear": "come so close that it is uncertain which is which afterwards",
}


def modes_page(result: ModesResult) -> Page:
    """Return the page of modes: where they become unstable, the diagram, each mode at the ends of the range."""
    parameter = bracketed(result.parameter, result.unit)
    words = "Damping and frequency of the modes that matter; critical values are marked."
    return Page(
        title=f"Modes of {result.model} over {result.parameter}",
        lead=_lead(result),
        facts={
            "parameter": f"{parameter}, {_range(result.sets[0])}",
            "configurations": ", ".join(_name(s) for s in result.sets),
            "critical values": f"to {result.tolerance:.2g}{behind(result.unit)}",
        },
        sections=[
            Section("Diagram", paragraphs=[sentence(result.criterion)], figures=[(result.plot, words)]),
            *(_configuration(result, s, parameter) for s in result.sets),
        ],
        summary=[v for s in result.sets for v in _verdicts(result, s)],
        notes=result.notes,
        kind="modes",
    )


def _name(modes: ModeSet) -> str:
    return modes.label or "the model as it is"


def _range(modes: ModeSet) -> str:
    return f"{counted(len(modes.value), 'value')} from {modes.value[0]:g} to {modes.value[-1]:g}"


def _lead(result: ModesResult) -> str:
    return " ".join(f"With {_name(s)}: {_stability(result, s)}." for s in result.sets)


def _stability(result: ModesResult, modes: ModeSet) -> str:
    """Return where the whole is unstable and where it is not; the least damping where it never is."""
    none = f"no mode{'' if result.followed is None else ' that was followed'} is unstable"
    stable, unit = modes.stable_ranges, behind(result.unit)
    if not modes.unstable_ranges:
        words = f"{none} at {result.parameter} = {_ranges(stable)}{unit}{_least(modes, unit)}"
    elif not stable:
        words = f"unstable everywhere, at {result.parameter} = {_ranges(modes.unstable_ranges)}{unit}"
    else:
        words = f"unstable at {result.parameter} = {_ranges(modes.unstable_ranges)}{unit}; {none} "
        words += f"at {_ranges(stable)}{unit}"
    unknown = f"; unknown at {counted(len(modes.failed), 'value')} without a linear model" if modes.failed else ""
    return f"{words}{unknown}"


def _ranges(ranges: Sequence[tuple[float, float]]) -> str:
    *most, last = (f"{low:.6g} … {high:.6g}" for low, high in ranges)
    return f"{', '.join(most)} and {last}" if most else last


def _least(modes: ModeSet, unit: str) -> str:
    if modes.least_damped is None:
        return ""
    mode, ratio, value = modes.least_damped
    return f"; least damped: mode {mode.number}, {100.0 * ratio:.3g} % at {value:.6g}{unit}"


def _verdicts(result: ModesResult, modes: ModeSet) -> list[Verdict]:
    """Return one verdict on the whole of a configuration; what single modes do stands in its table."""
    name = _name(modes)
    verdicts = [Verdict("failed", f"{name}: {result.parameter} = {v:g}: {why}") for v, why in modes.failed.items()]
    verdicts += _beyond(result, modes)
    if modes.unstable_ranges:
        ranges = "; ".join(_begun(result, modes, *pair) for pair in modes.unstable_ranges)
        return [Verdict("unstable", f"{name}: {result.parameter} = {ranges}"), *verdicts]
    which = "every mode" if result.followed is None else "every mode that was followed"
    return verdicts or [Verdict("stable", f"{name}: {which}, at every value")]


def _beyond(result: ModesResult, modes: ModeSet) -> list[Verdict]:
    """Return what is to be watched: a range that ends just before a mode becomes unstable looks stable."""
    ends = ", ".join(
        f"mode {n} reaches zero just beyond the range, at about {v:.5g}{behind(result.unit)}"
        for n, v in modes.reached_beyond
    )
    return [Verdict("watch", f"{_name(modes)}: {ends}: widen it")] if ends else []


def _begun(result: ModesResult, modes: ModeSet, low: float, high: float) -> str:
    """Return a range in which the whole is unstable, and with which mode it begins."""
    where = f"{low:.6g} … {high:.6g}{behind(result.unit)}"
    if low == modes.value[0]:
        return f"{where} (at the first value {counted(modes.unstable_count[0], 'mode')})"
    for c in modes.critical:
        if c.value == low and c.becomes == "unstable":
            at = f" at {c.frequency_hz:.4g} Hz" if c.frequency_hz > 0.0 else ""
            return f"{where} (begins with mode {c.mode}, {c.kind}{at})"
    return where


def _configuration(result: ModesResult, modes: ModeSet, parameter: str) -> Section:
    rows = [(str(c.mode), f"{c.value:.8g}", number(c.frequency_hz), c.kind, c.becomes) for c in modes.critical]
    headings = ("mode", f"critical {parameter}", "frequency [Hz]", "kind", "becomes")
    tables = [PageTable(headings, rows)] if rows else []
    meetings = [
        f"modes {' and '.join(map(str, m.modes))} {_KINDS.get(m.kind, m.kind)} near {result.parameter} = {m.value:.6g}"
        for m in modes.meetings
    ]
    part = _modes(modes, parameter, every=result.followed is None)
    return Section(f"With {_name(modes)}", items=meetings, tables=tables, parts=[part])


def _modes(modes: ModeSet, parameter: str, *, every: bool) -> Section:
    """Return every mode at both ends of the range, and where its damping is smallest."""
    headings = (
        "mode", "natural first [Hz]", "last [Hz]", "damping first [%]", "last [%]", "smallest [%]", f"at {parameter}",
        "states that take part",
    )  # fmt: skip
    rows = [_mode(m, modes) for m in modes.modes]
    title = f"{'All' if every else 'The'} {counted(len(rows), 'mode')} with {_name(modes)}"
    return Section(title, tables=[PageTable(headings, rows, right=range(7))], folded=len(rows) > 12)


def _mode(mode: Mode, modes: ModeSet) -> tuple[str, ...]:
    f, damping = mode.natural_frequency_hz, 100.0 * mode.damping
    known = [(float(d), float(v)) for d, v in zip(damping, modes.value, strict=True) if not math.isnan(d)]
    least, where = min(known, default=(math.nan, math.nan))
    numbers = (f[0], f[-1], damping[0], damping[-1], least, where)
    return (str(mode.number), *(number(float(x), ".4g") for x in numbers), ", ".join(mode.states))
