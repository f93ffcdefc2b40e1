"""The page of an operating point."""

from __future__ import annotations

from workbench.core.values.operating_point import told
from workbench.point.trim.result import Residual, TrimResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, number
from workbench.show.verdicts import Verdict

__all__ = ["trim_page"]


def trim_page(result: TrimResult) -> Page:
    """Return the page of an operating point: values, what is left over, directions that are open."""
    # One point of a family is an arbitrary one: that it was found does not say that it is the one that was meant.
    found = "watch" if result.null_directions else "converged"
    word = found if result.converged else "failed"
    return Page(
        title=f"Operating point of {result.model}",
        lead=_lead(result),
        facts={
            "searched for": ", ".join(result.unknowns) or "nothing",
            "effort": f"{counted(result.iterations, 'iteration')}, {counted(result.evaluations, 'evaluation')}",
        },
        sections=[_point(result), *_residuals(result), *_open(result)],
        summary=[Verdict(word, result.message)],
        notes=result.notes,
        kind="trim",
    )


def _lead(result: TrimResult) -> str:
    what = "nothing moves" if result.converged else "the search ended, but the model is not at rest"
    return f"States, inputs and outputs at {result.operating_point.time:g} s where {what}; method: {result.method}."


def _point(result: TrimResult) -> Section:
    point = result.operating_point
    groups = (("state", point.x), ("discrete state", point.discrete), ("input", point.u), ("output", point.y))
    rows = [
        (
            name,
            kind,
            f"{told(value):.8g}",
            point.units.get(name) or "",
            number(told(point.dx[name]) if name in point.dx else None, ".4g") if kind == "state" else "",
            ("found" if result.converged else "not found") if name in result.unknowns else "",
        )
        for kind, values in groups
        for name, value in values.items()
    ]
    headings = ("variable", "kind", "value", "unit", "derivative [unit/s]", "remark")
    return Section("Values", tables=[PageTable(headings, rows, right=(2, 4))])


def _residuals(result: TrimResult) -> list[Section]:
    if not result.residuals:
        return []
    rows = [
        (r.name, f"{told(r.value):.4g}", r.unit or "", f"{told(r.scaled):.2g}", _remark(r)) for r in result.residuals
    ]
    table = PageTable(("equation", "left over", "unit", "scaled", "remark"), rows, right=(1, 3))
    words = "Residual of each equation, relative to the change made by one nominal change of the unknowns."
    return [Section("Residuals", figures=[(result.plot, words)], tables=[table])]


def _remark(residual: Residual) -> str:
    if not residual.required:
        return "floating"
    return "no unknown changes it" if residual.idle and residual.value else ""


def _open(result: TrimResult) -> list[Section]:
    """Return directions in which the point may move and stays an equilibrium."""
    if not result.null_directions:
        return []
    words = (
        "The unknowns can change together in this way while every equation still holds: the point is one of a family "
        "of equilibria."
    )
    return [Section("Open directions", paragraphs=[words], items=[str(d) for d in result.null_directions])]
