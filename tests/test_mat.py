"""Records as MATLAB files, read back by SciPy."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

import workbench as wb
from tests.record_examples import Maker
from tests.test_records import RECORDS, example
from workbench.cli.app import run
from workbench.core.records.mat_file import matlab_names
from workbench.show.result import Result


def read(path: Path) -> dict[str, Any]:
    return {name: held for name, held in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}


def test_a_linear_model_is_read_back_with_its_names(tmp_path: Path) -> None:
    path = tmp_path / "lin.mat"
    assert run(["lin", "fmu:Rudder", "--inputs", "delC", "--mat", str(path)]) == 0
    with wb.load("fmu:Rudder") as rudder:
        linear = wb.lin(rudder, inputs=["delC"])
    linear.to_mat(tmp_path / "python.mat")
    assert read(tmp_path / "python.mat").keys() == read(path).keys()
    data = loadmat(path)
    for name in "ABCD":
        np.testing.assert_array_equal(data[name], getattr(linear, name))  # two dimensions, also with one input
    for name in ("state_names", "input_names", "output_names"):
        assert [str(cell[0]) for cell in data[name].ravel()] == list(getattr(linear.result, name))


def test_a_response_is_read_back_complex_and_with_units(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as lag:
        response = wb.nfr(lag, "u", "y", [0.1, 1.0], [1.0, 2.0])
    response.to_mat(tmp_path / "nfr.mat")
    data = read(tmp_path / "nfr.mat")
    np.testing.assert_array_equal(data["response"], response.response)
    np.testing.assert_array_equal(data["frequency_hz"], response.frequency_hz)
    assert data["response"] == pytest.approx(
        np.tile(1.0 / (1.0 + 2j * np.pi * response.frequency_hz), (2, 1)), rel=1e-3
    )
    assert (data["units"]["frequency_hz"], data["units"]["phase_deg"]) == ("Hz", "deg")


def test_a_time_history_has_the_names_that_matlab_allows(tmp_path: Path) -> None:
    outputs = ["plant.del", "gain.y", "del"]
    with wb.load("system:rudder_loop") as loop:
        history = wb.simulate(loop, stop=0.1, inputs={"reference": wb.Constant(2.0)}, outputs=outputs)
    history.to_mat(tmp_path / "history.mat")
    data = read(tmp_path / "history.mat")
    np.testing.assert_array_equal(data["time"], history.time)
    np.testing.assert_array_equal(data["signals"]["plant_del"], history["plant.del"])
    assert data["original_names"]["plant_del"] == "plant.del"
    assert "del" not in data["original_names"]
    assert data["units"]["plant_del"] == history.units["plant.del"]
    assert data["units"]["time"] == "s"
    assert loadmat(tmp_path / "history.mat")["time"].shape == (len(history.time), 1)


def test_names_are_made_valid_and_stay_different() -> None:
    names = ["a.b", "a_b", "der(x)", "x[1]", "1st", "_q", "end", "", "π", "n" * 70, "n" * 71]
    made = matlab_names(names)
    assert list(made.values()) == [
        "a_b", "a_b_2", "der_x", "x_1", "x_1st", "x_q", "x_end", "x", "x_2", "n" * 63, f"{'n' * 61}_2"
    ]  # fmt: skip


@pytest.mark.parametrize("kind", RECORDS, ids=lambda kind: kind.__name__)
def test_every_record_is_written_and_its_arrays_are_there(kind: type[Result], tmp_path: Path) -> None:
    record, path = example(kind), tmp_path / "record.mat"
    record.to_mat(path)
    data = read(path)
    declared = {declared.name for declared in fields(record)} | {"units", "original_names"}
    assert data.keys() <= set(matlab_names(declared).values())
    for name, held in vars(record).items():
        if isinstance(held, np.ndarray) and held.dtype.kind in "iufc":
            np.testing.assert_array_equal(np.squeeze(data[name]), np.squeeze(held))


@pytest.mark.parametrize("empty", [False, True])
def test_a_record_without_content_is_written_too(empty: bool, tmp_path: Path) -> None:
    record = Maker(empty=empty).record(wb.SimulationResult)
    record.to_mat(tmp_path / "x.mat")
    assert np.size(read(tmp_path / "x.mat")["time"]) == np.size(record.time)


def test_another_suffix_is_refused_before_anything_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "fmu:FirstOrderLag", "--stop", "1", "--mat", "x.csv"]) == 2
    assert "--mat: 'x.csv' must end in .mat" in capsys.readouterr().err
    with pytest.raises(wb.InputError, match=r"must end in \.mat"):
        Maker(empty=False).record(wb.SimulationResult).to_mat(tmp_path / "x.txt")


def test_a_study_writes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = 'models.lag = "fmu:FirstOrderLag"\nanalyses.lin = {command = "lin", model = "lag", mat = "lag.mat"}\n'
    Path("study.toml").write_text(text, encoding="utf-8")
    assert wb.run_study("study.toml", store=None, jobs=1).passed
    assert read(tmp_path / "lag.mat")["A"] == pytest.approx(-1.0)
