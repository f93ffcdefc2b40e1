"""What a system consists of: components, connections, inputs and outputs, before any FMU is opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from workbench.core.values.arrays import Floats
from workbench.core.values.conversion import Unit
from workbench.core.values.linear import Linear
from workbench.errors import InputError, suggest
from workbench.fmi.archive import Unpacked
from workbench.fmi.description import DefaultExperiment
from workbench.fmi.variable import Value, Variable
from workbench.fmi.wiring import Wire
from workbench.system.block_table.base import Block
from workbench.system.block_table.registry import block_of

__all__ = [
    "BlockComponent",
    "Component",
    "Connection",
    "FmuComponent",
    "FunctionComponent",
    "GainComponent",
    "LinearComponent",
    "MasterOptions",
    "Port",
    "Resolved",
    "SumComponent",
    "SystemDescription",
    "to_write",
]


@dataclass(frozen=True, kw_only=True)
class FmuComponent:
    """An FMU in a system.

    Attributes:
        name: name of the component; its variables are "name.variable" in the system.
        file: absolute path of an .fmu or an unpacked one, or `fmu:NAME`.
        interface: "auto", "me" or "cs".
        set: parameters and start values, by the FMU's names.
        step: communication step [s]; None: the FMU's.
        solver: "auto", "vkm" or "gear".
        units: variable → unit that the system file declares; counts where the FMU declares none.
        dependencies: "declared": its outputs and derivatives depend on the inputs and states that it declares; "all":
            what it declares is not believed, each of them depends on all.
        called: what the user calls the file, where it lies in a package that was unpacked; empty: by its path.
    """

    name: str
    file: str
    interface: str = "auto"
    set: Mapping[str, Value] = field(default_factory=dict)
    step: float | None = None
    solver: str = "auto"
    units: Mapping[str, str] = field(default_factory=dict)
    dependencies: str = "declared"
    called: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearComponent(Linear):
    """A linear system; a discrete one acts at multiples of its dt, wherever a run begins.

    Attributes:
        name: name of the component.
        x0: shape (n,), where the state starts.
        units: input or output → unit; those left out have none.
        file: absolute path of the file that holds the matrices; empty: they stand in the system's own.
    """

    name: str
    x0: Floats
    units: Mapping[str, str] = field(default_factory=dict)
    file: str = ""


@dataclass(frozen=True, kw_only=True)
class GainComponent:
    """y = gain · u, with the input `u` and the output `y`.

    Attributes:
        name: name of the component.
        gain: the factor.
        units: "u" and "y" → unit; those left out have none.
    """

    name: str
    gain: float = 1.0
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SumComponent:
    """y = Σ signs[k] · u(k+1), with the inputs `u1`, `u2`, … and the output `y`.

    Attributes:
        name: name of the component.
        signs: +1.0 or -1.0 (any factor works) for each input.
        unit: unit of all inputs and the output; None: none.
    """

    name: str
    signs: tuple[float, ...] = (1.0, 1.0)
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class FunctionComponent:
    """y = function(u), a static Python function; it lives in this process only and is called at every evaluation.

    Attributes:
        name: name of the component.
        function: takes shape (m,), returns shape (p,) (a number where p = 1).
        inputs: names of the m inputs.
        outputs: names of the p outputs.
        units: input or output → unit; those left out have none.
    """

    name: str
    function: Callable[[Floats], Floats | float]
    inputs: tuple[str, ...] = ("u",)
    outputs: tuple[str, ...] = ("y",)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BlockComponent:
    """A limit, a hysteresis, a table, a controller, a delay … : see `workbench info --blocks` for all of them.

    Attributes:
        name: name of the component.
        kind: kind of the block, as "saturation".
        parameters: parameters of that kind, by name; those left out have their default.
        units: input or output → unit; those left out have none.

    Raises:
        InputError: unknown kind or parameter, a parameter that is missing or out of its range.

    Examples:
        A saturation lets through what is within its limits.

        >>> limiter = wb.BlockComponent(name="limiter", kind="saturation", parameters={"lower": -0.5, "upper": 0.5})
        >>> with wb.connect({"limiter": limiter}, inputs=["limiter.u"], outputs=["limiter.y"]) as system:
        ...     print(wb.lin(system, u0={"limiter.u": 0.2}).D)
        [[1.]]
    """

    name: str
    kind: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check kind, parameters and units."""
        try:
            ports = (*self.block.inputs, "y")
            for port in self.units:
                if port not in ports:
                    raise InputError(f"units: '{port}' is not an input or output; {suggest(port, ports)}")
        except InputError as error:
            raise InputError(f"component {self.name}: {error}") from None

    @cached_property
    def block(self) -> Block:
        """The block with its parameters."""
        return block_of(self.kind, self.parameters)


