"""The page of a feed-forward filter."""

from __future__ import annotations

from functools import partial

from workbench.limit_cycles.feed_forward.result import FeedForwardResult
from workbench.limit_cycles.feed_forward.trial import Trial
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import number, pole_table
from workbench.show.verdicts import Verdict

__all__ = ["filter_page"]

# Picture of the result → section and what it shows; "simulated" is drawn where something was simulated.
_PICTURES = {
    "reduced": ("Reduction", "Filter before and after the reduction."),
    "compensation": ("Compensation", "G·F and H: where they agree, the filter cancels the block's output."),
    "mirrored": ("Mirroring and low-pass", "Before and after mirroring, and with the low-pass."),
    "error": ("Error", "G·F/H − 1 over frequency."),
    "poles": ("Poles", "What was cancelled and what was mirrored."),
}

_ENDS = {"finite escape": "escapes in finite time", "exponential": "grows exponentially"}


def filter_page(result: FeedForwardResult) -> Page:
    """Return the page of a filter: each step with its errors, pictures, simulations."""
    last = result.steps[-1]
    return Page(
        title=f"Feed-forward from {result.output} to {result.target}",
        lead=f"A filter of order {last.order}, {result.band[0]:g} to {result.band[1]:g} Hz: errors up to "
        f"{last.gain_error_db:.3g} dB and {last.phase_error_deg:.3g}°.",
        facts={
            "nonlinear block": f"{result.block}: {result.input} → {result.output}",
            "feedback": "none" if result.source is None else f"{result.source} with gain {result.gain:g}",
            **_second(result),
            "unstable poles": f"{len(result.open_unstable)} without feedback, {len(result.closed_unstable)} with it",
            "band": f"{result.band[0]:g} to {result.band[1]:g} Hz",
        },
        sections=[
            Section("Overview", figures=[(result.plot, "The design in one picture.")]),
            _steps(result),
            *(Section(t, figures=[(partial(result.plot, figure=f), words)]) for f, (t, words) in _PICTURES.items()),
            *_trials(result),
            Section("Poles of the filter", tables=[pole_table(result.part.poles.tolist(), 0.0)], explains=True),
        ],
        summary=[_verdict(t) for t in result.trials],
        notes=result.notes,
        kind="feed-forward",
    )


def _second(result: FeedForwardResult) -> dict[str, str]:
    if result.shared is None:
        return {}
    x, y = result.shared.weights
    return {"control inputs": f"{result.target} with {x:.4g}, {result.second} with {y:.4g} of the filter's output"}


def _steps(result: FeedForwardResult) -> Section:
    rows = [
        (
            s.name, str(s.order), f"{s.gain_error_db:.2f}", f"{s.gain_error_hz:.2f}", f"{s.phase_error_deg:.1f}",
            f"{s.phase_error_hz:.2f}", f"{s.residual:.2g}",
            "" if s.name == "reduced" else str(len(s.unstable_poles)), s.remark,
        )
        for s in result.steps
    ]  # fmt: skip
    headings = (
        "step", "order", "gain error [dB]", "at [Hz]", "phase error [deg]", "at [Hz]", "residual", "unstable", "remark",
    )  # fmt: skip
    low, high = result.band
    words = f"Errors compared with H/G from {low:g} to {high:g} Hz; residual: largest |G·F − H| over the largest |H|."
    return Section("Steps", paragraphs=[words], tables=[PageTable(headings, rows, right=range(1, 8))])


def _verdict(trial: Trial) -> Verdict:
    within = " within limits" if trial.limited else ""
    name = f"{trial.name}{within}"
    if trial.failure or trial.divergence is not None:
        return Verdict("failed", f"{name}: {trial.failure or trial.divergence}")
    rest = "" if trial.rest is None else f"{100.0 * trial.rest:.3g} % of the motion left at the end"
    return Verdict("simulated", f"{name}: {rest}")


def _trials(result: FeedForwardResult) -> list[Section]:
    if not result.trials:
        return []
    first = result.trials[0]
    rows = [
        (
            t.name,
            "yes" if t.limited else "no",
            *(_settled(t, seconds) for seconds in t.settling_seconds.values()),
            _left(t),
            f"{t.largest_target:.4g}",
            f"{t.largest_target_rate:.4g}",
        )
        for t in result.trials
    ]
    settled = (f"{100.0 * level:g} %" for level in first.settling_seconds)
    headings = ("control", "limits", *settled, "left at the end", "largest command", "rate [1/s]")
    words = (
        f"Seconds after {first.closes_at:g} s until {result.input} stays below a part of its largest value before, "
        f"{first.before:.4g}."
    )
    return [
        Section(
            "Simulations",
            paragraphs=[words],
            figures=[(partial(result.plot, figure="simulated"), "Time histories.")],
            tables=[PageTable(headings, rows, right=range(2, len(headings)))],
        )
    ]


def _settled(trial: Trial, seconds: float | None) -> str:
    if trial.failure:
        return ""
    return "never" if seconds is None else f"{seconds:.2f} s"


def _left(trial: Trial) -> str:
    if trial.failure:
        return _ENDS.get(trial.divergence.kind, trial.divergence.kind) if trial.divergence else "stopped"
    return number(trial.rest, ".2g")
