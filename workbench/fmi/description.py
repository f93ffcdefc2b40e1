"""What an FMU says about itself, as values; `reading.py` makes them of its modelDescription.xml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from workbench.core.values.conversion import BASE_UNITS, Unit
from workbench.fmi.variable import Variable

__all__ = [
    "Capabilities",
    "Clock",
    "DefaultExperiment",
    "DisplayUnit",
    "ModelDescription",
    "Terminal",
    "TerminalMember",
    "UnitDefinition",
]


@dataclass(frozen=True)
class DefaultExperiment:
    """The default experiment; None where the FMU names no value. Times in [s]."""

    start_time: float | None = None
    stop_time: float | None = None
    tolerance: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Capabilities:
    """What one interface claims to be able to do (claims, not probed).

    Attributes:
        identifier: stem of the shared library.
        state: get, set and free the FMU state.
        directional_derivatives: exact derivatives on request.
        variable_step: co-simulation steps may differ (true for model exchange).
        interpolates_inputs: co-simulation takes input derivatives (FMI 2.0).
        event_mode: co-simulation has an event mode (FMI 3.0).
        completed_step: wants to be told about every accepted step (model exchange).
        once_per_process: only one instance may live in a process.
        needs_tool: needs its authoring tool to be installed.
        adjoint_derivatives: exact derivatives from the outputs back to the inputs (FMI 3.0).
        intermediate_update: co-simulation asks for inputs inside a step (FMI 3.0).
        internal_step: step of the co-simulation's own solver [s] (FMI 3.0); None: it is not declared.
    """

    identifier: str
    state: bool = False
    directional_derivatives: bool = False
    variable_step: bool = True
    interpolates_inputs: bool = False
    event_mode: bool = False
    completed_step: bool = True
    once_per_process: bool = False
    needs_tool: bool = False
    adjoint_derivatives: bool = False
    intermediate_update: bool = False
    internal_step: float | None = None


@dataclass(frozen=True)
class DisplayUnit:
    """A unit in which values of another may be shown: shown = factor · value + offset."""

    name: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class UnitDefinition:
    """A unit of the FMU.

    Attributes:
        exponents: base unit ("kg", "m", "s", "A", "K", "mol", "cd", "rad") → exponent; None: not declared.
        factor, offset: value in base units = factor · value + offset.
        display: units in which its values may be shown.
    """

    exponents: Mapping[str, int] | None = None
    factor: float = 1.0
    offset: float = 0.0
    display: tuple[DisplayUnit, ...] = ()

    def unit(self, name: str) -> Unit | None:
        """Return it as a unit that converts; None: what it is made of is not declared."""
        if self.exponents is None or self.factor == 0.0:
            return None
        return Unit(name, tuple(self.exponents[b] for b in BASE_UNITS), self.factor, self.offset)


@dataclass(frozen=True)
class Clock:
    """How a clock of FMI 3.0 ticks.

    Attributes:
        kind: its intervalVariability: "constant", "fixed", "tunable" (periodic), "changing", "countdown" (the FMU says
            at run time when the next tick is), "triggered".
        causality: "input": the importer lets it tick; "output", "local": the FMU does.
        value_reference: the FMU's handle.
        interval: from tick to tick [s]; None: the FMU tells it at run time, or there is none.
        shift: from the start to the first tick [s].
        clocks: names of the clocks at whose ticks it can tick.
    """

    kind: str
    causality: str
    value_reference: int
    interval: float | None = None
    shift: float = 0.0
    clocks: tuple[str, ...] = ()


@dataclass(frozen=True)
class TerminalMember:
    """A variable of a terminal.

    Attributes:
        name: what it is called in the terminal; members of two terminals belong together by it.
        variable: name of the variable.
        kind: "signal", "inflow" or "outflow" (flows that sum to zero where terminals are connected).
    """

    name: str
    variable: str
    kind: str = "signal"


@dataclass(frozen=True)
class Terminal:
    """Variables that are connected together, as a plug of several pins.

    Attributes:
        name: those inside another are "outer.inner".
        kind: as the exporter calls it; None: not declared.
        rule: how members find each other: "plug" (all of them, by name), "bus" (those that both have, by name),
            "sequence" (by their order), or the exporter's own.
        members: its variables, without those of terminals inside.
        description: as declared.
    """

    name: str
    kind: str | None
    rule: str
    members: tuple[TerminalMember, ...]
    description: str | None = None


@dataclass(frozen=True)
class ModelDescription:
    """One FMU's description.

    Attributes:
        fmi_version: as written, e.g. "2.0".
        major: 1, 2 or 3.
        model_name, token, generation_tool, description: as written; `token` is the GUID.
        interfaces: "me" and "cs" → its capabilities.
        platforms: names of the folders with binaries.
        experiment: the default experiment.
        variables: every scalar, arrays taken apart, in the file's order.
        states: the continuous states; FMI 1.0 names them only at run time (empty here).
        derivatives: their derivatives, in the same order.
        state_count, indicator_count: numbers of continuous states and event indicators.
        shapes: value reference → shape, for FMI 3.0 arrays.
        log_categories: names of the FMU's log categories.
        notes: what the file bends, as far as somebody who uses the FMU wants to know.
        problems: every rule of FMI that the file bends.
        lost: what hides what a variable is, so that an input, output, state or start value may be lost.
        units: of the FMU, by name.
        enumerations: type → item → value.
        scheduled: what it is able to do in scheduled execution (FMI 3.0); None: not offered.
        clocks: name → how it ticks.
        clocked: variable → the clocks at whose ticks alone its value changes.
        terminals: variables that are connected together.
        intermediate: value references of inputs that may be set inside a step of co-simulation.
        components: of a system with co-simulation parts: those parts → whether their FMUs offer model exchange, too.
        has_history: an FMU of this workbench with a delay(), or a system with one: its states do not tell all that it
            remembers. Of other FMUs that is not known.
    """

    fmi_version: str
    major: int
    model_name: str
    token: str
    generation_tool: str | None
    description: str | None
    interfaces: Mapping[str, Capabilities]
    platforms: tuple[str, ...]
    experiment: DefaultExperiment
    variables: tuple[Variable, ...]
    states: tuple[Variable, ...]
    derivatives: tuple[Variable, ...]
    state_count: int
    indicator_count: int
    shapes: Mapping[int, tuple[int, ...]]
    log_categories: tuple[str, ...]
    notes: tuple[str, ...]
    problems: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    units: Mapping[str, UnitDefinition] = field(default_factory=dict)
    enumerations: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    scheduled: Capabilities | None = None
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    clocked: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    terminals: tuple[Terminal, ...] = ()
    intermediate: frozenset[int] = frozenset()
    components: Mapping[str, bool] = field(default_factory=dict)
    has_history: bool = False

    def way_out(self, *others: str) -> str:
        """Return what to do where co-simulation does not do: model exchange if it is offered, or something else.

        Args:
            others: what can be done besides, as "use a shorter `step`".
        """
        if self.components and all(self.components.values()):
            first = f'give interface "me" to {", ".join(self.components)}'
        elif "me" in self.interfaces:
            first = "use interface me"
        elif not others:
            without = [name for name, offered in self.components.items() if not offered]
            whose = f"of {', '.join(without)} " if without else ""
            return f"the FMU {whose}offers no other interface, so export it for model exchange"
        else:
            first, others = others[0], others[1:]
        again = "use " if first.startswith("use ") else ""
        return ", or ".join((first, *(other.removeprefix(again) for other in others)))

    @cached_property
    def input_names(self) -> frozenset[str]:
        """Names of the inputs."""
        return frozenset(v.name for v in self.variables if v.causality == "input")
