"""The envelope of a study: what is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.study.description import Envelope, GridPoint, Study
from workbench.study.envelope.borders import border_points, borders_in
from workbench.study.envelope.evaluate import Evaluator
from workbench.study.envelope.probability import Probability, probability, together
from workbench.study.envelope.request import EnvelopeOf
from workbench.study.envelope.result import (
    Border,
    EnvelopeParameter,
    EnvelopePoint,
    EnvelopeResult,
    WorstCase,
    margin_of,
)
from workbench.study.envelope.sampling import COUNTS, planned, point_of
from workbench.study.envelope.search import search
from workbench.study.envelope.worst import system_at
from workbench.study.finished_store import Finished
from workbench.study.position_in_file import in_file
from workbench.study.read import read_study
from workbench.study.requirements.base import Compliance
from workbench.study.run import default_store

__all__ = ["EnvelopeRun", "run"]


def run(name: str | Path, request: EnvelopeOf, job: Job) -> EnvelopeResult:
    """Map, search and count; see `EnvelopeOf`."""
    study = read_study(name)
    if study.envelope is None:
        raise InputError(f"{name}: has no [envelope]; wb.run_study runs it")
    envelope = _as_asked(study.envelope, request)
    folder = (Path(request.store) if request.store is not None else default_store(name)) if request.keep else None
    with (
        in_file(study.path),
        Finished(folder) as finished,
        job.ended_by(),
        Evaluator(study, finished, request.place, job) as evaluator,
    ):
        return EnvelopeRun(study, envelope, evaluator, job).done()


def _as_asked(envelope: Envelope, request: EnvelopeOf) -> Envelope:
    """Return the envelope with what the command line gives in place of the study."""
    names = ("plan", "points", "seed", "search", "width")
    given: dict[str, Any] = {n: getattr(request, n) for n in names if getattr(request, n) is not None}
    if given.get("width", 0.0) > 1.0:
        raise InputError(f"width: {given['width']:g} is more than a probability can be uncertain; take at most 1")
    result = replace(envelope, **given)
    if "points" in given and result.plan == "grid":
        raise InputError("points: a grid has the steps of its parameters; leave it out, or take another plan")
    return result


class EnvelopeRun:
    """An envelope that is run.

    Args:
        study: that it belongs to.
        envelope: what it asks for.
        evaluator: runs the analyses.
        job: is told what is finished.
    """

    def __init__(self, study: Study, envelope: Envelope, evaluator: Evaluator, job: Job) -> None:
        self._study, self._envelope, self._evaluator, self._job = study, envelope, evaluator, job
        self._planned = planned(study, envelope)
        self._points: list[EnvelopePoint] = []
        self._worst: WorstCase | None = None
        self._borders: list[Border] = []
        self._notes: list[str] = []
        self._limit: dict[str, Any] = {}
        self._unit: str | None = None
        failures = max(1, len(study.configurations))
        self._total = len(self._planned) + failures * envelope.search + len(border_points_of(study, envelope))
        self._done = 0

    def done(self) -> EnvelopeResult:
        """Do all of it; an interrupt ends it with what there is."""
        self._job.partial = self._partial
        self._map()
        if not self._evaluator.stopped:
            self._find_borders()
        if not self._evaluator.stopped:
            self._find_worst()
        return self._result()

    def _partial(self) -> EnvelopeResult | None:
        return self._result() if self._points else None

    def _tell(self, before: int, count: int, label: str) -> None:
        """Tell how far it is; the record so far is complete up to the last step."""
        if label:
            self._job.done(label, min(before + count, self._total), self._total)

    # -- the points ----------------------------------------------------------------------------

    def _map(self) -> None:
        runs = len(self._envelope.requirement.analyses)
        result = self._evaluator.findings(
            self._envelope.requirement,
            self._planned,
            progress=lambda done, label: self._tell(0, done // runs, label),
        )
        self._points = [_point(p, f) for p, f in zip(self._planned, result, strict=True) if f is not None]
        first = next((f for f in result if f is not None and f.limit), None)
        if first is not None:
            self._limit, self._unit = dict(first.limit), first.unit
        self._done = len(self._planned)

    # -- borders -------------------------------------------------------------------------------

    def _find_borders(self) -> None:
        envelope = self._envelope
        points = border_points_of(self._study, envelope)
        before = self._done
        if points:
            plan, outcomes = self._evaluator.outcomes(
                envelope.borders, points, progress=lambda done, label: self._tell(before, done, label)
            )
            for name in envelope.borders:
                for k, point in enumerate(points):
                    outcome = outcomes.get(plan.at[name, k])
                    if outcome is not None and outcome.result is not None:
                        self._borders += borders_in(outcome.result, name, point, envelope.axes)
                    elif outcome is not None:
                        self._notes.append(f"borders by {name} at {point.label or 'the only line'}: {outcome.reason}")
            self._done += len(points)

    # -- the worst case ------------------------------------------------------------------------

    def _find_worst(self) -> None:
        spent, failed, how = 0, 0, "plan"
        worst = min((p for p in self._points if p.margin is not None), key=margin_of, default=None)
        if self._envelope.search and worst is None:
            self._notes.append("no search for the worst case: no point of the plan has a margin")
        elif self._envelope.search:
            failures: list[str | None] = [*self._study.configurations] or [None]
            for failure in failures:
                if self._evaluator.stopped:
                    break
                point, evaluations, without = self._search(failure)
                spent, failed = spent + evaluations, failed + without
                if point is not None and worst is not None and margin_of(point) < margin_of(worst):
                    worst, how = point, "search"
        if worst is not None:
            self._worst = self._as_worst(worst, how, spent, failed)

    def _search(self, failure: str | None) -> tuple[EnvelopePoint | None, int, int]:
        """Search under one failure; return the worst point, and how many were looked at and failed."""
        spreads = self._envelope.spreads
        looked_at: dict[bytes, EnvelopePoint] = {}

        def margins(places: Floats) -> Floats:
            rows = [[s.across(float(x)) for s, x in zip(spreads, row, strict=True)] for row in places]
            points = [point_of(self._study, spreads, failure, row) for row in rows]
            result = self._evaluator.findings(self._envelope.requirement, points, patient=True)
            if any(f is None for f in result):
                raise KeyboardInterrupt
            measured = [_point(p, f) for p, f in zip(points, result, strict=True) if f is not None]
            looked_at.update(zip((row.tobytes() for row in places), measured, strict=True))
            self._done += len(points)
            self._tell(self._done, 0, f"worst case {failure or ''}".strip())
            return np.array([np.nan if p.margin is None else p.margin for p in measured])

        own = [p for p in self._points if p.failure == failure and p.margin is not None]
        own = [p for p in own if all(_inside(s, p.values[s.name]) for s in spreads)]
        places = np.array([[s.place(p.values[s.name]) for s in spreads] for p in own]).reshape(-1, len(spreads))
        known = (places, np.array([margin_of(p) for p in own]))
        envelope = self._envelope
        try:
            result = search(margins, len(spreads), known=known, evaluations=envelope.search, seed=envelope.seed)
        except KeyboardInterrupt:
            best = min((p for p in looked_at.values() if p.margin is not None), key=margin_of, default=None)
            return best, len(looked_at), sum(p.margin is None for p in looked_at.values())
        return looked_at.get(result.place.tobytes()), result.evaluations, result.failed

    def _as_worst(self, worst: EnvelopePoint, result: str, evaluations: int, failed: int) -> WorstCase | None:
        if isinstance(worst.value, str) or worst.value is None or worst.margin is None:
            return None
        requirement = self._envelope.requirement
        point = GridPoint(configuration=worst.failure, values=worst.values)
        lines = self._evaluator.line_at(requirement, point)
        said = f"Worst case of {self._study.name}: {requirement.name} {worst.value:.8g}, margin {worst.margin:+.4g}."
        models = dict.fromkeys(m for name in requirement.analyses for m in self._study.analyses[name].models)
        at = {m: self._study.model_at(m, point) for m in models}
        texts = {m: system_at(change, self._study.folder, [said, *lines]) for m, change in at.items()}
        return WorstCase(
            failure=worst.failure, values=worst.values, value=float(worst.value), margin=worst.margin,
            where=worst.where, found=result, evaluations=evaluations, failed=failed, commands=tuple(lines),
            systems={m: text for m, text in texts.items() if text},
        )  # fmt: skip

    # -- the record ----------------------------------------------------------------------------

    @cached_property
    def _units(self) -> dict[str, str]:
        from workbench.study.names import units_of  # noqa: PLC0415 - only where models are opened

        return units_of(self._study, [s.name for s in self._envelope.spreads])

    def _probabilities(self) -> tuple[Probability, ...]:
        envelope = self._envelope
        if envelope.plan == "grid":
            return ()
        failures: list[str | None] = [*self._study.configurations] or [None]
        passed = [[p.passed for p in self._points if p.failure == f] for f in failures]
        shared = {"confidence": envelope.confidence, "width": envelope.width}
        each = [probability(f, p, **shared) for f, p in zip(failures, passed, strict=True)]  # type: ignore[arg-type]
        if envelope.weights:
            weights = list(envelope.weights.values())
            each.append(together(passed, weights, confidence=envelope.confidence))
        return tuple(each)

    def _result(self) -> EnvelopeResult:
        envelope = self._envelope
        return EnvelopeResult(
            study=self._study.name,
            requirement=envelope.requirement.name,
            limit=self._limit,
            unit=self._unit,
            plan=envelope.plan,
            seed=envelope.seed,
            parameters=tuple(
                EnvelopeParameter(
                    name=s.name,
                    spread=s.words,
                    low=None if s.discrete else s.low,
                    high=None if s.discrete else s.high,
                    values=s.values,
                    unit=self._units.get(s.name),
                )
                for s in envelope.spreads
            ),
            failures=tuple(self._study.configurations),
            axes=envelope.axes,
            points=tuple(self._points),
            probabilities=self._probabilities(),
            interval=COUNTS[envelope.plan],
            worst=self._worst,
            borders=tuple(self._borders),
            planned=len(self._planned),
            measured=self._evaluator.measured,
            reused=self._evaluator.reused,
            files={self._study.path.name: self._study.sha256, **self._evaluator.files},
            notes=(*self._plan_notes(), *self._notes, *self._evaluator.afterwards),
        )

    def _plan_notes(self) -> Sequence[str]:
        envelope = self._envelope
        notes = []
        if envelope.plan == "sobol" and envelope.points & (envelope.points - 1):
            notes.append(f"{envelope.points} Sobol' points are not balanced; take a power of two")
        if len(envelope.spreads) > len(envelope.axes):
            notes.append(f"the map shows {' and '.join(envelope.axes) or 'no axis'}; the other parameters vary, too")
        return notes


def border_points_of(study: Study, envelope: Envelope) -> list[GridPoint]:
    """Return the points of borders; none where no analysis finds any."""
    return border_points(study, envelope) if envelope.borders else []


def _point(point: GridPoint, result: Compliance) -> EnvelopePoint:
    return EnvelopePoint(
        failure=point.configuration,
        values=dict(point.values),
        value=result.value,
        margin=result.margin,
        passed=None if result.value is None else result.passed,
        where=result.where,
        reason=result.reason,
    )


def _inside(spread: Any, value: Any) -> bool:  # noqa: ANN401
    """Return whether a value lies in what the search covers."""
    if spread.discrete:
        return value in spread.values
    return isinstance(value, int | float) and bool(spread.low <= value <= spread.high)
