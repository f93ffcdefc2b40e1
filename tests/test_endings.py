"""Nothing is lost and nobody left behind: Ctrl-C, SIGTERM, SIGHUP, a closed terminal, a program that is killed."""

from __future__ import annotations

import csv
import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tests.hostile_fmus import build_hostile
from tests.programs import ROOT, ended, start, wait_for
from workbench.cli.app import run
from workbench.cli.output import Output
from workbench.jobs.store import FILE_NAME

if sys.platform == "win32":
    pytest.skip("signals of POSIX: Windows delivers neither SIGTERM nor SIGHUP to a handler", allow_module_level=True)
import pty

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

# Periods of 0.01 s end before t = 0.5 s, from where on this FMU hangs; a period of 1 s never ends.
SWEEP = ["--input", "u", "--output", "y", "--amplitude", "1", "--freq", "1,100", "--max-periods", "4", "--jobs", "2"]

STUDY = """
name = "one that hangs"
[models]
good = "fmu:FirstOrderLag"
bad = "hang-at-start.fmu"

[analyses.first]
command = "lin"
model = "good"

[analyses.second]
command = "lin"
model = "bad"

[[requirements]]
name = "it is continuous"
analysis = "first"
kind = "value"
path = "dt"
max = 0
"""


class Hanging:
    """A command on an FMU that hangs.

    Args:
        folder: for all files.
        arguments: of the program.
        environment: of the process.

    Attributes:
        process: the program.
        pid: of the process in which the FMU hangs.
        temporary: folder for its temporary files.
    """

    def __init__(self, folder: Path, *arguments: str, **environment: str) -> None:
        tells, self.temporary = folder / "tells", folder / "temporary"
        self.temporary.mkdir()
        own = {"HOSTILE_TELLS": str(tells), "TMPDIR": str(self.temporary), **environment}
        self.process = start(["-m", "workbench", *arguments], **own)
        wait_for(lambda: tells.exists() and tells.read_text().endswith("\n"), self.process)
        self.pid = int(tells.read_text())

    def end(self, number: signal.Signals) -> tuple[int, list[str]]:
        """Send a signal to all processes, as a terminal or a batch queue does; return exit code and standard error."""
        os.killpg(self.process.pid, number)
        _, err = self.process.communicate()
        assert ended(self.pid)
        assert not list(self.temporary.iterdir())
        return self.process.returncode, err.splitlines()


def measured(store: Path) -> bool:
    """Whether a point is in a store that another process is making."""
    return (store / FILE_NAME).exists() and bool(points(store))


def points(folder: Path) -> int:
    """So many points are in a store; where the model stood, and how it moves by itself, are none."""
    with closing(sqlite3.connect(folder / FILE_NAME)) as database:
        try:
            names = [name for (name,) in database.execute("SELECT point FROM measurements")]
            return len(set(names) - {"operating point", "zero input"})
        except sqlite3.OperationalError:  # no table yet
            return 0


def sweep(folder: Path, *, how: str = "hang", **environment: str) -> tuple[Hanging, Path]:
    """Start a sweep of two points, one of which hangs; return when the other one is there."""
    fmu, out, store = build_hostile(folder, how), folder / "r.json", folder / "store"
    files = ["--json", str(out), "--csv", str(folder / "r.csv"), "--store", str(store)]
    found = Hanging(folder, "nfr", str(fmu), *SWEEP, "--no-drift-check", *files, **environment)
    wait_for(lambda: measured(store), found.process)
    return found, out


@pytest.mark.parametrize("number", SIGNALS)
def test_a_sweep_keeps_what_was_measured(tmp_path: Path, number: signal.Signals) -> None:
    found, out = sweep(tmp_path)
    code, err = found.end(number)
    assert code == 128 + number
    by = "" if number == signal.SIGINT else f" by {number.name}"
    assert [line for line in err if "interrupted" in line] == [
        f"note: interrupted{by} after 1 of 2 points; the same command continues"
    ]
    assert all(line.startswith("note: ") for line in err), err
    result = json.loads(out.read_text(encoding="utf-8"))
    (gain,) = result["gain"]
    assert gain[0] is None
    assert "interrupted" in result["failed"][0]["reason"]
    assert gain[1] == pytest.approx(1.0 / abs(1.0 + 200.0j * 3.141592653589793), rel=1e-3)
    with (tmp_path / "r.csv").open(encoding="utf-8") as table:
        assert len(list(csv.reader(table))) > 1
    assert points(tmp_path / "store") == 1


