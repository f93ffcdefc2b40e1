"""Pictures of requirements for the report: one maker for each kind that can be drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

from workbench.errors import WorkbenchError
from workbench.report.page import Section
from workbench.study.kinds.base import Compliance, Requirement, Result
from workbench.study.kinds.mask import Mask
from workbench.study.kinds.step import Overshoot, SettlingTime
from workbench.study.words import said

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workbench.study.result import Checked, StudyResult

__all__ = ["pictures"]

_MOST = 12  # pictures on a page; those of violated requirements first


def pictures(result: StudyResult) -> Iterator[Section]:
    """Yield a section with the pictures of a study, if there are any.

    Args:
        result: of the study.
    """
    figures: list[tuple[Callable[[], Figure], str]] = []
    for checked in sorted(result.checked, key=lambda c: c.finding.passed):
        outcome = result.runs.get(checked.runs[0])
        if len(figures) < _MOST and outcome is not None and outcome.result is not None:
            figure = _drawn(checked, outcome.result)
            if figure is not None:
                figures.append((partial(_drawing, figure), f"{checked.name}: {said(checked.finding)}."))
    if figures:
        yield Section("Pictures", figures=figures)


def _drawing(figure: Figure) -> Figure:
    return figure


def _drawn(checked: Checked, result: Result) -> Figure | None:
    maker = next((m for kind, m in _MAKERS.items() if isinstance(checked.requirement, kind)), None)
    try:
        return maker(checked.requirement, result, checked.name, checked.finding) if maker is not None else None
    except WorkbenchError:
        return None  # the finding says what is wrong


def _mask(requirement: Requirement, result: Result, title: str, found: Compliance) -> Figure | None:
    from workbench.plotting.study import plot_between_masks  # noqa: PLC0415 - matplotlib is slow to import

    if not isinstance(requirement, Mask):
        return None
    curves = requirement.responses(result, requirement.corners)
    units = {"gain": "dB", "phase": "deg"}
    unit = units.get(requirement.quantity, curves[0].unit)
    return plot_between_masks(
        {c.label: (c.frequency, c.values(requirement.quantity)) for c in curves},
        title=title,
        quantity=requirement.quantity,
        unit=unit,
        upper=requirement.upper or (),
        lower=requirement.lower or (),
        worst=_place(found),
    )


def _place(found: Compliance) -> tuple[float, float] | None:
    """Return the frequency [Hz] and the value of the worst place."""
    if not isinstance(found.value, float) or " Hz" not in found.where:
        return None
    return float(found.where.split(" Hz")[0]), found.value


def _step(requirement: Requirement, result: Result, title: str, found: Compliance) -> Figure | None:
    from workbench.plotting.study import LIMIT, plot_step  # noqa: PLC0415 - matplotlib is slow to import

    if not isinstance(requirement, SettlingTime | Overshoot):
        return None
    history = requirement.history(result)
    begin, final = requirement.ends(history)
    width = requirement.band * abs(final - begin)
    lines = {"final value": final}
    times: dict[str, float] = {}
    if isinstance(requirement, SettlingTime):
        share = f"{100.0 * requirement.band:g} %"
        lines = {f"final value + {share}": final + width, f"final value − {share}": final - width}
        if isinstance(found.value, float):
            times["settled"] = requirement.after + found.value
        if requirement.max is not None:
            times[LIMIT] = requirement.after + requirement.max
    elif requirement.max is not None:
        lines["limit"] = final + requirement.max / 100.0 * (final - begin)
    name = requirement.signal(result)
    unit = history.unit
    return plot_step(history.time, history.values, title=title, name=name, unit=unit, lines=lines, times=times)


_MAKERS: Mapping[type[Requirement], Callable[[Requirement, Result, str, Compliance], Figure | None]] = {
    Mask: _mask,
    SettlingTime: _step,
    Overshoot: _step,
}
