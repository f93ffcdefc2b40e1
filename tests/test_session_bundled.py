"""Sessions on the bundled FMUs: both FMI versions, both interfaces, against analytic truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.model.load import load
from workbench.signals.kinds import Constant, Signal, Sine, Step

BOTH = pytest.mark.parametrize("version", ["", "@3"])


def lag(t: Floats, frequency: float, tau: float) -> Floats:
    """Response of 1/(tau s + 1) at rest to sin(2π f t)."""
    omega = 2.0 * math.pi * frequency
    steady = 1.0 / complex(1.0, omega * tau)
    result: Floats = (steady * np.exp(1j * omega * t)).imag - steady.imag * np.exp(-t / tau)
    return result


@BOTH
@pytest.mark.parametrize(
    ("interface", "solver", "tolerance", "accuracy"),
    [("me", "vkm", 1e-8, 1e-7), ("me", "gear", 1e-8, 2e-6), ("cs", "auto", None, 2e-3)],
)
def test_lag_matches_the_closed_form(
    version: str, interface: str, solver: str, tolerance: float | None, accuracy: float
) -> None:
    step = 1e-3 if interface == "cs" else None
    points = np.linspace(0.1, 3.0, 30)
    with load(f"fmu:FirstOrderLag{version}", interface, solver, tolerance=tolerance, step=step) as model:
        tau = next(v.start for v in model.parameters if v.name == "tau")
        with model.open_session() as session:
            record = session.advance(1.5, signals={"u": Sine(frequency=1.0)}, record=["y"], points=points[:15])
            record2 = session.advance(3.0, signals={"u": Sine(frequency=1.0)}, record=["y"], points=points[15:])
    time = np.append(record.time, record2.time)
    values = np.append(record.values["y"], record2.values["y"])
    assert isinstance(tau, float)
    assert np.max(np.abs(values - lag(time, 1.0, tau))) < accuracy


@BOTH
def test_held_inputs_follow_the_recursion_of_a_held_lag(version: str) -> None:
    h = 0.05
    points: Floats = h * np.arange(1.0, 61.0)
    with (
        load(f"fmu:FirstOrderLag{version}", "cs", step=h, tolerance=1e-10, hold_inputs=True) as model,
        model.open_session() as session,
    ):
        record = session.advance(3.0, signals={"u": Sine(frequency=1.0)}, record=["y"], points=points)
    held, expected = 0.0, []
    for k in range(60):
        u = math.sin(2.0 * math.pi * h * k)
        held = u + (held - u) * math.exp(-h)
        expected.append(held)
    left = np.searchsorted(record.time, points - 1e-9)
    assert np.max(np.abs(record.values["y"][left] - expected)) < 1e-9


@BOTH
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_jump_at_a_tick_is_sampled_by_that_tick(version: str, interface: str) -> None:
    period = 0.022
    points: Floats = period * np.arange(1.0, 9.0)
    step = period if interface == "cs" else None
    with load(f"fmu:ElevatorLaw{version}", interface, step=step) as model, model.open_session() as session:
        signals = {"side_stick": Step(time=5.0 * period, value=0.05)}
        record = session.advance(8.0 * period, signals=signals, record=["elevator"], points=points)
    tick = np.flatnonzero(np.isclose(record.time, 5.0 * period))
    left, right = record.values["elevator"][tick[[0, -1]]]
    assert left == 2.0  # at rest at neutral
    assert right == pytest.approx(2.0 + 0.05 * 0.96 * 6.9, abs=1e-12)  # the shape's and the positive gain


def test_model_exchange_holds_no_inputs() -> None:
    with pytest.raises(InputError, match="hold_inputs: only co-simulation"):
        load("fmu:FirstOrderLag", "me", hold_inputs=True)


@BOTH
def test_start_time_and_a_parameter(version: str) -> None:
    with (
        load(f"fmu:FirstOrderLag{version}", start_values={"tau": 0.1}, tolerance=1e-9) as model,
        model.open_session(start_time=5.0) as session,
    ):
        session.advance(6.0, signals={"u": Step(time=5.5, value=1.0)})
        assert session.values(["y"])["y"] == pytest.approx(1.0 - math.exp(-5.0), abs=1e-7)


@BOTH
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize(("name", "u", "y"), [("Rudder", "delC", "del"), ("TwoRateQuantizer", "u", "y")])
def test_the_fmus_own_state_is_trusted_and_brings_the_session_back(
    name: str, u: str, y: str, interface: str, version: str
) -> None:
    signals: dict[str, Signal] = {u: Sine(frequency=8.0, amplitude=2.0)}
    with load(f"fmu:{name}{version}", interface) as model:
        assert model.snapshot_method() == "state"
        with model.open_session() as session:
            session.advance(0.101, signals=signals)
            saved = session.snapshot()
            runs = []
            for _ in range(2):
                session.advance(0.15, signals={u: Step(time=0.12, value=5.0)})
                session.restore(saved)
                runs.append(session.advance(0.2, signals=signals, record=[y]).values[y])
                session.restore(saved)
    assert np.array_equal(runs[0], runs[1])


@BOTH
def test_rudder_both_solvers_and_the_fmus_own_agree(version: str) -> None:
    signals: dict[str, Signal] = {"delC": Sine(frequency=5.0, amplitude=2.0)}
    points = np.linspace(0.02, 0.4, 20)
    runs = {}
    for interface, solver, step in (("me", "gear", None), ("me", "vkm", None), ("cs", "auto", 1e-4)):
        with (
            load(f"fmu:Rudder{version}", interface, solver, step=step) as model,
            model.open_session() as session,
        ):
            record = session.advance(0.4, signals=signals, record=["del"], points=points)
            # The last row at each time; co-simulation has more rows than the points.
            at = np.searchsorted(record.time, points, side="right") - 1
            runs[interface, solver] = record.values["del"][at]
    size = float(np.max(np.abs(runs["me", "vkm"])))
    assert runs["me", "gear"] == pytest.approx(runs["me", "vkm"], abs=2e-4 * size)
    assert runs["cs", "auto"] == pytest.approx(runs["me", "vkm"], abs=3e-3 * size)


def test_both_versions_give_the_same_quantiser() -> None:
    points = np.linspace(0.005, 1.0, 200)
    runs = []
    for version in ("", "@3"):
        with load(f"fmu:TwoRateQuantizer{version}") as model, model.open_session() as session:
            assert model.solver == "none"
            runs.append(session.advance(1.0, signals={"u": Sine(frequency=3.0)}, record=["y"], points=points))
    assert np.array_equal(runs[0].time, runs[1].time)
    assert np.array_equal(runs[0].values["y"], runs[1].values["y"])
    assert len(np.unique(runs[0].values["y"])) > 5


@BOTH
def test_cosimulation_goes_on_after_a_jump_of_the_input(version: str) -> None:
    signal = Step(time=0.35, value=1.0)
    with load(f"fmu:FirstOrderLag{version}", "cs", step=0.05) as model, model.open_session() as session:
        tau = session.values(["tau"])["tau"]
        session.advance(0.2, signals={"u": signal})
        record = session.advance(1.0, signals={"u": signal}, record=["y"])
    assert record.values["y"][-1] == pytest.approx(-math.expm1(-0.65 / tau), abs=1e-5)
    at = record.time == 0.35
    assert record.inputs["u"][at].tolist() == [0.0, 1.0]


@BOTH
def test_the_rudder_stays_at_rest_as_long_as_one_likes(version: str) -> None:
    # There every Newton correction of the implicit integrator is rounding.
    rng = np.random.default_rng(7)
    loads = [{"delC": 0.05, "pS": 2.163e7, "mH": 50.0, "bypass": 0.1}]
    loads += [
        dict(zip(loads[0], rng.uniform([-0.3, 1.5e7, -200.0, 0.0], [0.3, 2.5e7, 200.0, 0.2]).tolist(), strict=True))
        for _ in range(4)
    ]
    with load(f"fmu:Rudder{version}", "cs", step=1e-3) as model:
        for held in loads:
            signals: dict[str, Signal] = {name: Constant(value) for name, value in held.items()}
            with model.open_session(signals=signals) as session:
                record = session.advance(4.0, signals=signals, record=["del"], points=np.array([3.0, 4.0]))
            at = np.searchsorted(record.time, np.array([3.0, 4.0]) - 1e-9)
            early, late = record.values["del"][at]
            assert late == pytest.approx(early, abs=1e-9)