Component = FmuComponent | LinearComponent | GainComponent | SumComponent | FunctionComponent | BlockComponent


@dataclass(frozen=True, kw_only=True)
class Connection:
    """One output that drives one input: destination = gain · source + offset.

    Attributes:
        source: "component.output".
        destination: "component.input".
        gain, offset: applied to the value in `unit` (SSP's LinearTransformation).
        unit: unit in which the value is handed over; it is converted from the source's and to the destination's, and
            stands for a unit that is not declared. None: the destination's.
        convert: False: the number is handed over as it is, whatever the units (SSP's suppressUnitConversion).
        closes_at: time [s] at which the connection closes; before that the input receives 0. None: closed always.
    """

    source: str
    destination: str
    gain: float = 1.0
    offset: float = 0.0
    unit: str | None = None
    convert: bool = True
    closes_at: float | None = None


@dataclass(frozen=True, kw_only=True)
class MasterOptions:
    """How the co-simulation components of a system are stepped; of no use where there are none.

    Attributes:
        order: "gauss-seidel" (one after the other), "jacobi" (side by side), or "auto".
        extrapolation: order of the polynomial by which a value goes on over a step whose source is stepped later: 0 (it
            stands still), 1 or 2. Order 2 is for smooth signals.
        step_tolerance: tolerance of one communication step, relative to the largest magnitude that each connected value
            and output has had; None: 100 times the tolerance of the integration. Not together with a given step.
        hold_inputs: inputs stand over a step as they are at its start, as with simple masters.
    """

    order: str = "auto"
    extrapolation: int = 1
    step_tolerance: float | None = None
    hold_inputs: bool = False

    def given(self) -> dict[str, Any]:
        """Return what is not as it is anyway."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}


@dataclass(frozen=True, kw_only=True)
class SystemDescription:
    """A system as it is written down; nothing is opened or checked against FMUs yet (`connection_checks.resolve` does).

    Attributes:
        name: name of the system.
        components: in the order of the file.
        connections: in the order of the file.
        inputs: the system's input → the component inputs it drives.
        outputs: the system's output → the component variable it shows.
        default_experiment: what the file suggests.
        master: how its co-simulation components are stepped.
        notes: what of the file was bent or ignored, one line each.
        units: definitions of units in the file, by name.
        source: the file it comes from, for messages; empty: made in Python.
        folder: owns the unpacked files of an .ssp; they are removed when it is closed or no longer referred to, so
            keep it as long as the FMUs are needed. None: nothing was unpacked.
    """

    name: str
    components: tuple[Component, ...]
    connections: tuple[Connection, ...] = ()
    inputs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    default_experiment: DefaultExperiment = field(default_factory=DefaultExperiment)
    master: MasterOptions = field(default_factory=MasterOptions)
    notes: tuple[str, ...] = ()
    units: Mapping[str, Unit] = field(default_factory=dict)
    source: str = ""
    folder: Unpacked | None = field(default=None, repr=False, compare=False)

    def full_name(self, port: Port) -> str:
        """Return "component.variable".

        Args:
            port: variable of a component of this system.
        """
        return f"{self.components[port.component].name}.{port.variable.name}"


@dataclass(frozen=True)
class Port:
    """One variable of one component.

    Attributes:
        component: position in `SystemDescription.components`.
        variable: variable of that component.
    """

    component: int
    variable: Variable


@dataclass(frozen=True)
class Resolved:
    """A system whose names, types and units were checked.

    Attributes:
        wires: the connections; those of arrays taken apart.
        inputs: the system's input → the component inputs it drives (all of one unit, no conversion).
        outputs: the system's output → the variable it shows.
        notes: unconnected inputs and units converted on the user's behalf, one line each.
    """

    wires: tuple[Wire, ...]
    inputs: Mapping[str, tuple[Port, ...]]
    outputs: Mapping[str, Port]
    notes: tuple[str, ...] = ()


def to_write(given: object) -> SystemDescription:
    """Return a description that was given to be written; an open system is not one, since it was opened with values.

    Raises:
        InputError: it is something else.
    """
    if isinstance(given, SystemDescription):
        return given
    what = type(given).__name__
    raise InputError(
        f"a {what} is not a system's description: give wb.read_system(path), or recipe.system of an open system"
    )
