"""The page of a loop's margins."""

from __future__ import annotations

import math
from collections.abc import Collection

from workbench.core.values.decibels import decibels, degrees
from workbench.core.values.margins import Margins
from workbench.loops.loop.measured import LoopCurve, LoopPoint
from workbench.loops.loop.result import LoopResult
from workbench.loops.nyquist.absolute import AbsoluteStability
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, number, pole_table
from workbench.show.verdicts import Verdict

__all__ = ["loop_page", "margin_tables", "margin_verdict"]


def loop_page(result: LoopResult) -> Page:
    """Return the page of a loop: verdict on the closed loop, margins, pictures, what was measured."""
    place = result.place
    unit = behind(place.unit)
    return Page(
        title=f"Loop of {result.system} at {place.source}",
        lead=f"Opened at {place.label}, where the signal is {result.value:.6g}{unit} at the operating point.",
        facts={
            "convention": (
                "negative feedback: L is minus the ratio of the returned signal to the one passed on; closed loop "
                "1/(1 + L)"
            ),
            **({"measured so": result.why} if result.why else {}),
        },
        sections=[
            Section(
                "Pictures", figures=[(result.plot, "Loop transfer L as Bode and Nyquist pictures, and |S| and |T|.")]
            ),
            *_linear(result),
            *(_curve(c, place.unit) for c in result.curves),
            *_several(result),
        ],
        summary=_verdicts(result, unit),
        notes=result.notes,
        kind="loop",
    )


def _several(result: LoopResult) -> list[Section]:
    """Return the disk margins of several places, and what the others are by themselves."""
    if not result.others:
        return []
    rows = [
        (d.where, number(d.alpha), number(d.gain_db), number(d.phase_deg), number(d.frequency_hz))
        for d in result.disk_margins
    ]
    headings = ("where gain and phase vary at once", "disk", "gain ± [dB]", "phase ± [deg]", "at [Hz]")
    tables = [PageTable(headings, rows, right=(1, 2, 3, 4))] if rows else []
    parts = [
        Section(
            f"Opened at {other.place.label}",
            parts=[*_linear(other), *(_curve(c, other.place.unit) for c in other.curves)],
        )
        for other in result.others
    ]
    return [Section("Several loops", tables=tables, parts=parts)]


def _verdicts(result: LoopResult, unit: str) -> list[Verdict]:
    linear = [] if result.linear is None else [margin_verdict("linear loop", result.linear.margins)]
    verdicts = [
        *linear,
        *(margin_verdict(f"{c.how}, amplitude {c.amplitude:g}{unit}", c.margins) for c in result.curves),
    ]
    verdicts += [
        margin_verdict(f"opened at {other.place.label}", other.linear.margins)
        for other in result.others
        if other.linear is not None
    ]
    verdicts += [
        Verdict("stable", f"{d.where}: ±{d.gain_db:.3g} dB or ±{d.phase_deg:.3g}° (disk margin)")
        for d in result.disk_margins[-1:]
    ]
    failed = [(c, p) for one in (result, *result.others) for c in one.curves for p in c.failed]
    return verdicts + [
        Verdict("failed", f"amplitude {c.amplitude:g}{unit} at {p.frequency_hz:.5g} Hz: {p.reason}") for c, p in failed
    ]


def margin_verdict(where: str, margins: Margins) -> Verdict:
    """Return in one line whether the closed loop is stable, and its smallest margins.

    Args:
        where: which loop it is.
        margins: of it.
    """
    words = {"stable": "stable", "unstable": "unstable"}
    result = [
        f"gain margin {margins.gain_margin_db:.3g} dB" if 0.0 < margins.gain_margin < math.inf else "",
        f"phase margin {margins.phase_margin_deg:.3g}°" if math.isfinite(margins.phase_margin_deg) else "",
        f"delay margin {1e3 * margins.delay_margin_s:.3g} ms" if math.isfinite(margins.delay_margin_s) else "",
    ]
    unseen = _unseen(margins)
    not_seen = f"{' and '.join(unseen)} not seen in the band: widen it" if unseen else ""
    text = "; ".join(filter(None, [margins.words, ", ".join(filter(None, result)), not_seen]))
    word = words.get(margins.verdict, "unknown")
    return Verdict("watch" if unseen and word == "stable" else word, f"{where}: {text}")


def _unseen(m: Margins) -> list[str]:
    """Return the margins that a measured band is too narrow for; none: they are known, or nothing was measured."""
    if m.everywhere or not m.meaningful or math.isnan(m.peak_sensitivity):
        return []
    known = {"gain": m.gain_margin, "phase": m.phase_margin_deg, "delay": m.delay_margin_s}
    *most, last = [name for name, value in known.items() if math.isnan(value)] or [""]
    return [*most, f"{last} margin"] if last else []


def _linear(result: LoopResult) -> list[Section]:
    if result.linear is None:
        return []
    dt = result.linear.transfer.dt
    sampled = f", sampled every {dt:.6g} s" if dt > 0.0 else ""
    poles = pole_table(result.linear.stability.poles.tolist(), dt)
    return [
        Section(
            "Linear loop",
            paragraphs=[f"Linearised by {result.linear.lin.method}{sampled}."],
            tables=[*margin_tables(result.linear.margins), *_sectors(result.linear.absolute)],
            parts=[Section("Closed loop", tables=[poles], folded=True)],
        )
    ]


