"""Connected model exchange systems: one ODE, held against closed forms, with both drivers."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.drivers import DRIVERS, driven_by
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.system_models import LAG, difference, loop_of_two_saturations, run, unity_feedback
from workbench.errors import InputError, SimulationError
from workbench.fmi.bundled import bundled_path, bundled_systems, name_of_bundled
from workbench.fmi.variable import Variable
from workbench.jobs.options import Workers
from workbench.model import Model
from workbench.model.load import load
from workbench.point.lin.request import lin, lin_over
from workbench.point.trim.request import trim
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.session.fmu import FmuSession
from workbench.signals.kinds import Constant, Sine, Step
from workbench.study.fingerprint import Hashes
from workbench.system.connect import connect
from workbench.system.files.read import read_system
from workbench.system.load import load as load_any

both = pytest.mark.parametrize("driver", DRIVERS, indirect=True)

SPRINGS = ("MassSpringSubSystem1", "MassSpringSubSystem2")


@needs_gemseo
@both
def test_two_mass_spring_subsystems_are_the_whole(driver: str) -> None:
    names = ["x1", "x2", "v1", "v2"]
    first, second = (str(gemseo_fmu(name)) for name in SPRINGS)
    with (
        connect(
            {"a": first, "b": second},
            [("a.x1", "b.x1"), ("b.x2", "a.x2")],
            outputs={"x1": "a.x1", "x2": "b.x2", "v1": "a.v1", "v2": "b.v2"},
            tolerance=1e-10,
        ) as system,
        load(gemseo_fmu("MassSpringSystem"), tolerance=1e-10) as whole,
    ):
        parts, one = (run(m, 10.0, {}, names) for m in (system, whole))
        assert [s.name for s in system.states] == [f"{c}.{s.name}" for c, m in _opened(system) for s in m]
    assert max(np.abs(parts.values[n] - one.values[n]).max() for n in names) < 1e-7


def _opened(system: Model) -> list[tuple[str, tuple[Variable, ...]]]:
    found = []
    for name, fmu in zip("ab", SPRINGS, strict=True):
        with load(gemseo_fmu(fmu)) as model:
            found.append((name, model.states))
    return found


@both
def test_feedback_follows_the_closed_form(driver: str) -> None:
    with unity_feedback(LAG, gain=4.0) as model:
        record = run(model, 2.0, {"r": Step(time=0.5, value=1.0)}, ["y", "u", "p.u"])
        found = lin(model)
    since = np.maximum(record.time - 0.5, 0.0)
    assert record.values["y"] == pytest.approx(0.8 * -np.expm1(-5.0 * since), abs=1e-8)
    assert np.array_equal(record.values["u"], record.values["p.u"])
    assert pytest.approx(np.array([[-5.0]])) == found.A
    assert pytest.approx(np.array([[4.0]])) == found.B
    assert pytest.approx(np.array([[1.0], [-4.0]])) == found.C
    assert pytest.approx(np.array([[0.0], [4.0]])) == found.D


@both
def test_fmus_of_both_versions_are_trimmed_linearised_and_measured(driver: str) -> None:
    with connect(
        {"a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag@3"},
        [("a.y", "b.u", {"gain": -0.5})],
        inputs={"u": "a.u"},
        outputs={"y": "b.y"},
        start_values={"b.tau": 2.0},
    ) as model:
        point = trim(model, fix={"u": 2.0}).operating_point
        assert point.x == pytest.approx({"a.x": 2.0, "b.x": -1.0})
        assert pytest.approx(np.array([[-1.0, 0.0], [-0.25, -0.5]])) == lin(model).A
        measured = nfr(model, "u", "y", [0.1], [1.0], workers=Workers(in_process=True))
        assert model.snapshot_method() == "state"
        assert simulate(model, stop=1.0, outputs=["a.x"]).time[-1] == 1.0
    omega = 0.2 * np.pi
    assert measured.gain[0, 0] == pytest.approx(0.5 / abs((1 + 1j * omega) * (1 + 2j * omega)), rel=1e-3)


@both
def test_one_input_drives_two_components(driver: str) -> None:
    with connect(
        {"a": "fmu:FirstOrderLag", "b": LAG, "s": difference("s", 1.0, -1.0)},
        [("a.y", "s.u1"), ("b.y", "s.u2")],
        inputs={"u": ["a.u", "b.u"]},
        outputs={"y": "s.y"},
    ) as model:
        record = run(model, 2.0, {"u": Sine(frequency=1.0)}, ["y", "a.y", "a.u", "b.u"])
    assert np.abs(record.values["a.y"]).max() > 0.1
    assert record.values["y"] == pytest.approx(0.0, abs=1e-5)
    assert np.array_equal(record.values["a.u"], record.inputs["u"])
    assert np.array_equal(record.values["b.u"], record.inputs["u"])


@both
def test_a_connection_closes_at_its_time(driver: str) -> None:
    with connect(
        {"p": LAG, "g": -4.0},
        [("p.y", "g.u"), ("g.y", "p.u", {"closes_at": 1.0})],
        outputs={"y": "p.y"},
        start_values={"p.x": 1.0},
        tolerance=1e-9,
    ) as model:
        record = run(model, 2.0, {}, ["y", "p.u"])
        with model.open_session(start_time=1.5) as late:
            assert late.values(["p.u"])["p.u"] == pytest.approx(-4.0)
    t = record.time
    truth = np.where(t <= 1.0, np.exp(-t), np.exp(-1.0) * np.exp(-5.0 * (t - 1.0)))
    assert record.values["y"] == pytest.approx(truth, abs=1e-8)
    assert record.values["p.u"][t == 1.0] == pytest.approx([0.0, -4.0 * np.exp(-1.0)])


@both
def test_a_sampled_block_holds_its_output(driver: str) -> None:
    block = control.ss([[0.5]], [[1.0]], [[1.0]], [[2.0]], 0.1)
    with connect({"d": block}, inputs={"u": "d.u"}, outputs={"y": "d.y"}) as model:
        record = run(model, 1.0, {"u": Constant(1.0)}, ["y"], rows=7)
        found = lin(model)
    _, truth = control.forced_response(block, np.arange(10) * 0.1, np.ones(10))
    ticks = np.arange(10) * 0.1
    held = truth[np.searchsorted(ticks, record.time + 1e-9, side="right") - 1]
    right = np.append(np.diff(record.time) > 0.0, False)  # rows that are no left limits
    assert record.values["y"][right] == pytest.approx(held[right], abs=1e-12)
    assert (found.A, found.B, found.C, found.D) == (0.5, 1.0, 1.0, 2.0)
    assert found.dt == pytest.approx(0.1)


@both
def test_snapshots_bring_a_system_back_to_the_last_bit(driver: str) -> None:
    signals = {"r": Sine(frequency=0.5, amplitude=6.0)}
    points = np.linspace(1.1, 2.0, 10)
    with loop_of_two_saturations() as model, model.open_session() as session:
        assert model.snapshot_method() == "state"
        session.advance(1.0, signals=signals)
        saved = session.snapshot()
        runs = []
        for _ in range(2):
            session.restore(saved)
            runs.append(session.advance(2.0, signals=signals, record=["y"], points=points).values["y"])
    assert np.array_equal(runs[0], runs[1])


def test_both_drivers_find_the_same_events_inside_a_loop() -> None:
    signals = {"r": Sine(frequency=0.5, amplitude=6.0)}
    records = []
    for name in DRIVERS:
        with driven_by(name), loop_of_two_saturations() as model:
            records.append(run(model, 2.0, signals, ["y", "z", "s.u", "g.u"]))
    a, b = records
    assert a.time == pytest.approx(b.time, abs=1e-9)
    assert np.count_nonzero(np.diff(a.time) == 0.0) >= 4
    for record in records:
        v = record.values
        assert v["s.u"] == pytest.approx(6.0 * np.sin(np.pi * record.time) - 2.0 * v["z"], abs=1e-11)
        assert v["g.u"] == pytest.approx(1.5 * v["y"], abs=1e-11)
        assert np.abs(v["y"]).max() <= 1.0 + 1e-9
    assert a.values["y"] == pytest.approx(b.values["y"], abs=1e-9)


@both
def test_a_linear_loop_is_solved_and_linearised_exactly(driver: str) -> None:
    with connect(
        {"e": difference("e", 1.0, -1.0), "k": 4.0, "p": LAG},
        [("e.y", "k.u"), ("k.y", "e.u2"), ("k.y", "p.u")],
        inputs={"r": "e.u1"},
        outputs={"y": "k.y", "x": "p.y"},
    ) as model:
        assert any("algebraic loop" in note for note in model.notes)
        record = run(model, 1.0, {"r": Sine(frequency=1.0)}, ["y"])
        exact = lin(model, method="exact")
        differences = lin(model, method="difference")
    assert record.values["y"] == pytest.approx(0.8 * np.sin(2.0 * np.pi * record.time), abs=1e-15)
    for found in (exact, differences):
        assert pytest.approx(np.array([[0.8]])) == found.B
        assert pytest.approx(np.array([[0.8], [0.0]])) == found.D


@both
def test_a_python_function_inside_a_loop(driver: str) -> None:
    with connect(
        {"e": difference("e", 1.0, -3.0), "f": np.tanh, "p": LAG},
        [("e.y", "f.u"), ("f.y", "e.u2"), ("f.y", "p.u")],
        inputs={"r": "e.u1"},
        outputs={"y": "f.y"},
    ) as model:
        record = run(model, 1.0, {"r": Sine(frequency=1.0, amplitude=5.0)}, ["y"])
        response = nfr(model, "r", "y", [1.0], [1e-3])  # in this process: the function cannot be sent
    y = record.values["y"]
    assert y == pytest.approx(np.tanh(5.0 * np.sin(2.0 * np.pi * record.time) - 3.0 * y), abs=1e-12)
    assert response.gain[0, 0] == pytest.approx(0.25, rel=1e-3)


@both
@pytest.mark.parametrize("solver", ["gear", "vkm"])
def test_a_loop_whose_solution_ends_is_explained(driver: str, solver: str) -> None:
    """y = exp(r + y) has two solutions for r < −1 and none above; r = −1 at t = 0.26198 s."""
    with (
        connect(
            {"e": difference("e", 1.0, 1.0), "f": np.exp, "p": LAG},
            [("e.y", "f.u"), ("f.y", "e.u2"), ("f.y", "p.u")],
            inputs={"r": "e.u1"},
            outputs={"y": "f.y"},
            solver=solver,
        ) as model,
        pytest.raises(SimulationError) as caught,
    ):
        run(model, 2.0, {"r": Sine(offset=-3.0, frequency=0.25, amplitude=5.0)}, ["y"])
    assert "e.y → f.u" in str(caught.value)
    assert "residual" in str(caught.value)
    assert caught.value.time == pytest.approx(np.arcsin(0.4) / (0.5 * np.pi), abs=1e-3)


@both
def test_a_loop_gain_of_one_is_explained(driver: str) -> None:
    with (
        connect(
            {"e": difference("e", 1.0, 1.0), "k": 1.0},
            [("e.y", "k.u"), ("k.y", "e.u2")],
            inputs={"r": "e.u1"},
            outputs={"y": "k.y"},
        ) as model,
        pytest.raises(SimulationError, match=r"no solution was found .* e.y → k.u, k.y → e.u2"),
    ):
        run(model, 1.0, {"r": Sine(frequency=1.0)}, ["y"])


@both
def test_an_error_in_a_python_function_is_told(driver: str) -> None:
    def broken(u: np.ndarray) -> np.ndarray:
        if u[0] > 0.5:
            raise ValueError("too much")
        return u

    with (
        connect({"a": LAG, "f": broken}, [("a.y", "f.u")], ["a.u"], {"y": "f.y"}) as model,
        pytest.raises(SimulationError, match="f: the function raised ValueError: too much"),
    ):
        run(model, 3.0, {"a.u": Constant(1.0)}, ["y"])


def test_workers_measure_a_system_as_this_process_does() -> None:
    gains = []
    for workers in (Workers(jobs=2), Workers(in_process=True)):
        with unity_feedback("fmu:FirstOrderLag", gain=4.0, tolerance=1e-6) as model:
            gains.append(nfr(model, "r", "y", [0.5], [1.0], workers=workers).gain)
    assert np.array_equal(gains[0], gains[1])
    assert gains[0][0, 0] == pytest.approx(4.0 / abs(5.0 + 1j * np.pi), rel=1e-3)


def test_a_packed_recipe_needs_no_file() -> None:
    with unity_feedback("fmu:FirstOrderLag", gain=4.0) as model:
        packed, identity = model.recipe.packed(), model.recipe.identity()
    with packed.open() as again:
        assert pytest.approx(np.array([[-5.0]])) == lin(again).A
        assert again.recipe is not None
        assert again.recipe.identity() == identity
        assert identity != again.recipe.tighter(0.1).identity()


@pytest.mark.parametrize(
    ("components", "connections", "words"),
    [
        ({"a": "fmu:Rudderr"}, [], "component a: fmu:Rudderr: no bundled FMU of that name; did you mean Rudder"),
        ({"a": [1]}, [], "component a: list is not a component"),
        ({"a": float("nan")}, [], "component a: a gain must be a finite number"),
        (
            {"a": control.tf([1.0], [1.0, 1.0], True)},
            [],
            "component a: the StateSpace is discrete",
        ),
        ({"a": 1.0, "b": 2.0}, [("a.y", "b.u", {"gian": 2.0})], "'gian' is not an option; did you mean gain"),
        ({"a": 1.0, "b": 2.0}, [("a.y",)], r"give pairs \(source, destination\)"),
        ({"a": 1.0, "b": 2.0}, [("a.yy", "b.u")], "a.yy → b.u"),
        ({"a": 1.0, "b": 2.0}, [("a.y", "b.u"), ("b.y", "b.u")], "b.u has two sources"),
    ],
)
def test_bad_systems_are_refused_in_one_line(components: object, connections: object, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        connect(components, connections)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_wrong_names_in_a_system_are_refused() -> None:
    with pytest.raises(InputError, match=r"did you mean a\.tau"):
        connect({"a": "fmu:FirstOrderLag"}, start_values={"a.tua": 1.0})
    with pytest.raises(InputError, match="order is for systems with co-simulation components"):
        connect({"a": "fmu:FirstOrderLag"}, order="jacobi")


@both
def test_systems_are_connected_further(driver: str) -> None:
    with unity_feedback("fmu:FirstOrderLag", gain=4.0) as inner:
        outer = connect(
            {"in": inner, "k": 2.0, "e": difference("e", 1.0, -1.0)},
            [("e.y", "in.r"), ("in.y", "k.u"), ("k.y", "e.u2")],
            inputs={"r": "e.u1"},
            outputs={"y": "in.y", "u": "in.k.y"},
            start_values={"in.p.tau": 2.0},
        )
    with outer:
        assert [s.name for s in outer.states] == ["in.p.x"]
        assert pytest.approx(np.array([[-6.5]])) == lin(outer).A


def test_a_biased_model_cannot_be_connected() -> None:
    with load("fmu:FirstOrderLag", bias={"u": 1.0}) as model, pytest.raises(InputError, match="give the bias to the"):
        connect({"a": model})


def test_load_opens_system_files(tmp_path: Path) -> None:
    file = tmp_path / "two.toml"
    file.write_text(
        '[components]\na = "fmu:FirstOrderLag"\nb = {model = "fmu:FirstOrderLag", set = {tau = 2.0}}\n'
        '[connections]\n"b.u" = {from = "a.y", gain = -1.0}\n'
        '[inputs]\nu = "a.u"\n[outputs]\ny = "b.y"\n'
    )
    with load_any(file, start_values={"a.tau": 0.5}) as model:
        assert model.name == "two"
        assert pytest.approx(np.array([[-2.0, 0.0], [-0.5, -0.5]])) == lin(model).A
        grid = lin_over(model, {"b.tau": [1.0, 4.0]})
    assert [p.result.A[1, 1] for p in grid.points if p.result is not None] == pytest.approx([-1.0, -0.25])
    with load_any("fmu:FirstOrderLag") as model:
        assert model.name == "FirstOrderLag"
    with pytest.raises(InputError, match="hold_inputs"):
        load_any(file, hold_inputs=True)
    with load_any(file, interface="cs") as model:
        assert model.interface == "cs"


@pytest.mark.parametrize("name", bundled_systems())
def test_bundled_systems_are_opened_by_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert read_system(f"system:{name}").name == name
    (tmp_path / "around.toml").write_text(f'[components]\ninner = "system:{name}"\n')
    around = read_system("around.toml")
    assert {f"inner.{c.name}" for c in read_system(f"system:{name}").components} == {c.name for c in around.components}
    # A study measures again where the system or one of its FMUs is another.
    hashes = Hashes(tmp_path)
    has_fmus = name not in ("pitch_rate_limit", "pilot_in_the_loop")  # which are blocks alone
    assert bool(hashes.of_model(f"system:{name}").keys() & {"fmu:Aircraft", "fmu:Rudder"}) == has_fmus
    assert f"system:{name}" in hashes.of_model(f"system:{name}")
    assert hashes.of_word(f"--of=system:{name}") == hashes.of_model(f"system:{name}")
    assert hashes.of_word("system:none") == {}


def test_a_misspelt_bundled_system_is_told_the_near_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"system:failed_aleron: no bundled system .* did you mean failed_aileron,"):
        load_any("system:failed_aleron")
    with pytest.raises(InputError, match=r"system:x: no bundled system of that name; known: failed_aileron,"):
        load_any("system:x")
    (tmp_path / "around.toml").write_text('[components]\ninner = "system:failed_aleron"\n')
    with pytest.raises(InputError, match=r"\[components\] inner: system:failed_aleron: .* did you mean"):
        load_any(tmp_path / "around.toml")


def test_what_is_bundled_is_told_by_its_name(tmp_path: Path) -> None:
    for name in ("fmu:Rudder", "fmu:Rudder@3", "system:failed_aileron"):
        assert name_of_bundled(bundled_path(name)) == name
        # A file of the same name in such a folder of the user is not the bundled one.
        assert not name_of_bundled(tmp_path / bundled_path(name).parent.name / bundled_path(name).name)


def test_a_chain_of_many_is_read_in_levels_and_shares_its_binary() -> None:
    n = 40
    with connect(
        {f"c{i}": "fmu:FirstOrderLag" for i in range(n)},
        [(f"c{i}.y", f"c{i + 1}.u") for i in range(n - 1)],
        inputs={"u": "c0.u"},
        outputs={"y": f"c{n - 1}.y"},
    ) as model:
        wiring = model.new_instance().wiring
        assert wiring is not None
        assert len(wiring.continuous) == 1
        found = lin(model).A
    assert np.array_equal(found, -np.eye(n) + np.eye(n, k=-1))


def test_order_of_evaluation_follows_feed_through() -> None:
    gains = {f"k{i}": 1.0 for i in range(4)}
    shuffled = [("k2.y", "k3.u"), ("k0.y", "k1.u"), ("k1.y", "k2.u")]
    with connect(gains, shuffled, ["k0.u"], ["k3.y"]) as model:
        wiring = model.new_instance().wiring
        assert wiring is not None
        assert [g.members for g in wiring.continuous] == [(1,), (2,), (0,)]
        assert not wiring.loops()


def test_a_sampled_law_around_the_rudder_is_linearised_as_it_is_measured() -> None:
    """Kalman-Bertram over one period of the law against the measured response, to 2 Hz (Nyquist is 22.7 Hz)."""
    with connect(
        {"law": "fmu:ElevatorLaw", "r": "fmu:Rudder", "e": difference("e", 1.0, -0.02)},
        [("e.y", "law.side_stick"), ("law.elevator", "r.delC"), ("r.del", "e.u2", {"convert": False})],
        inputs={"cmd": "e.u1"},
        outputs={"del": "r.del"},
        tolerance=1e-8,
    ) as model:
        point = trim(model, fix={"cmd": 0.0}).operating_point
        found = lin(model, at=point)
        frequencies = [0.5, 2.0]
        measured = nfr(model, "cmd", "del", frequencies, [1e-3], workers=Workers(in_process=True))
    assert found.dt == pytest.approx(0.022)
    for k, frequency in enumerate(frequencies):
        z = np.exp(2j * np.pi * frequency * found.dt)
        response = (found.C @ np.linalg.solve(z * np.eye(len(found.A)) - found.A, found.B) + found.D)[0, 0]
        assert measured.gain[0, k] == pytest.approx(abs(response), rel=1e-3)
        assert measured.phase_deg[0, k] == pytest.approx(np.degrees(np.angle(response)), abs=0.1)


def _with_a_second_name(folder: Path) -> str:
    """Return a bundled FMU of FMI 3.0 whose input has an alias."""
    target = folder / "Aliased.fmu"
    with ZipFile(bundled_path("fmu:DeadBand@3")) as source, ZipFile(target, "w") as made:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                plain = b'causality="input" variability="continuous" unit="1" start="0.0" />'
                assert content.count(plain) == 1
                content = content.replace(plain, plain[:-3] + b'><Alias name="again" /></Float64>')
            made.writestr(name, content)
    return str(target)


@pytest.mark.parametrize("port", ["u", "again"])
def test_a_loop_through_a_dead_band_that_is_left_for_the_first_time(tmp_path: Path, port: str) -> None:
    """All that comes out of the band has been 0 until then: what is left of its equation is the rounding of its input.

    u = 2 (r − 3 y), where v = Cx + Du and y is what of v is outside ±0.25: solved by cases, integrated by SciPy. The
    input goes by an alias as well: its feed-through is declared for the other name.
    """
    A, B, C, D = np.array([[-0.51, -0.42], [0.5, 0.0]]), np.array([1.0, 0.0]), np.array([0.6407, 0.6794]), 0.43

    def answer(t: float, x: np.ndarray) -> tuple[float, float]:
        free = C @ x + 2.0 * D * 3.0 * np.sin(2.0 * np.pi * 0.3 * t)  # v where y = 0
        y = np.sign(free) * max(abs(free) - 0.25, 0.0) / (1.0 + 6.0 * D)
        return 6.0 * np.sin(2.0 * np.pi * 0.3 * t) - 6.0 * y, y

    times = np.linspace(0.05, 5.0, 100)
    exact = solve_ivp(
        lambda t, x: A @ x + B * answer(t, x)[0], (0.0, 5.0), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-12,
        max_step=0.01,
    )  # fmt: skip
    truth = np.array([answer(t, x)[1] for t, x in zip(times, exact.y.T, strict=True)])
    parts = {"e": difference("e", 1.0, -1.0), "g": 2.0, "band": _with_a_second_name(tmp_path), "h": 3.0}
    wires = [("e.y", "g.u"), ("g.y", f"band.{port}"), ("band.y", "h.u"), ("h.y", "e.u2")]
    with connect(parts, wires, inputs={"r": "e.u1"}, outputs=["band.y"], tolerance=1e-9) as model:
        assert not any("not connected" in note for note in model.notes)
        found = simulate(model, stop=5.0, points=times, inputs={"r": Sine(amplitude=3.0, frequency=0.3)})
    np.testing.assert_allclose(np.interp(times, found.time, found.signals["band.y"]), truth, atol=1e-6)


def test_inner_outputs_and_inputs_depend_on_what_reaches_them_through_the_connections() -> None:
    """y = 1/(s + 1), a lag without feed-through, so y depends on its state alone and all before it on r as well."""
    with unity_feedback(LAG, gain=2.0) as model:
        depends = {v.name: set(v.dependencies) for v in model.description.variables if v.dependencies is not None}
        with model.open_session() as session:
            assert isinstance(session, FmuSession)
            fed = {v.name for v in model.description.variables if session.instance.fed(v)}
    assert depends["p.y"] == depends["e.u2"] == depends["y"] == {"p.x"}
    assert depends["e.y"] == depends["k.u"] == depends["k.y"] == depends["p.u"] == {"r", "p.x"}
    assert depends["e.u1"] == {"r"}
    assert fed == {"e.u2", "k.u", "p.u"}
