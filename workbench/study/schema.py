"""The tables of a study file (.toml) as pydantic models; requirements are in `kinds`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from workbench.system.toml_schema import Table

__all__ = ["AnalysisTable", "ChangeTable", "ModelTable", "Scalar", "StudyTable"]

Scalar = bool | int | float | str


class StudyTable(Table):
    """The whole file; what the tables hold is read table by table."""

    name: str | None = None
    description: str = ""
    models: dict[str, Any] = Field(default_factory=dict)
    configurations: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Any] = Field(default_factory=dict)
    analyses: dict[str, Any]
    requirements: list[Any] = Field(default_factory=list)


class ChangeTable(Table):
    """What a configuration changes of a model. Steps in [s]."""

    model: str | None = None
    set: dict[str, Scalar] = Field(default_factory=dict)
    bias: dict[str, float] = Field(default_factory=dict)
    interface: Literal["auto", "me", "cs"] | None = None
    solver: Literal["auto", "vkm", "gear"] | None = None
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0, lt=1.0)


class ModelTable(ChangeTable):
    """A model: an FMU, `fmu:NAME`, or a system, and how it is opened."""

    model: str


class AnalysisTable(Table):
    """The keys of an analysis that are no options of its command."""

    command: str
