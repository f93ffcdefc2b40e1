"""Every request tells how far it is up to its end, and every command ends at Ctrl-C with what it has.

Nothing here waits by time: what stops a command is the first thing that it tells.
"""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.analysis.commands import REQUESTS
from workbench.analysis.simulate.request import Simulate
from workbench.analysis.simulate.result import SimulationResult
from workbench.cli.app import run
from workbench.core.job import Job
from workbench.core.progress import Bar
from workbench.core.where import Worker
from workbench.errors import StoppedError
from workbench.toolchain import host_only

LAGS = """
[components]
a = "fmu:FirstOrderLag"
b = "fmu:FirstOrderLag"
c = "fmu:FirstOrderLag"
[connections]
"b.u" = "a.y"
"c.u" = "b.y"
[inputs]
u = "a.u"
[outputs]
y = "c.y"
"""
# Three lags in a loop with a saturation, whose gain of 10 is more than the 8 that they tolerate.
LOOP = """
[components]
block = {model = "fmu:Saturation", set = {"C[1]" = 0.0, "C[2]" = 0.0, D = 1.0}}
a = "fmu:FirstOrderLag"
b = "fmu:FirstOrderLag"
c = "fmu:FirstOrderLag"
[connections]
"block.u" = {from = "c.y", gain = -10.0}
"a.u" = "block.y"
"b.u" = "a.y"
"c.u" = "b.y"
[outputs]
y = "c.y"
"""
BRAKED = """
[components]
block = {model = "fmu:Saturation", set = {"C[1]" = 0.0, "C[2]" = 0.0, D = 1.0}}
brake = {sum = "+-"}
plant = "fmu:FirstOrderLag"
[connections]
"brake.u2" = "block.y"
"plant.u" = "brake.y"
"block.u" = "plant.y"
[inputs]
u = "brake.u1"
[outputs]
y = "plant.y"
"""
MASTER = """
[components]
gain = {gain = 3.0}
plant = {model = "fmu:FirstOrderLag", interface = "cs"}
[connections]
"plant.u" = "gain.y"
[inputs]
reference = "gain.u"
[outputs]
y = "plant.y"
"""
LAG = """
model Lag
  input Real u;
  output Real y;
  Real x(start = 0);
equation
  der(x) = u - x;
  y = x;
end Lag;
"""

LAG_FMU = "fmu:FirstOrderLag"
SWEEP = "--input u --output y --freq 0.1,0.2 --amplitude 1 --in-process"
DESIGN = "braked.toml --block block --to brake.u1 --orders 1,1 --low-pass-order 0 --band 0.01:1"
# Request → its command line, the words of what it has when the first thing that it tells stops it; "": nothing. Those
# of nothing run in this process: a worker may be done before it hears that it should stop, and then has everything.
LINES = {
    "info": (f"{LAG_FMU} --no-probe", "model"),
    "simulate": (f"{LAG_FMU} --stop 300 --step 0.05 --input u=1", "time"),
    "nfr": (f"{LAG_FMU} {SWEEP}", "gain_db"),
    "trim": (f"{LAG_FMU} --u0 u=2", "converged"),
    "lin": (f"{LAG_FMU} --over tau=0.5,1,2", "systems"),
    "loop": ("loop.toml --open c.y --amplitude 1,2 --freq 0.1,0.2 --how inject --refine 0 --in-process", "measured"),
    "delays": ("master.toml --stop 1 --input reference=1 --step 0.02 --in-process", ""),
    "limit-cycle": ("loop.toml --block block --method shooting --vary gain=0.9:1.2 --in-process", ""),
    "feedback": ("lags.toml --from c.y --to a.u", "stable_gains"),
    "feed-forward": (f"{DESIGN} --input u=pulse:value=1,duration=0.1 --stop 2 --crude", "filter"),
    "modes": (f"{LAG_FMU} --vary tau=0.5:2 --points 3 --against tau=1 --in-process", ""),
    "compare": (f"{LAG_FMU} {LAG_FMU} --label one --label two --signal y --input u=1 --window 0:1", "motions"),
    "check": (f"{LAG_FMU} --interface me --only runs,reset", "checks"),
    "excite": (f"{LAG_FMU} --input u --output y --prbs amplitude=1,rate=2 --step 0.05 --in-process", "files"),
    "identify": ("data.csv --input u --output y --order 1", ""),
    "reproduce": ("fig31 --list", "targets"),
    "build": ("Lag.mo --out Lag.fmu --fmi 3", "files"),
    "export": ("lin.json --out linear.fmu --fmi 3", "platforms"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("jobs")
    systems = {"lags": LAGS, "loop": LOOP, "braked": BRAKED, "master": MASTER}
    for name, text in systems.items():
        (path / f"{name}.toml").write_text(text, encoding="utf-8")
    (path / "Lag.mo").write_text(LAG, encoding="utf-8")
    with wb.load("fmu:FirstOrderLag") as model:
        (path / "lin.json").write_text(json.dumps(wb.lin(model).to_dict()), encoding="utf-8")
    u = np.where(np.random.default_rng(1).random(400) < 0.5, -1.0, 1.0)
    y = np.zeros_like(u)
    for k in range(1, len(u)):  # a lag of 0.1 s, sampled every 0.05 s
        y[k] = y[k - 1] + (1.0 - np.exp(-0.5)) * (u[k - 1] - y[k - 1])
    rows = np.column_stack([0.05 * np.arange(len(u)), u, y])
    np.savetxt(path / "data.csv", rows, delimiter=",", header="time,u,y", comments="")
    return path


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch, folder: Path) -> list[float]:
    """What the command line's bar is told: the part done."""
    found: list[float] = []
    monkeypatch.chdir(folder)
    monkeypatch.setattr(Bar, "update", lambda _, done, __: found.append(done))
    monkeypatch.setattr("workbench.build.fmu.PLATFORMS", host_only())
    return found


def test_every_request_has_a_line() -> None:
    assert set(LINES) == set(REQUESTS)


@pytest.mark.parametrize("name", LINES)
def test_it_tells_how_far_it_is(name: str, heard: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    assert run([name, *LINES[name][0].split()]) == 0, capsys.readouterr().err
    assert heard == sorted(heard)
    assert heard[0] >= 0.0
    assert heard[-1] == 1.0


@pytest.mark.parametrize("name", LINES)
def test_it_ends_at_ctrl_c_with_what_it_has(
    name: str, folder: Path, heard: list[float], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: Bar, done: float, __: str) -> None:
        if not heard:
            os.kill(os.getpid(), signal.SIGINT)
        heard.append(done)

    monkeypatch.setattr(Bar, "update", interrupt)
    monkeypatch.setattr("workbench.workers.pool._GRACE", 60.0)  # on a busy machine
    line, kept = LINES[name]
    out = folder / f"{name}_out.json"
    assert run([name, *line.split(), "--json", str(out)]) == 130
    said = [text for text in capsys.readouterr().err.splitlines() if "interrupted" in text]
    assert len(said) == 1
    assert said[0].startswith("note: interrupted after ")
    assert out.exists() == bool(kept)
    if kept:
        assert kept in json.loads(out.read_text(encoding="utf-8"))


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
    asked = Simulate(stop=1e3, interval=0.01, inputs={"reference": "step:time=0.1,value=1"}, workers=place)
    with wb.load(folder / "master.toml", step=0.01) as model, pytest.raises(KeyboardInterrupt):
        asked.run(model, job)
    cut = job.partial()
    assert isinstance(cut, SimulationResult)
    assert cut.ended_at == float(cut.time[-1])
    assert 0.0 < cut.ended_at < 1e3
    assert told[0][1] == 100