def test_a_signal_that_comes_twice_at_once_is_one(tmp_path: Path) -> None:
    """As from `timeout`, which tells the process and then its group."""
    found, out = sweep(tmp_path)
    os.kill(found.process.pid, signal.SIGTERM)
    code, err = found.end(signal.SIGTERM)
    assert code == 128 + signal.SIGTERM
    assert err[-1] == "note: interrupted by SIGTERM after 1 of 2 points; the same command continues"
    assert json.loads(out.read_text(encoding="utf-8"))["gain"][0][1] > 0.0


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (
            ["nfr", "--input", "u", "--output", "y", "--freq", "1,2", "--amplitude", "1"],
            "interrupted: the result is written",
        ),
        (
            ["excite", "--input", "u", "--output", "y", "--prbs", "amplitude=1,rate=10", "--step", "0.1"],
            "interrupted: the result is written",
        ),
        (["simulate", "--stop", "1"], "interrupted: the result is written"),
    ],
)
def test_what_is_done_is_written_whole(
    command: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C when the first file is being written."""
    write = Output._write_json

    def slow(self: Output, full: Mapping[str, Any]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        write(self, full)

    monkeypatch.setattr(Output, "_write_json", slow)
    out, picture, page = (tmp_path / f"r.{suffix}" for suffix in ("json", "png", "html"))
    files = ["--json", str(out), "--plot", str(picture), "--report", str(page)]
    assert run([command[0], "fmu:FirstOrderLag", *command[1:], *files]) == 128 + signal.SIGINT
    (said,) = (line for line in capsys.readouterr().err.splitlines() if "interrupted" in line)
    assert said.startswith(f"note: {words}")
    assert json.loads(out.read_text(encoding="utf-8"))["command"] == command[0]
    assert picture.exists()
    assert page.exists()


@pytest.mark.parametrize(
    "command",
    [
        ["simulate", "--stop", "1"],
        ["info"],
        ["excite", "--input", "u", "--output", "y", "--prbs", "amplitude=1,rate=10"],
    ],
)
def test_every_command_ends_orderly(tmp_path: Path, command: list[str]) -> None:
    fmu = str(build_hostile(tmp_path, "hang-at-start"))
    code, err = Hanging(tmp_path, command[0], fmu, *command[1:]).end(signal.SIGTERM)
    assert code == 128 + signal.SIGTERM
    (line,) = (line for line in err if not line.startswith(("note: interface", "note: solver")))
    assert line.startswith("note: interrupted by SIGTERM")


def test_an_fmu_that_hangs_in_the_programs_own_process_does_not_keep_it(tmp_path: Path) -> None:
    code, err = Hanging(tmp_path, "lin", str(build_hostile(tmp_path, "hang-at-start")), "--in-process").end(
        signal.SIGTERM
    )
    assert code == 128 + signal.SIGTERM
    assert err == [
        "note: interrupted by SIGTERM: the code of an FMU, or of a library, does not return; there is no result"
    ]


def test_a_command_without_a_result_says_in_json_that_it_was_cancelled(tmp_path: Path) -> None:
    out = tmp_path / "r.json"
    found = Hanging(tmp_path, "trim", str(build_hostile(tmp_path, "hang-at-start")), "--json", str(out))
    code, _ = found.end(signal.SIGTERM)
    assert code == 128 + signal.SIGTERM
    assert json.loads(out.read_text(encoding="utf-8"))["failure"] == {"kind": "cancelled", "message": "interrupted"}


def test_a_study_keeps_the_analyses_that_are_done(tmp_path: Path) -> None:
    build_hostile(tmp_path, "hang-at-start")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    out = tmp_path / "r.json"
    found = Hanging(tmp_path, "run", str(tmp_path / "study.toml"), "--jobs", "1", "--json", str(out))
    code, err = found.end(signal.SIGHUP)
    assert code == 128 + signal.SIGHUP
    assert err[-1] == "note: interrupted by SIGHUP: 1 of 2 analyses were not run; the same command continues"
    result = json.loads(out.read_text(encoding="utf-8"))
    assert (result["measured"], result["missing"]) == (1, 1)


ON_THIS_TERMINAL = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from workbench.cli import main
main(sys.argv[1:])
"""


def test_a_terminal_that_is_closed_costs_no_result(tmp_path: Path) -> None:
    fmu, out = build_hostile(tmp_path, "hang"), tmp_path / "r.json"
    store, tells = tmp_path / "store", tmp_path / "tells"
    master, slave = pty.openpty()
    options = [*SWEEP, "--no-drift-check", "--json", str(out), "--store", str(store)]
    process = subprocess.Popen(
        [sys.executable, "-c", ON_THIS_TERMINAL, "nfr", str(fmu), *options],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "HOSTILE_TELLS": str(tells)},
    )
    os.close(slave)
    wait_for(lambda: measured(store) and tells.exists(), process)
    os.close(master)  # the system sends SIGHUP, and nothing can be written there any more
    assert process.wait() == 128 + signal.SIGHUP
    assert json.loads(out.read_text(encoding="utf-8"))["gain"][0][1] > 0.0


