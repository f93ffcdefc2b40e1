"""FMI 2.0 FMUs written in Python at the level of the C functions: hybrid models with known answers.

They keep FMI's state machine: a call in the wrong mode returns "error" and logs why.
"""
# ruff: noqa: ANN401  what crosses the C interface has no type worth a name

from __future__ import annotations

import copy
import ctypes
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tests import drivers
from workbench.fmi.description import Capabilities, DefaultExperiment, ModelDescription
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.instance import Instance
from workbench.fmi.library import Library, _signatures
from workbench.fmi.variable import Variable
from workbench.session.fmu import FmuSession
from workbench.session.probe import why_state_fails
from workbench.session.setup import Setup

OK, DISCARD, ERROR = 0, 2, 3


class Hybrid:
    """A hybrid model; subclasses override what they need. Values live in `v` by name."""

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    integers: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ("y",)
    nz = 0
    nominal: float | None = 1.0
    variable_step = True

    def __init__(self) -> None:
        names = (*self.states, *self.inputs, *self.integers, *self.outputs)
        self.v: dict[str, Any] = dict.fromkeys(names, 0.0)
        self.t = 0.0
        self.events: list[float] = []
        self.start()

    def start(self) -> None: ...

    def derivatives(self) -> list[float]:
        return [0.0] * len(self.states)

    def indicators(self) -> list[float]:
        return []

    def output(self) -> None: ...

    def event(self) -> tuple[bool, float]:
        """Handle an event; returns (states jumped, next time event)."""
        return False, math.inf

    def refuses(self) -> bool:
        """Whether the derivatives cannot be computed here."""
        return False

    def wants_event(self) -> bool:
        return False

    def step(self, h: float) -> int:
        """Co-simulation: explicit Euler."""
        for name, dx in zip(self.states, self.derivatives(), strict=True):
            self.v[name] += h * dx
        self.t += h
        return OK


