"""The algorithm of `drift`, its record and its page."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.names import declared_units
from workbench.model.operating_point import standing, start_at
from workbench.show.page import Page, PageTable, Section
from workbench.show.result import Result
from workbench_example.request import Drift

_ROWS = 500


@dataclass(frozen=True)
class DriftResult(Result):
    """How far outputs moved by themselves.

    Attributes:
        model: its name.
        begin, end: of the run [s].
        outputs: names.
        drift: max |y(t) - y(begin)| of each, in its unit, shape (outputs,).
        units: of each; None: it has none.
        notes: doubts.
        operating_point: where the run began.
    """

    _page = "workbench_example.drift:drift_page"
    _WHAT, _COMMAND = "a report of drift", "drift"

    model: str
    begin: float
    end: float
    outputs: tuple[str, ...]
    drift: Floats = field(metadata=entry(dims=("outputs",)))
    units: tuple[str | None, ...]
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None


def run(model: Model, request: Drift, job: Job) -> DriftResult:
    """Run a model without forcing; it is called in a worker process, without knowing it."""
    model, notes = start_at(model, request.at)
    names = [v.name for v in model.outputs if v.is_number]
    if not names:
        raise InputError(f"{model.name} has no outputs")
    with model.open_session() as session:
        begin, point = session.time, standing(model, session)
        if request.stop <= begin:
            raise InputError(f"stop: {request.stop:g} s is not after the start, {begin:g} s")
        before = session.values(names)
        times = np.linspace(begin, request.stop, _ROWS + 1)[1:]
        rows = session.advance(request.stop, signals={}, record=names, points=times)
    units = declared_units(model, names)
    result = DriftResult(
        model=model.name, begin=begin, end=request.stop, outputs=tuple(names),
        drift=np.array([np.abs(rows.values[name] - before[name]).max() for name in names]),
        units=tuple(units[name] for name in names), notes=tuple(notes), operating_point=point,
    )  # fmt: skip
    job.partial = lambda: result
    job.done("run", 1, 1)
    return result


def drift_page(result: DriftResult) -> Page:
    """Return the page of a record: a terminal, HTML and a notebook show it."""
    found = zip(result.outputs, result.drift.tolist(), result.units, strict=True)
    rows = [(name, f"{drift:.4g}", unit or "–") for name, drift, unit in found]
    return Page(
        title=f"Drift of {result.model}",
        lead=f"Without forcing, from {result.begin:g} to {result.end:g} s.",
        facts={},
        sections=[Section("Drift", tables=[PageTable(("output", "drift", "unit"), rows)])],
        notes=result.notes,
        kind="drift",
    )
