"""The pages of what an FMU or a system is and can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import overload

from workbench.fmi.description import DefaultExperiment, DisplayUnit, Terminal, TerminalMember
from workbench.health.info.result import ClockFacts, FmuInfo, InterfaceFacts, SystemInfo, VariableFacts, WireFacts
from workbench.health.references.declared import ReferenceResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted
from workbench.show.verdicts import Verdict

__all__ = ["info_page", "system_page"]

_GROUPS = {
    "inputs": "Inputs",
    "outputs": "Outputs",
    "states": "States",
    "parameters": "Parameters",
    "structural_parameters": "Structural parameters",
}
_DRIVEN = {True: "as the FMU says", False: "by others alone"}
_FIRST = ("inputs", "outputs")  # what fits one screen, where all does not
_FEW = 12  # rows of a table there, or of all
_FULL = "--full"
_INTERFACES = {"me": "model exchange (me)", "cs": "co-simulation (cs)"}
_MANY = 30
_NAMED = 4
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


def info_page(record: FmuInfo, *, full: bool = False) -> Page:
    """Return the page of an FMU.

    Args:
        record: of an FMU.
        full: whether a terminal shows all of it.
    """
    here = f"runs here ({', '.join(record.runs_here)})"
    alone = ": scheduled execution is for a scheduler" if record.scheduled_execution and not record.interfaces else ""
    runs = Verdict("good", here) if record.runnable else Verdict("poor", f"does not run here{alone}")
    return Page(
        title=record.model,
        lead=record.description or "",
        facts={
            "FMI": f"{record.fmi_version}, {', '.join(_offered(record)) or 'no interface'}",
            **({"made by": record.generation_tool} if record.generation_tool else {}),
            "platforms": ", ".join(record.platforms) or "none",
            "experiment": _experiment(record.experiment),
            **_referred(record.reference_results),
        },
        sections=[
            *_variables(record, full=full),
            *_further(
                [
                    *_references(record.reference_results),
                    *_clocks(record.clocks),
                    *_terminals(record.terminals),
                    *_enumerations(record.enumerations),
                    *_display_units(record),
                    *_capabilities(record.capabilities),
                ],
                full=full,
            ),
        ],
        summary=[runs, *_replayed(record.capabilities)],
        notes=record.notes,
        kind="info",
        shown_by=_FULL,
    )


def _further(sections: Sequence[Section], *, full: bool) -> list[Section]:
    """Return sections that a terminal shows when it is asked for all."""
    return [replace(section, explains=not full) for section in sections]


def _offered(record: FmuInfo) -> list[str]:
    return [
        *(_INTERFACES[name] for name in record.interfaces),
        *(["scheduled execution, not run here"] if record.scheduled_execution else []),
    ]


def _experiment(experiment: DefaultExperiment) -> str:
    given = {key: getattr(experiment, key) for key in _EXPERIMENT}
    return (
        ", ".join(_EXPERIMENT[key].format(value) for key, value in given.items() if value is not None) or "not declared"
    )


def _referred(references: Sequence[ReferenceResult]) -> dict[str, str]:
    """Return the fact that there are reference results."""
    names = ", ".join(r.name for r in references[:_NAMED]) + (", …" if len(references) > _NAMED else "")
    return {"reference results": f"{names}; workbench check --only references runs them again"} if references else {}


def _references(references: Sequence[ReferenceResult]) -> list[Section]:
    rows = [(r.name, _seconds(r.start_time), _seconds(r.stop_time), _seconds(r.step), _files(r)) for r in references]
    table = PageTable(("name", "start", "stop", "step", "files"), rows, right=(1, 2, 3))
    return [Section(f"Reference results ({len(rows)})", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _files(reference: ReferenceResult) -> str:
    """Return the files of a reference, or why it cannot be run."""
    files = (reference.results, reference.stimuli, reference.parameters)
    return reference.problem or ", ".join(file.rpartition("/")[2] for file in files if file)


def _replayed(capabilities: Mapping[str, InterfaceFacts]) -> list[Verdict]:
    """Return what it costs that the state of an FMU cannot be saved, once for all interfaces of which this is so."""
    reasons: dict[str, list[str]] = {}
    for interface, facts in capabilities.items():
        if facts.snapshots is not None and facts.snapshots.method != "state":
            reasons.setdefault(facts.snapshots.why, []).append(interface)
    return [
        Verdict("watch", f"{', '.join(names)}: an analysis that goes back in time repeats the run: {why}")
        for why, names in reasons.items()
    ]


def _capabilities(capabilities: Mapping[str, InterfaceFacts]) -> list[Section]:
    claims = [facts.declared for facts in capabilities.values()]
    if not claims:
        return []
    names = [key for key in _ABILITIES if key not in _SELDOM or any(getattr(c, key) for c in claims)]
    rows = [(_ABILITIES[key], *("yes" if getattr(c, key) else "–" for c in claims)) for key in names]
    tried = [facts.snapshots for facts in capabilities.values()]
    if any(tried):
        works = ("–" if s is None else "yes" if s.method == "state" else "no" for s in tried)
        rows.append(("tried: the saved state is restored", *works))
    return [Section("Declared capabilities", tables=[PageTable(("", *capabilities), rows)])]


def _variables(record: FmuInfo | SystemInfo, *, full: bool) -> list[Section]:
    """Return tables of the variables; a terminal shows some inputs and outputs, and the others when asked for all."""
    result = []
    few = sum(len(getattr(record, group, ())) for group in _GROUPS) <= _FEW
    items = record.enumerations if isinstance(record, FmuInfo) else {}
    for group, title in _GROUPS.items():
        variables: tuple[VariableFacts, ...] = getattr(record, group, ())
        if variables:
            rows = _Rows(variables, items)
            columns = ("name", "type", "unit", "start", "description")
            table = PageTable(columns, rows, right=(3,), most=None if full else _FEW)
            left_out = not (full or few or group in _FIRST)
            result.append(
                Section(f"{title} ({len(rows)})", tables=[table], folded=len(rows) > _MANY, explains=left_out)
            )
    return result


class _Rows(Sequence[tuple[str, ...]]):
    """Rows of variables, written when they are looked at: a terminal shows few of a hundred thousand."""

    def __init__(self, variables: Sequence[VariableFacts], items: Mapping[str, Mapping[str, int]]) -> None:
        self._variables, self._items = variables, items

    def __len__(self) -> int:
        return len(self._variables)

    @overload
    def __getitem__(self, place: int) -> tuple[str, ...]: ...

    @overload
    def __getitem__(self, place: slice) -> list[tuple[str, ...]]: ...

    def __getitem__(self, place: int | slice) -> tuple[str, ...] | list[tuple[str, ...]]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        variable = self._variables[place]
        return _variable(variable, self._items.get(variable.name, {}))


def _variable(v: VariableFacts, items: Mapping[str, int]) -> tuple[str, ...]:
    start = next((name for name, value in items.items() if value == v.start), v.start)
    shown = "" if start is None else f"{start:g}" if isinstance(start, float) else str(start)
    return (v.name, v.type, v.unit or "", shown, v.description or "")


def _clocks(clocks: Sequence[ClockFacts]) -> list[Section]:
    rows = [
        (
            c.name,
            c.causality,
            c.kind,
            _seconds(c.interval),
            _seconds(c.shift or None),
            _ticks(c),
            ", ".join(c.variables),
        )
        for c in clocks
    ]
    table = PageTable(("name", "causality", "kind", "every", "after", "ticks", "what changes"), rows, right=(3, 4))
    return [Section(f"Clocks ({len(rows)})", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:g} s"


def _ticks(clock: ClockFacts) -> str:
    return _DRIVEN[clock.driven] if clock.causality == "input" else "by itself"


def _terminals(terminals: Sequence[Terminal]) -> list[Section]:
    rows = [(t.name, t.rule, t.kind or "", _members(t.members), t.description or "") for t in terminals]
    table = PageTable(("name", "matching", "kind", "members", "description"), rows)
    return [Section(f"Terminals ({len(rows)})", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _members(members: Sequence[TerminalMember]) -> str:
    return ", ".join(f"{m.name} = {m.variable}" + ("" if m.kind == "signal" else f" ({m.kind})") for m in members)


def _enumerations(known: Mapping[str, Mapping[str, int]]) -> list[Section]:
    rows = [(name, ", ".join(f"{item} ({value})" for item, value in items.items())) for name, items in known.items()]
    table = PageTable(("variable", "items"), rows)
    return [Section("Enumerations", tables=[table], folded=len(rows) > _MANY)] if rows else []


def _display_units(record: FmuInfo) -> list[Section]:
    """Return how values become those in the units that the FMU wants them shown in."""
    variables = (*record.inputs, *record.outputs, *record.states, *record.parameters)
    used = {(v.unit or "", record.display_units[v.name]) for v in variables if v.name in record.display_units}
    rows = [(unit, d.name, _conversion(unit, d)) for unit, d in sorted(used, key=lambda pair: (pair[0], pair[1].name))]
    return [Section("Display units", tables=[PageTable(("unit", "shown in", "conversion"), rows)])] if rows else []


def _conversion(unit: str, display: DisplayUnit) -> str:
    offset = f" {'+' if display.offset > 0.0 else '−'} {abs(display.offset):.10g}" if display.offset else ""
    factor = "" if display.factor == 1.0 else f"{display.factor:.10g} · "
    return f"{display.name} = {factor}{unit}{offset}"


def system_page(record: SystemInfo, *, full: bool = False) -> Page:
    """Return the page of a system.

    Args:
        record: of a system.
        full: whether a terminal shows all of it.
    """
    parts, wires = record.components, record.connections
    return Page(
        title=f"System {record.model}",
        lead=f"{counted(len(parts), 'component')}, {counted(len(wires), 'connection')}.",
        facts={},
        sections=[
            Section(
                "Components and connections", tables=[PageTable(("name", "what"), [(c.name, c.what) for c in parts])]
            ),
            Section("Connections", tables=[_connections(wires)], folded=len(wires) > _MANY),
            *_variables(record, full=full),
        ],
        notes=record.notes,
        kind="info",
        shown_by=_FULL,
    )


def _connections(wires: Sequence[WireFacts]) -> PageTable:
    rows = [(w.source, w.destination, _how(w)) for w in wires]
    return PageTable(("from", "to", "by"), rows)


def _how(wire: WireFacts) -> str:
    words = [f"gain {wire.gain:g}"] if wire.gain != 1.0 else []
    words += [f"offset {wire.offset:g}"] if wire.offset else []
    words += [f"in {wire.unit}"] if wire.unit else []
    words += [f"closes at {wire.closes_at:g} s"] if wire.closes_at is not None else []
    return ", ".join(words)