def _sectors(result: AbsoluteStability | None) -> list[PageTable]:
    """Return what may stand in the connection in place of the gain 1."""
    if result is None:
        return []
    if result.refused:
        return [PageTable(("proven with a characteristic in the connection", ""), [("nothing", result.refused)])]

    def row(name: str, k: float | None) -> tuple[str, str]:
        return name, "any" if k is None else f"0 … {k:.6g}"

    rows = [
        row("constant gain", result.linear),
        row("circle criterion: any, also one that changes with time", result.circle),
        row("Popov's criterion: any that does not", result.popov),
    ]
    return [PageTable(("stable with, in the connection,", "slopes"), rows)]


def _curve(curve: LoopCurve, unit: str | None) -> Section:
    headings = (
        "frequency [Hz]", "gain", "gain [dB]", "phase [deg]", "THD passed [%]", "THD returned [%]",
        bracketed("injected", unit), "balance [%]", "periods", "status",
    )  # fmt: skip
    points = PageTable(headings, [_point(p) for p in curve.points], verdict=9, right=range(9))
    return Section(
        f"Measured ({curve.how}), amplitude {curve.amplitude:g}{behind(unit)}",
        items=curve.notes,
        tables=margin_tables(curve.margins, curve.frequency_hz[[0, -1]].tolist() if curve.frequency_hz.size else ()),
        parts=[Section("Points", tables=[points], folded=True)],
    )


def margin_tables(m: Margins, ends: Collection[float] = ()) -> list[PageTable]:
    """Return the margins with where they are, and the crossovers; of a loop that is not stable the crossovers alone.

    Args:
        m: margins; peaks that are NaN are left out.
        ends: of the band in which they were measured [Hz]: what is extreme there may be more so beyond.
    """

    def bound(sign: str, frequency_hz: float, text: str) -> str:
        at_edge = any(math.isclose(frequency_hz, end, rel_tol=1e-9) for end in ends)
        return f"{sign} {text} (edge of the band)" if at_edge else text

    rows = [
        ("gain margin", _db(m.gain_margin), _hz(m.phase_crossover_hz)),
        ("gain may fall to", _db(m.gain_reduction), ""),
        ("phase margin", _unit(m.phase_margin_deg, "deg"), _hz(m.gain_crossover_hz)),
    ]
    if not (m.everywhere and math.isnan(m.delay_margin_s)):  # else a delay is no factor on the signal
        rows.append(("delay margin", _unit(m.delay_margin_s, "s"), ""))
    if m.disk is not None:
        d = m.disk
        text = f"{d.alpha:.4g}: gain × {d.low:.4g} to {d.high:.4g}, phase ± {d.phase_deg:.4g}°"
        rows.append(("disk margin", bound("≤", d.frequency_hz, text), _hz(d.frequency_hz)))
    seen = not math.isnan(m.peak_sensitivity)
    if seen:
        for name, value, at in (
            ("largest |S|", m.peak_sensitivity, m.peak_sensitivity_hz),
            ("largest |T|", m.peak_complementary, m.peak_complementary_hz),
        ):
            rows.append((name, bound("≥", at, f"{value:.5g}"), _hz(at)))
    known = m.meaningful and (seen or m.everywhere)
    single = [PageTable(("margin", "value", "at [Hz]"), rows, right=(2,))] if known else []
    return [*single, *_crossovers(m)]


def _crossovers(m: Margins) -> list[PageTable]:
    """Return where |L| is 1 or L negative: with phase and gain of L where margins mean nothing."""

    def phase(margin: float) -> str:
        if m.meaningful:
            return f"phase margin {margin:.4g}°"
        return f"phase {margin - math.copysign(180.0, margin):.4g}°"

    def gain(db: float) -> str:
        return f"gain margin {db:.4g} dB" if m.meaningful else f"gain {-db:.4g} dB"

    rows = [("gain crossover", _hz(c.frequency_hz), phase(c.phase_margin_deg)) for c in m.gain_crossovers]
    rows += [("phase crossover", _hz(c.frequency_hz), gain(c.db)) for c in m.phase_crossovers]
    return [PageTable(("crossover", "at [Hz]", "value"), rows, right=(1,))] if rows else []


def _db(factor: float) -> str:
    if not math.isfinite(factor):
        return _unbounded(factor)
    return "no lower limit" if factor <= 0.0 else f"{float(decibels(factor)):.4f} dB (factor {factor:.5g})"


def _unit(value: float, unit: str) -> str:
    return f"{value:.5g} {unit}" if math.isfinite(value) else _unbounded(value)


def _unbounded(value: float) -> str:
    return "infinite" if math.isinf(value) else "not seen in the band"


def _hz(frequency: float) -> str:
    return f"{frequency:.5g}" if math.isfinite(frequency) else ""


def _point(p: LoopPoint) -> tuple[str, ...]:
    gain, db, phase = ("–", "–", "–") if p.value is None else _polar(p.value)
    percent = (None if x is None else 100.0 * x for x in (p.thd_passed, p.thd_returned))
    balance = None if p.balance is None else 100.0 * p.balance
    rest = (number(x, ".3g") for x in (*percent, p.injected, balance))
    return (f"{p.frequency_hz:.5g}", gain, db, phase, *rest, str(p.periods), p.status)


def _polar(value: complex) -> tuple[str, str, str]:
    size = abs(value)
    db = f"{float(decibels(size)):.3f}" if size > 0.0 else "–"
    return f"{size:.5g}", db, f"{float(degrees(value)):.2f}"
