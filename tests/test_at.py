"""Every command takes the same file by `--at`: what it writes begins there, and says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.three_lags import three_lags
from workbench.cli.app import run
from workbench.core.records.option import options_of
from workbench.core.values.operating_point import OperatingPoint
from workbench.loops.loop.request import Loop
from workbench.system.master.model import MasterModel

OPEN = next(declared.option.help for declared in options_of(Loop) if declared.name == "open")
MASTER = """
name = "two in step"
[components]
a = {model = "fmu:FirstOrderLag", interface = "cs"}
b = {model = "fmu:FirstOrderLag", interface = "cs"}
[connections]
"b.u" = "a.y"
[inputs]
r = "a.u"
[outputs]
y = "b.y"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("at")


def written(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def point_of(path: Path) -> OperatingPoint:
    return OperatingPoint.read(path)


@pytest.fixture(scope="module")
def rudder(folder: Path) -> Path:
    path = folder / "rudder.json"
    assert run(["trim", "fmu:Rudder", "--u0", "delC=2", "--float", "p1,p2", "--json", str(path)]) == 0
    return path


def assert_same(a: OperatingPoint, b: OperatingPoint) -> None:
    assert a.x == pytest.approx(b.x, rel=1e-9, abs=1e-9)
    assert a.u == pytest.approx(b.u)
    assert (a.model, a.model_sha256, a.time) == (b.model, b.model_sha256, b.time)


NFR = ["nfr", "fmu:Rudder", "--input", "delC", "--output", "del", "--freq", "4", "--amplitude", "0.01"]
COMMANDS = {
    "simulate": ["simulate", "fmu:Rudder", "--stop", "0.01", "--in-process"],
    "nfr": [*NFR, "--in-process"],
    "nfr carried": [*NFR, "--in-process", "--carry"],
    "branches": ["branches", "fmu:Rudder", "--input", "delC", "--output", "del", "--band", "4:5", "--amplitude", "0.01",
                 "--seeds", "0"],
    "lin": ["lin", "fmu:Rudder"],
    "trim": ["trim", "fmu:Rudder", "--float", "p1,p2"],
    "excite": [
        "excite", "fmu:Rudder", "--input", "delC", "--output", "del", "--prbs", "amplitude=0.1", "--step", "0.01",
        "--samples", "20", "--in-process",
    ],
    "bla": [
        "bla", "fmu:Rudder", "--input", "delC", "--output", "del", "--rms", "0.1", "--band", "2:10", "--realisations",
        "2",
    ],
    "modes": ["modes", "fmu:Rudder", "--vary", "mH=0:1", "--points", "2"],
    "feedback": ["feedback", "fmu:Rudder", "--from", "del", "--to", "delC"],
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_begins_at_the_point_and_says_so(name: str, rudder: Path, folder: Path) -> None:
    """And what it writes is a point again, the same."""
    first = folder / f"{name}.json"
    assert run([*COMMANDS[name], "--at", str(rudder), "--json", str(first)]) == 0
    assert_same(point_of(first), point_of(rudder))


# -- systems -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lags(folder: Path) -> Path:
    path = folder / "lags.toml"
    path.write_text(three_lags(20.0), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def held(lags: Path) -> Path:
    """At r = 0.02 the three lags hold y = r·k/(1 + k), which no run from the start shows."""
    path = lags.with_name("held.json")
    assert run(["trim", str(lags), "--u0", "r=0.02", "--json", str(path)]) == 0
    assert point_of(path).y["y"] == pytest.approx(0.02 * 20.0 / 21.0)
    return path


SYSTEMS = {
    "simulate": ["--stop", "0.5", "--in-process"],
    "loop": ["--open", "k.y"],
    "loop measured": [
        "--open",
        "k.y",
        "--amplitude",
        "0.1",
        "--freq",
        "0.5",
        "--how",
        "break",
        "--in-process",
    ],  # closed, it oscillates
    "limit-cycle": ["--block", "s", "--method", "describing function"],
    "feedback": ["--from", "y", "--to", "r"],
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_command_for_systems_begins_at_the_point(name: str, lags: Path, held: Path) -> None:
    out = lags.with_name(f"lags {name}.json")
    code = run([name.partition(" ")[0], str(lags), *SYSTEMS[name], "--at", str(held), "--json", str(out)])
    assert code == 0
    assert_same(point_of(out), point_of(held))


def test_the_loop_is_opened_where_the_point_has_its_signal(lags: Path, held: Path) -> None:
    out = lags.with_name("value.json")
    assert run(["loop", str(lags), "--open", "k.y", "--at", str(held), "--json", str(out)]) == 0
    assert written(out)["value"] == pytest.approx(0.02 * 20.0 / 21.0)
    with wb.load(lags) as model:
        for found in (wb.loop(model, "k.y", at=held), wb.loop(model, "k.y", at=OperatingPoint.read(held))):
            assert found.value == pytest.approx(0.02 * 20.0 / 21.0)


OPENED = (
    "Missing option '--open' (Connection at which the loop is opened: a source 'plant.y' (all its connections), "
    "an input 'controller.u' (the connection to it), one connection 'plant.y -> controller.u', "
    "or an output of the system); workbench loop --help has an example"
)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--at", "{held}"], OPENED),
        ([], OPENED),
        (["--open", "k.y", "--at", "{held}", "--trim"], "--at and --trim: only one of them"),
        (
            ["--open", "k.y", "--at", "none.json"],
            "--at: none.json: cannot be read: No such file or directory; workbench trim --json writes a point",
        ),
    ],
)
def test_a_loop_asked_for_wrongly(
    options: list[str], words: str, lags: Path, held: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert run(["loop", str(lags), *(text.format(held=held) for text in options)]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"workbench: {words}"


def test_compare_takes_a_point_for_each_model(lags: Path, held: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = lags.with_name("compare.json")
    windows = ["--output", "y", "--window", "0:0.5", "--label", "a", "--label", "b", "--in-process"]
    both = ["simulate", str(lags), str(lags), *windows]
    assert run([*both, "--at", str(held), "--at", str(held), "--json", str(out)]) == 0
    for entry in written(out)["motions"]:
        assert entry["peak"] == pytest.approx(0.02 * 20.0 / 21.0)
    assert run([*both, "--at", str(held)]) == 2
    assert "--at: 1 operating points for 2 models" in capsys.readouterr().err


def test_delays_are_measured_from_the_point(folder: Path) -> None:
    path = folder / "cs.toml"
    path.write_text(MASTER, encoding="utf-8")
    with wb.load(path) as model:
        assert isinstance(model, MasterModel)
        point = wb.trim(model, u0={"r": 3.0})
        report = wb.delays(model, stop=1.0, step=0.01, at=point)
        assert isinstance(report, wb.DelayReport)
        assert report.operating_point is not None
        assert report.operating_point.u == {"r": 3.0}
        assert report.outputs[0].span == pytest.approx(0.0, abs=1e-6)  # it rests there


# -- the first sample --------------------------------------------------------------------------


def assert_first_sample(model: wb.Model, point: OperatingPoint) -> None:
    """The first sample of a run is the point."""
    names = [*point.x, *point.y] if model.interface == "me" else [*point.y]
    run_ = wb.simulate(model, stop=point.time + 1e-3, at=point, outputs=names, verify_step=False)
    for name in names:
        expected = {**point.y, **point.x}[name]
        assert run_.signals[name][0] == pytest.approx(expected, rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_the_first_sample_is_the_point_where_initial_equations_are(interface: str) -> None:
    """SmallNonlinear with its own states elsewhere, and ElevatorLaw with discrete ones."""
    with wb.load("fmu:SmallNonlinear", interface) as model:
        assert_first_sample(model, OperatingPoint(x={"x[1]": 0.3, "x[2]": -0.2}, u={"u": 0.05}))
    with wb.load("fmu:ElevatorLaw", interface) as law:
        point = wb.trim(law, u0={"side_stick": -0.3}).operating_point
        assert_first_sample(law, point)


@needs_gemseo
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_the_response_about_the_rest_of_a_mass_with_initial_equations(interface: str) -> None:
    """m·s'' + d·s' + c·s = f with m = 1, d = 10, c = 10⁴: 1/(c − ω² + j d ω), about y = f/c − 0.5."""
    with wb.load(gemseo_fmu("Mass_Damper")) as model:
        point = wb.trim(model, u0={"f": 10.0}).operating_point
    with wb.load(gemseo_fmu("Mass_Damper"), interface) as model:
        found = wb.nfr(model, "f", "y", [10.0], 1.0, at=point, drift_check=False, workers=wb.Workers(in_process=True))
        omega = 20.0 * np.pi
        assert found.response[0, 0] == pytest.approx(1.0 / (1e4 - omega**2 + 10j * omega), rel=1e-2)
        assert found.offset[0, 0] == pytest.approx(-0.499, rel=1e-6)
        assert found.operating_point is not None
        assert found.operating_point.u == {"f": 10.0}
        assert found.operating_point.x == pytest.approx(point.x, rel=1e-9, abs=1e-9)


def test_an_input_that_leaves_the_point_at_once_is_told() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        point = wb.trim(model, u0={"u": 3.0}).operating_point
        found = wb.simulate(model, stop=1.0, at=point, inputs={"u": wb.Constant(4.0)})
        assert found.notes == ("u is 3 at the operating point, but its signal begins at 4",)
        assert found.signals["y"][0] == pytest.approx(3.0)
        assert found.signals["u"][0] == 4.0


def test_workers_and_the_store_know_the_point(folder: Path) -> None:
    store, here = folder / "store", wb.Workers(in_process=True)
    points = [OperatingPoint(x={"x": level}, u={"u": level}) for level in (0.0, 3.0)]
    with wb.load("fmu:FirstOrderLag") as model:
        found = [
            wb.nfr(model, "u", "y", [0.5], 0.1, at=p, store=store, workers=here, drift_check=False) for p in points
        ]
        again = wb.nfr(model, "u", "y", [0.5], 0.1, at=points[1], store=store, workers=here, drift_check=False)
        elsewhere = wb.nfr(model, "u", "y", [0.5], 0.1, at=points[1], workers=wb.Workers(jobs=1), drift_check=False)
    assert [f.offset[0, 0] for f in found] == pytest.approx([0.0, 3.0], abs=1e-4)
    np.testing.assert_array_equal(again.offset, found[1].offset)
    np.testing.assert_array_equal(elsewhere.offset, found[1].offset)
    assert again.operating_point == elsewhere.operating_point == found[1].operating_point
