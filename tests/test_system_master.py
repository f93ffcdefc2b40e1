"""Systems with co-simulation components: the master held against closed forms and against model exchange."""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import workbench as wb
from tests.drivers import DRIVERS
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.master_loops import REFERENCE, error_of, fmu, grid, lags, left_limits, mastered
from tests.system_models import difference
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import Sampler
from workbench.errors import InputError, SimulationError
from workbench.fmi.clocks import clocks_of
from workbench.fmi.declared import ClockVariable, Word
from workbench.fmi.ticking import periodic
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant, Signal, Sine, Step
from workbench.system.connect import connect
from workbench.system.description import FmuComponent
from workbench.system.load import load
from workbench.system.master.model import MasterModel
from workbench.system.master.richardson import halving
from workbench.system.master.sampled import repeating

both = pytest.mark.parametrize("driver", DRIVERS, indirect=True)

# -- order and accuracy -------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["", "@3"])
@pytest.mark.parametrize("first", ["cs", "me"])
@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
def test_the_error_falls_with_the_square_of_the_step(version: str, first: str, order: str) -> None:
    coarse, fine = (error_of(lags(first, version=version, step=h, order=order)) for h in (0.05, 0.025))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
def test_held_inputs_are_of_first_order(order: str) -> None:
    coarse, fine = (error_of(lags(step=h, order=order, hold_inputs=True)) for h in (0.025, 0.0125))
    assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("extrapolation", "order"), [(0, 1.0), (1, 2.0), (2, 3.0)])
@pytest.mark.parametrize("order_of_units", ["gauss-seidel", "jacobi"])
def test_the_error_falls_with_the_order_of_the_extrapolation(
    extrapolation: int, order: float, order_of_units: str
) -> None:
    coarse, fine = (
        error_of(lags("me", step=h, order=order_of_units, extrapolation=extrapolation)) for h in (0.05, 0.025)
    )
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.2)


@both
@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
def test_the_first_step_is_repeated_until_it_knows_its_slopes(driver: str, order: str) -> None:
    """Two co-simulation parts that do not begin at rest: one repetition does for neither, the sum passes on at once."""
    x0 = (-0.5, 1.0)
    coarse, fine = (error_of(lags(step=h, order=order, extrapolation=2, x0=x0), x0=x0) for h in (0.05, 0.025))
    assert math.log2(coarse / fine) == pytest.approx(3.0, abs=0.1)
    assert coarse < 2e-3


@needs_gemseo
def test_a_first_step_that_cannot_be_repeated_is_told() -> None:
    with springs(0.01, extrapolation=2) as model:
        with model.open_session() as session:
            session.advance(0.1, signals={})
        assert any("the first step cannot be repeated" in remark for remark in model.remarks())


@needs_gemseo
def test_a_step_that_cannot_be_controlled_has_no_tolerance() -> None:
    with (
        springs(None, step_tolerance=1e-3) as model,
        pytest.raises(
            InputError, match=r"step_tolerance: the step cannot be controlled: .* state.*; give step instead"
        ),
    ):
        model.open_session()


@both
def test_both_drivers_advance_the_model_exchange_part(driver: str) -> None:
    assert error_of(lags("me", step=0.05)) < 2e-3


def delays_of(model: wb.Model, **options: Any) -> wb.DelayReport:  # noqa: ANN401 - those of delays
    report = wb.delays(model, **options)
    assert isinstance(report, wb.DelayReport)
    return report


def test_gauss_seidel_follows_the_signals_and_jacobi_does_not() -> None:
    """A chain, its components named against the signals' direction: no value is old with Gauss-Seidel."""

    def chain(interface: str, order: str) -> DescribedModel:
        return connect(
            {"b": fmu("b", "fmu:FirstOrderLag", interface), "a": fmu("a", "fmu:Saturation", interface)},
            [("a.y", "b.u")],
            inputs={"r": "a.u"},
            outputs={"y": "b.y"},
            step=0.1,
            order=order,
            tolerance=1e-9,
        )

    signals: Mapping[str, Signal] = {"r": Sine(frequency=0.2, amplitude=0.1)}
    last = {}
    for interface, order in (("me", "auto"), ("cs", "gauss-seidel"), ("cs", "jacobi")):
        with chain(interface, order) as model, model.open_session(signals=signals) as session:
            session.advance(1.0, signals=signals)
            last[interface, order] = session.values(["y"])["y"]
            if isinstance(model, MasterModel):
                stages = (("a",), ("b",)) if order == "gauss-seidel" else (("b", "a"),)
                assert delays_of(model, stop=1.0).stages == stages
    truth = last["me", "auto"]
    serial, parallel = (abs(last["cs", order] - truth) for order in ("gauss-seidel", "jacobi"))
    assert serial < 1e-3 * abs(truth) * 5.0
    assert parallel > 3.0 * serial