class FakeC:
    """The C functions of one instance of a `Hybrid`."""

    def __init__(self, model: Hybrid, names: list[str]) -> None:
        self.m, self.names, self.mode = model, names, "instantiated"
        self.freed = False
        self.saved: dict[int, Hybrid] = {}

    def functions(self) -> dict[str, Callable[..., int]]:
        found = {n: getattr(self, n) for n in dir(self) if n.startswith("fmi2")}
        for absent in ("fmi2SetDebugLogging", "fmi2GetDirectionalDerivative", "fmi2SetRealInputDerivatives"):

            def missing(*_: object) -> int:
                raise AssertionError("missing function called")

            missing.missing = True  # type: ignore[attr-defined]
            found[absent] = missing
        return found

    def _go(self, allowed: str, to: str) -> int:
        if self.mode not in allowed.split():
            return ERROR
        self.mode = to
        return OK

    def fmi2SetupExperiment(self, _c: Any, _u: int, _tol: float, start: float, *_: Any) -> int:
        self.m.t = start
        return OK

    def fmi2EnterInitializationMode(self, _c: Any) -> int:
        return self._go("instantiated", "initialisation")

    def fmi2ExitInitializationMode(self, _c: Any) -> int:
        return self._go("initialisation", "event")

    def fmi2EnterEventMode(self, _c: Any) -> int:
        return self._go("continuous", "event")

    def fmi2EnterContinuousTimeMode(self, _c: Any) -> int:
        return self._go("event", "continuous")

    def fmi2NewDiscreteStates(self, _c: Any, info: Any) -> int:
        if self.mode != "event":
            return ERROR
        jumped, next_time = self.m.event()
        self.m.events.append(self.m.t)
        info._obj.newDiscreteStatesNeeded = 0
        info._obj.valuesOfContinuousStatesChanged = int(jumped)
        info._obj.nextEventTimeDefined = int(math.isfinite(next_time))
        info._obj.nextEventTime = next_time
        return OK

    # The promise that no earlier state will be restored is given where none is kept, and then alone.
    def _promised(self, never_back: int) -> bool:
        return bool(never_back) == (not self.saved)

    def fmi2CompletedIntegratorStep(self, _c: Any, never_back: int, event: Any, _terminate: Any) -> int:
        event._obj.value = int(self.m.wants_event())
        return OK if self.mode == "continuous" and self._promised(never_back) else ERROR

    def fmi2SetTime(self, _c: Any, t: float) -> int:
        """FMI 2.0 allows it in event mode, too; FMUs of Dymola do not."""
        if self.mode != "continuous":
            return ERROR
        self.m.t = t
        return OK

    def fmi2SetContinuousStates(self, _c: Any, x: Any, n: int) -> int:
        self.m.v.update(zip(self.m.states, x[:n], strict=True))
        return OK if self.mode == "continuous" else ERROR

    def fmi2GetContinuousStates(self, _c: Any, x: Any, n: int) -> int:
        x[:n] = [self.m.v[s] for s in self.m.states]
        return OK

    def fmi2GetDerivatives(self, _c: Any, dx: Any, n: int) -> int:
        if self.m.refuses():
            return DISCARD
        dx[:n] = self.m.derivatives()
        return OK

    def fmi2GetEventIndicators(self, _c: Any, z: Any, n: int) -> int:
        z[:n] = self.m.indicators()
        return OK

    def fmi2GetNominalsOfContinuousStates(self, _c: Any, x: Any, n: int) -> int:
        x[:n] = [self.m.nominal or 0.0] * n
        return OK

    def _get(self, _c: Any, vr: Any, n: int, values: Any) -> int:
        self.m.output()
        for i in range(n):
            values[i] = self.m.v[self.names[vr[i]]]
        return OK

    fmi2GetReal = _get

    def fmi2GetInteger(self, _c: Any, vr: Any, n: int, values: Any) -> int:
        for i in range(n):
            values[i] = int(self.m.v[self.names[vr[i]]])
        return OK

    def fmi2SetReal(self, _c: Any, vr: Any, n: int, values: Any) -> int:
        for i in range(n):
            self.m.v[self.names[vr[i]]] = values[i]
        return OK

    def fmi2SetInteger(self, _c: Any, vr: Any, n: int, values: Any) -> int:
        return ERROR if self.mode == "continuous" else self.fmi2SetReal(_c, vr, n, values)

    def fmi2DoStep(self, _c: Any, t: float, h: float, never_back: int) -> int:
        return self.m.step(h) if abs(t - self.m.t) < 1e-9 and self._promised(never_back) else ERROR

    def fmi2GetFMUstate(self, _c: Any, state: Any) -> int:
        key = len(self.saved) + 1
        self.saved[key] = copy.deepcopy(self.m)
        state._obj.value = key
        return OK

    def fmi2SetFMUstate(self, _c: Any, state: Any) -> int:
        self.m.__dict__.update(copy.deepcopy(self.saved[state.value]).__dict__)
        return OK

    def fmi2FreeFMUstate(self, _c: Any, state: Any) -> int:
        del self.saved[state._obj.value]
        return OK

    def fmi2Terminate(self, _c: Any) -> int:
        return OK

    def fmi2FreeInstance(self, _c: Any) -> int:
        assert not self.freed
        assert not self.saved
        self.freed = True
        return OK


class Pointer:
    """What a C caller passes by address, as the functions above see it when Python calls them."""

    def __init__(self, pointer: Any) -> None:
        self._pointer = pointer

    @property
    def _obj(self) -> Any:
        return self._pointer.contents

    @property
    def value(self) -> Any:
        return self._pointer

    def __getitem__(self, key: int | slice) -> Any:
        return self._pointer[key]

    def __setitem__(self, key: int | slice, value: Any) -> None:
        if isinstance(key, slice):
            for i, item in enumerate(value):
                self._pointer[i] = item
        else:
            self._pointer[key] = value


