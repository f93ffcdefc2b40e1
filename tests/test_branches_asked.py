"""Branches: what can be asked, and how it is answered."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import workbench as wb
from workbench.cli.app import run

DUFFING = ["fmu:Duffing", "--input", "u", "--output", "y"]
ELEVATOR = ["fmu:ElevatorLaw", "--output", "elevator", "--input"]
AILERON = ["system:failed_aileron", "--block", "damper"]
OVER = [*DUFFING, "--amplitude", "0.1", "--band", "0.15:0.3", "--seeds", "0"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["branches", *DUFFING, "--amplitude", "-0.1", "--band", "0.1:0.4"], "--amplitude: -0.1 is not a positive"),
        (["branches", *DUFFING, "--amplitude", "0", "--band", "0.1:0.4"], "--amplitude: 0 is not a positive number"),
        (["branches", *DUFFING, "--amplitude", "0.1", "--band", "0.4:0.1"], "with 0 < LO < HI [Hz]"),
        (["branches", *OVER, "--freq", "0.5"], "--freq: 0.5 Hz lies outside the band 0.15:0.3 Hz"),
        (["branches", *DUFFING, "--amplitude", "0.1", "--freq", "0.2"], "--band: give the lowest and the highest"),
        (["branches", *ELEVATOR, "side_stick", *OVER[5:]], "samples every 0.022 s"),
        (["branches", *ELEVATOR, "qF", *OVER[5:]], "no input 'qF'"),
        (["nfr", *DUFFING, "--freq", "0.2", "--amplitude", "0.1", "--branches"], "give one with --band"),
        (["limit-cycle", *AILERON, "--vary", "dampr.alpha2=1:2"], "did you mean damper.alpha2?"),
    ],
)
def test_what_cannot_be_is_said_at_once(line: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(line) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err.splitlines()[-1]


def test_all_responses_at_a_frequency_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "d.json"
    assert run(["branches", *OVER, "--freq", "0.207", "--json", str(out)]) == 0
    text = capsys.readouterr().out
    table = text[text.index("Responses at the frequencies asked for") :].splitlines()[3:6]
    assert [("unstable" in row, "stable" in row) for row in table] == [(False, True), (True, True), (False, True)]
    found = json.loads(out.read_text())["responses"]
    # Of the equation, by SciPy: see `test_between_the_folds_there_are_three_responses`.
    assert [r["gain"] for r in found] == pytest.approx([10.01201, 8.87296, 1.47398], rel=1e-5)
    assert [r["stable"] for r in found] == [True, False, True]
    again = wb.BranchesResult.from_dict(json.loads(out.read_text()))
    assert [r.gain for r in again.at(0.207)] == [r["gain"] for r in found]


def test_an_integrator_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "integrator.toml"
    file.write_text(
        "[components]\n"
        'lag = "fmu:FirstOrderLag"\n'
        "sum = {numerator = [1.0], denominator = [1.0, 0.0]}\n"
        '[connections]\n"sum.u" = "lag.y"\n[inputs]\nu = "lag.u"\n[outputs]\ny = "sum.y"\n'
    )
    assert run(["branches", str(file), "--input", "u", "--output", "y", "--amplitude", "1", "--band", "0.1:1"]) in {
        0,
        2,
    }
    assert "an integrator, whose response depends on where it starts?" in capsys.readouterr().err


def test_where_no_fold_is_found_the_onset_is_not_known(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["branches", *DUFFING, "--amplitude", "0.01", "--band", "0.1:0.3", "--seeds", "0", "--onset"]) == 0
    captured = capsys.readouterr()
    assert "no fold was found: the response does not jump up to amplitude 0.01" in captured.out
    assert "give larger --amplitude" in captured.out + captured.err


def test_a_sweep_with_branches_says_that_it_jumps_and_numbers_them_as_its_table() -> None:
    with wb.load("fmu:Duffing", tolerance=1e-8) as model:
        result = wb.nfr(model, "u", "y", band=(0.16, 0.28), ratio=1.3, amplitudes=[0.1, 0.03], branches=True)
    assert [b.amplitude for b in result.branches][:2] == sorted(b.amplitude or 0.0 for b in result.branches)[:2]
    assert {result.branches[f.branch].amplitude for f in result.folds if f.amplitude == 0.1} == {0.1}
    assert all(result.branches[f.branch].amplitude == pytest.approx(f.amplitude) for f in result.folds)
    from workbench.response.nfr.page import nfr_page

    assert any("the response jumps: folds from 0.185" in v.text for v in nfr_page(result).summary)


def test_a_fold_that_is_passed_and_cannot_be_located_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_locate", "_turning"):
        monkeypatch.setattr(f"workbench.response.periodic.special.{name}", lambda *_: None)
    with wb.load("fmu:Duffing", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "y", [0.1], band=(0.15, 0.3), seeds=0, in_process=True)
    assert found.folds == ()
    told = [w for w in found.warnings if "could not be located" in w]
    assert len(told) == 2
    # Both places lie before the fold, a stride of 0.08 of the span at most from it; 0.1858 and 0.2422 Hz are of
    # test_branches.py.
    near = [max(words, key=lambda f: abs(f - 0.214)) for words in (_numbers(line) for line in told)]
    assert sorted(near) == pytest.approx([0.1858, 0.2422], rel=0.06)


def _numbers(line: str) -> list[float]:
    """Return the two values between which something is said to be."""
    return [float(word) for word in re.findall(r"0\.\d+", line)]
