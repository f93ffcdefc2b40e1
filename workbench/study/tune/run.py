"""Find parameters that meet the requirements of a study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError, suggest
from workbench.fmi.bundled import bundled_path, is_bundled
from workbench.fmi.variable import FLOAT_TYPES
from workbench.identification.calibrate.quantities import FreeValues, scaled
from workbench.jobs.job import Job
from workbench.model.names import check_variables, variables_of
from workbench.study.description import Change, GridPoint, Study
from workbench.study.envelope.evaluate import Evaluator
from workbench.study.envelope.result import WorstCase
from workbench.study.envelope.run import EnvelopeRun
from workbench.study.finished_store import Finished
from workbench.study.position_in_file import in_file
from workbench.study.read import read_study
from workbench.study.requirements.base import Compliance
from workbench.study.run import default_store
from workbench.study.tune.controller import write_controller
from workbench.study.tune.minimax import MinimaxEnd
from workbench.study.tune.problem import Question, TuneProblem
from workbench.study.tune.request import Tune
from workbench.study.tune.result import Conflict, TunedParameter, TunedRequirement, TuneResult, TuneStart
from workbench.study.tune.search import Descent, conflict_of, descents, measured_descent
from workbench.study.tune.written import write_tuned
from workbench.system.files.read import read_system
from workbench.system.load import load
from workbench.system.parameters import with_values

__all__ = ["run"]

_ROUNDS = 4  # designs with the system linearised anew, and points that are added
_DIFFERENT = 0.02  # of its scale: a linear requirement that the study measures so differently is designed anew
_HOLDS = 0.01  # multiplier from which on a requirement holds the result
_AT_BOUND = 1e-6  # coordinate
_MET = 1e-6  # a value up to this counts as 0


def run(system: str | Path, request: Tune, job: Job) -> TuneResult:
    """Tune; see `Tune`."""
    study = _with_plain_names(read_study(request.study))
    models = _tuned_models(study, system)
    names = [r.name for r in study.requirements]
    if not names:
        raise InputError(f"{request.study}: has no requirement")
    for name in request.hard:
        if name not in names:
            raise InputError(f"hard: there is no requirement '{name}'; {suggest(name, names)}")
    free = _free(system, request, study.models[models[0]])
    folder = Path(request.store) if request.store is not None else default_store(request.study)
    with (
        in_file(study.path),
        Finished(folder if request.keep else None) as finished,
        job.ended_by(),
        Evaluator(study, finished, request.place, job) as evaluator,
    ):
        described = read_system(system)
        problem = TuneProblem(study, models, described, free, evaluator)
        work = _TuneRun(problem, request, job, evaluator=evaluator, finished=finished, system=described.name)
        result = work.done()
    if request.out is not None and result.objective is None:
        why = next((r.reason for r in result.requirements if r.reason), "")
        error = SimulationError(f"no requirement could be measured, and {request.out} was not written: {why}")
        error.before = result
        raise error
    if request.out is not None and request.sample is not None:
        tuned = with_values(described, result.values)
        write_controller(tuned, list(result.values), request.sample, Path(request.out), request.fmi or 2)
    elif request.out is not None:
        write_tuned(str(system), result.values, Path(request.out))
    return result


def _with_plain_names(study: Study) -> Study:
    """Return a study whose models have names without dots, so that "model.parameter" is one: a file names itself."""
    names = {n: n if "." not in n else f"model {k}" for k, n in enumerate(study.models, 1)}
    return replace(
        study,
        models={names[n]: change for n, change in study.models.items()},
        analyses={n: replace(a, models=tuple(names[m] for m in a.models)) for n, a in study.analyses.items()},
        configurations={c: {names[m]: x for m, x in changes.items()} for c, changes in study.configurations.items()},
    )


def _tuned_models(study: Study, system: str | Path) -> list[str]:
    """Return the models of a study that are the system."""

    def file(name: str, folder: Path) -> Path:
        return bundled_path(name) if is_bundled(name) else (folder / Path(name).expanduser()).resolve()

    own = file(str(system), Path.cwd())
    result = [n for n, change in study.models.items() if file(str(change.model), study.folder) == own]
    if not result:
        known = ", ".join(str(change.model) for change in study.models.values()) or "none"
        raise InputError(f"study: {study.path} has no model {system}; its models: {known}")
    return result


def _free(system: str | Path, request: Tune, change: Change) -> FreeValues:
    """Return what is searched for."""
    wanted: Mapping[str, tuple[float, float]] = request.free  # type: ignore[assignment]
    given = dict(change.options.get("set", {}))
    result = []
    with load(system) as model:
        check_variables(model, wanted, "parameter", "variable", what="free", number=True)
        known = variables_of(model)
        for name, limits in wanted.items():
            variable = known[name]
            start = given.get(name, model.start_values.get(name, variable.start))
            if variable.causality == "input" or variable.type not in FLOAT_TYPES or not isinstance(start, int | float):
                raise InputError(f"free: '{name}' is not a real parameter with a value")
            low = max(limits[0], -math.inf if variable.minimum is None else variable.minimum)
            high = min(limits[1], math.inf if variable.maximum is None else variable.maximum)
            result.append(scaled(name, variable, float(start), low, high))
    return FreeValues(tuple(result))


class _TuneRun:
    """A tuning under way."""

    def __init__(
        self, problem: TuneProblem, request: Tune, job: Job, *, evaluator: Evaluator, finished: Finished, system: str
    ) -> None:
        self._problem, self._request, self._job = problem, request, job
        self._evaluator, self._finished = evaluator, finished
        self._system = system
        self._searches: list[Descent] = []
        self._added: list[str] = []
        self._worst: WorstCase | None = None
        self._end: MinimaxEnd | None = None
        self._steps = 0
        self._reason = ""

    def done(self) -> TuneResult:
        """Do all of it."""
        problem = self._problem
        problem.extend(problem.study.points)
        first = problem.free.start
        before = self._measured(first, "requirements at the start values")
        self._tell("linear models")
        problem.members(first)
        z, after = self._designed(first)
        for _ in range(_ROUNDS if problem.study.envelope is not None else 0):
            if not self._extended(z):
                break
            before += self._measured(first, "requirements at the added point")[len(before) :]
            z, after = self._designed(z)
        conflict = self._conflict()
        return self._record(z, before, after, conflict)

    # -- designs -----------------------------------------------------------------------------------

    def _designed(self, z: Floats) -> tuple[Floats, list[Compliance]]:
        """Return coordinates and what the study measures there."""
        problem = self._problem
        if any(q.linear for q in problem.questions):
            z = self._linear(z)
        after = self._measured(z, "requirements at the values found")
        for _ in range(_ROUNDS):
            if not self._different(z, after):
                break
            problem.about(z)
            if problem.pieces(z) is None:
                problem.notes["linearised anew at the values found, the system is unstable there"] = None
                break
            z = self._linear(z, further=0)
            after = self._measured(z, "requirements at the values found")
        for label in self._different(z, after):
            problem.notes[f"{label}: the study measures something else than the linear model says, also anew"] = None
        values = [q.scaled(c) for q, c in zip(problem.questions, after, strict=True) if not q.linear]
        if any(v is None or v > 0.0 for v in values) and self._request.max_measured:
            self._tell("search with measured requirements")
            found = measured_descent(problem, z, self._request.hard, self._request.max_measured)
            self._reason = found.reason
            if found.end is not None:
                z, self._end = found.end.z, found.end
                after = self._measured(z, "requirements at the values found")
        return z, after

    def _linear(self, z: Floats, further: int | None = None) -> Floats:
        problem, count = self._problem, self._request.starts if further is None else further
        starts = [z, *problem.free.further(count)]
        found = descents(problem, starts, self._request.hard, self._request.max_steps, self._tell)
        self._searches += found
        ends = [(d.end.merit, k) for k, d in enumerate(found) if d.end is not None]
        if not ends:
            raise SimulationError(f"no start at which the requirements can be evaluated: {found[0].reason}")
        best = found[min(ends)[1]]
        self._end, self._reason = best.end, best.reason
        assert best.end is not None  # noqa: S101 - see `ends`
        return best.end.z

    def _different(self, z: Floats, after: Sequence[Compliance]) -> list[str]:
        """Return which linear requirements the study measures otherwise than the linear model says."""
        told: dict[int, float] = {}
        for p in (p for p in self._problem.pieces(z) or () if p.owner >= 0):
            told[p.owner] = max(p.value, told.get(p.owner, -math.inf))
        linear = [(k, q) for k, q in enumerate(self._problem.questions) if k in told and not q.jumps]
        pairs = [(q.label, told[k], q.scaled(after[k])) for k, q in linear]
        return [n for n, t, m in pairs if m is None or abs(m - t) > _DIFFERENT * (1.0 + abs(t))]

    def _extended(self, z: Floats) -> bool:
        """Add the worst point of the envelope; return whether it is worse than those that there are."""
        problem = self._problem
        envelope = problem.study.envelope
        assert envelope is not None  # noqa: S101 - see `done`
        self._tell("worst case of the envelope")
        tuned = problem.point_at(GridPoint(), z).values
        models = {
            name: change.changed(Change(model=None, options={"set": {
                n.partition(".")[2]: v for n, v in tuned.items() if n.partition(".")[0] == name}}))
            for name, change in problem.study.models.items()
        }  # fmt: skip
        study = replace(problem.study, models=models)
        with Evaluator(study, self._finished, self._request.place, self._job) as evaluator:
            found = EnvelopeRun(study, envelope, evaluator, Job()).done()
        self._worst = found.worst
        if found.worst is None:
            return False
        own = [
            c.margin for q, c in zip(problem.questions, self._measured(z, "known points"), strict=True)
            if q.requirement.name == envelope.requirement.name and c.margin is not None
        ]  # fmt: skip
        if own and found.worst.margin >= min(own) - _DIFFERENT * abs(min(own)) - 1e-9:
            return False
        point = GridPoint(configuration=found.worst.failure, values=dict(found.worst.values))
        if point in problem.points:
            return False
        problem.extend([point])
        self._added.append(point.label)
        return True

    def _conflict(self) -> Conflict | None:
        problem, end = self._problem, self._end
        if end is None or not any(q.linear for q in problem.questions):
            return None
        linear = list(dict.fromkeys(q.requirement.name for q in problem.questions if q.linear))
        names = [n for n in linear if n in self._request.hard] or linear
        held = [p.value for p in end.pieces if p.owner >= 0 and problem.questions[p.owner].requirement.name in names]
        if max(held) <= _MET:
            return None
        self._tell("which requirements exclude each other")
        return conflict_of(problem, end, names, self._request.max_steps)

    # -- measuring and telling ---------------------------------------------------------------------

    def _measured(self, z: Floats, words: str) -> list[Compliance]:
        self._tell(words)
        return self._problem.measured([z])[0]

    def _tell(self, words: str) -> None:
        self._steps += 1
        self._job.done(words, self._steps, self._steps + 1)

    # -- the record --------------------------------------------------------------------------------

    def _record(
        self, z: Floats, before: Sequence[Compliance], after: Sequence[Compliance], conflict: Conflict | None
    ) -> TuneResult:
        problem, end = self._problem, self._end
        values = [(q, q.scaled(c)) for q, c in zip(problem.questions, after, strict=True)]
        soft = [v for q, v in values if v is not None and (q.requirement.name not in self._request.hard)]
        every = soft or [v for _, v in values if v is not None]
        worst = self._worst
        return TuneResult(
            system=self._system,
            study=problem.study.name,
            parameters=tuple(_parameters(problem.free, z)),
            requirements=tuple(_requirements(problem, self._request, z, end, list(zip(before, after, strict=True)))),
            objective=max(every, default=None),
            history=() if end is None else end.values,
            starts=tuple(_start(problem, d) for d in self._searches),
            worst={} if worst is None else {
                **worst.values, **({"configuration": worst.failure} if worst.failure else {}), "margin": worst.margin,
            },
            added=tuple(self._added),
            conflict=conflict,
            measured=self._evaluator.measured,
            reused=self._evaluator.reused,
            evaluations=problem.evaluations,
            reason=self._reason,
            files={problem.study.path.name: problem.study.sha256, **self._evaluator.files},
            notes=(*problem.notes, *self._evaluator.afterwards),
        )  # fmt: skip


def _parameters(free: FreeValues, z: Floats) -> Iterator[TunedParameter]:
    low, high = free.limits
    for k, q in enumerate(free):
        yield TunedParameter(
            name=q.name, unit=q.unit, start=q.start, value=q.value(float(z[k])),
            low=q.low if math.isfinite(q.low) else None, high=q.high if math.isfinite(q.high) else None,
            at_bound=bool(min(z[k] - low[k], high[k] - z[k]) <= _AT_BOUND),
        )  # fmt: skip


def _requirements(
    problem: TuneProblem,
    request: Tune,
    z: Floats,
    end: MinimaxEnd | None,
    found: Sequence[tuple[Compliance, Compliance]],
) -> Iterator[TunedRequirement]:
    for k, (question, (was, now)) in enumerate(zip(problem.questions, found, strict=True)):
        active = end is not None and end.weights.get(k, 0.0) > _HOLDS
        yield TunedRequirement(
            name=question.requirement.name, at=question.point.label, kind=question.requirement.kind,
            hard=question.requirement.name in request.hard, linear=question.linear, unit=now.unit,
            before=was.value, after=now.value, limit=dict(now.limit), margin=now.margin,
            excess_before=question.scaled(was), excess=question.scaled(now), passed=now.passed,
            active=active, where=now.where, reason=now.reason,
            per_percent=_per_percent(problem, question, k, z, end) if active and question.linear else {},
        )  # fmt: skip


def _per_percent(
    problem: TuneProblem, question: Question, owner: int, z: Floats, end: MinimaxEnd | None
) -> dict[str, float]:
    """Return the change of the margin when a parameter grows by 1 %, at the place where it is least."""
    own = [] if end is None else [p for p in end.pieces if p.owner == owner]
    if not own or end is None or not np.array_equal(end.z, z) or question.jumps:
        return {}
    worst = max(own, key=lambda p: p.value)
    values, slopes = problem.free.values(z), problem.free.slopes(z)
    change = -worst.slope * question.own_scale * 0.01 * np.abs(values) / slopes
    return {q.name: float(x) for q, x in zip(problem.free, change, strict=True)}


def _start(problem: TuneProblem, found: Descent) -> TuneStart:
    end = found.end
    return TuneStart(
        values=problem.values(found.start), objective=None if end is None else end.value,
        steps=0 if end is None else end.evaluations, reason=found.reason,
    )  # fmt: skip
