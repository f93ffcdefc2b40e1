"""FMI 1.0 through the same sessions, on an FMU written in Python at the level of the C functions."""
# ruff: noqa: ANN401  what crosses the C interface has no type worth a name

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import drivers, hybrid_fmus
from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.hybrid_fmus import FakeC, Hybrid, describe
from workbench.errors import FmuError, SimulationError
from workbench.fmi.fmi1 import Instance1
from workbench.fmi.instance import Instance
from workbench.fmi.library import Library, _signatures
from workbench.fmi.variable import Variable
from workbench.session.fmu import FmuSession
from workbench.session.setup import Setup
from workbench.signals.kinds import Constant, Sine, Step


class Relay(Hybrid):
    """dx/dt = u, and x falls to 0 whenever it reaches 1; y = x, a time event at 0.25."""

    states = ("x",)
    inputs = ("u",)
    nz = 1

    def derivatives(self) -> list[float]:
        return [self.v["u"]]

    def indicators(self) -> list[float]:
        return [1.0 - self.v["x"]]

    def event(self) -> tuple[bool, float]:
        jump = self.v["x"] >= 1.0
        if jump:
            self.v["x"] = 0.0
        return jump, 0.25 if self.t < 0.25 else math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


class FakeOne(FakeC):
    """The functions of FMI 1.0 on the same models; `flag` is a Boolean of one byte."""

    flag = b"\1"

    def functions(self) -> dict[str, Any]:
        same = "SetTime SetContinuousStates GetContinuousStates GetDerivatives GetEventIndicators GetReal SetReal"
        found = {f"fmi1{n}": getattr(self, f"fmi2{n}") for n in same.split()}
        found |= {n: getattr(self, n) for n in dir(self) if n.startswith("fmi1")}
        return found

    def fmi2SetTime(self, _c: Any, t: float) -> int:
        """FMI 1.0 has no modes: it is told the time before `fmiInitialize`, too."""
        self.m.t = t
        return 0

    def fmi1GetNominalContinuousStates(self, _c: Any, x: Any, n: int) -> int:
        return self.fmi2GetNominalsOfContinuousStates(_c, x, n)

    def _event(self, info: Any) -> int:
        self.mode = "continuous"
        jumped, next_time = self.m.event()
        self.m.events.append(self.m.t)
        info._obj.iterationConverged = b"\1"
        info._obj.stateValuesChanged = b"\1" if jumped else b"\0"
        info._obj.upcomingTimeEvent = b"\1" if math.isfinite(next_time) else b"\0"
        info._obj.nextEventTime = next_time
        return 0

    def fmi1Initialize(self, _c: Any, _b: bytes, _tol: float, info: Any) -> int:
        return self._event(info)

    def fmi1EventUpdate(self, _c: Any, _b: bytes, info: Any) -> int:
        return self._event(info)

    def fmi1CompletedIntegratorStep(self, _c: Any, event: Any) -> int:
        event._obj.value = b"\0"
        return 0

    def fmi1GetBoolean(self, _c: Any, _vr: Any, n: int, values: Any) -> int:
        for i in range(n):
            values[i] = self.flag
        return 0

    def fmi1SetBoolean(self, _c: Any, _vr: Any, n: int, values: Any) -> int:
        self.flag = values[n - 1]
        return 0

    def fmi1GetInteger(self, _c: Any, _vr: Any, _n: int, _values: Any) -> int:
        return 3

    fmi1SetInteger = fmi1GetInteger
    fmi1GetString = fmi1GetInteger
    fmi1SetString = fmi1GetInteger

    def fmi1InitializeSlave(self, _c: Any, start: float, _b: bytes, _stop: float) -> int:
        self.m.t = start
        return 0

    def fmi1DoStep(self, _c: Any, t: float, h: float, _new: bytes) -> int:
        return self.fmi2DoStep(_c, t, h, 1)  # FMI 1.0 keeps no states

    def fmi1Terminate(self, _c: Any) -> int:
        return 0

    fmi1TerminateSlave = fmi1Terminate

    def fmi1FreeModelInstance(self, _c: Any) -> int:
        return self.fmi2FreeInstance(_c)

    fmi1FreeSlaveInstance = fmi1FreeModelInstance


class FakeInstance1(Instance1):
    def __init__(self, interface: str) -> None:
        description = dataclasses.replace(describe(Relay()), fmi_version="1.0", major=1)
        names = [v.name for v in description.variables]
        self.c = FakeOne(Relay(), names)
        functions = self.c.functions()
        if drivers.fakes == "compiled":
            functions = hybrid_fmus.as_c(functions, version=1, interface=interface)
        self._setup(description, Library(functions), interface=interface)
        self.source, self.folder, self.component = "one", Path(), 1
        self._name_ends()


def open_one(interface: str, solver: str, step: float | None = None) -> FmuSession:
    by_name = {v.name: v for v in describe(Relay()).variables}

    def instance() -> Instance:
        return FakeInstance1(interface)

    kind = drivers.DRIVERS[drivers.fakes][interface]
    return kind(Setup(by_name, instance, solver=solver, rtol=1e-9, step=step))


@pytest.mark.parametrize("solver", ["vkm", "gear"])
def test_model_exchange_with_state_time_and_input_events(solver: str) -> None:
    signals = {"u": Step(time=0.5, value=4.0, initial=1.0)}
    with open_one("me", solver) as session:
        record = session.advance(1.0, signals=signals, record=["y"], points=np.array([0.5, 0.9, 1.0]))
        events = list(session.instance.c.m.events)  # type: ignore[attr-defined]
        saved = session.snapshot()
        session.advance(1.2, signals=signals)
        after = session.values(["y"])
        session.restore(saved)
        assert session.time == 1.0
        session.advance(1.2, signals=signals)
        assert session.values(["y"])["y"] == pytest.approx(after["y"], abs=1e-9)
    # x = t up to 0.5, then rises by 4 a second and falls from 1 to 0 at 0.625 and 0.875
    assert events == pytest.approx([0.0, 0.0, 0.25, 0.5, 0.625, 0.875], abs=1e-9)
    assert record.values["y"][record.time == 0.9][-1] == pytest.approx(0.1, abs=1e-8)


def test_cosimulation() -> None:
    with open_one("cs", "fmu", step=1e-3) as session:
        record = session.advance(0.5, signals={"u": Sine(frequency=1.0)}, record=["y"])
        assert record.values["y"][-1] == pytest.approx(1.0 / math.pi, abs=2e-3)


def test_booleans_are_single_bytes() -> None:
    instance = FakeInstance1("me")
    access = instance.access([Variable(name="flag", type="Boolean")])
    assert access.read() == [True]
    access.write([False])
    assert access.read() == [False]


def test_a_bad_status_is_an_error_and_fmi_1_saves_no_state() -> None:
    instance = FakeInstance1("me")
    with pytest.raises(SimulationError, match="fmiGetInteger returned error"):
        instance.access([Variable(name="n", type="Integer")]).read()
    with pytest.raises(FmuError, match=r"FMI 1\.0 cannot save"):
        instance.get_state()


def test_status_results_of_fmi_1_are_numbers() -> None:
    # FMPy declares some as strings: an error status would then be read as an address.
    for interface in ("me", "cs"):
        texts = {n for n, (result, _) in _signatures(1, interface).items() if "char_p" in str(result)}
        assert all(n.endswith(("Version", "TypesPlatform")) for n in texts)


def test_constant_inputs_need_no_event() -> None:
    with open_one("me", "vkm") as session:
        session.advance(0.2, signals={"u": Constant(0.0)})
        assert session.instance.c.m.events == [0.0]  # type: ignore[attr-defined]
