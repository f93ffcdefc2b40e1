"""What a command tells one to do instead, and which files it says that it has written."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.cli.app import run

RUN = ["simulate", "fmu:FirstOrderLag", "--step", "0.01", "--stop", "3"]


def record_of(folder: Path) -> Path:
    """Write a record of the lag, by the tool itself, under a step."""
    file = folder / "lag.csv"
    assert run([*RUN, "--input", "u=step:time=1,value=1", "--csv", str(file)]) == 0
    return file


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["trim", "fmu:Rudder", "--u0", "delC=600,p_PS=35"], "--u0: one name and value at a time; repeat the option"),
        (["trim", "fmu:Rudder", "--u0", "delC=1deg, a=2"], "repeat the option for each: delC=1deg and a=2"),
        (["simulate", "fmu:Rudder", "--interval", "0.001"], "--interval is for several models; use --step"),
        (["simulate", "fmu:Rudder", "--window", "1:2"], "--window is for several models; leave it out"),
    ],
)
def test_the_way_to_say_it_is_told(line: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(line) == 2
    assert told in capsys.readouterr().err


def test_a_wrong_heading_is_told_with_the_option_that_names_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rig.csv"
    file.write_text("time,valve,pos\n" + "".join(f"{0.1 * k},1,{1.0 - 0.9**k}\n" for k in range(40)))
    line = ["calibrate", "fmu:FirstOrderLag", str(file), "--free", "tau"]
    assert run(line) == 2
    said = capsys.readouterr().err
    assert "say with --output which output is in which column, as y=pos; columns: valve, pos" in said
    run([*line, "--output", "y=pos"])
    assert "--input says which input is in which column, as u=column" in capsys.readouterr().err


def test_files_that_an_analysis_writes_itself_are_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fitted.toml"
    assert run(["calibrate", "fmu:FirstOrderLag", str(record_of(tmp_path)), "--free", "tau", "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert out.exists()
    assert f"wrote {out}" in told.out + told.err


def test_a_record_of_the_tool_itself_has_two_rows_at_one_time_only_where_they_differ(tmp_path: Path) -> None:
    with record_of(tmp_path).open() as opened:
        rows = [[float(x) for x in row] for row in list(csv.reader(opened))[1:]]
    pairs = [(a, b) for a, b in itertools.pairwise(rows) if a[0] == b[0]]
    assert len(pairs) == 1  # the step of the input
    assert all(a != b for a, b in pairs)
    with wb.load("fmu:Rudder") as rudder:  # whose events are more than its outputs show
        found = wb.simulate(rudder, inputs={"delC": wb.Sine(amplitude=30.0, frequency=2.0)}, stop=2.0)
    again = np.flatnonzero(np.diff(found.time) == 0.0)
    assert all(any(v[k] != v[k + 1] for v in found.signals.values()) for k in again)


@pytest.mark.parametrize(("repeated", "told"), [("1,2,3", ""), ("1,2,4", "1 time appears twice with other values")])
def test_rows_that_are_given_twice_are_told_of_where_they_differ(tmp_path: Path, repeated: str, told: str) -> None:
    file = tmp_path / "data.csv"
    file.write_text(f"time,u,y\n0,1,2\n1,2,3\n{repeated}\n2,3,4\n3,3,4\n")
    notes = wb.read_experiment(file, inputs=["u"], outputs=["y"]).notes
    assert [note for note in notes if "twice" in note and told in note] or not told
    assert bool(told) == any("twice" in note for note in notes)


def test_a_column_without_a_unit_that_is_a_plain_number_needs_no_word() -> None:
    data = wb.make_experiment(0.1, [0.0, 1.0], [0.0, 1.0], input_names=["u"], output_names=["y"])
    assert data.in_units({"u": "1"}).notes == data.notes
    assert any("y has no unit" in note for note in data.in_units({"y": "m"}).notes)


def test_a_knot_of_a_straight_input_is_one_row() -> None:
    """Either side of it may have the line at another rounding; xarray and pandas want each time once."""
    t = np.linspace(0.0, 2.0, 201)
    with wb.load("fmu:FirstOrderLag") as model:
        found = wb.simulate(model, stop=2.0, inputs={"u": wb.Table(t.tolist(), np.sin(t).tolist())}, points=t[1:])
    assert found.time.tolist() == t.tolist()
