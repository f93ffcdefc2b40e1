"""`workbench nfr` and what all commands share: files, exit codes, one-line errors."""

from __future__ import annotations

import csv
import itertools
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.cli.app import run
from workbench.cli.program import COMMANDS

LAG = ["nfr", "fmu:FirstOrderLag", "--input", "u", "--output", "y", "--amplitude", "1"]


def complaint(capsys: pytest.CaptureFixture[str], arguments: Sequence[str]) -> str:
    """Run, expect exit code 2 and one line on standard error (notes apart), and return that line."""
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("workbench: ")
    return lines[0]


def test_json_csv_and_picture_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / name for name in ("r.json", "r.csv", "r.png")]
    options = [x for pair in zip(("--json", "--csv", "--plot"), map(str, files), strict=True) for x in pair]
    assert run([*LAG, "--band", "0.5:2", *options]) == 0
    out = capsys.readouterr().out
    assert "amplitudes: 1" in out
    assert all(f"wrote {file}" in out for file in files)
    result = json.loads(files[0].read_text(encoding="utf-8"))
    assert result["command"] == "nfr"
    assert {"model", "interface", "solver", "version", "seconds", "gain", "failed"} <= set(result)
    assert result["frequency_hz"][-1] == 2.0
    with files[1].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row["gain"]) for row in rows], result["gain"][0])
    assert files[2].stat().st_size > 5_000


def test_json_on_standard_output_is_alone_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*LAG, "--freq", "1,2", "--json", "-"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["frequency_hz"] == [1.0, 2.0]
    assert captured.err == ""


def test_csv_on_standard_output_is_alone_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*LAG, "--freq", "1", "--csv", "-"]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("amplitude,frequency_hz,gain")


