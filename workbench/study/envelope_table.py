"""The table [envelope] of a study, read and checked."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from workbench.errors import InputError
from workbench.study.description import Envelope, Study, StudyAnalysis
from workbench.study.envelope.request import PlanName
from workbench.study.position_in_file import known
from workbench.study.requirements.base import Requirement
from workbench.study.spread import KINDS, Spread, read_spread
from workbench.system.files.toml_schema import TomlTable, read_table

__all__ = ["read_envelope", "varied_by"]

_WHERE = "[envelope]"
# Commands that find where stability changes over a parameter, and their option that says which.
_BORDERS: Mapping[str, str] = {"modes": "vary", "limit-cycle": "vary"}


class EnvelopeTable(TomlTable):
    """What is varied, how, and what is asked of it.

    Attributes:
        parameters: "model.parameter" → how it spreads.
        requirement: name of the requirement whose value is mapped; by default the first.
        plan: how the points are chosen.
        points: number of points, without a grid.
        seed: of the random numbers.
        confidence: level of the intervals of probabilities.
        width: of the interval that is aimed at, for which the report tells the number of points.
        failures: configuration → its probability, of sum 1.
        map: both parameters over which the map is drawn; by default the first two with a range.
        borders: analyses that find where stability changes over the first parameter of the map.
        lines: number of values of the second parameter at which borders are found.
        search: number of evaluations with which the worst case is searched for; 0: it is the worst point of the plan.
    """

    parameters: dict[str, Any]
    requirement: str | None = None
    plan: PlanName = "grid"
    points: int = Field(default=64, ge=1, le=1_000_000)
    seed: int = Field(default=1, ge=0)
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    width: float | None = Field(default=None, gt=0.0, le=1.0)
    failures: dict[str, float] = Field(default_factory=dict)
    map: list[str] | None = Field(default=None, min_length=2, max_length=2)
    borders: list[str] = Field(default_factory=list)
    lines: int = Field(default=9, ge=2, le=1000)
    search: int = Field(default=0, ge=0, le=1_000_000)


def read_envelope(given: Mapping[str, Any], study: Study) -> Envelope:
    """Return what the table asks for.

    Args:
        given: as the TOML reader returns it.
        study: with everything else that stands in its file.

    Raises:
        InputError: one line with the table and the key.
    """
    table = read_table(EnvelopeTable, given, _WHERE)
    if study.grid:
        raise InputError('[grid] and [envelope]: only one of them; an envelope has plan = "grid"')
    spreads = tuple(_spreads(table.parameters, study))
    requirement = _requirement(table.requirement, study)
    axes = _axes(table.map, spreads)
    for name in table.borders:
        _check_border(name, study, axes)
    return Envelope(
        spreads=spreads,
        requirement=requirement,
        plan=table.plan,
        points=table.points,
        seed=table.seed,
        confidence=table.confidence,
        width=table.width,
        weights=_weights(table.failures, study),
        axes=axes,
        borders=tuple(table.borders),
        lines=table.lines,
        search=table.search,
    )


def _spreads(given: Mapping[str, Any], study: Study) -> Iterator[Spread]:
    result = list(_named(given))
    if not result:
        raise InputError('[envelope.parameters]: is empty; give one, as in "plant.k" = {range = [1.0, 2.0]}')
    for name, table in result:
        where = f'[envelope.parameters] "{name}"'
        owner, dot, _ = name.partition(".")
        if not dot:
            raise InputError(f'{where}: must be "model.parameter"; models: {", ".join(study.models) or "none"}')
        known(where, "model", owner, study.models)
        yield read_spread(name, table, where)


def _named(given: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and tables. TOML reads an unquoted plant.k as table plant with key k: both ways are taken."""
    for key, value in given.items():
        if isinstance(value, dict) and not set(value) & set(KINDS) and all(isinstance(v, dict) for v in value.values()):
            yield from _named(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _requirement(name: str | None, study: Study) -> Requirement:
    if not study.requirements:
        raise InputError(f"{_WHERE}: there is no [[requirements]] to compare the points with; give one")
    if name is not None:
        known(_WHERE, "requirement", name, [r.name for r in study.requirements])
    result = next(r for r in study.requirements if name in (None, r.name))
    if result.baseline(Path()) is not None:
        raise InputError(
            f'{_WHERE}: "{result.name}" is compared with a file, not with a limit; take another requirement'
        )
    return result


def _weights(given: Mapping[str, float], study: Study) -> dict[str, float]:
    where = "[envelope.failures]"
    for name, weight in given.items():
        known(where, "configuration", name, study.configurations)
        if not weight >= 0.0:
            raise InputError(f"{where} {name}: the probability {weight:g} is below 0")
    if not given:
        return {}
    lacking = [name for name in study.configurations if name not in given]
    if lacking:
        raise InputError(f"{where}: {lacking[0]} is missing; give every configuration its probability, or none")
    if not math.isclose(math.fsum(given.values()), 1.0, rel_tol=1e-9):
        raise InputError(f"{where}: the probabilities add up to {math.fsum(given.values()):g}, not to 1")
    return {name: given[name] for name in study.configurations}


def _axes(given: Sequence[str] | None, spreads: Sequence[Spread]) -> tuple[str, ...]:
    ranges = [s.name for s in spreads if not s.discrete]
    for name in given or ():
        known(f"{_WHERE}: map", "parameter", name, [s.name for s in spreads])
        if name not in ranges:
            raise InputError(f"{_WHERE}: map: {name} has values, not a range; an axis needs a range")
    if given is not None and given[0] == given[1]:
        raise InputError(f"{_WHERE}: map: names {given[0]} twice")
    return tuple(given or ranges[:2])


def _check_border(name: str, study: Study, axes: Sequence[str]) -> None:
    where = f"{_WHERE}: borders"
    known(where, "analysis", name, study.analyses)
    analysis = study.analyses[name]
    if analysis.command.name not in _BORDERS:
        raise InputError(
            f"{where}: [analyses.{name}] runs {analysis.command.name}; borders come from {' and '.join(_BORDERS)}"
        )
    varied = varied_by(analysis)
    if not axes or varied != axes[0]:
        raise InputError(
            f"{where}: [analyses.{name}] varies {varied or 'nothing'}, the first axis of the map is "
            f"{axes[0] if axes else 'not there'}; let it vary that, or give map = [first, second]"
        )


def varied_by(analysis: StudyAnalysis) -> str:
    """Return the parameter that an analysis varies, as "model.parameter"; empty: none, or several."""
    given = analysis.options.get(_BORDERS[analysis.command.name])
    names = list(given) if isinstance(given, Mapping) else [str(given).partition("=")[0].strip()] if given else []
    return f"{analysis.models[0]}.{names[0]}" if len(names) == 1 and len(analysis.models) == 1 else ""