def test_the_delay_of_the_report_destabilises_as_it_says() -> None:
    """L = 25/(s + 1)² has 23° of phase at its crossover: a delay of 82 ms uses it up."""
    grown = {}
    for step in (0.06, 0.1):
        with lags(gain=25.0, step=step, order="jacobi", hold_inputs=True) as model:
            (loop,) = delays_of(model, stop=1.0).loops
            assert loop.mean_s == pytest.approx(step)
            assert loop.crossover_hz == pytest.approx(math.sqrt(24.0) / (2.0 * math.pi), rel=1e-6)
            signals: Mapping[str, Signal] = {"r": Step(time=0.0, value=1.0)}
            with model.open_session(signals=signals) as session:
                record = session.advance(20.0, signals=signals, record=["y"])
        late = record.values["y"][record.time > 15.0]
        early = record.values["y"][record.time < 5.0]
        grown[loop.phase_lost_deg or 0.0] = float(np.ptp(late) / np.ptp(early))
    margin = 180.0 - 2.0 * math.degrees(math.atan(math.sqrt(24.0)))
    assert all((lost > margin) == (growth > 1.0) for lost, growth in grown.items())


# -- springs ------------------------------------------------------------------------------------


def springs(step: float | None, step_tolerance: float | None = None, extrapolation: int = 1) -> MasterModel:
    files = (str(gemseo_fmu(f"MassSpringSubSystem{k}")) for k in (1, 2))
    return mastered(
        connect(
            {name: fmu(name, file) for name, file in zip("ab", files, strict=True)},
            [("a.x1", "b.x1"), ("b.x2", "a.x2")],
            outputs={"v1": "a.v1", "v2": "b.v2", "x1": "a.x1", "x2": "b.x2"},
            step=step,
            step_tolerance=step_tolerance,
            extrapolation=extrapolation,
        )
    )


def springs_truth(t: Floats) -> Floats:
    a = np.array([[0, 0, -2, 1], [0, 0, 1, -2], [1, 0, 0, 0], [0, 1, 0, 0]], dtype=float)
    values, vectors = np.linalg.eig(a)
    weights = np.linalg.solve(vectors, np.array([1.0, 0.0, 0.0, 1.0]))
    found: Floats = (vectors @ (np.exp(np.outer(values, t)) * weights[:, None])).real
    return found


@needs_gemseo
def test_the_error_of_the_report_is_that_of_the_springs() -> None:
    names, points = ["v1", "v2", "x1", "x2"], grid(100, 0.1)
    errors = []
    for step in (0.02, 0.005):
        with springs(step) as model:
            report = delays_of(model, stop=10.0)
            with model.open_session() as session:
                assert [session.values([n])[n] for n in names] == [1.0, 0.0, 0.0, 1.0]
                record = session.advance(10.0, signals={}, record=names, points=points)
        found = left_limits(record, points, names)
        true = {n: np.abs(found[n] - row).max() for n, row in zip(names, springs_truth(points), strict=True)}
        for output in report.outputs:
            assert 1.0 / 3.0 < output.error / true[output.name] < 3.0
            assert output.order == pytest.approx(1.0, abs=0.2)
        errors.append(np.array([o.error for o in report.outputs]))
        assert any("Euler" in line for line in report.lines())
    assert np.log2(errors[0] / errors[1]) / 2.0 == pytest.approx(1.0, abs=0.2)


@needs_gemseo
def test_components_without_saved_states_take_fixed_steps_and_replay() -> None:
    with springs(None) as model:
        assert "state" in model.why_fixed_step()
        assert model.snapshot_method() == "replay"
        with model.open_session(step=0.01) as session:
            session.advance(0.5, signals={})
            saved = session.snapshot()
            first = session.advance(1.0, signals={}, record=["x1"])
            session.restore(saved)
            assert session.time == 0.5
            second = session.advance(1.0, signals={}, record=["x1"])
    assert np.array_equal(first.values["x1"], second.values["x1"])


# -- sampled components -------------------------------------------------------------------------


