"""What every page tells of how it was made: model, FMUs with hashes, settings, versions, seconds, the call."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from workbench import __version__
from workbench.core.values.operating_point import point_of_json
from workbench.errors import InputError, is_choice
from workbench.requests.origin import ModelFacts, Origin
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted

__all__ = ["finished", "point_facts", "versions"]

_NAMED = 12  # inputs and states of an operating point
_PACKAGES = ("fmpy", "numpy", "scipy", "control")
_INTERFACES = {"me": "model exchange", "cs": "co-simulation", "mixed": "model exchange and co-simulation"}


def versions() -> str:
    """Return the versions of what computes, in one line."""
    return ", ".join([f"FMI workbench {__version__}", *_packages(), f"Python {platform.python_version()}"])


def _packages() -> list[str]:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - a terminal does not show them

    result = []
    for name in _PACKAGES:
        try:
            result.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # copied there without its metadata
            result.append(name)
    return result


def finished(page: Page, origin: Origin) -> Page:
    """Return a page with what is known about how it was made.

    Args:
        page: what a result says of itself.
        origin: how it was made.
    """
    name = "command" if origin.call.startswith("workbench ") else "call"
    command = {name: origin.call} if origin.call else {}
    if origin.line and name == "call":
        command["command"] = origin.line
    facts = {
        **page.facts,
        **_models(origin.models),
        **_choices(origin.notes),
        **_files(origin.files),
        **_run(origin),
        **command,
        **page.facts,  # what a page says itself holds
    }
    notes = dict.fromkeys(note for note in (*page.notes, *origin.notes) if not is_choice(note))
    return replace(
        page,
        facts=facts,
        notes=tuple(notes),
        sections=[*page.sections, *_components(origin.models)],
        kind=" · ".join(["FMI workbench", *filter(None, [page.kind or origin.command.replace("_", "-")])]),
    )


def point_facts(data: Mapping[str, Any]) -> dict[str, str]:
    """Return where a result was measured: the inputs that were held, and the operating point.

    Args:
        data: the result as JSON has it.
    """
    try:
        point = point_of_json(data)
    except InputError:  # a search that ran away leaves no finite numbers
        return {}
    if point is None:
        return {}
    forced = _forced(data) | _moved(data, point.u)
    held = {name: value for name, value in point.u.items() if name not in forced}
    still = replace(point, u={name: value for name, value in point.u.items() if name in forced})
    return {
        **(
            {"held inputs": replace(point, u=held, x={}, discrete={}).words(_NAMED).rpartition("; ")[0]} if held else {}
        ),
        "operating point": still.words(_NAMED),
    }


def _forced(data: Mapping[str, Any]) -> set[str]:
    """Return the inputs that were moved."""
    one, experiments = data.get("input"), data.get("data")
    of_data = (
        {n for e in experiments if isinstance(e, Mapping) for n in e.get("input_names", ())}
        if isinstance(experiments, list)
        else set()
    )
    return {str(one["name"] if isinstance(one, Mapping) and "name" in one else one)} | of_data


def _moved(data: Mapping[str, Any], u: Mapping[str, float]) -> set[str]:
    """Return the inputs that a simulation or an experiment has recorded at other values than at the point."""
    recorded = data.get("signals") or data.get("u")
    histories = recorded if isinstance(recorded, Mapping) else {}
    known = {name: np.ravel(histories[name]) for name in u if name in histories}
    return {name for name, values in known.items() if np.any(values != u[name])}


def _choices(notes: Iterable[str]) -> dict[str, str]:
    """Return what `auto` took, which stands beside the interface and not among the notes again."""
    result = dict.fromkeys(
        note.replace("chosen by auto; ", "").replace(" (chosen by auto)", "") for note in notes if is_choice(note)
    )
    return {"chosen by auto": ", ".join(result)} if result else {}


def _run(origin: Origin) -> dict[str, str]:
    """Return the versions, when, and how long it took."""
    when = f"{origin.when:%Y-%m-%d %H:%M} UTC"
    lasted = "" if origin.seconds is None else f"{origin.seconds:.3g} s, "
    return {"versions": versions(), "run": f"{lasted}{when}, {platform.system()} {platform.machine()}"}


# -- models ------------------------------------------------------------------------------------


def _models(models: Iterable[ModelFacts]) -> dict[str, str]:
    result: dict[str, str] = {}
    for i, model in enumerate(models, start=1):
        number = f" {i}" if i > 1 else ""
        result.update({f"{name}{number}": value for name, value in _model(model).items() if value})
    return result


def _model(model: ModelFacts) -> dict[str, str]:
    single = model.fmus[0] if len(model.fmus) == 1 and not model.fmus[0].component else None
    facts = {"model": model.name, "interface": _interface(model)}
    if single is None:
        return {**facts, "system": _system(model), "SHA-256": model.sha256, **_settings(model)}
    made = f"{single.generation_tool or 'the FMU does not name its tool'}, FMI {single.fmi_version}"
    return {
        **facts,
        "FMU": single.file,
        "SHA-256": single.sha256,
        "generated by": made,
        **_settings(model),
    }


def _settings(model: ModelFacts) -> dict[str, str]:
    """Return what was set, beside what the file has; that nothing was is worth a word, too."""
    if not model.start_values:
        own = "nothing: what is not varied here is as the file has it" if model.fmus or model.source else ""
        return {"set": own, "bias": _pairs(model.bias)}
    texts = [
        f"{name} = {_value(value)}"
        + (f" (the FMU has {_value(model.defaults[name])})" if model.defaults.get(name, value) != value else "")
        for name, value in model.start_values.items()
    ]
    return {"set": ", ".join(texts), "bias": _pairs(model.bias)}


def _system(model: ModelFacts) -> str:
    if not model.fmus and not model.blocks:
        return ""
    parts = [counted(len(model.fmus), "FMU"), counted(len(model.blocks), "block")]
    return ", ".join(filter(None, [" and ".join(parts), model.source]))


def _interface(model: ModelFacts) -> str:
    """Return interface, solver, tolerance and step in one line."""
    parts = [f"{model.interface} ({_INTERFACES[model.interface]})" if model.interface in _INTERFACES else ""]
    parts += [f"solver {model.solver}" if model.solver else ""]
    parts += [f"tolerance {model.tolerance:g}" if model.tolerance is not None else ""]
    parts += [f"step {model.step:g} s" if model.step is not None else ""]
    return ", ".join(filter(None, parts))


def _value(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def _pairs(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {_value(value)}" for name, value in values.items())


def _files(files: Mapping[str, str]) -> dict[str, str]:
    lines = [f"{name}, SHA-256 {digest}" for name, digest in files.items()]
    return {"files": "\n".join(lines)} if lines else {}


def _components(models: Iterable[ModelFacts]) -> list[Section]:
    """Return one section for each system: its FMUs, each with its hash, and its blocks."""
    result = []
    for model in models:
        rows = [
            (f.component, f.file, f.interface, f.fmi_version, f.generation_tool or "not told", f.sha256)
            for f in model.fmus
            if f.component
        ]
        rows += [(name, kind, "", "", "", "") for name, kind in model.blocks.items()]
        if rows:
            headings = ("component", "FMU or block", "interface", "FMI", "generated by", "SHA-256")[
                : 6 if model.fmus else 2
            ]
            cells = [row[: len(headings)] for row in rows]
            result.append(Section(f"Components of {model.name}", tables=[PageTable(headings, cells, right=())]))
    return result
