"""Components that are not FMUs: linear systems, gains, sums and static Python functions, as instances.

They show the same functions as an FMU does, so that nothing else knows the difference: here in readable Python, for
the kernel in lti.c, on the same memory.
"""

# ruff: noqa: ANN401 - C buffers come in here as ctypes gives them
from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import Sampler, exact
from workbench.errors import InputError, SimulationError
from workbench.fmi.access import TypeCalls
from workbench.fmi.description import Capabilities, DefaultExperiment, ModelDescription
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.instance import EventInfo, Instance
from workbench.fmi.instants import Instants
from workbench.fmi.library import Library
from workbench.fmi.variable import Variable
from workbench.kernel.native_blocks import Lti, call_back, lti_addresses
from workbench.system.description import (
    BlockComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
)

__all__ = ["BlockInstance", "NativeComponent", "block_description", "block_ports", "described"]

NativeComponent = LinearComponent | GainComponent | SumComponent | FunctionComponent | BlockComponent


class BlockInstance(Instance):
    """One block. Its variables stand in one memory, by value reference: inputs, states, outputs.

    A sampled linear system is a clock: at tick k, y = C x + D u and x = A x + B u, and y is held until the next tick;
    x has from tick k to tick k + 1 the value x[k + 1] that the next tick will use (the scheme of
    Modelica.Blocks.Discrete.StateSpace).

    Args:
        component: what it computes.
        description: its variables, from `block_description`.
    """

    version: ClassVar[int] = 2
    TYPES: ClassVar[Mapping[str, TypeCalls]] = {"Real": TypeCalls("fmi2GetReal", "fmi2SetReal", ctypes.c_double)}
    CALLS: ClassVar[Mapping[str, str]] = Instance2.CALLS

    def __init__(self, component: NativeComponent, description: ModelDescription) -> None:
        linear = _linear(component)
        self._function = component.function if isinstance(component, FunctionComponent) else None
        self._sampled = linear.dt > 0.0
        self._matrices = [np.ascontiguousarray(m, dtype=np.float64) for m in (linear.A, linear.B, linear.C, linear.D)]
        nx, nu, ny = len(linear.A), len(linear.input_names), len(linear.output_names)
        self.memory = np.zeros(nu + nx + ny)
        self._next = np.zeros(nx)
        self._trouble: BaseException | None = None
        self.native = Lti(
            nx=nx,
            nu=nu,
            ny=ny,
            **{n: m.ctypes.data for n, m in zip("abcd", self._matrices, strict=True)},
            memory=self.memory.ctypes.data,
            next=self._next.ctypes.data,
        )
        self._period = exact(linear.dt)
        if self._function is not None:
            self._callback = call_back(self.native, self._call_back)
        self.u, self.state, self.y = np.split(self.memory, [nu, nu + nx])
        self.state[:] = linear.x0
        self.source, self.folder = description.model_name, Path()
        self.component = ctypes.addressof(self.native)
        functions = {"fmi2GetReal": self._get_real, "fmi2SetReal": self._set_real}
        self._setup(description, _BlockLibrary(functions), interface="me")
        self._starts()

    def _starts(self) -> None:
        for variable in self.description.variables:
            if variable.causality == "input":
                self.memory[variable.value_reference] = float(variable.start or 0.0)

    def _instantiate(self, *, logging: bool) -> Any:
        return self.component

    def close(self) -> None:
        self._closed = True

    # -- values -----------------------------------------------------------------------------

    def _get_real(self, _component: Any, references: Any, n: int, values: Any) -> int:
        chosen = references[:n]
        if max(chosen, default=0) >= len(self.u) + len(self.state):
            self._evaluate()
        for i, reference in enumerate(chosen):
            values[i] = self.memory[reference]
        return 0

    def _set_real(self, _component: Any, references: Any, n: int, values: Any) -> int:
        for i, reference in enumerate(references[:n]):
            self.memory[reference] = values[i]
        return 0

    def _evaluate(self) -> None:
        """Bring the outputs up to date; those of a sampled system stand between ticks."""
        if self._function is not None:
            self.y[:] = self._answer(self.u.copy())
        elif not self._sampled or self.native.ticking:
            _, _, c, d = self._matrices
            self.y[:] = c @ self.state + d @ self.u

    def _answer(self, u: Floats) -> Floats:
        """Return function(u).

        Raises:
            SimulationError: it raised, or gives another number of values.
        """
        if self._function is None:
            return np.empty(0)
        name = self.description.model_name
        try:
            with np.errstate(all="ignore"):  # a solution is sought with it
                y = np.atleast_1d(np.asarray(self._function(u), dtype=np.float64))
        except Exception as error:
            raise SimulationError(
                f"{name}: the function raised {type(error).__name__}: {error}", time=self.time
            ) from error
        if y.shape != self.y.shape:
            raise SimulationError(
                f"{name}: the function returns {y.size} values for {self.y.size} outputs", time=self.time
            )
        return y

    def _call_back(self, u: Any, y: Any) -> int:
        """Evaluate the function for compiled code; an error waits until Python is back."""
        try:
            answer = self._answer(np.array(u[: len(self.u)]))
        except SimulationError as error:
            self._trouble = error
            return 3
        for i, value in enumerate(answer.tolist()):
            y[i] = value
        return 0

    def fail(self, name: str, status: int) -> Any:
        trouble, self._trouble = self._trouble, None
        if trouble is not None:
            raise trouble
        super().fail(name, status)

    # -- life -------------------------------------------------------------------------------

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = self.native.time = start_time
        if self._sampled:
            self.native.instants = Instants.of(Sampler(self._period).since(start_time))
        self.native.ticks, self.native.ticking = 0, int(self._sampled)

    def exit_initialisation(self) -> None:
        self._running = True

    def set_time(self, time: float) -> None:
        self.time = self.native.time = time

    def set_states(self) -> None:
        if self.nx:
            self.state[:] = self.x

    def get_states(self) -> None:
        if self.nx:
            self.x[:] = self.state

    def get_derivatives(self) -> None:
        if self.nx:
            a, b, _, _ = self._matrices
            self.dx[:] = a @ self.state + b @ self.u

    def get_indicators(self) -> None:
        """There are none."""

    def get_nominals(self) -> Floats:
        return np.ones(self.nx)

    def enter_event_mode(self) -> None:
        self.native.ticking = int(self._sampled and self._due())

    def _due(self) -> bool:
        return self.time >= self._tick()

    def _tick(self, *, after: int = 0) -> float:
        return self.native.instants.at(self.native.ticks + after)

    def enter_continuous_mode(self) -> None:
        if self.native.ticking:
            a, b, _, _ = self._matrices
            self._evaluate()
            if self._due():
                self.state[:] = a @ self.state + b @ self.u
                self.native.ticks += 1
            self.native.ticking = 0

    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        ticks = self.native.ticking and self._due()  # not where it begins between two ticks
        following = self._tick(after=int(ticks)) if self._sampled else math.inf
        return False, EventInfo(terminate=False, states_changed=False, nominals_changed=False, next_time=following)

    # -- saved states -----------------------------------------------------------------------

    def get_state(self) -> Any:
        return bytes(self.native), self.memory.copy()

    def set_state(self, state: Any) -> None:
        ctypes.memmove(self.component, state[0], ctypes.sizeof(Lti))
        self.memory[:] = state[1]
        self.time = self.native.time

    def free_state(self, state: Any) -> None:
        """Python's memory frees itself."""

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> Floats:
        move = np.zeros(len(self.memory))
        for variable, value in zip(knowns, seed, strict=True):
            move[variable.value_reference] += value
        nu, nx = len(self.u), len(self.state)
        a, b, c, d = self._matrices
        du, dx = move[:nu], move[nu : nu + nx]
        if self._sampled:
            rates, outputs = np.zeros(nx), np.zeros(len(self.y))
        else:
            rates, outputs = a @ dx + b @ du, c @ dx + d @ du
        result = np.concatenate([move[: nu + nx], outputs, rates])
        return np.array([result[v.value_reference] for v in unknowns])


