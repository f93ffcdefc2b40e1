"""The page of an identification with static blocks."""

from __future__ import annotations

from workbench.data.advice.page import data_facts
from workbench.identification.structures.result import StructureResult
from workbench.identification.structures.table import StaticTable
from workbench.identification.validate.spread import model_spread
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, number, pole_table
from workbench.show.verdicts import Verdict

__all__ = ["structure_page"]


def structure_page(result: StructureResult) -> Page:
    """Return the page of a linear block with static blocks: tables with errors, poles, how well it follows."""
    where = "other data" if result.other is not None else "the data of the fit"
    lead = (
        f"{result.structure.capitalize()} model of order {result.order}: fit {result.fit_percent:.4g} % on {where}, "
        f"the linear model alone {result.linear_fit_percent:.4g} %."
    )
    data = result.data
    ends = ((result.before, data.input_names[0], data.input_units[0]), (result.behind, *_output(result)))
    tables = [_values(table, name, unit) for table, name, unit in ends if table is not None]
    words = "Static blocks with 95 % errors; below, measured and simulated output."
    tried = [(str(t.order), str(t.knots or "none"), number(t.criterion, ".6g")) for t in result.tried]
    regions = model_spread(result.linear).words if result.order else ()
    return Page(
        title=f"{result.structure.capitalize()} model of {data.name}",
        lead=lead,
        facts={
            **data_facts(data),
            "order": f"{result.order}, {result.order_reason}",
            "disturbance": f"equation of order {result.noise_order}, innovations {number(result.noise_rms, '.4g')} rms",
        },
        sections=[
            Section("Static blocks", tables=tables, figures=[(result.plot, words)]),
            Section(
                "Linear block",
                items=regions,
                tables=[pole_table(result.linear.poles.tolist(), result.linear.dt, "Poles")],
            ),
            Section("Orders and numbers of knots", tables=[PageTable(("order", "knots", "Bayesian criterion"), tried)]),
        ],
        summary=[
            *(Verdict("failed", why) for why in result.failed.values()),
            *([] if result.failed else [_verdict(result)]),
        ],
        notes=result.notes,
        kind="structure",
    )


def _output(result: StructureResult) -> tuple[str, str | None]:
    return result.data.output_names[0], result.data.output_units[0]


def _verdict(result: StructureResult) -> Verdict:
    if result.pays:
        return Verdict("good", "the data show static blocks")
    return Verdict("watch", "the data show no static block of this kind")


def _values(table: StaticTable, name: str, unit: str | None) -> PageTable:
    head = bracketed(name, unit)
    rows = [
        (number(x), number(y), number(error, ".2g"))
        for x, y, error in zip(table.x.tolist(), table.y.tolist(), table.error.tolist(), strict=True)
    ]
    return PageTable((f"into the block: {head}", "out of it", "95 % error ±"), rows, right=range(3))
