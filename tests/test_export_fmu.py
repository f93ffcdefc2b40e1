"""Exported FMUs against the matrices they were made of: matrices, responses and time histories in closed form.

Built for this machine only.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from scipy.linalg import expm

from workbench.build.export import ExportResult, generate_linear
from workbench.build.fmu import compile_and_pack
from workbench.build.matrices import matrices_of
from workbench.build.request import export
from workbench.build.state_space import state_space
from workbench.build.toolchain import host_only
from workbench.cli.app import run
from workbench.model.load import load
from workbench.point.lin.request import lin
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant, Table

DT = 0.022
U0, Y0, X0 = np.array([1.5, -2.0]), np.array([10.0, 20.0]), np.array([0.1, 0.0, -0.2])
B = np.array([[1.0, 0.0], [0.5, -2.0], [0.0, 0.25]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 1.0]])
D = np.array([[0.7, 0.0], [0.0, -0.3]])
A = {
    "discrete": np.array([[0.8, 0.3, 0.0], [-0.3, 0.7, 0.1], [0.0, 0.0, 0.5]]),
    "continuous": np.array([[-1.0, 3.0, 0.0], [-3.0, -1.0, 0.4], [0.0, 0.0, -20.0]]),
}
INPUTS, OUTPUTS, STATES = ["a.b", "x[1]"], ["y.out[2]", "elevator"], ["q", "plant.x[2]", "z"]
EVERYWHERE = [(fmi, interface) for fmi in (2, 3) for interface in ("me", "cs")]
HOST = [p.name for p in host_only()]


def data(kind: str) -> dict[str, Any]:
    return {
        "A": A[kind].tolist(), "B": B.tolist(), "C": C.tolist(), "D": D.tolist(),
        "dt": DT if kind == "discrete" else 0.0, "input_names": INPUTS, "output_names": OUTPUTS,
        "state_names": STATES, "u0": U0.tolist(), "y0": Y0.tolist(), "x0": X0.tolist(),
        "input_units": ["deg", None], "output_units": ["m", "deg/s"],
    }  # fmt: skip


Fmus = dict[tuple[str, int], Path]


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    """Both models in both versions, compiled once for both."""
    folder = tmp_path_factory.mktemp("exported")
    files = {(kind, fmi): folder / f"{kind}{fmi}.fmu" for kind in A for fmi in (2, 3)}
    for kind in A:
        matrices = matrices_of(data(kind))
        sources = generate_linear(matrices, state_space(matrices, kind))
        compile_and_pack(sources, {fmi: files[kind, fmi] for fmi in (2, 3)}, host_only())
    return files


def sampled(u: np.ndarray) -> np.ndarray:
    """The outputs of the discrete model by its definition, shape (k, 2), for u of shape (k, 2)."""
    x, y = X0, np.zeros((len(u), 2))
    for k, now in enumerate(u - U0):
        y[k] = Y0 + C @ x + D @ now
        x = A["discrete"] @ x + B @ now
    return y


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", A)
def test_fmus_are_valid_and_named_as_asked(fmus: Fmus, kind: str, fmi: int) -> None:
    assert validate_fmu(str(fmus[kind, fmi])) == []
    with load(str(fmus[kind, fmi])) as model:
        assert [(v.name, v.unit, v.start) for v in model.inputs] == [("a.b", "deg", 1.5), ("x[1]", None, -2.0)]
        assert [(v.name, v.unit) for v in model.outputs] == [("y.out[2]", "m"), ("elevator", "deg/s")]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", A)
def test_lin_returns_the_matrices(fmus: Fmus, kind: str, fmi: int) -> None:
    with load(str(fmus[kind, fmi]), "me") as model:
        result = lin(model).result
    found = (result.state_names, result.input_names, result.output_names)
    assert tuple(map(list, found)) == (STATES, INPUTS, OUTPUTS)
    assert result.dt == pytest.approx(DT if kind == "discrete" else 0.0, rel=1e-12)
    tolerance = 1e-7 if kind == "discrete" else 0.0  # directional derivatives are exact, widths are not
    for name, expected in (("A", A[kind]), ("B", B), ("C", C), ("D", D)):
        np.testing.assert_allclose(getattr(result, name), expected, rtol=0.0, atol=tolerance)


def test_lin_of_co_simulation_has_the_same_markov_parameters(fmus: Fmus) -> None:
    with load(str(fmus["discrete", 2]), "cs") as model:
        result = lin(model).result
    x = expected = None
    for k in range(8):
        found = result.D if k == 0 else result.C @ np.linalg.matrix_power(result.A, k - 1) @ result.B
        x = B if k == 1 else A["discrete"] @ x if x is not None else x
        expected = D if x is None else C @ x
        np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize(("fmi", "interface"), EVERYWHERE)
def test_the_response_of_the_continuous_model(fmus: Fmus, fmi: int, interface: str) -> None:
    frequencies = [0.3, 1.0, 4.0]
    with load(str(fmus["continuous", fmi]), interface) as model:
        result = nfr(model, "a.b", "y.out[2]", frequencies, 2.0, drift_check=False)
    for k, f in enumerate(frequencies):
        expected = (C @ np.linalg.solve(2j * np.pi * f * np.eye(3) - A["continuous"], B) + D)[0, 0]
        found = result.gain[0, k] * np.exp(1j * np.radians(result.phase_deg[0, k]))
        assert abs(found / expected - 1.0) < 1e-3


@pytest.mark.parametrize(("fmi", "interface"), EVERYWHERE)
def test_the_response_of_the_discrete_model_is_that_behind_its_hold(fmus: Fmus, fmi: int, interface: str) -> None:
    # A sine whose period is a whole number of samples: the samples repeat, and so does the output.
    frequency = 1.0 / (40 * DT)
    # In FMI 3 inputs are held between communication points: on average half a step late, while the model samples
    # the value of the very point. So the phase is off by half a step, and the step has to be short.
    step = DT / 100 if (fmi, interface) == (3, "cs") else None
    with load(str(fmus["discrete", fmi]), interface, step=step) as model:
        result = nfr(model, "a.b", "y.out[2]", [frequency], 2.0, drift_check=False)
    s = 2j * np.pi * frequency * DT
    sample = (C @ np.linalg.solve(np.exp(s) * np.eye(3) - A["discrete"], B) + D)[0, 0]
    expected = sample * (1.0 - np.exp(-s)) / s
    found = result.gain[0, 0] * np.exp(1j * np.radians(result.phase_deg[0, 0]))
    assert abs(found / expected - 1.0) < 1e-3


@pytest.mark.parametrize("step", [None, 0.0137, 0.1])
@pytest.mark.parametrize(("fmi", "interface"), EVERYWHERE)
def test_the_discrete_model_ticks_at_its_own_times(fmus: Fmus, fmi: int, interface: str, step: float | None) -> None:
    u = np.random.default_rng(0).normal(size=(40, 2))
    ticks = DT * np.arange(len(u))
    # The inputs change between the ticks, so that it does not matter which comes first where both coincide.
    changes = tuple(ticks - 0.3 * DT)
    forced = {name: Table(changes, tuple(u[:, j]), "hold") for j, name in enumerate(INPUTS)}
    with load(str(fmus["discrete", fmi]), interface, step=step if interface == "cs" else None) as model:
        points: list[float] = (ticks + 0.5 * DT).tolist()
        result = simulate(model, stop=points[-1], inputs=forced, outputs=OUTPUTS, points=points, verify_step=False)
    found = np.column_stack([np.interp(points, result.time, result.signals[name]) for name in OUTPUTS])
    np.testing.assert_allclose(found, sampled(u), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("fmi", [2, 3])
def test_several_ticks_in_one_step_of_another_importer(fmus: Fmus, fmi: int) -> None:
    step = 2.7 * DT  # no multiple of the period, with two or three ticks inside
    result = simulate_fmu(
        str(fmus["discrete", fmi]),
        stop_time=30 * step,
        output_interval=step,
        start_values={"a.b": 3.0, "x[1]": 0.5},
        output=OUTPUTS,
        fmi_type="CoSimulation",
    )
    assert len(result) == 31
    y = sampled(np.tile([3.0, 0.5], (100, 1)))
    times = result["time"]
    clear = np.abs(times / DT - np.round(times / DT)) > 1e-6  # elsewhere a tick and a point coincide
    clear[0] = True  # the first tick is made when the initialisation ends
    expected = y[np.floor(times / DT).astype(int)]
    found = np.column_stack([result[name] for name in OUTPUTS])
    assert clear.sum() >= 27
    np.testing.assert_allclose(found[clear], expected[clear], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("fmi", "interface"), EVERYWHERE)
def test_the_continuous_model_moves_by_the_matrix_exponential(fmus: Fmus, fmi: int, interface: str) -> None:
    points = [0.05 * k for k in range(1, 41)]
    forced = {"a.b": Constant(3.0), "x[1]": Constant(-2.0)}
    with load(str(fmus["continuous", fmi]), interface, tolerance=1e-9) as model:
        result = simulate(model, stop=points[-1], inputs=forced, outputs=OUTPUTS, points=points, verify_step=False)
    a, u = A["continuous"], np.array([1.5, 0.0])
    rest = -np.linalg.solve(a, B @ u)
    states = np.array([rest + expm(a * t) @ (X0 - rest) for t in points])
    found = np.column_stack([np.interp(points, result.time, result.signals[name]) for name in OUTPUTS])
    np.testing.assert_allclose(found, Y0 + states @ C.T + D @ u, rtol=0.0, atol=1e-6)


def test_names_and_comments_that_hurt(tmp_path: Path) -> None:
    lag = {"A": [[-1.0]], "B": [[1.0]], "C": [[2.0]], "D": [[0.5]], "dt": 0.0}
    names = {"input_names": ["side stick /* ??/"], "output_names": ['"<&>é\\ */'], "state_names": ["%s%n"]}
    result = export({**lag, **names}, tmp_path / "2 b.fmu", fmi=3, platforms=HOST)
    assert result.model == "Model_2_b"
    assert validate_fmu(str(result.file)) == []
    assert b'variableNamingConvention="flat"' in zipfile.ZipFile(result.file).read("modelDescription.xml")
    with load(str(result.file)) as model:
        found = lin(model).result
    assert [list(found.input_names), list(found.output_names), list(found.state_names)] == list(names.values())
    assert [getattr(found, key).item() for key in "ABCD"] == [-1.0, 1.0, 2.0, 0.5]


def test_71_states_and_39_outputs_return_exactly(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    a = random.normal(size=(71, 71))
    a -= np.eye(71) * (np.linalg.eigvals(a).real.max() + 0.5)
    b, c, d = random.normal(size=(71, 3)), random.normal(size=(39, 71)), random.normal(size=(39, 3))
    names = {"input_names": [f"u[{i}]" for i in range(3)], "output_names": [f"y.a{i}" for i in range(39)]}
    result = export({"A": a, "B": b, "C": c, "D": d, "dt": 0, **names}, tmp_path / "large.fmu", platforms=HOST)
    assert isinstance(result, ExportResult)
    assert result.file.stat().st_size < 1_000_000
    assert (result.model, result.n_states, result.n_inputs, result.n_outputs) == ("large", 71, 3, 39)
    with load(str(result.file), "me") as model:
        found = lin(model).result
    for name, expected in (("A", a), ("B", b), ("C", c), ("D", d)):
        np.testing.assert_array_equal(getattr(found, name), expected)


def test_a_linearised_fmu_is_exported_and_linearised_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("workbench.build.toolchain.PLATFORMS", host_only())
    with load("fmu:Rudder") as model:
        first = lin(model).result
    source, target, report = (tmp_path / name for name in ("lin.json", "again.fmu", "report.json"))
    source.write_text(json.dumps({"command": "lin", **first.to_dict()}), encoding="utf-8")
    assert run(["build", str(source), "--out", str(target), "--json", str(report)]) == 0
    out = capsys.readouterr().out
    assert "Linear model again as an FMU\nFMI 2, continuous: 8 states, 4 inputs, 1 output." in out
    told = json.loads(report.read_text(encoding="utf-8"))
    assert (told["states"], told["platforms"], told["stiff"]) == (8, HOST, True)
    with load(str(target), "me") as model:
        again = lin(model).result
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    assert again.operating_point.u == first.operating_point.u
    assert again.operating_point.y == first.operating_point.y
