"""The pages of what an FMU or a system is and can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.analysis.info.result import FmuInfo, InterfaceFacts, SystemInfo, VariableFacts, WireFacts
from workbench.fmi.description import DefaultExperiment
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
    runs = (
        Verdict("good", f"runs here ({', '.join(record.runs_here)})")
        if record.runnable
        else Verdict("poor", "does not run here")
    )
    return Page(
        title=record.model,
        lead=record.description or f"An FMU of FMI {record.fmi_version}.",
        facts={
            "FMI": f"{record.fmi_version} ({', '.join(record.interfaces) or 'no interface'})",
            **({"made by": record.generation_tool} if record.generation_tool else {}),
            "platforms": ", ".join(record.platforms) or "none",
            "experiment": _experiment(record.experiment),
        },
        sections=[*_variables(record), _capabilities(record.capabilities)],
        summary=[runs, *_snapshots(record.capabilities)],
        notes=record.notes,
        kind="info",
    )


def _experiment(experiment: DefaultExperiment) -> str:
    given = {key: getattr(experiment, key) for key in _EXPERIMENT}
    return ", ".join(_EXPERIMENT[key].format(value) for key, value in given.items() if value is not None) or "not told"


def _snapshots(capabilities: Mapping[str, InterfaceFacts]) -> list[Verdict]:
    found = []
    for interface, abilities in capabilities.items():
        probed = abilities.snapshots
        if probed is not None:
            why = f": {probed.why}" if probed.why else ""
            word = "good" if probed.method == "state" else "watch"
            found.append(Verdict(word, f"{interface}: snapshots by {probed.method}{why}"))
    return found


def _capabilities(capabilities: Mapping[str, InterfaceFacts]) -> Section:
    claims = [facts.declared for facts in capabilities.values()]
    rows = [(text, *("yes" if getattr(c, key) else "–" for c in claims)) for key, text in _ABILITIES.items()]
    return Section("Declared capabilities", tables=[Table(("", *capabilities), rows if claims else [])])


def _variables(record: FmuInfo | SystemInfo) -> list[Section]:
    found = []
    for group in _GROUPS:
        variables: tuple[VariableFacts, ...] = getattr(record, group)
        if variables:
            rows = [_variable(v) for v in variables]
            table = Table(("name", "type", "unit", "start", "description"), rows, right=(3,))
            found.append(Section(f"{group.capitalize()} ({len(rows)})", tables=[table], folded=len(rows) > _MANY))
    return found


def _variable(v: VariableFacts) -> tuple[str, ...]:
    shown = "" if v.start is None else f"{v.start:g}" if isinstance(v.start, float) else str(v.start)
    return (v.name, v.type, v.unit or "", shown, v.description or "")


def system_page(record: SystemInfo) -> Page:
    """Return the page of a system."""
    parts, wires = record.components, record.connections
    return Page(
        title=f"System {record.model}",
        lead=f"{counted(len(parts), 'component')}, {counted(len(wires), 'connection')}.",
        facts={},
        sections=[
            Section("Components and connections", tables=[Table(("name", "what"), [(c.name, c.what) for c in parts])]),
            Section("Connections", tables=[_connections(wires)], folded=len(wires) > _MANY),
            *_variables(record),
        ],
        notes=record.notes,
        kind="info",
    )


def _connections(wires: Sequence[WireFacts]) -> Table:
    rows = [(w.source, w.destination, _how(w)) for w in wires]
    return Table(("from", "to", "by"), rows)


def _how(wire: WireFacts) -> str:
    words = [f"gain {wire.gain:g}"] if wire.gain != 1.0 else []
    words += [f"offset {wire.offset:g}"] if wire.offset else []
    words += [f"in {wire.unit}"] if wire.unit else []
    words += [f"closes at {wire.closes_at:g} s"] if wire.closes_at is not None else []
    return ", ".join(words)