def flight(interface: str, version: str = "", order: str = "auto") -> DescribedModel:
    return connect(
        {
            "law": fmu("law", f"fmu:ElevatorLaw{version}", interface),
            "plant": control.tf([1.0], [0.1, 1.0, 0.0]),
            "e": difference("e", 1.0, -0.5),
        },
        [("e.y", "law.side_stick"), ("law.elevator", "plant.u", {"offset": -2.0}), ("plant.y", "e.u2")],
        inputs={"r": "e.u1"},
        outputs={"y": "plant.y", "elevator": "law.elevator"},
        tolerance=1e-9,
        order=order,
    )


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("version", ["", "@3"])
def test_a_sampled_controller_is_as_exact_as_in_one_equation(version: str, order: str) -> None:
    signals: Mapping[str, Signal] = {"r": Sine(frequency=0.5, amplitude=0.5)}
    points = grid(59, 0.022, 0.01)  # off the instants
    found = []
    for model in (flight("me"), flight("cs", version, order=order)):
        with model, model.open_session(step=0.05, signals=signals) as session:
            record = session.advance(points[-1], signals=signals, record=["y", "elevator"], points=points)
            found.append(left_limits(record, points, ["y", "elevator"]))
    for name in found[0]:
        assert found[1][name] == pytest.approx(found[0][name], abs=1e-7)


def test_the_report_knows_the_instants() -> None:
    with mastered(flight("cs")) as model:
        report = delays_of(model, stop=0.5, inputs={"r": Constant(0.2)}, frequency=1.0)
    assert report.periods == pytest.approx({"law": 0.022})
    assert [c.mean_s for c in report.connections] == [0.0, 0.0]
    assert [c.phase_lost_deg for c in report.connections] == [0.0, 0.0]
    assert report.to_dict()["periods"] == report.periods
    assert all("\n" not in line for line in report.lines())


def test_instants_of_two_rates_are_one_pattern() -> None:
    times = sorted({round(0.1 * k, 9) for k in range(60)} | {round(0.15 * k, 9) for k in range(40)})
    found = repeating(times)
    assert found is not None
    tenths = [(Fraction(3, 10), Fraction(k, 20)) for k in (0, 2, 3, 4)]
    assert [(s.period, s.offset) for s in found.samplers] == tenths
    assert repeating([0.0, 0.1, 0.25, 0.3, 0.47]) is None


def test_instants_that_are_added_up_are_the_pattern_that_was_meant() -> None:
    times = [0.03]
    while len(times) < 200:
        times.append(times[-1] + 0.1)
    found = repeating(times)
    assert found is not None
    assert times[-1] != found.samplers[0].instant(199)
    assert found.samplers == (Sampler(Fraction(1, 10), Fraction(3, 100)),)


# -- the step -----------------------------------------------------------------------------------


def test_the_step_is_controlled_where_states_can_be_saved() -> None:
    loose, tight = (error_of(lags(tolerance=tolerance)) for tolerance in (1e-5, 1e-8))
    assert loose < 5e-3
    assert tight < 0.1 * loose
    with lags() as model:
        assert model.why_fixed_step() == ""
        assert any("step doubling" in note for note in model.notes)
    with lags(step=0.1) as model:
        assert "0.1 s is given" in model.why_fixed_step()


def test_richardson_finds_order_and_error() -> None:
    t = np.linspace(0.0, 1.0, 11)
    runs = [np.sin(t) + 0.3 * h**2 * np.cos(t) for h in (1.0, 0.5, 0.25)]
    found = halving("y", *runs)
    assert found.order == pytest.approx(2.0)
    assert found.error == pytest.approx(0.3)
    uneven = halving("y", t, t + 0.1, t + 0.3)
    assert uneven.order is None
    assert uneven.error == pytest.approx(0.2)


# -- what a session must do ---------------------------------------------------------------------


@pytest.mark.parametrize("step", [None, 0.05])
@pytest.mark.parametrize("version", ["", "@3"])
def test_snapshots_bring_back_the_last_bit(step: float | None, version: str) -> None:
    with lags("me", version=version, step=step) as model:
        assert model.snapshot_method() == "state"
        with model.open_session(signals=REFERENCE) as session:
            session.advance(1.0, signals=REFERENCE)
            saved, runs = session.snapshot(), []
            for _ in range(2):
                session.restore(saved)
                assert session.time == 1.0
                runs.append(session.advance(2.0, signals=REFERENCE, record=["y", "a", "e.y"]))
    assert np.array_equal(runs[0].time, runs[1].time)
    for name in runs[0].values:
        assert np.array_equal(runs[0].values[name], runs[1].values[name])


