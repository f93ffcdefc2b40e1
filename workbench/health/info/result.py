"""What an FMU or a system is and can do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from workbench.core.records.record import entry
from workbench.fmi.description import Capabilities, DefaultExperiment, DisplayUnit, Terminal
from workbench.fmi.variable import Variable
from workbench.health.info.snapshots import Snapshots
from workbench.health.references.declared import ReferenceResult
from workbench.show.result import Result

__all__ = ["ClockFacts", "FmuInfo", "InterfaceFacts", "PartFacts", "SystemInfo", "VariableFacts", "WireFacts"]


@dataclass(frozen=True)
class VariableFacts:
    """A variable.

    Attributes:
        name, type, unit, start, description, min, max, nominal: as declared; None where nothing is.
    """

    name: str
    type: str
    unit: str | None
    start: float | int | bool | str | None
    description: str | None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None

    @classmethod
    def of(cls, variables: Iterable[Variable]) -> tuple[VariableFacts, ...]:
        """Return what is shown of variables.

        Args:
            variables: of a model.
        """
        return tuple(
            cls(v.name, v.type, v.unit, v.start, v.description, v.minimum, v.maximum, v.nominal) for v in variables
        )


@dataclass(frozen=True)
class ClockFacts:
    """A clock of FMI 3.0.

    Attributes:
        name: of the clock.
        kind: "constant", "fixed", "tunable", "changing", "countdown", "triggered".
        causality: "input", "output", "local".
        interval: from tick to tick [s]; None: known at run time, or there is none.
        shift: from the start to the first tick [s].
        driven: whether runs here let it tick; triggered input clocks tick only where something else tells them to.
        variables: whose values change at its ticks alone.
    """

    name: str
    kind: str
    causality: str
    interval: float | None
    shift: float
    driven: bool
    variables: tuple[str, ...]


@dataclass(frozen=True)
class InterfaceFacts:
    """What an interface can do.

    Attributes:
        declared: what it claims.
        snapshots: how snapshots are taken; None: not tried.
    """

    declared: Capabilities = field(metadata=entry(inline=True))
    snapshots: Snapshots | None


@dataclass(frozen=True, kw_only=True)
class FmuInfo(Result):
    """What an FMU is and can do.

    Attributes:
        model, description, fmi_version, generation_tool, experiment: as declared.
        interfaces: "me" and "cs", where it has them.
        platforms: for which it has binaries.
        runnable: whether it runs on this computer.
        runs_here: the interfaces that do.
        inputs, outputs, states, parameters: variables.
        capabilities: interface → what it can do.
        notes: what is doubtful in the file, one line each.
        structural_parameters: those that sizes of arrays follow from.
        scheduled_execution: whether it offers that interface, which nothing here runs.
        clocks: its clocks.
        terminals: its variables that are connected together.
        enumerations: variable → item → value.
        display_units: variable → the unit in which it is to be shown: shown = factor · value + offset.
        reference_results: results of its exporter that it carries (FMI-LS-REF); `check` runs them again.
    """

    _page = "workbench.health.info.page:info_page"

    model: str
    description: str | None
    fmi_version: str
    generation_tool: str | None
    interfaces: tuple[str, ...]
    platforms: tuple[str, ...]
    runnable: bool
    runs_here: tuple[str, ...]
    inputs: tuple[VariableFacts, ...]
    outputs: tuple[VariableFacts, ...]
    states: tuple[VariableFacts, ...]
    parameters: tuple[VariableFacts, ...]
    capabilities: Mapping[str, InterfaceFacts]
    experiment: DefaultExperiment
    notes: tuple[str, ...]
    structural_parameters: tuple[VariableFacts, ...] = ()
    scheduled_execution: bool = False
    clocks: tuple[ClockFacts, ...] = ()
    terminals: tuple[Terminal, ...] = ()
    enumerations: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    display_units: Mapping[str, DisplayUnit] = field(default_factory=dict)
    reference_results: tuple[ReferenceResult, ...] = ()


@dataclass(frozen=True)
class PartFacts:
    """A component of a system.

    Attributes:
        name: in the system.
        what: in a few words.
    """

    name: str
    what: str


@dataclass(frozen=True)
class WireFacts:
    """A connection of a system.

    Attributes:
        destination, source: "component.variable".
        gain, offset: what the value is multiplied by, and what is added.
        unit: in which it is handed over; None: its own.
        closes_at: time from which on it is there [s]; None: always.
    """

    destination: str
    source: str
    gain: float
    offset: float
    unit: str | None
    closes_at: float | None


@dataclass(frozen=True, kw_only=True)
class SystemInfo(Result):
    """What a system consists of.

    Attributes:
        model: its name.
        interfaces, solver: how it runs.
        runnable: whether it runs on this computer.
        components, connections: its parts.
        inputs, outputs, parameters, states: variables.
        notes: one line each.
    """

    _page = "workbench.health.info.page:system_page"

    model: str
    interfaces: tuple[str, ...]
    solver: str
    runnable: bool
    components: tuple[PartFacts, ...]
    connections: tuple[WireFacts, ...]
    inputs: tuple[VariableFacts, ...]
    outputs: tuple[VariableFacts, ...]
    parameters: tuple[VariableFacts, ...]
    states: tuple[VariableFacts, ...]
    notes: tuple[str, ...]
