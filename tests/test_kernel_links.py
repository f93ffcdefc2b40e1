"""Several FMUs with connections in one compiled run: the same code path as a single one, a list of two."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest

from workbench.core.values.arrays import Floats
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import Wire
from workbench.kernel.native_forcing import NativeForcing
from workbench.kernel.native_record import NativeRecord
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Cs, Me
from workbench.model.load import FmuModel, load
from workbench.signals.kinds import Signal, Sine, Step
from workbench.system.order import plan

GAIN = -0.5


def named(model: FmuModel, name: str) -> Variable:
    return next(v for v in model.description.variables if v.name == name)


def two_lags(version: str, interface: str, signal: Signal, points: Floats) -> Floats:
    """u → lag → gain → lag → y; columns time, u, y of the first, y of the second."""
    with (
        load(f"fmu:FirstOrderLag{version}", interface, "auto", step=1e-3) as model,
        model.open_session(signals={"u": signal}) as a,
        model.open_session() as b,
    ):
        u, y = named(model, "u"), named(model, "y")
        system = NativeSystem([a.instance, b.instance], plan([Wire(y, u, 0, 1, GAIN)], parts=2))
        forcing = NativeForcing(system, [(u, signal, 0.0, [(0, u)])], longest_step=signal.longest_step)
        forcing.written[0] = signal(0.0)
        forcing.apply()
        record = NativeRecord(system, [(y, 0), (y, 1)])
        runs = {"me": run_me, "cs": run_cs}
        runs[interface](system, record, points)
        table = record.columns()
        record.close()
    return table


def run_me(system: NativeSystem, record: NativeRecord, points: Floats) -> None:
    scale, most = np.full(2, 1e-6), np.full(2, np.inf)
    native = Me(
        system=system.address, solver_name=b"vkm", rtol=1e-10, scale=scale.ctypes.data, most=most.ctypes.data,
        time=0.0, next_time=0.0,  # an event at once: connected values are passed on in event mode
    )  # fmt: skip
    library, address = system.library, ctypes.addressof(native)
    assert library.kernel_me_open(address)
    done = library.kernel_me_run(address, points[-1], points.ctypes.data, len(points), record.address, 1)
    library.kernel_me_close(address)
    assert done, system.structure.failure.code


def run_cs(system: NativeSystem, record: NativeRecord, points: Floats) -> None:
    native = Cs(system=system.address, fixed=math.nan, longest=1e-3, variable_step=1, step_given=1)
    address = ctypes.addressof(native)
    run = system.library.kernel_cs_run
    assert run(address, points[-1], points.ctypes.data, len(points), record.address, 1)


@pytest.mark.parametrize("version", ["", "@3"])
@pytest.mark.parametrize(("interface", "accuracy"), [("me", 1e-8), ("cs", 2e-3)])
def test_two_lags_follow_the_closed_form(version: str, interface: str, accuracy: float) -> None:
    points = np.arange(1, 51) / 50.0
    time, u, first, second = two_lags(version, interface, Step(time=0.3, value=2.0), points)
    with load(f"fmu:FirstOrderLag{version}") as model:
        tau = named(model, "tau").start
    assert isinstance(tau, float)
    s = np.maximum(time - 0.3, 0.0) / tau
    assert first == pytest.approx(2.0 * -np.expm1(-s), abs=accuracy)
    assert second == pytest.approx(GAIN * 2.0 * (1.0 - (1.0 + s) * np.exp(-s)), abs=accuracy)
    assert u[time > 0.3] == pytest.approx(2.0)
    assert np.count_nonzero(time == 0.3) == 2


def test_inputs_of_the_second_are_continuous_inside_the_solver() -> None:
    points = np.array([1.0])  # nothing is recorded in between, yet the second sees the first move
    time, _, _, second = two_lags("", "me", Sine(frequency=1.0), points)
    dense = two_lags("", "me", Sine(frequency=1.0), np.arange(1, 1001) / 1000.0)
    assert time[-1] == 1.0
    assert second[-1] == pytest.approx(dense[3][-1], abs=1e-9)
