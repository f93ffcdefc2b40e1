"""An FMU that ends its own run has answered: the result says when, and nothing before is lost."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.drivers import DRIVERS
from tests.foreign_fmus import build_foreign, build_shy
from tests.hostile_fmus import build_hostile
from workbench.cli.app import run
from workbench.errors import EndedError, SimulationError
from workbench.jobs.options import Workers
from workbench.model.load import load
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult

GRID = np.linspace(0.03, 0.99, 33)  # 0.5 s lies between two of them
LATE = 0.01  # a solver's step beyond the end, for the FMU that ends with a step


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
@pytest.mark.parametrize(("name", "interface"), [("event", "me"), ("event", "cs"), ("step", "me"), ("step", "cs")])
def test_the_result_ends_where_the_fmu_ends_it(tmp_path: Path, name: str, interface: str, driver: str) -> None:
    with load(build_foreign(tmp_path, name), interface, tolerance=1e-9, step=0.03) as model:
        result = simulate(model, stop=0.99, points=GRID)
    assert result.failed is None
    assert result.ended_at == pytest.approx(0.5, abs=1e-12 if (name, interface) != ("step", "me") else 0.5)
    assert result.ended_at is not None
    assert result.ended_at >= 0.5
    assert result.time[-1] == result.ended_at
    np.testing.assert_allclose(result.signals["y[1,2]"], 1.0 - np.exp(-result.time), atol=1e-7)
    assert [t for t in result.time if t < 0.5] == [0.0, *GRID[GRID < 0.5]]
    assert any("the FMU ended its run" in text and "before 0.99 s" in text for text in result.notes)


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_an_fmu_of_fmi_3_that_ends_its_run(tmp_path: Path, driver: str) -> None:
    with load(build_shy(tmp_path, "ends"), step=0.03) as model:
        result = simulate(model, stop=0.99, points=GRID)
    assert (result.ended_at, result.time[-1]) == (0.5, 0.5)
    np.testing.assert_allclose(result.signals["y"], 1.0 - np.exp(-result.time), rtol=1e-9)


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_a_session_keeps_what_it_recorded(tmp_path: Path, driver: str) -> None:
    words = r"the FMU ended its run \(at t = 0\.5 s\)"
    with (
        load(build_foreign(tmp_path, "event"), "me") as model,
        model.open_session() as session,
        pytest.raises(EndedError, match=words) as caught,
    ):
        session.advance(2.0, signals={}, record=["clock"], points=GRID)
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301  as it comes from a worker
    assert (type(again), str(again), again.time) == (EndedError, str(caught.value), 0.5)
    assert again.before.time[-1] == 0.5
    np.testing.assert_allclose(again.before.values["clock"], again.before.time)


def test_a_failed_run_hands_over_what_came_before(tmp_path: Path) -> None:
    fmu = build_hostile(tmp_path, "error")
    with load(fmu, "cs", step=0.01) as model, pytest.raises(SimulationError, match="the pump ran dry") as caught:
        simulate(model, stop=1.0, points=GRID)
    before = caught.value.before
    assert isinstance(before, SimulationResult)
    assert before.failed == str(caught.value)
    assert before.ended_at == pytest.approx(0.5, abs=0.02)
    assert 0.45 < before.time[-1] <= 0.5


def test_the_command_says_so_everywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = build_foreign(tmp_path, "event")
    out, table = tmp_path / "run.json", tmp_path / "run.csv"
    assert run(["simulate", str(fmu), "--stop", "1", "--json", str(out), "--csv", str(table)]) == 0
    found = json.loads(out.read_text())
    assert (found["ended_at"], found["failed"], found["time"][-1]) == (0.5, None, 0.5)
    assert table.read_text().splitlines()[-1] == "# ended at 0.5 s: by the FMU itself"
    told = capsys.readouterr()
    assert "from 0 to 0.5 s" in told.out
    assert "note: the FMU ended its run (at t = 0.5 s), before 1 s" in told.err
    failing = build_hostile(tmp_path, "error")
    assert run(["simulate", str(failing), "--stop", "1", "--json", str(out)]) == 2
    found = json.loads(out.read_text())
    assert "the pump ran dry" in found["failed"]
    assert 0.4 < found["ended_at"] < 0.6


def test_a_point_that_the_fmu_does_not_live_to_see_fails_by_name(tmp_path: Path) -> None:
    with load(build_foreign(tmp_path, "event"), "me") as model:
        response = nfr(model, "u", "y[1,2]", [1.0, 50.0], 1.0, workers=Workers(in_process=True))
    (slow,) = [f for f in response.failed if f.frequency_hz == 1.0]
    assert "the FMU ended its run (at t = 0.5 s)" in slow.reason
    assert math.isnan(response.gain[0][0])


def test_the_events_ahead_end_where_the_fmu_ends_its_run(tmp_path: Path) -> None:
    with load(build_foreign(tmp_path, "event"), "me") as model, model.open_point() as point:
        np.testing.assert_allclose(point.ticks(5, math.inf), [0.5])
        assert point.at(np.array([0.25]), np.array([1.0])).dx == pytest.approx([0.75])


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_no_step_is_shortened_for_a_run_that_ends(tmp_path: Path, interface: str) -> None:
    """The reason is that the FMU ends its run, and a shorter communication step would not help."""
    with load(build_foreign(tmp_path, "event"), interface) as model:
        found = nfr(model, "u", "y[1,2]", [5.0], [0.1], workers=Workers(in_process=True))
    (failed,) = found.failed
    assert failed.reason == "the FMU ended its run (at t = 0.5 s)"
