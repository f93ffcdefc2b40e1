"""What every page tells of how it was made: model, FMUs with hashes, settings, versions, seconds, the call."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from workbench import __version__
from workbench.origin import ModelFacts, Origin
from workbench.report.page import Page, Section, Table

__all__ = ["finished", "versions"]

_PACKAGES = ("fmpy", "numpy", "scipy", "control")
_INTERFACES = {"me": "model exchange", "cs": "co-simulation", "mixed": "model exchange and co-simulation"}


def versions() -> str:
    """Return the versions of what computes, in one line."""
    return ", ".join([f"FMI workbench {__version__}", *_packages(), f"Python {platform.python_version()}"])


def _packages() -> list[str]:
    found = []
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # copied there without its metadata
            found.append(name)
    return found


def finished(page: Page, origin: Origin) -> Page:
    """Return a page with what is known about how it was made.

    Args:
        page: what a result says of itself.
        origin: how it was made.
    """
    command = {"command": origin.call} if origin.call else {}
    facts = {**page.facts, **_models(origin.models), **_files(origin.files), **_run(origin), **command}
    notes = dict.fromkeys([*page.notes, *origin.notes])
    return replace(
        page,
        facts=facts,
        notes=tuple(notes),
        sections=[*page.sections, *_components(origin.models)],
        kind=" · ".join(["FMI workbench", *filter(None, [page.kind or origin.command.replace("_", "-")])]),
    )


def _run(origin: Origin) -> dict[str, str]:
    """Return the versions, when, and how long it took."""
    when = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    lasted = "" if origin.seconds is None else f"{origin.seconds:.3g} s, "
    return {"versions": versions(), "made": f"{lasted}{when}, {platform.system()} {platform.machine()}"}


# -- models ------------------------------------------------------------------------------------


def _models(models: Iterable[ModelFacts]) -> dict[str, str]:
    found: dict[str, str] = {}
    for i, model in enumerate(models, start=1):
        number = f" {i}" if i > 1 else ""
        found.update({f"{name}{number}": value for name, value in _model(model).items() if value})
    return found


def _model(model: ModelFacts) -> dict[str, str]:
    single = model.fmus[0] if len(model.fmus) == 1 and not model.fmus[0].component else None
    facts = {"model": model.name, "interface": _interface(model)}
    if single is None:
        return {**facts, "system": _system(model), "set": _pairs(model.start_values), "bias": _pairs(model.bias)}
    made = f"{single.generation_tool or 'the FMU does not say by what'}, FMI {single.fmi_version}"
    return {
        **facts,
        "FMU": single.file,
        "SHA-256": single.sha256,
        "made by": made,
        "set": _pairs(model.start_values),
        "bias": _pairs(model.bias),
    }


def _system(model: ModelFacts) -> str:
    if not model.fmus and not model.blocks:
        return ""
    return f"{len(model.fmus)} FMUs and {len(model.blocks)} blocks{f', {model.source}' if model.source else ''}"


def _interface(model: ModelFacts) -> str:
    """Return interface, solver, tolerance and step in one line."""
    parts = [f"{model.interface} ({_INTERFACES[model.interface]})" if model.interface in _INTERFACES else ""]
    parts += [f"solver {model.solver}" if model.solver else ""]
    parts += [f"tolerance {model.tolerance:g}" if model.tolerance is not None else ""]
    parts += [f"step {model.step:g} s" if model.step is not None else ""]
    return ", ".join(filter(None, parts))


def _pairs(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items())


def _files(files: Mapping[str, str]) -> dict[str, str]:
    lines = [f"{name}, SHA-256 {digest}" for name, digest in files.items()]
    return {"files": "\n".join(lines)} if lines else {}


def _components(models: Iterable[ModelFacts]) -> list[Section]:
    """Return one section for each system: its FMUs, each with its hash, and its blocks."""
    found = []
    for model in models:
        rows = [
            (f.component, f.file, f.interface, f.fmi_version, f.generation_tool or "not told", f.sha256)
            for f in model.fmus
            if f.component
        ]
        rows += [(name, kind, "", "", "", "") for name, kind in model.blocks.items()]
        if rows:
            headings = ("component", "FMU or block", "interface", "FMI", "made by", "SHA-256")
            found.append(Section(f"Components of {model.name}", tables=[Table(headings, rows, right=())]))
    return found