class _BlockLibrary(Library):
    """Python functions, and the addresses of their compiled twins."""

    def address(self, name: str) -> int | None:
        return lti_addresses().get(name)


def _linear(component: NativeComponent) -> LinearComponent:
    """Return gains and sums as what they are: linear systems without states; functions with no matrices."""
    if isinstance(component, LinearComponent):
        return component
    if isinstance(component, BlockComponent) and (result := component.block.matrices()) is not None:
        return LinearComponent(
            name=component.name, A=result.a, B=result.b, C=result.c, D=result.d, dt=result.dt,
            x0=np.zeros(len(result.a)), input_names=component.block.inputs, output_names=("y",),
            state_names=component.block.states, units=component.units,
        )  # fmt: skip
    inputs, outputs, gains = block_ports(component)
    return LinearComponent(
        name=component.name, A=np.zeros((0, 0)), B=np.zeros((0, len(inputs))), C=np.zeros((len(outputs), 0)), D=gains,
        dt=0.0, input_names=inputs, output_names=outputs, state_names=(), x0=np.zeros(0),
    )  # fmt: skip


def block_ports(component: NativeComponent) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Return the names of a block's m inputs and p outputs, and its direct gains, shape (p, m)."""
    if isinstance(component, LinearComponent):
        return component.input_names, component.output_names, component.D
    if isinstance(component, GainComponent):
        return ("u",), ("y",), np.array([[component.gain]])
    if isinstance(component, SumComponent):
        names = tuple(f"u{k}" for k in range(1, len(component.signs) + 1))
        return names, ("y",), np.array([component.signs])
    if isinstance(component, FunctionComponent):
        return component.inputs, component.outputs, np.ones((len(component.outputs), len(component.inputs)))
    if isinstance(component, BlockComponent):
        return component.block.inputs, ("y",), np.full((1, len(component.block.inputs)), float(component.block.feeds))
    raise InputError(f"{component.name}: this kind of component is unknown")


