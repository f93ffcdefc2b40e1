"""Data of a system whose loop is closed say so, from the wiring alone; the wiring is the truth here."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.data.experiment.experiment import read_experiment
from workbench.errors import InputError

LOOP = """
[components]
plant = "fmu:FirstOrderLag"
filter = "fmu:FirstOrderLag"
controller = {gain = 4.0}
error = {sum = "+-"}
[connections]
"error.u1" = "filter.y"
"error.u2" = "plant.y"
"controller.u" = "error.y"
"plant.u" = "controller.y"
[inputs]
reference = "filter.u"
[outputs]
y = "plant.y"
u = "controller.y"
smooth = "filter.y"
"""


def recorded(text: str, folder: Path, outputs: str = "y,u,smooth", samples: int = 400) -> Path:
    """Write the data of an experiment on a system."""
    system, data = folder / "system.toml", folder / "data.csv"
    system.write_text(text, encoding="utf-8")
    command = ["excite", str(system), "--input", "reference", "--outputs", outputs, "--prbs", "amplitude=1"]
    count = ["--samples", str(samples), "--validation", "0"]
    assert run([*command, "--step", "0.1", *count, "--csv", str(data), "--json", str(folder / "excite.json")]) == 0
    return data


@pytest.mark.parametrize(
    ("source", "target", "words"),
    [
        ("reference", "y", "reference acts on the closed loop of plant, controller and error in system system"),
        ("u", "y", "u is inside the closed loop of plant, controller and error in system system: it reacts"),
        ("smooth", "y", "smooth acts on the closed loop of plant, controller and error in system system"),
        ("reference", "smooth", ""),  # the filter stands before the loop
    ],
)
def test_identification_says_first_what_the_wiring_knows(
    source: str, target: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = recorded(LOOP, tmp_path)
    capsys.readouterr()
    command = ["identify", str(data), "--input", source, "--output", target, "--order", "1"]
    assert run([*command, "--json", str(tmp_path / "found.json")]) in (0, 1)
    lines = capsys.readouterr().out.splitlines()
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert lines[1].startswith("This is not a model of the plant: the data come from a closed loop.") == bool(words)
    assert any(line.startswith(f"failed: NOT A MODEL OF THE PLANT: {words}") for line in lines) == bool(words)
    assert (found["closed_loop"] is True) == bool(words)
    assert json.loads((tmp_path / "excite.json").read_text(encoding="utf-8"))["closed_loops"][0]["system"] == "system"


def test_the_data_keep_it_whatever_is_done_to_them(tmp_path: Path) -> None:
    data = read_experiment(recorded(LOOP, tmp_path), inputs=["reference"], outputs=["y", "u"])
    (loop,) = data.loops
    assert loop.components == ("plant", "controller", "error")
    assert loop.acting == ("reference", "y", "u", "smooth")
    assert loop.inside == loop.showing == ("y", "u")
    for other in (data.part(5), data.select(["u"], ["y"]), data.with_data(y=2.0 * data.y), wb.detrend(data).experiment):
        assert other.loops == data.loops
    data.to_csv(tmp_path / "again.csv")
    assert read_experiment(tmp_path / "again.csv", inputs=["reference"], outputs=["y", "u"]).loops == data.loops


@pytest.mark.parametrize(
    "text",
    [
        LOOP.replace('"error.u2" = "plant.y"\n', ""),  # a chain
        LOOP.replace('"error.u2" = "plant.y"', '"error.u2" = {from = "plant.y", closes_at = 1000.0}'),  # closed later
    ],
)
def test_what_is_not_closed_is_not_marked(text: str, tmp_path: Path) -> None:
    data = recorded(text, tmp_path)
    assert data.read_text(encoding="utf-8").startswith("time [s],reference")
    assert read_experiment(data, inputs=["reference"], outputs=["y"]).loops == ()


def test_one_model_has_no_loop_and_a_broken_remark_is_refused(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        assert model.closed_loops(["u", "y"], until=1.0) == ()
    text = '# closed loop {"system": 3\ntime [s],u,y\n' + "".join(f"{k},{k % 2},{k % 3}\n" for k in range(50))
    (tmp_path / "broken.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.csv: cannot read the comment"):
        read_experiment(tmp_path / "broken.csv", inputs=["u"], outputs=["y"])
