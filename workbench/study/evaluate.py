"""Hold the results of a study against its requirements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.errors import InputError
from workbench.study.description import Point, Study
from workbench.study.kinds.base import Compliance, NotMeasured, Requirement, Result
from workbench.study.outcome import Outcome
from workbench.study.plan import Plan, Run
from workbench.study.result import Checked

__all__ = ["answer", "questions"]


def questions(study: Study, plan: Plan) -> list[Checked]:
    """Return every requirement at every point at which its analyses differ, nothing measured yet.

    Args:
        study: what was asked for.
        plan: what is run.
    """
    found: list[Checked] = []
    for requirement in study.requirements:
        seen: set[tuple[Run, ...]] = set()
        for k, point in enumerate(plan.points):
            runs = tuple(plan.at[name, k] for name in requirement.analyses)
            if runs not in seen and _applies(requirement, point):
                seen.add(runs)
                empty = Compliance(value=None)
                found.append(Checked(requirement=requirement, point=_label(runs), runs=runs, finding=empty))
    return found


def answer(question: Checked, outcomes: Mapping[Run, Outcome]) -> Checked:
    """Return a requirement with what came out.

    Args:
        question: one of `questions`.
        outcomes: what was run.

    Raises:
        InputError: the requirement asks for what cannot be in such a result.
    """
    finding = _finding(question.requirement, [outcomes.get(run) for run in question.runs])
    return replace(question, finding=finding)


def _applies(requirement: Requirement, point: Point) -> bool:
    chosen = requirement.configurations is None or point.configuration in requirement.configurations
    wanted = {name: v if isinstance(v, list) else [v] for name, v in requirement.grid.items()}
    return chosen and all(point.values[name] in values for name, values in wanted.items())


def _label(runs: Sequence[Run]) -> str:
    """Join what of the point concerns the analyses."""
    configuration = next((r.point.configuration for r in runs if r.point.configuration), None)
    values = {name: value for r in runs for name, value in r.point.values.items()}
    return Point(configuration=configuration, values=values).label


def _finding(requirement: Requirement, outcomes: Sequence[Outcome | None]) -> Compliance:
    results: list[Result] = []
    for name, outcome in zip(requirement.analyses, outcomes, strict=True):
        if outcome is None:
            return _none(requirement, f"{name} was not run")
        if outcome.result is None:
            return _none(requirement, f"{name} failed: {outcome.reason}")
        results.append(outcome.result)
    try:
        return requirement.find(results)
    except NotMeasured as error:
        return _none(requirement, str(error))
    except InputError as error:
        raise InputError(f'[[requirements]] "{requirement.name}": {_without(str(error), requirement.name)}') from None


def _none(requirement: Requirement, reason: str) -> Compliance:
    """Return that nothing was measured, and why; the limits that stand in the file are shown beside it."""
    given = {name: getattr(requirement, name, None) for name in ("min", "max")}
    limit = {name: float(value) for name, value in given.items() if value is not None}
    return Compliance(value=None, limit=limit, unit=getattr(requirement, "unit", None), reason=reason)


def _without(message: str, name: str) -> str:
    return message.removeprefix(f"{name}: ")
