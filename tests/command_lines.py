"""A quick command line of every request, and the files that these lines read: what tests of all commands share."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import workbench as wb

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

ENVELOPE = """
models.lag = "fmu:FirstOrderLag"
analyses.linear = {command = "lin", model = "lag"}
requirements = [{name = "quick", analysis = "linear", kind = "stability", max = 0.0}]
envelope.parameters = {"lag.tau" = {range = [0.5, 2.0], steps = 4}}
"""

TUNED = """
components.error = {sum = "+-"}
components.gain = 1.0
components.lag = "fmu:FirstOrderLag"
connections = {"gain.u" = "error.y", "lag.u" = "gain.y", "error.u2" = "lag.y"}
inputs.u = "error.u1"
outputs.y = "lag.y"
"""
WANTED = """
analyses.linear = {command = "lin", model = "tuned.toml"}
requirements = [{name = "quick", analysis = "linear", kind = "stability", max = -3.0}]
"""

LAG_FMU = "fmu:FirstOrderLag"
SWEEP = "--input u --output y --freq 0.1,0.2 --amplitude 1 --in-process"
LOUD = "--amplitude 1,2 --freq 0.1,0.2"
DESIGN = "braked.toml --block block --to brake.u1 --orders 1,1 --low-pass-order 0 --band 0.01:1"
# Request → its command line behind `workbench`, the words of what it has when the first thing that it tells stops it;
# "": nothing. Those of nothing run in this process: a worker may be done before it hears that it should stop, and then
# has everything.
LINES = {
    "info": (f"info {LAG_FMU} --no-probe", "model"),
    "simulate": (f"simulate {LAG_FMU} --stop 300 --step 0.05 --input u=1", "time"),
    "nfr": (f"nfr {LAG_FMU} {SWEEP}", "gain_db"),
    "branches": (f"branches {LAG_FMU} --input u --output y --amplitude 1,2 --band 0.1:0.2 --in-process", "branches"),
    "trim": (f"trim {LAG_FMU} --u0 u=2", "converged"),
    "lin": (f"lin {LAG_FMU} --over tau=0.5,1,2", "systems"),
    "loop": (f"loop loop.toml --open c.y {LOUD} --how inject --refine 0 --in-process", "measured"),
    "robust": (f"robust {LAG_FMU} --uncertain tau=0.5:1.5 --in-process", ""),
    "delays": ("check master.toml --stop 1 --input reference=1 --step 0.02 --in-process --delays", ""),
    "limit-cycle": ("limit-cycle loop.toml --block block --method shooting --vary gain=0.99:1.01 --in-process", ""),
    "feedback": ("feedback lags.toml --from c.y --to a.u", "stable_gains"),
    "feed-forward": (f"feed-forward {DESIGN} --input u=pulse:value=1,duration=0.1 --stop 2 --crude", "filter"),
    "modes": (f"modes {LAG_FMU} --vary tau=0.5:2 --points 3 --against tau=1 --in-process", ""),
    "compare": (f"simulate {LAG_FMU} {LAG_FMU} --label one --label two --output y --input u=1 --window 0:1", "motions"),
    "envelope": ("run envelope.toml --jobs 1", "points"),
    "tune": ("tune tuned.toml --free gain.gain=0.1:10 --study wanted.toml --starts 0 --jobs 1", ""),
    "check": (f"check {LAG_FMU} --interface me --only runs,reset", "checks"),
    "excite": (f"excite {LAG_FMU} --input u --output y --prbs amplitude=1,rate=2 --step 0.05 --in-process", "files"),
    "identify": ("identify data.csv --input u --output y --order 1", ""),
    "calibrate": (f"calibrate {LAG_FMU} data.csv --free tau=0.01:10 --in-process", ""),
    "onset": ("onset system:pitch_rate_limit --input stick --limiter limiter --amplitude 0.1,1.1", ""),
    "bla": (f"bla {LAG_FMU} --input u --output y --rms 1,2 --band 0.1:1 --realisations 2", "words"),
    "fit": ("identify response.csv --max-order 4", ""),
    "blocks": ("info --blocks relay", "blocks"),
    "build": ("build Lag.mo --out Lag.fmu --fmi 3", "files"),
    "compile": (f"build {LAG_FMU} --out made.fmu", "binaries"),
    "export": ("build lin.json --out linear.fmu --fmi 3", "platforms"),
}  # fmt: skip


def write_files(path: Path) -> None:
    """Write the files of `LINES` into a folder."""
    systems = {"envelope": ENVELOPE, "lags": LAGS, "loop": LOOP, "braked": BRAKED, "master": MASTER, "tuned": TUNED}
    systems["wanted"] = WANTED
    for name, text in systems.items():
        (path / f"{name}.toml").write_text(text, encoding="utf-8")
    (path / "Lag.mo").write_text(LAG, encoding="utf-8")
    with wb.load("fmu:FirstOrderLag") as model:
        (path / "lin.json").write_text(json.dumps(wb.lin(model).to_dict()), encoding="utf-8")
    f = np.geomspace(0.01, 1.0, 20)
    lag = 1.0 / (2j * np.pi * f + 1.0)
    rows = np.column_stack([f, np.abs(lag), np.degrees(np.angle(lag))])
    np.savetxt(path / "response.csv", rows, delimiter=",", header="frequency,gain,phase", comments="")
    u = np.where(np.random.default_rng(1).random(400) < 0.5, -1.0, 1.0)
    y = np.zeros_like(u)
    for k in range(1, len(u)):  # a lag of 0.1 s, sampled every 0.05 s
        y[k] = y[k - 1] + (1.0 - np.exp(-0.5)) * (u[k - 1] - y[k - 1])
    rows = np.column_stack([0.05 * np.arange(len(u)), u, y])
    np.savetxt(path / "data.csv", rows, delimiter=",", header="time,u,y", comments="")
