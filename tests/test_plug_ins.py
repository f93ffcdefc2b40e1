"""Plug-ins: one of each kind from an installed package, everywhere that the workbench's own are; and broken ones."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import workbench as wb
from tests.test_confine import needs_landlock
from workbench.cli.app import run
from workbench.core.records import plug_ins
from workbench.errors import InputError
from workbench.requests.kept import origin_of
from workbench.study.fingerprint import code_hash

EXAMPLE = Path(__file__).parents[1] / "examples" / "plugin"
NAME = "workbench-example 0.1.0"
LAG = ["fmu:FirstOrderLag", "--bias", "u=1"]  # 1/(s + 1), from rest: y = 1 - exp(-t)
DRIFT = 1.0 - math.exp(-1.0)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the example, built as pip builds it."""
    folder = tmp_path_factory.mktemp("built")
    source = shutil.copytree(EXAMPLE, folder / "plugin", ignore=shutil.ignore_patterns("__pycache__"))
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=source, check=True)
    (result,) = folder.glob("*.whl")
    return result


@pytest.fixture
def path(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Path], None]]:
    """Puts a folder of packages on the path; afterwards all is as before."""
    plug_ins._faults.clear()
    yield lambda folder: monkeypatch.syspath_prepend(str(folder))
    plug_ins._faults.clear()
    for name in [n for n in sys.modules if n.partition(".")[0] in {"workbench_example", "broken"}]:
        del sys.modules[name]
    vars(wb).pop("drift", None)


@pytest.fixture
def site(wheel: Path, tmp_path: Path, path: Callable[[Path], None]) -> Path:
    """A folder of packages in which the example is installed, and nothing else."""
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    path(site)
    return site


def in_json(arguments: list[str], folder: Path) -> Mapping[str, Any]:
    """Return what a command that ends well writes."""
    file = folder / "result.json"
    assert run([*arguments, "--json", str(file)]) == 0
    result: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return result


# -- one of each -------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [[], ["--in-process"], pytest.param(["--confine"], marks=needs_landlock)])
def test_an_analysis_is_a_command(site: Path, tmp_path: Path, where: list[str]) -> None:
    found = in_json(["drift", *LAG, "--stop", "1", *where], tmp_path)
    assert (found["command"], found["outputs"]) == ("drift", ["y"])
    assert found["drift"] == pytest.approx([DRIFT], rel=1e-5)


def test_an_analysis_is_a_function(site: Path, tmp_path: Path) -> None:
    assert "drift" in dir(wb)
    with wb.load("fmu:FirstOrderLag", bias={"u": 1.0}) as lag:
        found = wb.drift(lag, 1.0)  # type: ignore[attr-defined]
    assert found.drift == pytest.approx([DRIFT], rel=1e-5)
    origin = origin_of(found)
    assert origin is not None
    assert "wb.drift(model, 1.0)" in origin.call
    written = in_json(["drift", *LAG, "--stop", "1"], tmp_path)
    assert type(found).from_dict(written).drift == pytest.approx(found.drift, rel=1e-9)