def as_c(functions: Mapping[str, Callable[..., int]], *, version: int, interface: str) -> dict[str, Any]:
    """Return the functions as C functions with an address, so that compiled code can call them."""
    found: dict[str, Any] = {}
    for name, (result, arguments) in _signatures(version, interface).items():
        if name in functions:
            function = functions[name]
            missing = getattr(function, "missing", False)
            plain = [a in PLAIN for a in arguments]
            made = ctypes.CFUNCTYPE(result, *arguments)(_from_c(function, plain))
            found[name] = function if missing else made
    return found


PLAIN = (ctypes.c_double, ctypes.c_int, ctypes.c_size_t, ctypes.c_uint, ctypes.c_bool, ctypes.c_char, ctypes.c_char_p)


def _from_c(function: Callable[..., int], plain: list[bool]) -> Callable[..., int]:
    def call(*arguments: Any) -> int:
        seen = [a if p else Pointer(a) for a, p in zip(arguments, plain, strict=True)]
        return function(*seen)

    return call


class LyingC(FakeC):
    """Claims to save its state, but does not take it back."""

    def fmi2SetFMUstate(self, _c: Any, state: Any) -> int:
        return OK


class FakeInstance(Instance2):
    def __init__(self, description: ModelDescription, c: FakeC, interface: str) -> None:
        functions: dict[str, Any] = c.functions()
        if drivers.fakes == "compiled":
            functions = as_c(functions, version=2, interface=interface)
        self._setup(description, Library(functions), interface=interface)
        self.source, self.folder, self.component, self.c = "fake", Path(), 1, c


def variables(model: Hybrid) -> tuple[Variable, ...]:
    nominal = model.nominal or None
    found = [Variable(name=n, nominal=nominal) for n in model.states]
    found += [Variable(name=n, causality="input", start=0.0) for n in model.inputs]
    found += [
        Variable(name=n, type="Integer", causality="input", variability="discrete", start=0) for n in model.integers
    ]
    found += [Variable(name=n, causality="output") for n in model.outputs]
    return tuple(v._replace(value_reference=i) for i, v in enumerate(found))


def describe(model: Hybrid, *, state: bool = False) -> ModelDescription:
    every = variables(model)
    claims = Capabilities("fake", state=state, variable_step=model.variable_step)
    return ModelDescription(
        fmi_version="2.0",
        major=2,
        model_name=type(model).__name__,
        token="",
        generation_tool=None,
        description=None,
        interfaces={"me": claims, "cs": claims},
        platforms=(),
        experiment=DefaultExperiment(),
        variables=every,
        states=every[: len(model.states)],
        derivatives=(),
        state_count=len(model.states),
        indicator_count=model.nz,
        shapes={},
        log_categories=(),
        notes=(),
    )


def open_fake(
    make: Callable[[], Hybrid],
    solver: str = "gear",
    *,
    interface: str = "me",
    c: type[FakeC] = FakeC,
    state: bool = False,
    rtol: float = 1e-8,
    step: float | None = None,
    bias: dict[str, float] | None = None,
    start_time: float = 0.0,
    hold_inputs: bool = False,
) -> FmuSession:
    """Return a session on a fake; `session.instance.c.m` is the model."""
    description = describe(make(), state=state)
    names = [v.name for v in description.variables]

    def instance() -> Instance:
        return FakeInstance(description, c(make(), names), interface)

    kind = drivers.DRIVERS[drivers.fakes][interface]
    by_name = {v.name: v for v in description.variables}
    setup = Setup(by_name, instance, rtol=rtol, solver=solver, step=step, bias=bias or {})
    works = state and not why_state_fails(kind, setup)
    return kind(
        Setup(
            by_name,
            instance,
            rtol=rtol,
            solver=solver,
            step=step,
            bias=bias or {},
            start_time=start_time,
            hold_inputs=hold_inputs,
            state_works=lambda: works,
        )
    )


def inside(session: FmuSession) -> Hybrid:
    """Return the model inside a session on a fake."""
    instance = session.instance
    assert isinstance(instance, FakeInstance)
    return instance.c.m
