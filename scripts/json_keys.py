"""Compare the JSON keys of every command with those of an earlier version.

    python scripts/json_keys.py keys.json            compare; lost keys end with 1
    python scripts/json_keys.py keys.json --write    write what this version has

A key is its path, with [] for any element of a list; values are not looked at. The earlier version writes its keys
from its own checkout: `git worktree add ../before v0.1; cp scripts/json_keys.py ../before/scripts; …`.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shlex
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from workbench.cli.app import run

# In this order, in one folder: later ones read what earlier ones wrote.
LINES = (
    "info fmu:Rudder --json info.json",
    "info system:failed_aileron --json info_system.json",
    "check fmu:FirstOrderLag --only runs,reset,drift --json check.json",
    "simulate fmu:Rudder --stop 0.1 --input delC=1 --json simulate.json",
    "nfr fmu:Rudder --input delC --output del --freq 1,2 --amplitude 1,4 --json nfr.json",
    "nfr fmu:FirstOrderLag --input u --output y --freq 1 --amplitude 1 --carry --json nfr_carried.json",
    "trim fmu:Rudder --u0 delC=2 --float p1,p2 --json trim.json",
    "branches fmu:Duffing --input u --output y --amplitude 0.1 --band 0.15:0.3 --onset --json branches.json",
    "nfr fmu:Duffing --input u --output y --amplitude 0.1 --band 0.15:0.3 --branches --json nfr_branches.json",
    "trim fmu:ElevatorLaw --json trim_law.json",
    "lin fmu:Rudder --at trim.json --inputs delC --json lin.json",
    "lin fmu:FirstOrderLag --over tau=0.1,0.2 --json lin_over.json",
    "lin fmu:FirstOrderLag --snapshot 0.1,0.2 --input u=1 --json lin_along.json",
    "lin fmu:FirstOrderLag --compare --freq 1 --amplitude 1 --json lin_compare.json",
    "modes fmu:Rudder --at trim.json --vary mH=0:1 --points 3 --json modes.json",
    "loop system:rudder_loop --open plant.del --json loop.json",
    "loop system:rudder_loop --open plant.del --freq 0.5 --amplitude 0.1 --json loop_measured.json",
    "blocks rate_limiter --json blocks.json",
    "delays loop.toml --stop 2 --step 0.01 --json delays.json",
    "feedback fmu:Rudder --at trim.json --from del --to delC --json feedback.json",
    (
        "feedback system:failed_aileron --from aircraft.outer_aileron_position --to aircraft.inner_aileron --json "
        "feedback_block.json"
    ),
    "limit-cycle system:failed_aileron --block damper --output z_wing_tip --json limit_cycle.json",
    (
        "limit-cycle system:failed_aileron --block damper --output z_wing_tip --band 2.6:2.7 --method shooting --vary "
        "damper.alpha2=6900:7100 --json limit_cycle_vary.json"
    ),
    (
        "limit-cycle system:failed_aileron_feedforward --block damper --block actuator --output z_wing_tip --band 1:10 "
        "--amplitude 0.01:1 --time 150 --method 'describing function' --json limit_cycle_blocks.json"
    ),
    (
        "feed-forward system:failed_aileron --block damper --to aircraft.inner_aileron --feedback "
        "aircraft.outer_aileron_position:-1 --orders 36,29 --cancel 3e-3 --json feed_forward.json"
    ),
    (
        "compare fmu:FirstOrderLag fmu:FirstOrderLag --label a --label b --signal y --input u=1 --window 0:1 "
        "--json compare.json"
    ),
    (
        "excite fmu:FirstOrderLag --input u --output y --prbs amplitude=1 --step 0.05 --samples 200 --json excite.json "
        "--csv data.csv"
    ),
    "onset system:pitch_rate_limit --input stick --limiter limiter --amplitude 1.1 --json onset.json",
    "bla fmu:FirstOrderLag --input u --output y --rms 1 --band 0.1:1 --json bla.json",
    "fit bla.json --order 1 --json fit.json",
    "identify data.csv --input u --output y --order 3 --json identify.json",
    "export lin.json --out rudder_lin.fmu --json export.json",
    "run study:rudder_specification --json run.json",
    "envelope study:aileron_envelope --plan sobol --points 4 --width 0.5 --json envelope.json",
)

# The two parts step one after the other, so that there is a delay to be found.
LOOP = """
[components]
lag = {model = "fmu:FirstOrderLag", interface = "cs"}
other = {model = "fmu:FirstOrderLag", interface = "cs"}
[connections]
"other.u" = "lag.y"
[inputs]
u = "lag.u"
[outputs]
y = "other.y"
"""


def keys(value: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of all keys."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{path}.{key}".lstrip(".")
            yield from keys(inner, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list):
        for inner in value:
            yield from keys(inner, f"{path}[]")


def found() -> dict[str, list[str]]:
    """Run every line in a folder of its own; return line → keys, or what was said where there is no JSON."""
    result: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        Path("loop.toml").write_text(LOOP, encoding="utf-8")
        for line in LINES:
            said = io.StringIO()
            with redirect_stdout(io.StringIO()), redirect_stderr(said):
                code = run(shlex.split(line))
            file = Path(line.partition("--json ")[2].split()[0])
            if file.exists():
                result[line] = sorted(set(keys(json.loads(file.read_text(encoding="utf-8")))))
            else:
                result[line] = [f"exit code {code}: {said.getvalue().strip()}"]
            sys.stderr.write(f"{len(result[line]):5d} keys, exit code {code}: {line}\n")
        os.chdir("/")
    return result


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    file = arguments.file.absolute()
    now = found()
    if arguments.write:
        file.write_text(json.dumps(now, indent=1), encoding="utf-8")
        return 0
    before = json.loads(file.read_text(encoding="utf-8"))
    lost = 0
    for line, known in before.items():
        here = set(now.get(line, ()))
        gone, new = [k for k in known if k not in here], [k for k in now.get(line, ()) if k not in set(known)]
        lost += len(gone)
        for title, listed in (("lost", gone), ("new", new)):
            if listed:
                sys.stdout.write(f"{line}\n  {title}: {', '.join(listed)}\n")
    sys.stdout.write(f"{lost} keys lost\n")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
