"""Systems as container FMUs: near the system in proportion to the step; what a container cannot hold is refused."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import control
import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.system_models import run as run_system
from workbench.build.container import ContainerResult, export_container
from workbench.build.request import export
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.bundled import bundled_path
from workbench.model.described_model import DescribedModel
from workbench.model.load import load
from workbench.signals.kinds import Constant, Step
from workbench.system.connect import connect
from workbench.system.description import Connection, FmuComponent, SystemDescription
from workbench.system.load import load as load_system

pytest.importorskip("fmpy.container_fmu", reason="this FMPy is older than container FMUs (0.3.22)")

LAG = "fmu:FirstOrderLag"
RING = [("a.y", "b.u"), ("b.y", "a.u")]


def ring() -> DescribedModel:
    """Two lags of both FMI versions that drive each other: a.x = (1 + exp(−2 t))/2, no feed-through."""
    return connect({"a": LAG, "b": f"{LAG}@3"}, RING, outputs={"x": "a.y"}, start_values={"a.x": 1.0})


def simulated(file: Path, stop: float, interval: float) -> Mapping[str, Floats]:
    found: Mapping[str, Floats] = fmpy.simulate_fmu(str(file), stop_time=stop, output_interval=interval)
    return found


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_container_comes_near_the_system_in_proportion_to_the_step(tmp_path: Path, fmi: int) -> None:
    errors = []
    with ring() as system:
        for step in (0.1, 0.05, 0.025):
            result = export_container(system, tmp_path / "ring.fmu", step=step, fmi=fmi)
            assert validate_fmu(str(result.file)) == []
            found = simulated(result.file, 2.0, 0.1)
            truth = 0.5 * (1.0 + np.exp(-2.0 * found["time"]))
            errors.append(np.abs(found["x"] - truth).max())
            assert result.fmi == fmi
            assert any(f"{step} s" in note and "delay of one step" in note for note in result.notes)
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_workbench_runs_it_with_inputs_and_parameters(tmp_path: Path, fmi: int) -> None:
    signals = {"r": Step(time=0.5, value=2.0)}
    with connect(
        {"a": LAG, "b": f"{LAG}@3"},
        [("a.y", "b.u")],
        inputs={"r": ["a.u"]},
        outputs={"y": "b.y", "z": "a.x"},
        start_values={"b.tau": 0.25, "b.x": -1.0},
    ) as system:
        result = export_container(system, tmp_path / "chain.fmu", step=2.0**-10, fmi=fmi)
        truth = run_system(system, 2.0, signals, ["y", "z"], rows=16)
    assert (result.inputs, result.outputs, result.parameters) == (("r",), ("y", "z"), ("a.tau", "b.tau"))
    with load(result.file, step=result.step) as model:
        starts = {v.name: v.start for v in model.description.variables}
        assert starts["b.tau"] == 0.25
        assert starts["b.x"] == -1.0
        found = run_system(model, 2.0, signals, ["y", "z"], rows=16)
    with load(result.file, step=result.step, start_values={"b.tau": 1e3}) as model:
        slow = run_system(model, 2.0, signals, ["y"], rows=16)
    for name in ("y", "z"):
        assert found.values[name][-1] == pytest.approx(truth.values[name][-1], abs=4e-3)
    assert slow.values["y"] == pytest.approx(-1.0, abs=0.01)


@needs_gemseo
def test_two_mass_spring_subsystems_in_a_container(tmp_path: Path) -> None:
    """Third-party FMUs in a loop; steps of powers of two, as these FMUs refuse to go beyond their stop time."""
    parts = {n: str(gemseo_fmu(f"MassSpringSubSystem{k}")) for k, n in ((1, "a"), (2, "b"))}
    errors = []
    with connect(parts, [("a.x1", "b.x1"), ("b.x2", "a.x2")], outputs={"x1": "a.x1", "x2": "b.x2"}) as system:
        truth = run_system(system, 10.0, {}, ["x1"], rows=40).values["x1"]
        for step in (2.0**-7, 2.0**-8):
            file = export_container(system, tmp_path / "springs.fmu", step=step).file
            assert validate_fmu(str(file)) == []
            errors.append(np.abs(simulated(file, 10.0, 0.25)["x1"][1:] - truth[-40:]).max())
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)


def test_values_go_through_feed_through_at_once(tmp_path: Path) -> None:
    """b.y = 0.43 b.u without delay: connections stand in that order, whatever the order of the file."""
    with connect(
        {"c": LAG, "b": "fmu:Saturation", "a": LAG},
        [("b.y", "c.u"), ("a.y", "b.u")],
        inputs={"r": "a.u"},
        outputs={"y": "a.y", "u": "c.u"},
        start_values={"a.x": 0.5, "r": 1.0, "b.B[1]": 0.0},
    ) as system:
        file = export_container(system, tmp_path / "chain.fmu", step=0.1).file
    found = simulated(file, 1.0, 0.1)
    assert found["y"] == pytest.approx(1.0 - 0.5 * np.exp(-found["time"]), abs=1e-6)
    assert found["u"] == pytest.approx(0.43 * found["y"], abs=1e-12)


def test_the_same_system_gives_the_same_bytes(tmp_path: Path) -> None:
    with ring() as system:
        files = [export_container(system, tmp_path / f"{n}.fmu", step=0.1).file for n in "ab"]
        other = export_container(system, tmp_path / "c.fmu", step=0.2).file
    first, second = (f.read_bytes() for f in files)
    assert first == second
    assert first != other.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.fmu", "b.fmu", "c.fmu"]


def test_an_unpacked_fmu_beside_a_packed_one(tmp_path: Path) -> None:
    shutil.unpack_archive(bundled_path(LAG), tmp_path / "lag", "zip")
    with connect({"a": str(tmp_path / "lag"), "b": LAG}, [("a.y", "b.u")], outputs={"y": "b.y"}) as system:
        result = export_container(system, tmp_path / "two.fmu", step=0.125)
    assert simulated(result.file, 1.0, 0.125)["y"] == pytest.approx(0.0)


# -- what is refused --------------------------------------------------------------------------


def description(
    parts: Mapping[str, str], connections: Sequence[Connection] = (), outputs: Mapping[str, str] | None = None
) -> SystemDescription:
    components = tuple(FmuComponent(name=name, file=file) for name, file in parts.items())
    return SystemDescription(name="s", components=components, connections=tuple(connections), outputs=outputs or {})


def link(*, gain: float = 1.0, offset: float = 0.0, closes_at: float | None = None) -> Connection:
    return Connection(source="a.y", destination="b.u", gain=gain, offset=offset, closes_at=closes_at)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (control.tf([1.0], [1.0, 1.0]), "component b: a linear system is not an FMU; make it one with `workbench buil"),
        (2.0, "component b: a gain is not an FMU"),
        (np.tanh, "component b: a Python function exists only in this process"),
    ],
)
def test_blocks_are_refused(tmp_path: Path, value: object, said: str) -> None:
    with connect({"a": LAG, "b": value}, [("a.y", "b.u")]) as system, pytest.raises(InputError, match=said) as caught:
        export_container(system, tmp_path / "x.fmu", step=0.1)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"gain": -2.0}, "connection a.y → b.u: the gain or unit conversion (× -2) cannot be in a container"),
        ({"offset": 1.0}, "(× 1 + 1)"),
        (
            {"closes_at": 140.0},
            "connection a.y → b.u: closes at t = 140 s; connections in a container are always closed",
        ),
    ],
)
def test_connections_are_refused(tmp_path: Path, options: dict[str, float], said: str) -> None:
    with pytest.raises(InputError) as caught:
        export_container(description({"a": LAG, "b": LAG}, [link(**options)]), tmp_path / "x.fmu", step=0.1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_components_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "x.fmu"
    cases: list[tuple[SystemDescription, str]] = [
        (description({"a": str(_without_cs(tmp_path))}), "component a: its FMU offers model exchange only"),
        (description({"a": str(tmp_path / "no.fmu")}), "component a: .*no such file"),
        (
            description(
                {"a": "fmu:Saturation", "b": "fmu:Saturation"}, [link(), Connection(source="b.y", destination="a.u")]
            ),
            "algebraic loop a.y → b.u, b.y → a.u: a container evaluates it once per step",
        ),
    ]
    for system, said in cases:
        with pytest.raises(InputError, match=said):
            export_container(system, out, step=0.1)
    stepped = SystemDescription(name="s", components=(FmuComponent(name="a", file=LAG, step=0.5),))
    with pytest.raises(InputError, match=r"component a: its communication step is 0.5 s, and the container has one"):
        export_container(stepped, out, step=0.1)
    with (
        connect({"a": LAG}, [], inputs={"r": "a.u"}, bias={"r": 1.0}) as biased,
        pytest.raises(InputError, match="input r: a container cannot have a bias"),
    ):
        export_container(biased, out, step=0.1)
    assert not out.exists()


def _without_cs(folder: Path) -> Path:
    source, target = zipfile.ZipFile(bundled_path(LAG)), folder / "me.fmu"
    with source, zipfile.ZipFile(target, "w") as archive:
        text = source.read("modelDescription.xml").decode()
        begin = text.index("<CoSimulation")
        end = text.index(">", begin) + 1
        if text[end - 2] != "/":
            end = text.index("</CoSimulation>") + len("</CoSimulation>")
        archive.writestr("modelDescription.xml", text[:begin] + text[end:])
    return target


@pytest.mark.parametrize(
    ("out", "options", "said"),
    [
        ("x.zip", {"step": 0.1}, "must end in .fmu"),
        ("no/x.fmu", {"step": 0.1}, "does not exist"),
        ("x.fmu", {"step": 0.0}, "step"),
        ("x.fmu", {"step": float("nan")}, "step"),
        ("x.fmu", {"step": 0.1, "fmi": 1}, "FMI 1 cannot be written; choose 2 or 3"),
    ],
)
def test_wrong_options(tmp_path: Path, out: str, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        export_container(description({"a": LAG}), tmp_path / out, **options)


# -- the command ------------------------------------------------------------------------------

CHAIN = """
[components]
a = "fmu:FirstOrderLag"
b = {model = "fmu:FirstOrderLag", set = {tau = 0.5}}
[connections]
"b.u" = "a.y"
[inputs]
r = "a.u"
[outputs]
y = "b.y"
"""


def test_the_command_takes_a_system(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    system, out, report = tmp_path / "chain.toml", tmp_path / "chain.fmu", tmp_path / "out.json"
    system.write_text(CHAIN, encoding="utf-8")
    assert run(["build", str(system), "--out", str(out), "--step", "0.125", "--fmi", "3", "--json", str(report)]) == 0
    said = capsys.readouterr().out
    for fact in ("System chain as a container FMU", "parts: a, b", "inputs: r", "outputs: y", "parameters: 2"):
        assert fact in said
    assert "delay of one step" in said
    found = json.loads(report.read_text(encoding="utf-8"))
    assert (found["step"], found["fmi"], found["components"]) == (0.125, 3, ["a", "b"])
    with load(out, step=0.125) as model:
        last = run_system(model, 8.0, {"r": Constant(1.0)}, ["y"], rows=1).values["y"][-1]
    assert last == pytest.approx(1.0, abs=1e-2)


def test_the_function_takes_a_system(tmp_path: Path) -> None:
    system = tmp_path / "chain.toml"
    system.write_text(CHAIN, encoding="utf-8")
    with load_system(system) as model:
        results = [export(found, tmp_path / "x.fmu", step=0.125, name="lags") for found in (system, model)]
    assert results[0] == results[1]
    assert isinstance(results[0], ContainerResult)
    assert (results[0].model, results[0].components) == ("lags", ("a", "b"))
    with pytest.raises(InputError, match="platforms and stiff are for linear models"):
        export(system, tmp_path / "x.fmu", step=0.125, stiff=True)


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        (CHAIN, [], "step is needed for a system"),
        (CHAIN.replace('"a.y"', '{from = "a.y", gain = 2.0}'), ["--step", "0.1"], "connection a.y → b.u: the gain"),
        (None, ["--step", "0.1"], "step is for systems"),
    ],
)
def test_the_command_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, options: list[str], said: str
) -> None:
    file = tmp_path / ("model.json" if text is None else "chain.toml")
    file.write_text(text or "{}", encoding="utf-8")
    assert run(["build", str(file), "--out", str(tmp_path / "x.fmu"), *options]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
