"""Every request tells how far it is up to its end, and every command ends at Ctrl-C with what it has.

Nothing here waits by time: what stops a command is the first thing that it tells.
"""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.command_lines import LINES, write_files
from tests.lying_fmus import build_lying
from tests.mimic_fmus import build_mimic
from workbench.build.toolchain import host_only
from workbench.cli.app import run
from workbench.commands import REQUESTS, request_of
from workbench.errors import StoppedError
from workbench.jobs.job import Job
from workbench.jobs.options import InWorker, Worker
from workbench.point.lin.request import Lin
from workbench.point.lin.result import LinResult
from workbench.point.trim.request import Trim
from workbench.point.trim.result import TrimResult
from workbench.requests.progress_bar import Bar
from workbench.response.simulate.request import Simulate
from workbench.response.simulate.result import SimulationResult

# The lines that run in a worker, in this process.
_HERE = [
    (name, "--in-process")
    for name, (line, _) in LINES.items()
    if "--in-process" not in line and issubclass(request_of(name), InWorker)
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("jobs")
    write_files(path)
    return path


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch, folder: Path) -> list[float]:
    """What the command line's bar is told: the part done."""
    found: list[float] = []
    monkeypatch.chdir(folder)
    monkeypatch.setattr(Bar, "update", lambda _, done, __: found.append(done))
    monkeypatch.setattr("workbench.build.toolchain.PLATFORMS", host_only())
    return found


def test_every_request_has_a_line() -> None:
    assert set(LINES) == set(REQUESTS), "tests/command_lines.py: a line for each request of workbench/commands.py"


