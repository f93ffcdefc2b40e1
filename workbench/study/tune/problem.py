"""The requirements at all points as pieces over the coordinates of the free parameters."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.machine.scratch import remove, scratch_folder
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.calibrate.quantities import FreeValues
from workbench.jobs.runner import Reply
from workbench.study.commands import Reference, filled
from workbench.study.description import GridPoint, Study
from workbench.study.envelope.evaluate import Evaluator
from workbench.study.plan import PlannedRun, RunResult, make_plan
from workbench.study.requirements.base import Compliance, Limited, Requirement, convert
from workbench.study.requirements.response import UNITS, Bandwidth, Mask
from workbench.study.run import applies, finding_of
from workbench.study.tune.extract import Extracted, ExtractJob, extract
from workbench.study.tune.family import LinearFamily, Member
from workbench.study.tune.minimax import SmoothPiece
from workbench.study.tune.readings import Distance, closed_poles, is_linear, readings, scale_of
from workbench.system.description import Component, SystemDescription
from workbench.system.parameters import with_parameters

__all__ = ["STABILITY", "Question", "TuneProblem"]

_WIDTH = 0.01  # coordinate: of the differences by which measured requirements are differentiated
_SLOW_WIDTH = 1e-3  # likewise of linear models by parameters that are not of blocks
_NEAR = -0.1  # of that natural frequency: poles left of it do not hinder a step
STABILITY = -1  # owner of the poles, which must stay left of the axis
_AMPLE = -10.0  # value of a requirement that nothing endangers, e.g. a margin without a crossing
_MISSED = 1.0  # likewise of one that is not met, whose distance nobody knows: no pole in its band, an infinite norm
_SAME = 1e-4  # relative: how far the poles with the blocks put in again may be from those without taking them out


@dataclass(frozen=True, eq=False)
class Question:
    """A requirement at a point.

    Attributes:
        requirement: of the study.
        point: where.
        runs: of its analyses, with the parameters as they were.
        linear: whether it is a function of a linear model whose derivatives are known.
    """

    requirement: Requirement
    point: GridPoint
    runs: tuple[PlannedRun, ...]
    linear: bool

    @property
    def label(self) -> str:
        """For people: "damping (worn)"."""
        return f"{self.requirement.name} ({self.point.label})" if self.point.label else self.requirement.name

    @property
    def jumps(self) -> bool:
        """Whether its number jumps, so that the pieces count something else that has the same sign."""
        own = self.requirement
        return isinstance(own, Bandwidth) and own.equal is None

    def scaled(self, found: Compliance) -> float | None:
        """Return what was measured as the value of a piece, at most 0 where it is met; None: nothing was measured."""
        if found.value is None or (isinstance(found.value, float) and math.isnan(found.value)):
            return None
        if found.margin is None:
            return -1.0 if found.passed else 1.0
        unit, factor = found.unit, 1.0
        if isinstance(self.requirement, Limited) and self.requirement.unit and self.requirement.units:
            unit = self.requirement.units[0]
            zero, one = (convert(x, self.requirement.unit, unit, self.requirement.name) for x in (0.0, 1.0))
            factor = one - zero
        return max(_AMPLE, -found.margin * factor / self.scale(found.limit, unit, factor))

    def scale(self, limit: Mapping[str, float | bool | str], unit: str | None, factor: float = 1.0) -> float:
        """Return the unit in which its distance from the limit counts."""
        if isinstance(self.requirement, Mask):
            return scale_of({}, UNITS.get(self.requirement.quantity, "dB"))
        given = {n: factor * x if isinstance(x, int | float) else x for n, x in limit.items()}
        return scale_of(given, unit)

    @property
    def own_scale(self) -> float:
        """The same of a linear one, whose limits are in the file."""
        own = self.requirement
        if not isinstance(own, Limited):
            return self.scale({}, None)
        unit = own.units[0]
        given = {n: getattr(own, n) for n in ("min", "max", "equal") if getattr(own, n) is not None}
        return self.scale({n: convert(float(x), own.unit or unit, unit, own.name) for n, x in given.items()}, unit)


class TuneProblem:
    """What is to be met, at all points so far.

    Args:
        study: with the requirements.
        models: names of the models in it that are tuned.
        system: that these are.
        free: its parameters.
        evaluator: runs the analyses of the study.

    Attributes:
        questions: each with its number.
        points: at which they are asked.
        evaluations: of linear models so far.
        notes: one line each.
    """

    def __init__(
        self, study: Study, models: Sequence[str], system: SystemDescription, free: FreeValues, evaluator: Evaluator
    ) -> None:
        self.study, self.free = study, free
        self._models, self._system, self._evaluator = tuple(models), system, evaluator
        self.questions: list[Question] = []
        self.points: list[GridPoint] = []
        self.notes: dict[str, None] = {}
        self.evaluations = 0
        self._families: dict[tuple[PlannedRun, tuple[float, ...]], LinearFamily] = {}
        self._slow: tuple[str, ...] = ()
        self._about = free.start  # coordinates at which the rest of the system is linearised
        self._outcomes: dict[PlannedRun, RunResult] = {}

    # -- points ------------------------------------------------------------------------------------

    def values(self, z: Floats) -> dict[str, float]:
        """Return parameter → value."""
        return dict(zip((q.name for q in self.free), self.free.values(z).tolist(), strict=True))

    def point_at(self, point: GridPoint, z: Floats) -> GridPoint:
        """Return a point with the tuned values."""
        own = {f"{model}.{name}": value for model in self._models for name, value in self.values(z).items()}
        return replace(point, values={**point.values, **own})

    def extend(self, points: Iterable[GridPoint]) -> None:
        """Ask the requirements at further points.

        Raises:
            InputError: a linear model cannot be made.
        """
        new = [p for p in points if p not in self.points]
        self.points += new
        names = list(dict.fromkeys(n for r in self.study.requirements for n in r.analyses))
        plan = make_plan(self.study.alone(names), [self.point_at(p, self._about) for p in new])
        seen = {(q.requirement.name, *q.runs) for q in self.questions}
        for k, point in enumerate(new):
            for requirement in self.study.requirements:
                runs = tuple(plan.at[name, k] for name in requirement.analyses)
                if applies(requirement, point) and (requirement.name, *runs) not in seen:
                    seen.add((requirement.name, *runs))
                    command, options = runs[0].analysis.command.name, runs[0].options
                    linear = len(runs) == 1 and is_linear(requirement, command, options)
                    self.questions.append(Question(requirement, point, runs, linear))

    def about(self, z: Floats) -> None:
        """Linearise the rest of the system anew, at other parameters, where it has moved with them."""
        self._about = z
        self._families.clear()

    # -- linear ones -------------------------------------------------------------------------------

    def members(self, z: Floats) -> dict[PlannedRun, Member]:
        """Return the linear models at coordinates; those that cannot be made are left out, and not linear any more."""
        runs = list(dict.fromkeys(q.runs[0] for q in self.questions if q.linear))
        values = self.values(z)
        self._make(runs, z)
        key = tuple(values[n] for n in self._slow)
        self.evaluations += 1
        return {run: self._families[run, key].at(values) for run in runs if (run, key) in self._families}

    def instability(self, z: Floats) -> list[SmoothPiece]:
        """Return the real parts of all poles over the natural frequency in the middle, as pieces."""
        result = []
        for run, member in self.members(z).items():
            result += self._borders(member, closed_poles(member, loop=_is_loop(run)), z, -math.inf)
        return result

    def unstable(self, z: Floats) -> str:
        """Return which pole of which linear model is farthest right, for people."""
        every = ((r, run) for run, m in self.members(z).items() for r in closed_poles(m, loop=_is_loop(run)))
        worst, run = max(every, key=lambda found: found[0].value)
        tuned = {f"{model}.{q.name}" for model in self._models for q in self.free}
        point = replace(run.point, values={n: v for n, v in run.point.values.items() if n not in tuned})
        where = f" ({point.label})" if point.label else ""
        return f"{run.analysis.name}{where} keeps a pole at {worst.place:.4g} 1/s"

    def _borders(self, member: Member, found: Sequence[Distance], z: Floats, least: float = _NEAR) -> list[SmoothPiece]:
        rate = float(np.median([abs(r.place) for r in found])) if found else 1.0
        near = [r for r in found if r.value > least * rate]
        return [SmoothPiece(r.value / rate, self._slope(member, r.weight, z) / rate, r.place, STABILITY) for r in near]

    def pieces(self, z: Floats, only: Sequence[str] | None = None) -> list[SmoothPiece] | None:
        """Return the linear requirements; None: a linear model is unstable there.

        Args:
            z: coordinates.
            only: names of requirements; None: all.
        """
        try:
            members = self.members(z)
        except InputError:  # a value that a block refuses
            return None
        poles = [(m, closed_poles(m, loop=_is_loop(run))) for run, m in members.items()]
        if any(r.value >= 0.0 for _, found in poles for r in found):
            return None
        result = [p for m, found in poles for p in self._borders(m, found, z)]
        for number, question in enumerate(self.questions):
            if not question.linear or (only is not None and question.requirement.name not in only):
                continue
            member, scale = members[question.runs[0]], question.own_scale
            found = readings(question.requirement, member)
            own = [
                SmoothPiece(max(-r.value / scale, _AMPLE), -self._slope(member, r.weight, z) / scale, r.place, number)
                for r in found if math.isfinite(r.value)
            ]  # fmt: skip
            ample = bool(found) and all(r.value > 0.0 for r in found)
            result += own or [SmoothPiece(_AMPLE if ample else _MISSED, np.zeros(len(z)), 0.0, number)]
        return result

    def _slope(self, member: Member, weight: Floats, z: Floats) -> Floats:
        return member.slope(weight, [q.name for q in self.free]) * self.free.slopes(z)

    def _make(self, runs: Sequence[PlannedRun], z: Floats) -> None:
        """Make the linear families that are missing, of parameters outside of blocks one for each of their values."""
        values, start = self.values(z), self.values(self._about)
        key = tuple(values[n] for n in self._slow)
        missing = [run for run in runs if (run, key) not in self._families]
        if not missing:
            return
        sets = [{**start, **{n: values[n] for n in self._slow}}]
        slow = [k for k, q in enumerate(self.free) if q.name in self._slow]
        for k in slow:
            side = 1.0 if z[k] + _SLOW_WIDTH <= self.free.limits[1][k] else -1.0
            moved = z.copy()
            moved[k] += side * _SLOW_WIDTH
            sets.append({**sets[0], self.free[k].name: self.values(moved)[self.free[k].name]})
        for run, (first, *others) in zip(missing, self._extracted(missing, sets), strict=True):
            if first.rest is None:
                self._give_up(run, first.reason)
                continue
            slopes = {}
            for k, other in zip(slow, others, strict=True):
                name = self.free[k].name
                if other.rest is None or other.rest.A.shape != first.rest.A.shape:
                    raise InputError(f"{name}: the linear model changes its states with it; leave it out")
                slopes[name] = (_whole(other) - _whole(first)) / (sets[1 + slow.index(k)][name] - sets[0][name])
            blocks = self._components(run, first.blocks)
            family = LinearFamily(first.rest, blocks, slopes, -1.0 if _is_loop(run) else 1.0)
            self._families[run, key] = family
        unknown = {n for n in values if not any(n.startswith(f"{c}.") for c in self._taken_out())} - set(self._slow)
        if unknown:  # not of a block that can be taken out: the rest depends on them, too
            self._slow = tuple(q.name for q in self.free if q.name in {*self._slow, *unknown})
            self._families.clear()
            self._make([run for run in runs if self._still_linear(run)], z)

    def _taken_out(self) -> set[str]:
        """Return the components that are taken out of every linear model."""
        every = [{c.name for c in family.components} for family in self._families.values()]
        return set.intersection(*every) if every else set()

    def _still_linear(self, run: PlannedRun) -> bool:
        return any(q.linear and q.runs[0] is run for q in self.questions)

    def _give_up(self, run: PlannedRun, reason: str) -> None:
        """Ask what reads a linear model by running the analysis, as it cannot be made."""
        self.notes[f"{run.label} is run for each value of the parameters: {reason}"] = None
        self.questions = [replace(q, linear=False) if q.runs[0] is run else q for q in self.questions]

    def _components(self, run: PlannedRun, names: Sequence[str]) -> tuple[Component, ...]:
        given = {**dict(run.options.get("set", {}))}
        known = {f"{c.name}." for c in self._system.components}
        own = {n: v for n, v in given.items() if f"{n.rpartition('.')[0]}." in known}
        system, _ = with_parameters(self._system, own)
        return tuple(next(c for c in system.components if c.name == name) for name in names)

    def _extracted(self, runs: Sequence[PlannedRun], sets: Sequence[Mapping[str, float]]) -> list[list[Extracted]]:
        """Return what the workers find, [run][set of values]."""
        blocks = tuple(dict.fromkeys(q.name.rpartition(".")[0] for q in self.free if q.name not in self._slow))
        jobs: deque[ExtractJob] = deque()
        result: dict[int, Extracted] = {}
        scratch = scratch_folder("tune")
        for run in runs:
            for given in sets:
                options = filled(run.options, partial(self._file, run=run, folder=scratch))
                options["set"] = {**dict(options.get("set", {})), **given}
                jobs.append(ExtractJob(
                    number=len(jobs), command=run.analysis.command.name, subject=str(run.models[0].model),
                    options=options, folder=self.study.folder, blocks=blocks,
                ))  # fmt: skip
        count = len(jobs)
        for event in self._evaluator.performed(extract, jobs):
            failed = Extracted(None, reason=getattr(event, "reason", ""))
            result[event.job.number] = event.value if isinstance(event, Reply) else failed
        remove(scratch)
        every = [result[k] for k in range(count)]
        return [every[k : k + len(sets)] for k in range(0, count, len(sets))]

    def _file(self, reference: Reference, run: PlannedRun, folder: Path) -> str:
        """Return a file with the result that an analysis takes."""
        found = self._outcomes.get(run.needs[reference.analysis])
        if found is None or found.result is None:
            raise InputError(f"{run.label} needs {reference.analysis}, which has no result")
        path = folder / f"{reference.analysis}.json"
        path.write_text(json.dumps(found.result), encoding="utf-8")
        return str(path)

    # -- measured ones -----------------------------------------------------------------------------

    def measured(self, places: Sequence[Floats], *, all_of: bool = True) -> list[list[Compliance]]:
        """Return how every requirement came out by the analyses of the study, [place][question].

        Args:
            places: coordinates.
            all_of: whether linear ones are measured, too; else they stand as not measured.
        """
        asked = [q for q in self.questions if all_of or not q.linear]
        names = list(dict.fromkeys(n for q in asked for n in q.requirement.analyses))
        points = [self.point_at(p, z) for z in places for p in self.points]
        plan, outcomes = self._evaluator.outcomes(names, points, patient=True)
        if self._evaluator.stopped:
            raise KeyboardInterrupt
        self._outcomes.update(outcomes)
        result = []
        for k in range(len(places)):
            found = []
            for question in self.questions:
                if question not in asked:
                    found.append(Compliance(value=None))
                    continue
                at = k * len(self.points) + self.points.index(question.point)
                runs = [outcomes.get(plan.at[name, at]) for name in question.requirement.analyses]
                found.append(finding_of(question.requirement, runs))
            result.append(found)
        return result

    def mixed_pieces(self, z: Floats) -> list[SmoothPiece] | None:
        """Return all requirements, those that are not linear with differences of measurements for derivatives.

        None: a linear model is unstable there, or something could not be measured.
        """
        linear = self.pieces(z) if any(q.linear for q in self.questions) else []
        if linear is None:
            return None
        _, high = self.free.limits
        sides = np.where(z + _WIDTH <= high, 1.0, -1.0) * _WIDTH
        here, *beside = self.measured([z, *(z + np.eye(len(z))[k] * sides[k] for k in range(len(z)))], all_of=False)
        result: list[SmoothPiece] = list(linear)
        for number, question in enumerate(self.questions):
            if question.linear:
                continue
            value = question.scaled(here[number])
            if value is None:
                return None
            others = [question.scaled(found[number]) for found in beside]
            slope = [0.0 if o is None else (o - value) / side for o, side in zip(others, sides.tolist(), strict=True)]
            result.append(SmoothPiece(value, np.array(slope), 1.0, number))
        return result


def _is_loop(run: PlannedRun) -> bool:
    return bool(run.analysis.command.name == "loop")


def _whole(found: Extracted) -> Floats:
    rest: Any = found.rest
    return np.block([[rest.A, rest.B], [rest.C, rest.D]])