def test_every_communication_point_is_two_rows_and_parts_are_the_whole() -> None:
    with lags(step=0.1) as model:
        with model.open_session(signals=REFERENCE) as session:
            whole = session.advance(1.0, signals=REFERENCE, record=["y"])
        with model.open_session(signals=REFERENCE) as session:
            first = session.advance(0.5, signals=REFERENCE, record=["y"])
            second = session.advance(1.0, signals=REFERENCE, record=["y"])
    inner = whole.time[1:-1].reshape(-1, 2)
    assert np.array_equal(inner[:, 0], inner[:, 1])
    assert inner[:, 0] == pytest.approx(np.arange(1, 10) * 0.1)
    assert np.array_equal(np.concatenate([first.values["y"], second.values["y"]]), whole.values["y"])


def test_a_connection_closes_on_time() -> None:
    with connect(
        {"p": fmu("p", "fmu:FirstOrderLag"), "g": -4.0},
        [("p.y", "g.u"), ("g.y", "p.u", {"closes_at": 1.003})],
        outputs={"y": "p.y"},
        start_values={"p.x": 1.0},
        step=0.01,
    ) as model:
        result = simulate(model, stop=2.0, outputs=["y", "p.u"], interval=0.1, verify_step=False)
    t = result.time
    truth = np.where(t <= 1.003, np.exp(-t), np.exp(-1.003) * np.exp(-5.0 * (t - 1.003)))
    assert result.signals["y"] == pytest.approx(truth, abs=3e-4)
    assert result.signals["p.u"][t < 1.0] == pytest.approx(0.0)


@needs_gemseo
def test_an_error_names_component_and_time() -> None:
    with (
        connect(
            {"a": fmu("a", str(gemseo_fmu("Mass_Damper")))}, inputs={"f": "a.f"}, outputs={"y": "a.y"}, step=1.0
        ) as model,
        model.open_session() as session,
        pytest.raises(SimulationError, match=r"a[. ]") as caught,
    ):
        session.advance(1000.0, signals={}, record=["y"])
    assert caught.value.time is not None


def test_an_unknown_order_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean jacobi"):
        lags(order="jacoby")


def test_a_recipe_makes_the_same_system_again() -> None:
    with lags(step=0.1, order="jacobi") as model:
        recipe = pickle.loads(pickle.dumps(model.recipe))  # noqa: S301 - our own
        with recipe.open() as again:
            assert mastered(again).order == "jacobi"
            assert error_of(again) == error_of(lags(step=0.1, order="jacobi"))


def test_a_system_file_says_who_is_stepped(tmp_path: Path) -> None:
    path = tmp_path / "loop.toml"
    path.write_text(
        """
[components]
a = {model = "fmu:FirstOrderLag", interface = "cs"}
b = "fmu:FirstOrderLag"
[connections]
"b.u" = "a.y"
"a.u" = {from = "b.y", gain = -1.0}
[outputs]
y = "b.y"
[experiment]
stop = 1.0
step = 0.05
"""
    )
    with load(path) as model:
        assert mastered(model).interface == "cs"
        assert any("master: gauss-seidel" in note for note in model.notes)
        assert "0.05 s is given" in mastered(model).why_fixed_step()


def test_clocks_of_a_description_are_instants() -> None:
    """Also those that count: one third of a second, which no decimal is."""
    ticking = partial(ClockVariable, causality=Word("input"))
    constant, fixed, triggered = Word("constant"), Word("fixed"), Word("triggered")
    declared = [
        ticking(name="a", interval_variability=constant, interval_decimal=0.02),
        ticking(name="b", interval_variability=constant, interval_decimal=0.04, shift_decimal=0.01),
        ticking(name="c", interval_variability=triggered),
        ticking(name="d", interval_variability=fixed, interval_counter=1, shift_counter=2, resolution=3),
    ]
    assert periodic(clocks_of(declared, {})) == (
        Sampler(Fraction(1, 50)), Sampler(Fraction(1, 25), Fraction(1, 100)), Sampler(Fraction(1, 3), Fraction(2, 3))
    )  # fmt: skip


def test_a_components_own_step_is_kept() -> None:
    slow = FmuComponent(name="a", file="fmu:FirstOrderLag", interface="cs", step=0.03)
    with (
        connect({"a": slow}, inputs={"u": "a.u"}, outputs={"y": "a.y"}, step=0.1) as model,
        model.open_session() as session,
    ):
        record = session.advance(0.1, signals={"u": Constant(1.0)}, record=["y"])
    assert np.unique(record.time) == pytest.approx([0.0, 0.03, 0.06, 0.09, 0.1])
    assert record.values["y"][-1] == pytest.approx(-math.expm1(-0.1), abs=1e-6)
