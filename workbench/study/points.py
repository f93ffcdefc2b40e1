"""The points of a study's grid, and what they make of its models."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

from workbench.study.description import Change, Point, Study
from workbench.study.schema import Scalar

__all__ = ["model_at", "part_of", "points"]


def points(study: Study) -> list[Point]:
    """Return every combination of configuration and parameter values, in the order of the file."""
    names = list(study.grid)
    configurations: list[str | None] = [*study.configurations] or [None]
    return [
        Point(configuration=configuration, values=dict(zip(names, values, strict=True)))
        for configuration in configurations
        for values in product(*study.grid.values())
    ]


def model_at(study: Study, model: str, point: Point) -> Change:
    """Return a model as a point has it.

    Args:
        study: that holds it.
        model: its name.
        point: of the grid.
    """
    found = study.models[model]
    if point.configuration is not None:
        found = found.changed(study.configurations[point.configuration].get(model, Change(model=None)))
    values: Mapping[str, Any] = _of_model(point.values, model)
    return found.changed(Change(model=None, options={"set": values})) if values else found


def part_of(study: Study, point: Point, models: set[str]) -> Point:
    """Return what of a point concerns some models: results differ only by that."""
    values = {name: value for name, value in point.values.items() if name.partition(".")[0] in models}
    configuration = point.configuration
    if configuration is not None and not _configured(study) & models:
        configuration = None
    return Point(configuration=configuration, values=values)


def _configured(study: Study) -> set[str]:
    return {model for changes in study.configurations.values() for model in changes}


def _of_model(values: Mapping[str, Scalar], model: str) -> dict[str, Scalar]:
    split = [(name.partition("."), value) for name, value in values.items()]
    return {parameter: value for (owner, _, parameter), value in split if owner == model}