def texts_in(data: object) -> Iterator[str]:
    """Yield every text of JSON."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict | list):
        for part in data.values() if isinstance(data, dict) else data:
            yield from texts_in(part)


@pytest.mark.parametrize("name", LINES)
def test_it_tells_how_far_it_is(
    name: str, heard: list[float], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words: list[str] = []

    def update(_: Bar, done: float, text: str) -> None:
        heard.append(done)
        words.append(text)

    monkeypatch.setattr(Bar, "update", update)
    out = Path(f"{name}_words.json")
    assert run([*LINES[name][0].split(), "--json", str(out)]) == 0, capsys.readouterr().err
    assert not re.findall(r"`\w+(?:=[^`]*)?`", "".join(capsys.readouterr())), "options of Python on the command line"
    told = json.loads(out.read_text(encoding="utf-8"))
    flags = re.compile(r"(?<![\w-])--[a-z]")
    assert not [text for text in texts_in(told) if flags.search(text) and "workbench " not in text], "flags in Python"
    assert heard == sorted(heard)
    assert heard[0] >= 0.0
    assert heard[-1] == 1.0
    assert not [text for text in words if re.search(r"\w\(\w*=| object at 0x", text)], "an object, not words"


# The part done from which on there is something to keep, where it is not there with the first that is told: a power of
# `bla` needs all its realisations.
KEEPS_FROM = {"bla": 0.5}


@pytest.mark.parametrize("name", LINES)
def test_it_ends_at_ctrl_c_with_what_it_has(
    name: str, folder: Path, heard: list[float], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: Bar, done: float, __: str) -> None:
        if done < KEEPS_FROM.get(name, 0.0):
            return
        if not heard:
            os.kill(os.getpid(), signal.SIGINT)
        heard.append(done)

    monkeypatch.setattr(Bar, "update", interrupt)
    monkeypatch.setattr("workbench.jobs.pool._GRACE", 60.0)  # on a busy machine
    line, kept = LINES[name]
    out = folder / f"{name}_out.json"
    assert run([*line.split(), "--json", str(out)]) == 130
    said = [text for text in capsys.readouterr().err.splitlines() if "interrupted" in text]
    assert len(said) == 1
    assert said[0].startswith("note: interrupted after ")
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["failure"]["kind"] == "cancelled"
    assert not kept or kept in written


@pytest.mark.parametrize(("name", "where"), [*((name, "") for name in LINES), *_HERE])
def test_ctrl_c_when_all_is_done_loses_nothing(
    name: str,
    where: str,
    folder: Path,
    heard: list[float],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = LINES[name][0]

    def interrupt(_: Bar, done: float, __: str) -> None:
        if done == 1.0 and 1.0 not in heard:
            os.kill(os.getpid(), signal.SIGINT)
        heard.append(done)

    monkeypatch.setattr(Bar, "update", interrupt)
    monkeypatch.setattr("workbench.jobs.pool._GRACE", 60.0)
    whole, out = folder / f"{name}_words.json", folder / f"{name}_out.json"  # the first was written above
    assert run([*line.split(), *where.split(), "--json", str(out)]) == 130, capsys.readouterr().err
    cut = json.loads(out.read_text(encoding="utf-8"))
    assert cut.pop("failure")["kind"] == "cancelled"
    heard[:] = [1.0]
    assert whole.exists() or run([*line.split(), "--json", str(whole)]) == 0
    assert set(json.loads(whole.read_text(encoding="utf-8"))) <= set(cut)


def test_python_hands_out_what_there_is_with_the_interrupt() -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(StoppedError) as stopped:
        wb.lin_over(model, {"tau": [0.5, 1.0]}, progress=stop, in_process=True)
    grid = stopped.value.before
    assert isinstance(grid, wb.LinGrid)
    assert [point.result is not None for point in grid.points] == [True, False]


@pytest.mark.parametrize("place", [None, Worker()])
def test_a_system_that_python_steps_is_stopped_between_its_steps(folder: Path, place: Worker | None) -> None:
    told: list[tuple[int, int]] = []

    def stop(_: object, done: int, total: int) -> None:
        told.append((done, total))
        job.stop()

    job = Job(stop)
    asked = Simulate(stop=1e4, interval=0.01, inputs={"reference": "step:time=0.1,value=1"}, workers=place)
    with wb.load(folder / "master.toml", step=0.01) as model, pytest.raises(KeyboardInterrupt):
        asked.run(model, job)
    cut = job.partial()
    assert isinstance(cut, SimulationResult)
    assert cut.ended_at == float(cut.time[-1])
    assert 0.0 < cut.ended_at < 1e4
    assert told[0][1] == 100


def _stopped(asked: Lin | Trim, model: wb.Model, after: int) -> tuple[object, list[str]]:
    """Return what there is of a request that is stopped when so many parts are done, and what it said."""
    said: list[str] = []

    def stop(_: object, done: int, __: int) -> None:
        if done >= after:
            job.stop()

    job = Job(stop)
    job.say = said.append
    with pytest.raises(KeyboardInterrupt):
        asked.run(model, job)
    return job.partial(), said


def test_a_slow_trim_says_what_it_costs_and_leaves_its_best_point(tmp_path: Path) -> None:
    """Also from a worker, and at a time limit: what was told last is kept."""
    with wb.load(build_mimic(tmp_path, "slow"), interface="cs") as model:
        best, said = _stopped(Trim(workers=Worker()), model, 1)
    assert isinstance(best, TrimResult)
    assert not best.converged
    assert best.operating_point.time == pytest.approx(64 * 0.02)
    assert best.operating_point.y["y"] == pytest.approx(1.0, abs=0.2)
    assert [r.name for r in best.residuals] == ["movement of output y"]
    assert len(said) == 1
    assert "a second of this model takes" in said[0]


def test_a_slow_linearisation_says_what_it_costs_and_leaves_what_nothing_has_tested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workbench.point.lin.pulses.SLOW", 0.0)
    with wb.load(build_mimic(tmp_path, "orderly"), interface="cs") as model:
        before, said = _stopped(Lin(workers=Worker(in_process=True)), model, 1)
        found, _ = _stopped(Lin(workers=Worker(in_process=True)), model, 4)
    assert before is None
    assert len(said) == 1
    assert "at least 4 are coming" in said[0]
    assert isinstance(found, LinResult)
    assert [d.column for d in found.doubts] == ["u"]
    natural = np.abs(np.log(np.linalg.eigvals(found.A).astype(complex))) / found.dt
    assert np.min(np.abs(natural - 10.0)) < 0.01


def test_a_linear_model_that_was_refused_is_not_left_as_what_there_is(tmp_path: Path) -> None:
    """Pulses give a model of an FMU that takes its inputs late, which other pulses refuse."""
    job = Job()
    with (
        wb.load(build_lying(tmp_path, "late-inputs"), interface="cs") as model,
        pytest.raises(wb.WorkbenchError) as why,
    ):
        Lin(workers=Worker(in_process=True)).run(model, job)
    assert "there is no linear model" in str(why.value)
    assert job.partial() is None
