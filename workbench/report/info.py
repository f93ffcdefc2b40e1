"""The pages of what an FMU or a system is and can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.analysis.info.result import FmuInfo, SystemInfo
from workbench.report.page import Page, Section, Table
from workbench.report.tables import counted
from workbench.report.tones import Verdict

__all__ = ["info_page", "system_page"]

_GROUPS = ("inputs", "outputs", "states", "parameters")
_MANY = 30
_EXPERIMENT = {
    "start_time": "start {:g} s",
    "stop_time": "stop {:g} s",
    "step": "step {:g} s",
    "tolerance": "tolerance {:g}",
}
_ABILITIES = {
    "state": "saves and restores its state",
    "directional_derivatives": "directional derivatives",
    "variable_step": "variable communication step",
    "needs_tool": "needs its authoring tool",
    "once_per_process": "one instance per process",
}


def info_page(record: FmuInfo) -> Page:
    """Return the page of an FMU."""
    data = record.to_dict()
    interfaces = data["interfaces"]
    here = f"runs here ({', '.join(data['runs_here'])})"
    runs = Verdict("good", here) if data["runnable"] else Verdict("poor", "does not run here")
    return Page(
        title=str(data["model"]),
        lead=data["description"] or f"An FMU of FMI {data['fmi_version']}.",
        facts={
            "FMI": f"{data['fmi_version']} ({', '.join(interfaces) or 'no interface'})",
            **({"made by": data["generation_tool"]} if data["generation_tool"] else {}),
            "platforms": ", ".join(data["platforms"]) or "none",
            "experiment": _experiment(data["experiment"]),
        },
        sections=[*_variables(data), _capabilities(data["capabilities"])],
        summary=[runs, *_snapshots(data["capabilities"])],
        notes=data["notes"],
        kind="info",
    )


def _experiment(experiment: Mapping[str, Any]) -> str:
    told = [text.format(experiment[key]) for key, text in _EXPERIMENT.items() if experiment.get(key) is not None]
    return ", ".join(told) or "not told"


def _snapshots(capabilities: Mapping[str, Any]) -> list[Verdict]:
    found = []
    for interface, abilities in capabilities.items():
        probed = abilities.get("snapshots")
        if probed is not None:
            why = f": {probed['why']}" if probed["why"] else ""
            word = "good" if probed["method"] == "state" else "watch"
            found.append(Verdict(word, f"{interface}: snapshots by {probed['method']}{why}"))
    return found


def _capabilities(capabilities: Mapping[str, Any]) -> Section:
    names = [key for key in _ABILITIES if any(key in c for c in capabilities.values())]
    rows = [(_ABILITIES[key], *("yes" if c.get(key) else "–" for c in capabilities.values())) for key in names]
    return Section("Declared capabilities", tables=[Table(("", *capabilities), rows)])


def _variables(data: Mapping[str, Any]) -> list[Section]:
    found = []
    for group in _GROUPS:
        if data[group]:
            rows = [_variable(v) for v in data[group]]
            table = Table(("name", "type", "unit", "start", "description"), rows, right=(3,))
            found.append(Section(f"{group.capitalize()} ({len(rows)})", tables=[table], folded=len(rows) > _MANY))
    return found


def _variable(v: Mapping[str, Any]) -> tuple[str, ...]:
    start = v["start"]
    shown = "" if start is None else f"{start:g}" if isinstance(start, float) else str(start)
    return (v["name"], v["type"], v["unit"] or "", shown, v["description"] or "")


def system_page(record: SystemInfo) -> Page:
    """Return the page of a system."""
    data = record.to_dict()
    parts, wires = data["components"], data["connections"]
    return Page(
        title=f"System {data['model']}",
        lead=f"{counted(len(parts), 'component')}, {counted(len(wires), 'connection')}.",
        facts={},
        sections=[
            Section(
                "Components and connections", tables=[Table(("name", "what"), [(c["name"], c["what"]) for c in parts])]
            ),
            Section("Connections", tables=[_connections(wires)], folded=len(wires) > _MANY),
            *_variables(data),
        ],
        notes=data["notes"],
        kind="info",
    )


def _connections(wires: Sequence[Mapping[str, Any]]) -> Table:
    rows = [(w["source"], w["destination"], _how(w)) for w in wires]
    return Table(("from", "to", "by"), rows)


def _how(wire: Mapping[str, Any]) -> str:
    words = [f"gain {wire['gain']:g}"] if wire["gain"] != 1.0 else []
    words += [f"offset {wire['offset']:g}"] if wire["offset"] else []
    words += [f"in {wire['unit']}"] if wire["unit"] else []
    words += [f"closes at {wire['closes_at']:g} s"] if wire["closes_at"] is not None else []
    return ", ".join(words)