def test_ctrl_c_before_the_command_begins_writes_no_traceback() -> None:
    code = (
        "import signal\nfrom workbench.cli import interrupt, main\nlisten = interrupt.listen_for_endings\n"
        "interrupt.listen_for_endings = lambda: (listen(), signal.raise_signal(signal.SIGINT))\n"
        "main(['lin', 'fmu:FirstOrderLag'])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (128 + signal.SIGINT, "", "")


def test_a_signal_that_is_ignored_stays_ignored(tmp_path: Path) -> None:
    """As under nohup."""
    code = "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN)\nfrom workbench.cli import main; main({})"
    fmu = str(build_hostile(tmp_path, "hang-at-start"))
    tells = tmp_path / "tells"
    process = start(["-c", code.format(["simulate", fmu, "--stop", "1"])], HOSTILE_TELLS=str(tells))
    wait_for(tells.exists, process)
    os.killpg(process.pid, signal.SIGHUP)
    os.killpg(process.pid, signal.SIGTERM)
    _, err = process.communicate()
    assert process.returncode == 128 + signal.SIGTERM
    assert "interrupted by SIGTERM" in err


# -- a program that is killed ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "environment"),
    [("hang", {}), ("hang-at-start", {}), ("nothing", {"HOSTILE_HANGS_WHEN_LOADED": "1"})],
)
def test_a_worker_whose_fmu_hangs_ends_with_the_program(tmp_path: Path, name: str, environment: dict[str, str]) -> None:
    found = Hanging(tmp_path, "simulate", str(build_hostile(tmp_path, name)), "--stop", "1", **environment)
    assert found.pid != found.process.pid
    found.process.kill()
    found.process.communicate()  # returns when nobody has the pipes any more
    assert ended(found.pid)
    assert not list(found.temporary.iterdir())


def test_a_reader_that_has_seen_enough_costs_no_file(tmp_path: Path) -> None:
    file = tmp_path / "lag.json"
    words = ["nfr", "fmu:FirstOrderLag", "--input", "u", "--output", "y", "--freq", "1", "--amplitude", "1"]
    with start(["-m", "workbench", *words, "--in-process", "--json", str(file)]) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        program.stdout.close()  # as `| head -1` does
        program.stderr.read()
    assert program.returncode == 0
    told = json.loads(file.read_text(encoding="utf-8"))
    assert told["asked"] == {"input": "u", "output": "y", "frequencies": "1", "amplitudes": "1", "in_process": True}
