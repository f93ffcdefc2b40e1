"""The page of the advice on data."""

from __future__ import annotations

from workbench.data.advice.result import Advice
from workbench.data.experiment.experiment import Experiment
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import Verdict

__all__ = ["advice_page", "advice_table", "data_facts"]


def data_facts(data: Experiment) -> dict[str, str]:
    """Return what an experiment is, as facts of a page."""
    return {
        "data": f"{data.name}: {data.n_samples} samples every {data.dt:g} s",
        "inputs → outputs": f"{', '.join(data.input_names)} → {', '.join(data.output_names)}",
    }


def advice_table(advice: Advice) -> PageTable:
    """Return every finding with its evidence."""
    rows = [(f.topic, f.verdict, f.evidence, f.advice) for f in advice.findings]
    return PageTable(("question", "verdict", "evidence", "advice"), rows, verdict=1)


def advice_page(advice: Advice) -> Page:
    """Return the page of a judgement of data: each question with verdict, evidence and what to do."""
    orders = "as many as were tested" if advice.excited_orders is None else str(advice.excited_orders)
    return Page(
        title=f"Are the data of {advice.experiment.name} good enough?",
        lead=f"Judged: {advice.worst}.",
        facts={**data_facts(advice.experiment), "orders excited": orders},
        sections=[
            Section("Data", figures=[(advice.plot, "The data; marked: what was found in them.")]),
            Section("Findings", tables=[advice_table(advice)]),
        ],
        summary=[Verdict(f.verdict, f"{f.topic}: {f.evidence}") for f in advice.findings],
        kind="advise",
    )
