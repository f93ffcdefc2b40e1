"""The pages of a feed-forward filter and of a balanced reduction."""

from __future__ import annotations

from functools import partial

import numpy as np

from workbench.analysis.feed_forward.result import FeedForwardResult
from workbench.analysis.feed_forward.trial import Trial
from workbench.analysis.reduction.balanced import BalancedReduction
from workbench.report.page import Page, Section, Table
from workbench.report.tables import counted, number, pole_table
from workbench.report.tones import Verdict

__all__ = ["feed_forward_page", "reduction_page"]

# Picture of the result → section and what it shows; "simulated" is drawn where something was simulated.
_PICTURES = {
    "reduced": ("Reduction", "Filter before and after the reduction."),
    "compensation": ("Compensation", "G·F and H: where they agree, the filter cancels the block's output."),
    "mirrored": ("Mirroring and low-pass", "Before and after mirroring, and with the low-pass."),
    "error": ("Error", "G·F/H − 1 over frequency."),
    "poles": ("Poles", "What was cancelled and what was mirrored."),
}


def feed_forward_page(result: FeedForwardResult) -> Page:
    """Return the page of a filter: each step with its errors, pictures, simulations."""
    last = result.steps[-1]
    return Page(
        title=f"Feed-forward from {result.output} to {result.target}",
        lead=f"A filter of order {last.order}, {result.band[0]:g} to {result.band[1]:g} Hz: errors up to "
        f"{last.gain_error_db:.3g} dB and {last.phase_error_deg:.3g}°.",
        facts={
            "nonlinear block": f"{result.block}: {result.input} → {result.output}",
            "feedback": "none" if result.source is None else f"{result.source} with gain {result.gain:g}",
            "unstable poles": f"{len(result.open_unstable)} without feedback, {len(result.closed_unstable)} with it",
            "band": f"{result.band[0]:g} to {result.band[1]:g} Hz",
        },
        sections=[
            Section("Overview", figures=[(result.plot, "The design in one picture.")]),
            _steps(result),
            *(Section(t, figures=[(partial(result.plot, figure=f), words)]) for f, (t, words) in _PICTURES.items()),
            *_trials(result),
            Section("Poles of the filter", tables=[pole_table(result.part.poles.tolist(), 0.0)], folded=True),
        ],
        summary=[_verdict(t) for t in result.trials],
        notes=result.notes,
        kind="feed-forward",
    )


def _steps(result: FeedForwardResult) -> Section:
    rows = [
        (
            s.name, str(s.order), f"{s.gain_error_db:.3g}", f"{s.phase_error_deg:.3g}", f"{100.0 * s.residual:.3g}",
            str(len(s.unstable_poles)), s.remark,
        )
        for s in result.steps
    ]  # fmt: skip
    headings = ("step", "order", "gain error [dB]", "phase error [deg]", "left [%]", "unstable poles", "remark")
    return Section("Steps", tables=[Table(headings, rows, right=range(1, 6))])


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
    levels = list(result.trials[0].settling_seconds)
    rows = [
        (
            t.name,
            "yes" if t.limited else "no",
            *(number(t.settling_seconds[level], ".4g") for level in levels),
            number(None if t.rest is None else 100.0 * t.rest, ".3g"),
            f"{t.largest_target:.4g}",
            f"{t.largest_target_rate:.4g}",
        )
        for t in result.trials
    ]
    settled = (f"settled to {100.0 * level:g} % [s]" for level in levels)
    headings = ("control", "limits", *settled, "left [%]", "largest command", "rate [1/s]")
    return [
        Section(
            "Simulations",
            figures=[(partial(result.plot, figure="simulated"), "Time histories.")],
            tables=[Table(headings, rows, right=range(2, len(headings)))],
        )
    ]


def reduction_page(result: BalancedReduction) -> Page:
    """Return the page of a reduced system: Hankel singular values, error bound, poles."""
    values = result.hankel[:60]
    kept = result.order - result.unstable
    largest = float(np.max(result.hankel, initial=0.0)) or 1.0
    rows = [
        (str(k), f"{v:.5g}", f"{v / largest:.3g}", "kept" if k <= kept else "left out")
        for k, v in enumerate(values.tolist(), start=1)
    ]
    headings = ("state", "Hankel singular value", "of the largest", "")
    return Page(
        title=f"Reduction from order {result.full_order} to {result.order}",
        lead=f"No gain of the difference exceeds {result.bound:.4g} at any frequency.",
        facts={"method": result.method, "unstable poles": f"{counted(result.unstable, 'pole')}, all kept"},
        sections=[
            Section("Singular values", tables=[Table(headings, rows)]),
            Section("Poles", tables=[pole_table(result.part.poles.tolist(), 0.0)]),
        ],
        kind="balanced-reduction",
    )
