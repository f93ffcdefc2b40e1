"""Sessions at an operating point: FMUs whose initialisation overrides start values, and what does not take is told."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from tests.drivers import each_driver  # noqa: F401
from tests.fmi1_fmus import build_fmi1
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.lin_fmus import built
from tests.mimic_fmus import build_mimic
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.variable import Value
from workbench.model.described_model import DescribedModel
from workbench.model.load import load
from workbench.point.lin.request import lin
from workbench.point.lin.step_check import step_check
from workbench.point.trim.request import trim
from workbench.response.simulate.request import simulate
from workbench.session.start_values import NotReachedError
from workbench.signals.kinds import Constant
from workbench.system.connect import connect

SOURCES = Path(__file__).parent / "modelica"
K, D = 100.0, 4.0  # of Overridden


@cache
def file(name: str, fmi: int = 2) -> str:
    return built((SOURCES / f"{name}.mo").read_text(encoding="utf-8"), name, fmi)


def overridden(interface: str, fmi: int = 2, *, starts: Mapping[str, Value] | None = None) -> DescribedModel:
    return load(file("Overridden", fmi), interface, tolerance=1e-10, start_values=starts or {})


def exact(s: float, v: float, force: float, t: float) -> Floats:
    """Return position and velocity of the mass after t under a constant force."""
    rest = np.array([force / K, 0.0])
    moved = expm(t * np.array([[0.0, 1.0], [-K, -D]])) @ (np.array([s, v]) - rest)
    return np.asarray(moved + rest)


both_versions = pytest.mark.parametrize("fmi", [2, 3])
both_interfaces = pytest.mark.parametrize("interface", ["me", "cs"])


# -- model exchange -------------------------------------------------------------------------


@both_versions
def test_states_and_inputs_of_a_point_hold_whatever_initial_equations_say(fmi: int) -> None:
    point = {"s": 0.3, "v": -2.0, "f": 20.0, "locked": 1.0}
    with overridden("me", fmi) as model, model.open_at(values=point) as session:
        assert session.values([*point]) == point
        session.advance(0.4, signals={})
        assert list(session.values(["s", "v"]).values()) == pytest.approx(exact(0.3, -2.0, 30.0, 0.4), abs=1e-8)


@both_versions
def test_relations_are_those_of_the_point(fmi: int) -> None:
    with overridden("me", fmi) as model, model.open_at(values={"s": 0.7}) as session:
        assert session.values(["level"]) == {"level": 1.0}


def test_what_a_point_does_not_name_starts_as_the_model_starts_it() -> None:
    with overridden("me") as model, model.open_at(values={"v": 3.0}) as session:
        assert session.values(["s", "v", "f"]) == {"s": 0.5, "v": 3.0, "f": 0.0}


@pytest.mark.parametrize("method", ["state", "replay"])
def test_a_restored_session_stands_at_the_point_again(method: str) -> None:
    with overridden("me") as model:
        model._why_replay = "" if method == "state" else "as told by the test"
        with model.open_at(values={"s": 0.3, "f": 30.0}) as session:
            saved = session.snapshot()
            session.advance(0.5, signals={"f": Constant(-5.0)})
            session.restore(saved)
            assert session.values(["s", "v", "f"]) == {"s": 0.3, "v": 0.0, "f": 30.0}
            session.advance(0.4, signals={})
            assert list(session.values(["s", "v"]).values()) == pytest.approx(exact(0.3, 0.0, 30.0, 0.4), abs=1e-8)


def test_an_event_at_the_point_moves_the_state_as_the_model_says() -> None:
    with load(file("Resetting"), "me") as model, model.open_at(values={"x": 1.25, "u": 1.0}) as session:
        assert session.values(["x"]) == {"x": 0.0}
        session.advance(0.25, signals={})
        assert session.values(["x"])["x"] == pytest.approx(0.25)


def test_memory_that_is_lost_on_the_way_to_a_point_is_refused_by_name() -> None:
    with overridden("me") as model:
        with model.open_at(values={"s": 0.9, "passed": 1.0}) as session:
            assert session.values(["s", "passed"]) == {"s": 0.9, "passed": 1.0}
        with pytest.raises(NotReachedError, match=r"passed is true, not false.*only before initialisation"):
            model.open_at(values={"s": 0.9, "passed": 0.0})


@pytest.fixture(scope="module")
def fmi1(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_fmi1(tmp_path_factory.mktemp("fmi1"), "Overridden", "me")


def test_states_without_names_are_set_too(fmi1: Path) -> None:
    with (
        load(fmi1, tolerance=1e-10) as model,
        model.open_at(values={"state[1]": 0.3, "state[2]": -2.0, "f": 20.0}) as session,
    ):
        assert session.values(["y"]) == {"y": 0.3}
        session.advance(0.4, signals={})
        assert session.values(["y"])["y"] == pytest.approx(exact(0.3, -2.0, 20.0, 0.4)[0], abs=1e-8)


def test_a_linear_model_at_a_point_is_that_of_the_model_there() -> None:
    with overridden("me") as model:
        point = trim(model, u0={"f": 30.0}).operating_point
        assert point.x["s"] == pytest.approx(30.0 / K)
        linear = lin(model, at=point, inputs=["f"], outputs=["y"])
        check = step_check(model, linear.result, input="f", output="y", height=5.0, stop=2.0)
        assert check.error < 1e-6


# -- co-simulation --------------------------------------------------------------------------


@both_versions
def test_co_simulation_is_led_to_an_equilibrium(fmi: int) -> None:
    with overridden("cs", fmi) as model, model.open_at(values={"s": 0.3, "v": 0.0, "f": 30.0}) as session:
        begin = session.time
        assert begin == 0.0
        assert session.values(["s"])["s"] == pytest.approx(0.3, abs=1e-9)
        record = session.advance(begin + 1.0, signals={}, record=["s"], points=begin + np.linspace(0.1, 1.0, 10))
        assert np.ptp(record.values["s"]) < 1e-9
        saved = session.snapshot()
        session.advance(begin + 2.0, signals={"f": Constant(0.0)})
        session.restore(saved)
        assert session.values(["s"])["s"] == pytest.approx(0.3, abs=1e-9)


@both_versions
def test_co_simulation_says_which_point_it_cannot_reach(fmi: int) -> None:
    with (
        overridden("cs", fmi) as model,
        pytest.raises(NotReachedError, match=r"Overridden: .*s is 0\.3\d*, not 0\.7.*use interface me"),
    ):
        model.open_at(values={"s": 0.7, "f": 30.0})


def test_outputs_tell_whether_a_black_box_has_come_to_the_point() -> None:
    with overridden("cs") as model:
        with model.open_at(values={"f": 30.0}, outputs={"y": 0.3}) as session:
            assert session.values(["y"])["y"] == pytest.approx(0.3, abs=1e-9)
        with pytest.raises(NotReachedError, match=r"y is 0\.3\d*, not 0\.4"):
            model.open_at(values={"f": 30.0}, outputs={"y": 0.4})


# -- systems --------------------------------------------------------------------------------


def test_states_of_a_systems_components_are_set() -> None:
    with connect(
        {"a": file("Overridden"), "b": file("Overridden", 3)}, [("a.level", "b.f", {"gain": 50.0})], ["a.f"], ["b.y"]
    ) as model:
        with model.open_at(values={"a.s": 0.7, "b.s": 0.5, "a.f": 70.0}) as session:
            session.advance(0.5, signals={})
            found = session.values(["a.s", "b.s"])
        assert found == pytest.approx({"a.s": 0.7, "b.s": 0.5}, abs=1e-9)


def test_states_of_model_exchange_components_beside_co_simulation_are_set() -> None:
    from workbench.system.description import FmuComponent

    parts = {
        "a": FmuComponent(name="a", file=file("Overridden"), interface="me"),
        "lag": FmuComponent(name="lag", file="fmu:FirstOrderLag", interface="cs"),
    }
    with (
        connect(parts, [("a.level", "lag.u")], ["a.f"], ["lag.y"], step=1e-2) as model,
        model.open_at(values={"a.s": 0.7, "lag.x": 1.0, "a.f": 70.0}) as session,
    ):
        assert session.time == 0.0
        session.advance(0.5, signals={})
        assert session.values(["a.s", "lag.x"]) == pytest.approx({"a.s": 0.7, "lag.x": 1.0}, abs=1e-9)


# -- start values ---------------------------------------------------------------------------


@both_interfaces
def test_parameters_that_the_setup_resets_are_set_again_and_that_is_told(interface: str, tmp_path: Path) -> None:
    with load(build_mimic(tmp_path, "orderly"), interface, start_values={"c": 50.0, "d": 8.0}) as model:
        wanted = simulate(model, stop=0.5)
        assert not any("forgets" in note for note in simulate(model, stop=0.5).notes)
    for name in ("orderly", "forgets"):
        with load(build_mimic(tmp_path, name), interface) as model:
            assert np.max(np.abs(simulate(model, stop=0.5).signals["y"] - wanted.signals["y"])) > 1e-3
    with load(build_mimic(tmp_path, "forgets"), interface, start_values={"c": 50.0, "d": 8.0}) as model:
        for _ in range(2):  # learned once, kept for the next session
            assert np.array_equal(simulate(model, stop=0.5).signals["y"], wanted.signals["y"])
        assert any(
            "forgets parameters that are set before fmi2SetupExperiment" in note
            for note in simulate(model, stop=0.5).notes
        )


@both_interfaces
@both_versions
def test_a_start_value_that_does_not_take_is_refused_by_name(interface: str, fmi: int) -> None:
    with (
        overridden(interface, fmi, starts={"s": 0.9}) as model,
        pytest.raises(
            InputError, match=r"Overridden: the FMU does not accept a start value: s is 0\.5, not 0\.9; .*`at`"
        ),
    ):
        simulate(model, stop=0.1)


@both_interfaces
def test_a_guess_that_comes_out_otherwise_is_noted(interface: str, tmp_path: Path) -> None:
    """As FMI has it, `initial="approx"` is where an FMU begins to search."""
    folder = tmp_path / "unpacked"
    with zipfile.ZipFile(file("Overridden")) as archive:
        archive.extractall(folder)
    description = folder / "modelDescription.xml"
    text = description.read_text(encoding="utf-8")
    description.write_text(re.sub('(name="s" value[^>]*initial=)"exact"', r'\1"approx"', text), encoding="utf-8")
    with load(folder, interface, start_values={"s": 0.9}) as model:
        notes = simulate(model, stop=0.1).notes
    assert "the FMU uses a start value only as a guess (initial approx): s is 0.5, not 0.9" in notes


@both_interfaces
def test_parameters_and_inputs_are_taken(interface: str) -> None:
    with overridden(interface, starts={"k": 50.0, "f": 25.0, "locked": True}) as model, model.open_session() as session:
        assert session.values(["k", "f", "locked"]) == {"k": 50.0, "f": 25.0, "locked": 1.0}


# -- wrong input ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"S": 1.0}, "the model has no variable 'S'; did you mean s?"),
        ({"s": float("nan")}, "s must be a finite number"),
        ({"locked": 0.4}, "locked is of type Boolean and cannot be 0.4"),
    ],
)
def test_a_point_that_is_none_is_refused(values: dict[str, float], words: str) -> None:
    with overridden("me") as model, pytest.raises(InputError) as caught:
        model.open_at(values=values)
    assert words in str(caught.value)


# -- a foreign FMU --------------------------------------------------------------------------


@needs_gemseo
@pytest.mark.parametrize(
    ("interface", "each_driver"), [("me", "compiled"), ("me", "python"), ("cs", "compiled")], indirect=["each_driver"]
)  # a step of the FMU is the FMU's: the oracle in co-simulation is compared on smaller models above
def test_mass_damper_stays_at_its_trim(interface: str) -> None:
    fmu = gemseo_fmu("Mass_Damper")  # s_rel = 1 − f/c − … at rest; y = 0.5 − s_rel
    with load(fmu, "me") as model:
        point = trim(model, u0={"f": 10.0}).operating_point
        assert point.y["y"] == pytest.approx(-0.5 + 10.0 / 1e4)
        if interface == "me":
            linear = lin(model, at=point)
            check = step_check(model, linear.result, input="f", output="y", height=1.0, stop=0.5)
            assert check.error < 1e-6
    with (
        load(fmu, interface, step=1.25e-4 if interface == "cs" else None) as model,
        model.open_at(time=point.time, values={**point.x, **point.u}, outputs=point.y) as session,
    ):
        grid = session.time + np.linspace(0.01, 1.0, 100)
        record = session.advance(grid[-1], signals={}, record=["y"], points=grid)
    assert record.values["y"] == pytest.approx(np.full(len(record.time), -0.499), abs=1e-9)


@needs_gemseo
@pytest.mark.parametrize("each_driver", ["compiled"], indirect=True)
def test_a_step_in_co_simulation_is_that_of_its_own_linear_model() -> None:
    """The export integrates by explicit Euler: z(k+1) = (I + hA) z(k) + hB u, z from the trim, whatever the ODE does.

    So the model that belongs to a run is that of `lin` in co-simulation with the same step, not that of the ODE.
    """
    h, fmu = 1e-3, gemseo_fmu("Mass_Damper")
    with load(fmu, "me") as model:
        point = trim(model, u0={"f": 10.0}).operating_point
    a, b = np.array([[0.0, 1.0], [-1e4, -10.0]]), np.array([0.0, 1.0])
    motion = [np.zeros(2)]
    for _ in range(500):
        motion.append(motion[-1] + h * (a @ motion[-1] + b))
    with load(fmu, "cs", step=h) as model:
        linear = lin(model, at=point, inputs=["f"], outputs=["y"]).result
        found = step_check(model, linear, input="f", output="y", height=1.0, stop=0.5)
    euler = point.y["y"] + np.array(motion)[:, 0]
    assert found.nonlinear == pytest.approx(euler, abs=1e-9 * np.ptp(euler))
    assert linear.dt == h
    assert np.poly(linear.A) == pytest.approx(np.poly(np.eye(2) + h * a), rel=1e-6)
    assert found.error < 1e-6


@needs_gemseo
@both_interfaces
def test_mass_damper_refuses_start_values_that_it_overrides(interface: str) -> None:
    with (
        load(gemseo_fmu("Mass_Damper"), interface, start_values={"damper.s_rel": 0.999}) as model,
        pytest.raises(InputError, match=r"damper\.s_rel is 0\.5, not 0\.999"),
    ):
        simulate(model, stop=0.1)
