"""The page of a robustness analysis."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.loops.robust.family import UncertainParameter
from workbench.loops.robust.result import RobustResult, WorstDisk
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["robust_page"]


def robust_page(result: RobustResult) -> Page:
    """Return the page: verdict and margin, worst parameter set, worst-case gain and disk margin, µ over frequency."""
    return Page(
        title=f"Robustness of {result.model}",
        lead=_lead(result),
        facts={
            "uncertain": counted(len(result.parameters), "parameter"),
            "stability margin": _between(result.stability.lower, result.stability.upper, result.stability.up_to),
            "equilibrium": "found at each parameter set" if result.trimmed else "the operating point is held",
            "linear models": str(result.neglected.models),
            "neglected": f"{100.0 * result.neglected.relative:.2g} % of what the parameters do; in the bounds",
        },
        sections=[_parameters(result), _worst(result), *_gain(result), _mu(result)],
        summary=_verdicts(result),
        notes=result.notes,
        kind="robust",
    )


def _lead(result: RobustResult) -> str:
    s = result.stability
    if s.approximate:
        return "Whether it is stable for all parameters in their ranges is not known: it has transport delays."
    if s.verdict == "stable":
        parts = f", proved in {s.boxes} parts" if s.boxes > 1 else ""
        return f"Stable for all parameters in their ranges{parts}."
    if s.verdict == "unstable":
        return "Unstable for some parameters in their ranges."
    why = "the bounds leave a gap" if s.lower > 0.0 else "nothing is proved, and no unstable set was found in them"
    return f"Whether it is stable for all parameters in their ranges is not decided: {why}."


def _between(lower: float, upper: float, up_to: float) -> str:
    """Say up to which multiple of the ranges the model is stable."""
    sure = f"stable up to {lower:.3g} times the ranges" if lower > 0.0 else "nothing is proved"
    if math.isinf(upper):
        return f"{sure}; no unstable set was found up to {up_to:.3g} times"
    return f"{sure}, unstable from {upper:.3g} times on"


def _verdicts(result: RobustResult) -> list[Verdict]:
    s = result.stability
    gap = f" (gap {100.0 * (1.0 - s.lower / s.upper):.2g} %)" if math.isfinite(s.upper) and s.lower > 0.0 else ""
    of = "with Padé approximations of the delays: " if s.approximate else ""
    verdicts = [Verdict(s.verdict, of + _between(s.lower, s.upper, s.up_to) + gap)]
    gain = result.worst_gain
    if gain is not None and not result.disk_margins:
        word = "good" if math.isfinite(gain.upper) else "unknown"
        verdicts.append(Verdict(word, f"worst-case gain {_bounds(gain.lower, gain.upper)}, nominal {gain.nominal:.4g}"))
    verdicts += [Verdict("good" if d.alpha > 0.0 else "unknown", f"{d.where}: {_disk(d)}") for d in result.disk_margins]
    return verdicts


def _bounds(lower: float, upper: float) -> str:
    return f"between {lower:.4g} and {upper:.4g}" if math.isfinite(upper) else f"at least {lower:.4g}, not bounded"


def _disk(d: WorstDisk) -> str:
    if not d.alpha > 0.0:
        return f"no disk margin is proved; found {d.found:.3g}, nominal {d.nominal:.3g}"
    gain = f"±{d.gain_db:.3g} dB" if math.isfinite(d.gain_db) else "any gain"
    return f"{gain} or ±{d.phase_deg:.3g}° are left in the worst case (disk {d.alpha:.3g}, nominal {d.nominal:.3g})"


def _parameters(result: RobustResult) -> Section:
    worst = result.stability.worst
    rows = [
        (p.name, f"{p.low:.6g}", f"{p.high:.6g}", p.unit or "", str(rank), _found(p, worst.parameters[p.name]))
        for p, rank in zip(result.parameters, result.neglected.ranks, strict=True)
    ]
    table = PageTable(("parameter", "low", "high", "unit", "rank", "worst found"), rows)
    return Section("Parameters", tables=[table])


def _found(p: UncertainParameter, value: float) -> str:
    """Return a value of the worst set, and that it is outside the range: sets are sought in multiples of the ranges."""
    slack = 1e-9 * (p.high - p.low)
    return f"{value:.6g}" if p.low - slack <= value <= p.high + slack else f"{value:.6g}, outside the range"


def _worst(result: RobustResult) -> Section:
    worst = result.stability.worst
    what = "Unstable" if worst.unstable else "Slowest pole in the ranges"
    unit = "" if result.dt > 0.0 else " 1/s"
    values = ", ".join(
        f"{p.name} = {worst.parameters[p.name]:.6g}{behind(p.unit)}" for p in result.parameters
    )  # fmt: skip
    pole = f"{worst.pole.real:.5g}{f' ± {worst.pole.imag:.5g}j' if worst.pole.imag else ''}{unit}"
    words = f"{what}: {values}; pole {pole}, {number(worst.frequency_hz)} Hz. The model was linearised there."
    return Section(
        "Worst case of stability", paragraphs=[words], code=[result.command_line] if result.command_line else []
    )


def _gain(result: RobustResult) -> Sequence[Section]:
    gain = result.worst_gain
    if gain is None:
        return []
    rows = [
        ("nominal", f"{gain.nominal:.5g}"),
        ("worst found", f"{gain.lower:.5g}"),
        ("proved bound", f"{gain.upper:.5g}" if math.isfinite(gain.upper) else "none"),
        ("at [Hz]", number(gain.frequency_hz)),
        *((bracketed(p.name, p.unit), f"{gain.parameters[p.name]:.6g}") for p in result.parameters),
    ]
    title = "Worst case of S - T" if result.disk_margins else "Worst-case gain"
    return [Section(title, tables=[PageTable(("", "value"), rows, right=(1,))])]


def _mu(result: RobustResult) -> Section:
    beside = "poles" if result.worst_gain is None else "gain"
    caption = (
        "Left, the bounds of µ over frequency: below 1 the loop is stable for all parameters in their ranges. "
        f"Right, the {beside} in the middle of the ranges and at the worst parameters found."
    )
    return Section("µ over frequency", figures=[(result.plot, caption)] if result.mu else [])
