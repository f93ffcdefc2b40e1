"""The page of the onset of rate limiting."""

from __future__ import annotations

from workbench.loops.onset.result import OnsetPoint, OnsetResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["onset_page"]

_TONES = {
    "not reached": "good",
    "below the boundary": "good",
    "above the boundary": "poor",
    "outside of the boundary's phases": "watch",
}


def onset_page(result: OnsetResult) -> Page:
    """Return the page of an onset: verdict for each amplitude, the points in the Nichols chart, jumps, the attitude."""
    reached = sum(p.frequency_hz is not None for p in result.points)
    rate = f"{result.rate:g}{behind((result.limited_unit or '') + '/s')}"
    return Page(
        title=f"Rate limit of {result.limiter} in {result.model}",
        lead=f"The limit of {rate} is reached at {reached} of {counted(len(result.points), 'amplitude')} of "
        f"{result.input}.",
        facts={
            "input": bracketed(result.input, result.input_unit),
            "limited": f"{bracketed(result.limited, result.limited_unit)}, {rate}",
            **({"reached": _least(result.points[0], result.input_unit)} if result.points else {}),
        },
        sections=[_points(result), *_attitude(result)],
        summary=[_verdict(p, result.input_unit) for p in result.points],
        notes=result.notes,
        kind="onset",
    )


def _least(p: OnsetPoint, unit: str | None) -> str:
    """Say which amplitudes reach the limit anywhere in the band."""
    if p.least_amplitude is None:
        return "never: the input does not move what is limited"
    size = f"from an amplitude of {p.least_amplitude:.4g}{behind(unit)} on, at {p.highest_hz:.4g} Hz"
    return size + (", the end of the band: the rate still rises there, a wider band lowers it" if p.rises else "")


def _verdict(p: OnsetPoint, unit: str | None) -> Verdict:
    size = f"amplitude {p.amplitude:g}{behind(unit)}"
    if p.frequency_hz is None:
        highest = f"{100.0 * p.highest_ratio:.3g} % of the limit, at {p.highest_hz:.4g} Hz"
        end = ", the end of the band" if p.rises else ""
        return Verdict(_TONES[p.verdict], f"{size}: the rate reaches {highest}{end}")
    if p.above_db is None:
        words = "the boundary is published from -180° to -60° only"
    else:
        side = "above" if p.above_db > 0.0 else "below"
        words = f"{abs(p.above_db):.2f} dB {side} the boundary" + ("; expect a jump" if side == "above" else "")
    return Verdict(
        _TONES[p.verdict],
        f"{size}: onset at {p.frequency_hz:.4g} Hz, there L = {p.gain_db:.2f} dB at {p.phase_deg:.1f}°, {words}",
    )


def _points(result: OnsetResult) -> Section:
    headings = (
        bracketed("amplitude", result.input_unit), "onset [Hz]", "phase of L [deg]", "gain of L [dB]",
        "boundary [dB]", "above [dB]",
    )  # fmt: skip
    rows = [
        (
            f"{p.amplitude:g}", number(p.frequency_hz), number(p.phase_deg, ".2f"), number(p.gain_db, ".2f"),
            number(p.boundary_db, ".2f"), number(p.above_db, "+.2f"),
        )
        for p in result.points
    ]  # fmt: skip
    items = [
        f"amplitude {p.amplitude:g}: {p.jumps_told}"
        + "".join(f"; {j.kind} at {j.frequency_hz:.5g} Hz" for j in p.jumps or ())
        for p in result.points
        if p.jumps_told
    ]
    caption = "Open loop in the Nichols chart with the onset points and the boundary; the rate that is asked for."
    return Section("Onset points", tables=[PageTable(headings, rows)], items=items, figures=[(result.plot, caption)])


def _attitude(result: OnsetResult) -> list[Section]:
    attitude = result.attitude
    if attitude is None:
        return []
    rows = [
        ("bandwidth by phase, 45° before -180°", number(attitude.phase_bandwidth_hz), "Hz"),
        ("bandwidth by gain, 6 dB above that at -180°", number(attitude.gain_bandwidth_hz), "Hz"),
        ("bandwidth, the lower of both", number(attitude.bandwidth_hz), "Hz"),
        ("phase delay", number(attitude.phase_delay_s), "s"),
    ]
    table = PageTable(("of the response to the input", "value", "unit"), rows, right=(1,))
    return [Section(f"Attitude {attitude.output}", tables=[table])]