def test_help_says_which_package_a_plug_in_is_from(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    listed = capsys.readouterr().out.partition("From other packages:")[2]
    assert re.findall(r"^  (\S+)  ", listed, re.MULTILINE) == ["drift", "second_order", ".lvm", "drift"]
    assert listed.count(NAME) == 4
    assert run(["drift", "--help"]) == 0
    assert f"From the package {NAME}." in capsys.readouterr().out
    assert run(["drif"]) == 2
    assert "did you mean drift?" in capsys.readouterr().err


def test_a_block_is_part_of_a_system(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "system.toml"
    file.write_text(
        '[components]\nactuator = {block = "second_order", frequency = 2.0, damping = 0.25, gain = 3.0}\n'
        '[inputs]\nu = "actuator.u"\n[outputs]\ny = "actuator.y"\n',
        encoding="utf-8",
    )
    assert '"title": "second_order"' in json.dumps(wb.schema("system"))
    with wb.load(file) as system:
        model = wb.lin(system)
        identity = system.recipe.identity()
    w = 4.0 * math.pi
    assert np.sort_complex(np.linalg.eigvals(model.A)) == pytest.approx(
        [w * complex(-0.25, -s) for s in (math.sqrt(1 - 0.25**2), -math.sqrt(1 - 0.25**2))]
    )
    assert -model.C @ np.linalg.solve(model.A, model.B) == pytest.approx(np.array([[3.0]]))
    assert identity["system"]["components"]["actuator"]["package"] == NAME, "a store keeps apart what versions gave"
    assert run(["info", "--blocks", "second_order"]) == 0
    assert "Natural frequency." in capsys.readouterr().out


STUDY = """
[models]
lag = {{model = "fmu:FirstOrderLag", bias = {{u = 1.0}}}}
[analyses.rest]
command = "drift"
model = "lag"
stop = 1.0
[[requirements]]
name = "stays"
analysis = "rest"
kind = "drift"
max = {limit}
"""


@pytest.mark.parametrize(("limit", "code"), [(DRIFT + 0.01, 0), (DRIFT - 0.01, 1)])
def test_a_requirement_is_part_of_a_study(site: Path, tmp_path: Path, limit: float, code: int) -> None:
    file = tmp_path / "study.toml"
    file.write_text(STUDY.format(limit=limit), encoding="utf-8")
    kinds = [one["properties"]["kind"] for one in wb.schema("study")["properties"]["requirements"]["items"]["anyOf"]]
    assert {"const": "drift"} in kinds
    jsonschema.validate(tomllib.loads(file.read_text(encoding="utf-8"))["analyses"]["rest"], wb.schema("drift"))
    assert run(["run", str(file), "--store", str(tmp_path / "store")]) == code


def test_what_another_version_of_a_plug_in_measured_is_not_taken(site: Path) -> None:
    before = code_hash.__wrapped__()
    with (site / "workbench_example" / "drift.py").open("a", encoding="utf-8") as code:
        code.write("# another version\n")
    assert code_hash.__wrapped__() != before


LVM = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\nY_Unit_Label\tV\tmm\n***End_of_Header***\n"


def test_a_reader_is_asked_by_the_suffix(site: Path, tmp_path: Path) -> None:
    file = tmp_path / "bench.LVM"
    file.write_text(
        LVM + "X_Value\tvalve\tpiston\tComment\n0.0\t1.5\t2.5\n0.1\t1.6\t2.6\n0.2\t1.7\t2.7\n", encoding="utf-8"
    )
    data = wb.read_experiment(file, inputs=["valve"], outputs=["piston"])
    assert (data.u.ravel().tolist(), data.y.ravel().tolist()) == ([1.5, 1.6, 1.7], [2.5, 2.6, 2.7])
    assert data.dt == pytest.approx(0.1)
    file.write_text("no header", encoding="utf-8")
    with pytest.raises(InputError, match=r"bench\.LVM: has no line \*\*\*End_of_Header\*\*\*"):
        wb.read_experiment(file, inputs=["valve"], outputs=["piston"])
    file.write_text(LVM + "X_Value\tvalve\n0.0\tten\n", encoding="utf-8")
    with pytest.raises(InputError, match=f"the reader of the package {NAME} failed: ValueError: .*'ten'"):
        wb.read_experiment(file, inputs=["valve"], outputs=["piston"])


# -- broken ones -------------------------------------------------------------------------------


def installed(site: Path, package: str, declared: str, code: str = "") -> None:
    """Install a package that declares entry points."""
    facts = site / f"{package}-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n", encoding="utf-8")
    (facts / "entry_points.txt").write_text(declared, encoding="utf-8")
    (site / "broken.py").write_text(code, encoding="utf-8")


BROKEN = {
    "import": ("commands", "odd", "import nothing_of_this_name", "ModuleNotFoundError: No module named 'nothing_of_"),
    "ends": ("commands", "odd", "raise SystemExit(3)", "SystemExit: 3"),
    "gone": ("commands", "odd", "", "AttributeError: module 'broken' has no attribute 'Odd'"),
    "type": ("commands", "odd", "Odd = 3", "is not a request"),
    "taken": ("commands", "nfr", "", "the workbench has that name itself"),
    "moved": ("commands", "compare", "", "the workbench has that name itself"),
    "block": ("blocks", "odd", "class Odd: pass", "is not a block"),
    "requirement": ("requirements", "odd", "class Odd: pass", "is not a requirement"),
    "reader": ("readers", "odd", "def Odd(path): pass", "'odd' is not the suffix of a file"),
    "group": ("command", "odd", "", "its group is none of fmi_workbench.commands, "),
}
LISTS = {"blocks": ["info", "--blocks"], "requirements": ["schema", "study"]}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plug_in_gets_a_line_and_stops_nothing_else(
    name: str, tmp_path: Path, path: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    kind, what, code, message = BROKEN[name]
    installed(tmp_path, "acme", f"[fmi_workbench.{kind}]\n{what} = broken:Odd\n", code)
    path(tmp_path)
    assert run(["info", "fmu:FirstOrderLag"]) == 0
    assert "acme" not in capsys.readouterr().err, "who asks for the workbench's own hears nothing of plug-ins"
    for listing in (["--help"], *([LISTS[kind]] if kind in LISTS else [])):
        assert run(listing) == 0
        said = capsys.readouterr()
        told = [line for line in said.err.splitlines() if "acme" in line]
        assert len(told) == 1
        assert "of the package acme 1.0" in told[0]
        assert message in told[0]
        assert "acme" not in said.out, "what cannot be used is not listed"


BLOCK = """
import numpy as np
from workbench.system.block_table.base import Block, BlockStateSpace
from workbench.core.records.option import option
class Odd(Block):
    "Fails where its gain is negative, and has too few outputs where that is large."
    kind = "odd"
    gain: float = option("Gain.", default=1.0)
    def matrices(self):
        gain = np.full((0 if self.gain > 9.0 else 1, 1), self.gain**0.5 if self.gain >= 0.0 else 1 / 0)
        return BlockStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), gain)
"""


def test_what_goes_wrong_in_a_block_names_its_package(tmp_path: Path, path: Callable[[Path], None]) -> None:
    installed(tmp_path, "acme", "[fmi_workbench.blocks]\nodd = broken:Odd\n", BLOCK)
    path(tmp_path)
    file = tmp_path / "system.toml"
    whose = r"odd: the block of the package acme 1\.0"
    for gain, message in (
        (4.0, ""),
        (-1.0, f"{whose} failed: ZeroDivisionError: division by zero"),
        (10.0, rf"{whose}: its matrices have the shapes .* 0 states, 1 inputs and an output"),
    ):
        file.write_text(
            f'components.k = {{block = "odd", gain = {gain}}}\ninputs.u = "k.u"\noutputs.y = "k.y"\n', encoding="utf-8"
        )
        if message:
            with pytest.raises(InputError, match=message):
                wb.load(file)
        else:
            with wb.load(file) as system:
                assert wb.lin(system).D.tolist() == [[2.0]]


def test_whoever_asks_for_a_broken_plug_in_is_told(
    tmp_path: Path, path: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    installed(tmp_path, "acme", "[fmi_workbench.commands]\nodd = broken:Odd\n", "import nothing_of_this_name")
    path(tmp_path)
    assert run(["odd", "fmu:FirstOrderLag"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "command 'odd' of the package acme 1.0 cannot be used" in line
    with pytest.raises(AttributeError, match=r"no attribute 'odd'; command 'odd' of the package acme 1\.0"):
        _ = wb.odd  # type: ignore[attr-defined]


def test_neither_of_two_plug_ins_of_a_name_is_used(
    site: Path, tmp_path: Path, path: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    installed(tmp_path / "other", "acme", "[fmi_workbench.commands]\ndrift = broken:Odd\n")
    path(tmp_path / "other")
    assert run(["drift", *LAG, "--stop", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(part in line for part in ("'drift'", NAME, "acme 1.0", "uninstall all but one"))


def test_without_plug_ins_nothing_is_imported_for_them() -> None:
    """Reading all entry points would take half as long as the whole help."""
    code = (
        "import sys; from workbench.cli.app import run; run(['--help']); sys.exit('importlib.metadata' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, stdout=subprocess.DEVNULL).returncode == 0


@pytest.mark.parametrize("damage", ["METADATA", "entry_points.txt"])
def test_a_damaged_package_stops_nothing(
    damage: str, site: Path, tmp_path: Path, path: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    installed(tmp_path / "other", "acme", "[fmi_workbench.commands]\nodd = broken:Odd\n")
    file = tmp_path / "other" / "acme-1.0.dist-info" / damage
    file.write_text("[fmi_workbench.commands]\nodd\n" if damage == "entry_points.txt" else "", encoding="utf-8")
    path(tmp_path / "other")
    assert run(["--help"]) == 0
    out, err = capsys.readouterr()
    assert NAME in out
    assert "acme" in err or "broken:Odd" in err