def block_description(component: NativeComponent) -> ModelDescription:
    """Return what a block says about itself, in an FMU's words."""
    linear = _linear(component)
    units = _units(component, linear)
    variables, states, derivatives = _variables(linear, units)
    exact = not isinstance(component, FunctionComponent) and linear.dt == 0.0
    able = Capabilities("", state=True, directional_derivatives=exact, completed_step=False)
    return described(component.name, able, variables, states, derivatives)


def described(  # noqa: PLR0917
    name: str,
    able: Capabilities,
    variables: tuple[Variable, ...],
    states: tuple[Variable, ...],
    derivatives: tuple[Variable, ...],
    indicators: int = 0,
) -> ModelDescription:
    """Return the description of a component that is not an FMU, in an FMU's words.

    Args:
        name: of the component.
        able: what its model exchange offers.
        variables: all of them.
        states: continuous states, which are among them.
        derivatives: of the states.
        indicators: number of event indicators.
    """
    return ModelDescription(
        fmi_version="2.0",
        major=2,
        model_name=name,
        token="",
        generation_tool=None,
        description=None,
        interfaces={"me": able},
        platforms=(),
        experiment=DefaultExperiment(),
        variables=variables,
        states=states,
        derivatives=derivatives,
        state_count=len(states),
        indicator_count=indicators,
        shapes={},
        log_categories=(),
        notes=(),
    )


def _units(component: NativeComponent, linear: LinearComponent) -> Mapping[str, str]:
    if not isinstance(component, SumComponent):
        return component.units
    return dict.fromkeys((*linear.input_names, *linear.output_names), component.unit) if component.unit else {}


def _variables(
    linear: LinearComponent, units: Mapping[str, str]
) -> tuple[tuple[Variable, ...], tuple[Variable, ...], tuple[Variable, ...]]:
    """Return all variables, the continuous states and their derivatives; the derivatives stand behind the outputs."""
    nu, nx, ny = len(linear.input_names), len(linear.state_names), len(linear.output_names)
    sampled = linear.dt > 0.0
    kind = "discrete" if sampled else "continuous"
    inputs = tuple(
        Variable(n, unit=units.get(n), start=0.0, causality="input", value_reference=i)
        for i, n in enumerate(linear.input_names)
    )
    states = tuple(
        Variable(n, unit=units.get(n), start=float(linear.x0[i]), variability=kind, value_reference=nu + i)
        for i, n in enumerate(linear.state_names)
    )
    outputs = tuple(
        Variable(
            n, unit=units.get(n), causality="output", variability=kind, value_reference=nu + nx + j,
            dependencies=_reached(linear, linear.C[j], linear.D[j]),
        )
        for j, n in enumerate(linear.output_names)
    )  # fmt: skip
    rates = tuple(
        Variable(
            f"der({s.name})", value_reference=nu + nx + ny + i, derivative_of=s.name,
            dependencies=_reached(linear, linear.A[i], linear.B[i]),
        )
        for i, s in enumerate(states)
    )  # fmt: skip
    if sampled:
        return (*inputs, *states, *outputs), (), ()
    return (*inputs, *states, *outputs), states, rates


def _reached(linear: LinearComponent, by_states: Floats, by_inputs: Floats) -> tuple[str, ...]:
    """Return the inputs and states whose factors in a row of the matrices are not zero."""
    through = [n for n, d in zip(linear.input_names, by_inputs, strict=True) if d != 0.0]
    return (*through, *(n for n, c in zip(linear.state_names, by_states, strict=True) if c != 0.0))
