"""The pages of what an FMU or a system is and can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.analysis.info.result import FmuInfo, SystemInfo
from workbench.fmi.description import DisplayUnit
from workbench.report.page import Page, Section, Table
from workbench.report.tables import counted
from workbench.report.tones import Verdict

__all__ = ["info_page", "system_page"]

_GROUPS = {
    "inputs": "Inputs",
    "outputs": "Outputs",
    "states": "States",
    "parameters": "Parameters",
    "structural_parameters": "Structural parameters",
}
_DRIVEN = {True: "as the FMU says", False: "by others alone"}
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
    "adjoint_derivatives": "adjoint derivatives",
    "variable_step": "variable communication step",
    "needs_tool": "needs its authoring tool",
    "once_per_process": "one instance per process",
}
_SELDOM = ("adjoint_derivatives",)  # shown where an interface has it


def info_page(record: FmuInfo) -> Page:
    """Return the page of an FMU."""
    data = record.to_dict()
    here = f"runs here ({', '.join(data['runs_here'])})"
    alone = ": scheduled execution is for a scheduler" if data["scheduled_execution"] and not data["interfaces"] else ""
    runs = Verdict("good", here) if data["runnable"] else Verdict("poor", f"does not run here{alone}")
    return Page(
        title=str(data["model"]),
        lead=data["description"] or f"An FMU of FMI {data['fmi_version']}.",
        facts={
            "FMI": f"{data['fmi_version']} ({', '.join(_offered(data)) or 'no interface'})",
            **({"made by": data["generation_tool"]} if data["generation_tool"] else {}),
            "platforms": ", ".join(data["platforms"]) or "none",
            "experiment": _experiment(data["experiment"]),
        },
        sections=[
            *_variables(data),
            *_clocks(data["clocks"]),
            *_terminals(data["terminals"]),
            *_enumerations(data["enumerations"]),
            *_display_units(record),
            *_capabilities(data["capabilities"]),
        ],
        summary=[runs, *_snapshots(data["capabilities"])],
        notes=data["notes"],
        kind="info",
    )


def _offered(data: Mapping[str, Any]) -> list[str]:
    return [*data["interfaces"], *(["scheduled execution, not run here"] if data["scheduled_execution"] else [])]


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


def _capabilities(capabilities: Mapping[str, Any]) -> list[Section]:
    if not capabilities:
        return []
    names = [k for k in _ABILITIES if k not in _SELDOM or any(c.get(k) for c in capabilities.values())]
    rows = [(_ABILITIES[key], *("yes" if c.get(key) else "–" for c in capabilities.values())) for key in names]
    return [Section("Declared capabilities", tables=[Table(("", *capabilities), rows)])]


def _variables(data: Mapping[str, Any]) -> list[Section]:
    found = []
    for group, title in _GROUPS.items():
        if data.get(group):
            rows = [_variable(v, data.get("enumerations", {})) for v in data[group]]
            table = Table(("name", "type", "unit", "start", "description"), rows, right=(3,))
            found.append(Section(f"{title} ({len(rows)})", tables=[table], folded=len(rows) > _MANY))
    return found


def _variable(v: Mapping[str, Any], enumerations: Mapping[str, Mapping[str, int]]) -> tuple[str, ...]:
    items = {value: name for name, value in enumerations.get(v["name"], {}).items()}
    start = items.get(v["start"], v["start"])
    shown = "" if start is None else f"{start:g}" if isinstance(start, float) else str(start)
    return (v["name"], v["type"], v["unit"] or "", shown, v["description"] or "")


def _clocks(clocks: Sequence[Mapping[str, Any]]) -> list[Section]:
    rows = [
        (c["name"], c["causality"], c["kind"], _seconds(c["interval"]), _seconds(c["shift"] or None), _ticks(c),
         ", ".join(c["variables"]))
        for c in clocks
    ]  # fmt: skip
    table = Table(("name", "causality", "kind", "every", "after", "ticks", "what changes"), rows, right=(3, 4))
    return [Section(f"Clocks ({len(rows)})", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:g} s"


def _ticks(clock: Mapping[str, Any]) -> str:
    return _DRIVEN[clock["driven"]] if clock["causality"] == "input" else "by itself"


def _terminals(terminals: Sequence[Mapping[str, Any]]) -> list[Section]:
    rows = [(t["name"], t["rule"], t["kind"] or "", _members(t["members"]), t["description"] or "") for t in terminals]
    table = Table(("name", "matching", "kind", "members", "description"), rows)
    return [Section(f"Terminals ({len(rows)})", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _members(members: Sequence[Mapping[str, Any]]) -> str:
    words = (f"{m['name']} = {m['variable']}" + ("" if m["kind"] == "signal" else f" ({m['kind']})") for m in members)
    return ", ".join(words)


def _enumerations(known: Mapping[str, Mapping[str, int]]) -> list[Section]:
    rows = [(name, ", ".join(f"{item} ({value})" for item, value in items.items())) for name, items in known.items()]
    table = Table(("variable", "items"), rows)
    return [Section("Enumerations", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _display_units(record: FmuInfo) -> list[Section]:
    """Return how values become those in the units that the FMU wants them shown in."""
    variables = (*record.inputs, *record.outputs, *record.states, *record.parameters)
    used = {(v.unit or "", record.display_units[v.name]) for v in variables if v.name in record.display_units}
    rows = [(unit, d.name, _conversion(unit, d)) for unit, d in sorted(used, key=lambda pair: (pair[0], pair[1].name))]
    return [Section("Display units", tables=[Table(("unit", "shown in", "conversion"), rows)])] if rows else []


def _conversion(unit: str, display: DisplayUnit) -> str:
    offset = f" {'+' if display.offset > 0.0 else '−'} {abs(display.offset):.10g}" if display.offset else ""
    factor = "" if display.factor == 1.0 else f"{display.factor:.10g} · "
    return f"{display.name} = {factor}{unit}{offset}"


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
