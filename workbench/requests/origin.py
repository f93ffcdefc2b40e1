"""What is known about how a result was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

__all__ = ["FmuOrigin", "ModelFacts", "Origin"]


@dataclass(frozen=True, kw_only=True)
class FmuOrigin:
    """One FMU.

    Attributes:
        component: its name in a system; empty for a model that is one FMU.
        model: the model's name, as the FMU tells it.
        file: the file's or folder's name, without where it is.
        sha256: of the file, or of the folder's files; empty where they are gone.
        fmi_version: as written, e.g. "2.0".
        generation_tool: as written; empty where the FMU does not say.
        interface: "me" or "cs".
    """

    component: str
    model: str
    file: str
    sha256: str
    fmi_version: str
    generation_tool: str
    interface: str


@dataclass(frozen=True, kw_only=True)
class ModelFacts:
    """One model: an FMU, a system, or something written in Python.

    Attributes:
        name: of the model.
        source: how `workbench.load` finds it again; empty for a model that is not a file.
        interface: "me", "cs" or "mixed".
        solver: what integrates.
        tolerance: relative, of the integration; None: the FMU's own.
        step: communication step that was given, or on which the FMU insists [s]; None: neither.
        start_values: parameters and start values that were set.
        defaults: of what was set → value as the FMU declares it; those without one are left out.
        bias: constants added to inputs.
        fmus: those it consists of.
        sha256: of a system's file; empty: it is none, or gone.
        blocks: component → what it is, with its parameters, for components that are not FMUs.
        notes: the model's remarks.
    """

    name: str
    source: str = ""
    interface: str = ""
    solver: str = ""
    tolerance: float | None = None
    step: float | None = None
    start_values: Mapping[str, Any] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)
    fmus: tuple[FmuOrigin, ...] = ()
    sha256: str = ""
    blocks: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Origin:
    """How a result was made.

    Attributes:
        command: name of the command or function.
        call: the command line that makes it again, or the call in Python.
        line: the command line that does the same as a call in Python; empty: none is known.
        models: what it was made on.
        files: name → SHA-256 of other files that were read.
        seconds: that it took; None: not known.
        when: it was done.
        notes: remarks made on the way.
        data: the result in full, as the command line writes it to JSON; None: the result's own `to_dict`.
    """

    command: str = ""
    call: str = ""
    line: str = ""
    models: tuple[ModelFacts, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None
    when: datetime = field(default_factory=lambda: datetime.now(UTC), compare=False)
    notes: tuple[str, ...] = ()
    data: Mapping[str, Any] | None = None
