"""FMUs built from Modelica: valid, equal to the oracle and to closed forms, exact slopes, exact rollback.

Built once for this machine only; the cross-compiled ones are checked against the committed FMUs.
"""

from __future__ import annotations

import platform
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from rumoca import Session as FrontEnd
from rumoca import SimConfig
from scipy.linalg import expm

from workbench.build.fmu import build_all, build_fmu, generate
from workbench.errors import SimulationError
from workbench.fmi.instance import Instance
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Constant, Sine

HERE = Path(__file__).parent
MODELS = {
    "Hybrid": HERE / "modelica" / "Hybrid.mo",
    "Cubic": HERE / "modelica" / "Cubic.mo",
    "Arrays.StateSpace": HERE / "modelica" / "Arrays.mo",
    "Arrays.Elementary": HERE / "modelica" / "Arrays.mo",
}
INPUT = 0.5
# Points that no event falls on: there left and right limit differ and either is right.
GRID = np.arange(0.0137, 2.0, 0.0137)

_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
_MACHINES = {"x86_64": "x86_64", "AMD64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
HOST = f"{_MACHINES[platform.machine()]}-{_SYSTEMS[sys.platform]}"


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmus")
    build_all(sorted(set(MODELS.values())), out=folder, platforms=[HOST])
    return folder


def file_of(folder: Path, model: str, fmi: int) -> Path:
    return folder / f"fmi{fmi}" / f"{model.replace('.', '_')}.fmu"


def run(file: Path, interface: str, names: list[str], *, tolerance: float = 1e-10) -> SimulationResult:
    solver = "vkm" if interface == "me" else "auto"
    with load(file, interface=interface, solver=solver, tolerance=tolerance) as model:
        return simulate(
            model,
            stop=float(GRID[-1]),
            inputs={"u": Constant(INPUT)},
            outputs=names,
            points=GRID,
            verify_step=False,
        )


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", MODELS)
def test_fmus_are_valid(fmus: Path, model: str, fmi: int) -> None:
    assert validate_fmu(str(file_of(fmus, model, fmi))) == []


@pytest.fixture(scope="module")
def oracle() -> dict[str, dict[str, np.ndarray]]:
    """The front end's own simulator on the model wrapped with a constant input."""
    results = {}
    for model, file in MODELS.items():
        text = f"{file.read_text()}\nmodel Wrapped\n  {model} m;\nequation\n  m.u = {INPUT};\nend Wrapped;\n"
        config = SimConfig(solver="rk-like", rtol=1e-11, atol=1e-12)
        result = (
            FrontEnd()
            .loads(text, model="Wrapped", filename="Wrapped.mo")
            .simulate(t=float(GRID[-1]) + 0.0137, dt=0.0137, config=config)
        )
        times = np.asarray(result.time)
        rows = [int(np.argmin(np.abs(times - t))) for t in GRID]
        assert np.abs(times[rows] - GRID).max() < 1e-9
        results[model] = {name.removeprefix("m."): np.asarray(result[name])[rows] for name in result.names}
    return results


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("model", MODELS)
def test_trajectories_equal_the_oracle(
    fmus: Path, oracle: dict[str, dict[str, np.ndarray]], model: str, interface: str, fmi: int
) -> None:
    expected = oracle[model]
    with load(file_of(fmus, model, fmi), interface=interface) as opened:
        known = {v.name for v in opened.description.variables}
    names = [n for n in expected if n in known and n != "u"]
    assert len(names) >= 3
    result = run(file_of(fmus, model, fmi), interface, names)
    rows = np.searchsorted(result.time, GRID, side="right") - 1
    assert np.abs(result.time[rows] - GRID).max() < 1e-12
    for name in names:
        got, wanted = result.signals[name][rows], expected[name].astype(float)
        scale = max(1.0, float(np.abs(wanted).max()))
        assert np.abs(got - wanted).max() < 1e-6 * scale, name


def test_bouncing_ball_hits_the_floor_when_it_must(fmus: Path) -> None:
    """t1 = √(2h/g), then each flight lasts e times the one before."""
    for interface in ("me", "cs"):
        with load(file_of(fmus, "Hybrid", 2), interface=interface, solver="auto", tolerance=1e-10) as model:
            first = np.sqrt(2.0 / 9.81)
            times = np.cumsum([first, 2 * 0.7 * first, 2 * 0.7**2 * first])
            with model.open_session() as session:
                for count, hit in enumerate(times):
                    for instant, bounces in ((hit - 1e-7, count), (hit + 1e-7, count + 1)):
                        session.advance(instant, signals={}, points=np.array([instant]))
                        assert session.values(["bounces"])["bounces"] == bounces, (interface, hit)


def test_linear_system_equals_its_matrix_exponential(fmus: Path) -> None:
    a = np.array([[-1, 2, 0, 0], [-2, -1, 0.5, 0], [0, 0, -3, 1], [0.1, 0, 0, -0.5]])
    b, x0 = np.array([0.0, 1.0, 0.0, 2.0]), np.full(4, 0.1)
    steady = -np.linalg.solve(a, b * INPUT)
    names = [f"x[{i}]" for i in range(1, 5)]
    for fmi in (2, 3):
        for interface in ("me", "cs"):
            result = run(file_of(fmus, "Arrays.StateSpace", fmi), interface, names)
            for t, *x in zip(result.time, *(result.signals[n] for n in names), strict=True):
                assert np.abs(x - (steady + expm(a * t) @ (x0 - steady))).max() < 1e-8


def test_start_that_depends_on_a_parameter_follows_it(fmus: Path) -> None:
    for fmi in (2, 3):
        text = zipfile.ZipFile(file_of(fmus, "Cubic", fmi)).read("modelDescription.xml").decode()
        line = next(line for line in text.splitlines() if 'name="x"' in line)
        assert 'initial="calculated"' in line
        assert "start=" not in line
        for interface in ("me", "cs"):
            file = file_of(fmus, "Cubic", fmi)
            with (
                load(file, interface=interface, start_values={"x0": 3.0}) as model,
                model.open_session() as session,
            ):
                assert session.values(["x"])["x"] == 3.25


def test_calculated_parameter_follows_a_parameter(fmus: Path) -> None:
    for fmi in (2, 3):
        with load(file_of(fmus, "Hybrid", fmi), start_values={"g": 1.5}) as model, model.open_session() as session:
            assert session.values(["twiceG"])["twiceG"] == 3.0


def test_tunable_period_is_obeyed(fmus: Path) -> None:
    with load(file_of(fmus, "Hybrid", 2), start_values={"period": 0.1}) as model, model.open_session() as session:
        session.advance(1.0, signals={}, points=np.array([1.0]))
        assert session.values(["deadlines"])["deadlines"] == 8  # 0.25, 0.35, …, 0.95


# Directional derivatives


@pytest.fixture(params=[2, 3])
def live(request: pytest.FixtureRequest, fmus: Path) -> Iterator[tuple[Instance, list[str], list[str]]]:
    """A model exchange instance in continuous mode with its knowns and unknowns."""
    with load(file_of(fmus, "Arrays.Elementary", request.param)) as model:
        instance = model.new_instance()
        instance.enter_initialisation(0.0, None)
        instance.exit_initialisation()
        instance.iterate_events()
        instance.enter_continuous_mode()
        yield instance, ["u", "x[1]", "x[2]", "x[3]"], ["y", "table", "ratio", "der(x[1])", "der(x[2])", "der(x[3])"]
        instance.close()


def test_directional_derivatives_equal_differences(live: tuple[Instance, list[str], list[str]]) -> None:
    instance, knowns, unknowns = live
    by_name = {v.name: v for v in instance.description.variables}
    inputs, outputs = [by_name[n] for n in knowns], [by_name[n] for n in unknowns]
    u, y = instance.access(inputs[:1]), instance.access(outputs)
    point = np.array([0.3, 0.55, 1.4, 0.2])

    def evaluate(at: np.ndarray) -> np.ndarray:
        u.write([float(at[0])])
        instance.x[:] = at[1:]
        instance.set_states()
        return np.array(y.read(), dtype=float)

    for column in range(4):
        h = 1e-4
        unit = np.eye(4)[column]
        # Fourth order, so that the difference is good to 1e-10.
        slope = (
            8 * (evaluate(point + h * unit) - evaluate(point - h * unit))
            - (evaluate(point + 2 * h * unit) - evaluate(point - 2 * h * unit))
        ) / (12 * h)
        evaluate(point)
        exact = instance.directional_derivative(outputs, [inputs[column]], [1.0])
        assert exact == pytest.approx(slope, rel=1e-8, abs=1e-9), knowns[column]


def test_directional_derivative_of_a_linear_system_is_its_matrix(fmus: Path) -> None:
    a = [[-1, 2, 0, 0], [-2, -1, 0.5, 0], [0, 0, -3, 1], [0.1, 0, 0, -0.5]]
    for fmi in (2, 3):
        with load(file_of(fmus, "Arrays.StateSpace", fmi)) as model:
            instance = model.new_instance()
            instance.enter_initialisation(0.0, None)
            instance.exit_initialisation()
            instance.iterate_events()
            instance.enter_continuous_mode()
            by_name = {v.name: v for v in model.description.variables}
            rates = [by_name[f"der(x[{i}])"] for i in range(1, 5)]
            for column in range(4):
                got = instance.directional_derivative(rates, [by_name[f"x[{column + 1}]"]], [1.0])
                assert np.array_equal(got, np.array(a)[:, column])
            instance.close()


# Rollback


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_rollback_is_exact_to_the_last_bit(fmus: Path, interface: str, fmi: int) -> None:
    names = ["h", "v", "T", "held", "next", "mode", "stairs", "y", "bounces", "deadlines"]
    signals = {"u": Sine(amplitude=0.3, frequency=1.7)}
    with load(file_of(fmus, "Hybrid", fmi), interface=interface) as model, model.open_session() as session:
        assert model.snapshot_method() == "state"
        session.advance(0.42, signals=signals, record=names)
        snapshot = session.snapshot()
        before = session.values(names)
        runs = []
        for _ in range(2):
            session.restore(snapshot)
            assert session.values(names) == before
            runs.append(session.advance(1.9, signals=signals, record=names, points=np.linspace(0.5, 1.9, 29)))
        for name in names:
            assert runs[0].values[name].tobytes() == runs[1].values[name].tobytes()


# Reproducible bytes: `dev.py build --check` compares all FMUs and platforms


def test_the_token_follows_the_equations_and_not_the_place(tmp_path: Path) -> None:
    tokens = []
    for folder, gain in (("a", 1), ("b", 1), ("c", 2)):
        file = tmp_path / folder / "M.mo"
        file.parent.mkdir()
        file.write_text(f"model M\n  output Real y;\nequation\n  y = {gain}*time;\nend M;\n")
        text = generate(file, "M").descriptions[2].decode()
        tokens.append(text.split('guid="')[1].split('"')[0])
    assert tokens[0] == tokens[1] != tokens[2]


def test_no_path_of_the_building_machine_is_inside(fmus: Path) -> None:
    with zipfile.ZipFile(file_of(fmus, "Hybrid", 2)) as archive:
        for name in archive.namelist():
            data = archive.read(name)
            assert str(Path.home()).encode() not in data or str(Path.home()) == "/", name
            assert b"/tmp/" not in data, name


def test_what_a_model_asks_for_at_the_start_is_done(tmp_path: Path) -> None:
    file = tmp_path / "Start.mo"
    file.write_text(
        "model Start\n  Real x(start = 1, fixed = true);\n  discrete Real n(start = 0, fixed = true);\nequation\n"
        "  der(x) = -x;\n  when initial() then\n    reinit(x, 2);\n    n = 5;\n  end when;\n"
        '  when x < 0.5 then\n    terminate("small enough");\n  end when;\nend Start;\n'
    )
    build_fmu([file], out=tmp_path / "Start.fmu", platforms=[HOST])
    for interface in ("me", "cs"):
        with load(tmp_path / "Start.fmu", interface=interface) as model, model.open_session() as session:
            assert session.values(["x", "n"]) == {"x": 2.0, "n": 5.0}
            session.advance(1.3, signals={}, points=np.array([1.3]))
            assert session.values(["x"])["x"] == pytest.approx(2.0 * np.exp(-1.3), rel=1e-4)
            with pytest.raises(SimulationError, match="end"):  # x passes 0.5 at ln 4 = 1.386 s
                session.advance(1.5, signals={}, points=np.array([1.5]))
