"""The default experiment of an FMU decides what nobody else decides, and the result says so."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.foreign_fmus import build_foreign
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.model.load import load
from workbench.point.trim.request import trim
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate

FULL = '<DefaultExperiment startTime="3" stopTime="5" tolerance="1e-4" stepSize="0.25" />'
INTERFACES = ["me", "cs"]


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_foreign(tmp_path_factory.mktemp("full"), experiment=FULL)


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_run_begins_and_ends_where_the_experiment_does(full: Path, interface: str) -> None:
    with load(full, interface) as model:
        result = simulate(model)
        assert "start: 3 s, from the FMU's default experiment; `start` changes it" in model.notes
        assert "tolerance: 0.0001, from the FMU's default experiment; `tolerance` changes it" in model.notes
    assert "stop: 5 s, from the FMU's default experiment; `stop` changes it" in result.notes
    assert (result.time[0], result.time[-1]) == (3.0, 5.0)
    np.testing.assert_allclose(result.signals["clock"], result.time, rtol=1e-12)
    np.testing.assert_allclose(result.signals["y[1,2]"], 1.0 - np.exp(3.0 - result.time), atol=1e-3)


def test_the_step_of_the_experiment_is_the_output_interval(full: Path) -> None:
    with load(full, "me") as model:
        np.testing.assert_allclose(simulate(model).time, np.linspace(3.0, 5.0, 9))
        assert len(simulate(model, interval=0.5).time) == 5
        many = simulate(model, stop=5003.0)  # 20,000 points of 0.25 s
    assert many.time[1] - many.time[0] == 1.0


@pytest.mark.parametrize("interface", INTERFACES)
def test_what_is_asked_for_comes_first(full: Path, interface: str) -> None:
    with load(full, interface, start=1.0, tolerance=1e-9) as model:
        result = simulate(model, stop=2.0)
        assert not any("experiment" in text for text in (*result.notes, *model.notes) if "step" not in text)
        assert simulate(model, stop=2.0, start_time=0.5).time[0] == 0.5
    assert (result.time[0], result.time[-1]) == (1.0, 2.0)
    assert result.signals["y[1,2]"][-1] == pytest.approx(1.0 - math.exp(-1.0), abs=1e-8)


def test_every_analysis_begins_there(full: Path) -> None:
    with load(full, "me", tolerance=1e-9) as model:
        assert trim(model, u0={"u": 2.0}).operating_point.time == 3.0

        response = nfr(model, "u", "y[1,2]", [0.5], 1.0, workers=Workers(in_process=True))
    assert response.gain[0][0] == pytest.approx(1.0 / math.hypot(1.0, math.pi), rel=1e-4)


def test_without_a_stop_time_one_line_asks_for_it(tmp_path: Path) -> None:
    with load(build_foreign(tmp_path)) as model, pytest.raises(InputError, match="has no default stop time"):
        simulate(model)
    with pytest.raises(InputError, match="start: nan is not a number"):
        load(build_foreign(tmp_path), start=math.nan)


def test_the_command_needs_no_stop(full: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "run.json"
    assert run(["simulate", str(full), "--in-process", "--json", str(file)]) == 0
    found = json.loads(file.read_text())
    assert (found["time"][0], found["time"][-1]) == (3.0, 5.0)
    told = capsys.readouterr().err
    assert "start: 3 s" in told
    assert "stop: 5 s" in told
    assert run(["simulate", str(full), "--start", "4", "--in-process", "--json", str(file)]) == 0
    assert json.loads(file.read_text())["time"][0] == 4.0


def test_recording_does_not_shorten_the_communication_step(tmp_path: Path) -> None:
    file = build_foreign(tmp_path, experiment='<DefaultExperiment stopTime="10" stepSize="0.2" />')
    with load(file, "cs") as model:
        np.testing.assert_allclose(simulate(model).time, np.linspace(0.0, 10.0, 51), rtol=1e-12)
    with load(file, "cs", step=0.001) as model:
        assert len(simulate(model).time) == 501
    with load(file, "cs", step=4.0) as model:
        np.testing.assert_allclose(simulate(model).time, [0.0, 4.0, 8.0, 10.0])