def test_parameter_and_bias_reach_the_model(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*LAG, "--freq", "1", "--json", "-", "--set", "tau=0.01", "--bias", "u=3"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["gain"][0][0] == pytest.approx(1.0 / abs(1.0 + 0.02j * np.pi), rel=1e-3)
    assert result["offset"][0][0] == pytest.approx(3.0, abs=1e-2)


@needs_gemseo
def test_points_that_failed_give_exit_code_1_and_their_reason(capsys: pytest.CaptureFixture[str]) -> None:
    mass_damper = ["nfr", str(gemseo_fmu("Mass_Damper")), "--input", "f", "--output", "y", "--amplitude", "1"]
    assert run([*mass_damper, "--interface", "cs", "--step", "0.01", "--freq", "1,2"]) == 1
    out = capsys.readouterr().out
    assert "failed: 2 points, the first at 1 Hz: " in out


@needs_gemseo
def test_a_step_that_matters_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    mass_damper = ["nfr", str(gemseo_fmu("Mass_Damper")), "--input", "f", "--output", "y", "--amplitude", "1"]
    assert run([*mass_damper, "--interface", "cs", "--step", "2e-4", "--freq", "15", "--json", "-"]) == 0
    captured = capsys.readouterr()
    (warning,) = [w for w in json.loads(captured.out)["warnings"] if "half the communication step" in w]
    assert f"note: {warning.replace('`step`', '--step')}" in captured.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["nfr"],
            (
                "Missing argument 'MODEL' (FMU file or folder, fmu:NAME[@3], or a system: .toml, .ssp, system:NAME); "
                "workbench nfr --help has an example"
            ),
        ),
        (["nosuch"], "No such command 'nosuch'"),
        ([*LAG, "--freq"], "requires an argument"),
        ([*LAG, "--freq", "1", "--json", "--plot", "x.png"], "--json needs a value, but --plot follows"),
        ([*LAG, "--nosuch"], "No such option"),
        ([*LAG, "--ratio", "x", "--freq", "1"], "--ratio: 'x' is not a number"),
        ([*LAG, "--jobs", "1.5", "--freq", "1"], "--jobs: '1.5' is not a whole number"),
        ([*LAG, "--interface", "mee", "--freq", "1"], "'mee' is unknown; did you mean me?"),
        (LAG, "neither is given"),
        ([*LAG, "--freq", "1", "--band", "1:2"], "both are given"),
        ([*LAG, "--freq", ""], "--freq: '' is not a number"),
        ([*LAG, "--freq", "1,x"], "--freq: 'x' is not a number"),
        ([*LAG, "--freq", "-1"], "--freq: -1 is not a positive number"),
        ([*LAG, "--freq", "0"], "--freq: 0 is not a positive number"),
        ([*LAG, "--band", "1"], "--band: '1' is not of the form LO:HI"),
        ([*LAG, "--band", "1-5"], "--band: '1-5' is not of the form LO:HI, as in 0.1:10 [Hz]"),
        ([*LAG, "--band", "2:1"], "falls from 2 to 1 Hz"),
        ([*LAG, "--band", "1:2", "--ratio", "1"], "must be above 1"),
        ([*LAG, "--freq", "1", "--errcrit", "0"], "errcrit: 0"),
        ([*LAG, "--freq", "1", "--max-periods", "1"], "at least 2"),
        ([*LAG[:-1], "0", "--freq", "1"], "--amplitude: 0 is not a positive number"),
        ([*LAG, "--freq", "1", "--set", "tau"], "--set: 'tau' is not of the form NAME=VALUE"),
        ([*LAG, "--freq", "1", "--set", "taw=1"], "did you mean tau?"),
        ([*LAG, "--freq", "1", "--set", "tau=fast"], "tau"),
        ([*LAG, "--freq", "1", "--bias", "u=x"], "--bias: u: 'x' is not a number"),
        ([*LAG, "--freq", "1", "--plot", "r.bmp"], "must end in one of .png"),
        ([*LAG, "--freq", "1", "--json", "nosuch/r.json"], "the folder 'nosuch' does not exist"),
        ([*LAG, "--freq", "1", "--json", "-", "--csv", "-"], "cannot both go to standard output"),
        (["nfr", "nosuch.fmu", *LAG[2:], "--freq", "1"], "nosuch.fmu"),
        (["nfr", "fmu:FirstOrderLga", *LAG[2:], "--freq", "1"], "did you mean FirstOrderLag"),
        (["nfr", "pyproject.toml", *LAG[2:], "--freq", "1"], "pyproject.toml"),
        ([*LAG[:3], "y", *LAG[4:], "--freq", "1"], "'y' of FirstOrderLag is an output; its inputs are: u"),
        ([*LAG[:5], "u", *LAG[6:], "--freq", "1"], "'u' of FirstOrderLag is an input; its outputs and states are: y"),
        ([*LAG[:3], "uu", *LAG[4:], "--freq", "1"], "has no input 'uu'; did you mean u?"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert message in complaint(capsys, arguments)


def test_help_has_an_example_for_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    for command in COMMANDS:
        assert run([command, "--help"]) == 0
        text = capsys.readouterr().out
        assert f"Example: workbench {command}" in text or f"Examples: workbench {command}" in text


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"workbench {wb.__version__}"


def test_help_needs_no_numerics() -> None:
    # Nor the types of all options, which take as long to look up as the requests to import.
    code = (
        "import sys\nfrom workbench.cli.app import run\nfrom workbench.core.records import option\nrun(['--help'])\n"
        "slow = {'concurrent.futures', 'fmpy', 'logging', 'numpy', 'rich', 'scipy', 'workbench.jobs.worker_main'}\n"
        "print(slow & set(sys.modules), option._options_of.cache_info().currsize)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "set() 0"


def test_an_interrupt_that_python_drops_in_a_finaliser_comes_again() -> None:
    code = """
import time
from workbench.cli.interrupt import insist_on_interrupts

class Finalised:
    def __del__(self):
        raise KeyboardInterrupt

insist_on_interrupts()
try:
    Finalised()
    time.sleep(20)
except KeyboardInterrupt:
    print("heard")
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("heard", "")


def test_what_an_fmu_is_does_not_wait_for_libraries_that_it_does_not_need() -> None:
    # scipy.signal takes longer to import than a small FMU to read; every command imports what this one does.
    code = """
import sys
from workbench.cli import main
try:
    main()
except SystemExit:
    pass
sys.exit(any(m in sys.modules for m in ("control", "matplotlib", "scipy.signal", "scipy.stats")))
"""
    command = [sys.executable, "-c", code, "info", "fmu:FirstOrderLag", "--no-probe"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "FirstOrderLag" in done.stdout


SWEEPS = list(itertools.product(["FirstOrderLag", "TwoRateQuantizer"], ["me", "cs"]))


@pytest.fixture(scope="module")
def imported() -> Mapping[tuple[str, str], frozenset[str]]:
    """Run all sweeps in a process of their own, in their order; return what is imported after each of them."""
    code = """
import sys, workbench as wb
for word in sys.argv[1:]:
    with wb.load(*word.split(",")) as model:
        wb.nfr(model, "u", "y", [1.0], 1.0, workers=wb.Workers(in_process=True))
    print(*sys.modules)
"""
    words = [sys.executable, "-c", code, *(f"fmu:{fmu},{interface}" for fmu, interface in SWEEPS)]
    lines = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    return {sweep: frozenset(line.split()) for sweep, line in zip(SWEEPS, lines, strict=True)}


@pytest.mark.parametrize("sweep", SWEEPS, ids=" ".join)
def test_a_sweep_does_not_wait_for_libraries_that_it_does_not_need(
    sweep: tuple[str, str], imported: Mapping[tuple[str, str], frozenset[str]]
) -> None:
    # python-control takes as long to import as many a sweep takes to run.
    assert imported[sweep].isdisjoint({"control", "matplotlib", "scipy.signal"})
    assert "numpy" in imported[sweep]
