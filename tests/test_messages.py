"""Messages about a command line: each names the flag or the file, what is wrong with it, and what to do."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import pytest

from workbench.cli.app import run
from workbench.core.values.margins import UNSTABLE, GainCrossover, Margins, PhaseCrossover
from workbench.loops.loop.page import _crossovers

LOOP = """
[components]
lag = "fmu:FirstOrderLag"
error = {sum = "+-"}
[connections]
"error.u2" = "lag.y"
"lag.u" = "error.y"
[inputs]
r = "error.u1"
[outputs]
y = "lag.y"
"""
LAG = "fmu:FirstOrderLag"


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("loop loop.toml --open lag.y --band 1:5", ["--band: ", "--amplitude"]),
        (f"lin {LAG} --input u", ["--input: 'u'", "did you mean --inputs?"]),
        ("run nosuch.toml", ["nosuch.toml: no such file", "study:NAME"]),
        ("run lop.toml", ["did you mean loop.toml?"]),
        ("run loop.toml", ["loop.toml: is a system, not a study", "simulate"]),
        (f"simulate {LAG} --stop 1s", ["--stop: '1s' is not a number", "in s, without a unit"]),
        (f"nfr {LAG} --input u --output y --amplitude 1 --band 0.5Hz:2", ["--band: '0.5Hz'", "in Hz, without a unit"]),
        (f"simulate {LAG} --stop 1 --at loop.toml", ["--at: loop.toml: is not JSON (line 2", "trim"]),
        ("info notes.md", ["notes.md: is not an FMU, a system or an SSP", ".toml", ".ssp"]),
        ("info nosuch.fmu", ["nosuch.fmu: no such file", ".toml", ".ssp"]),
        ("info text.fmu", ["text.fmu: not a zip archive or damaged"]),
        (f"simulate {LAG} --stop 1 --set V=1", ["--set: ", "no variable 'V'"]),
        (f"simulate {LAG} --stop 1 --set u=abc", ["--set: u: 'abc'"]),
        ("simulate loop.toml --stop 1 --set V=1", ["--set: ", "no variable 'V'"]),
        (f"lin {LAG} --u0 u=abc", ["--u0: u: 'abc'"]),
        (
            "simulate loop.toml --stop 1 --output nosuchname",
            ["--output: ", "its outputs are: y", "its states are: lag.x"],
        ),
    ],
)
def test_a_message_says_where_and_what_to_do(
    line: str, parts: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.toml").write_text(LOOP, encoding="utf-8")
    Path("pyproject.toml").write_text("", encoding="utf-8")
    for name in ("notes.md", "text.fmu"):
        Path(name).write_text("words", encoding="utf-8")
    assert run(line.split()) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert all(part in said for part in parts)
    assert "pyproject" not in said
    assert "Expecting" not in said


def test_an_unstable_loop_shows_no_margin() -> None:
    """L(jω) is −2 and e^(j 1.1°): the phase and the gain of L, and no word of a margin."""
    nothing = float("nan")
    crossover = GainCrossover.of(1.0, cmath.rect(1.0, math.radians(1.1)))
    found = Margins(
        verdict=UNSTABLE, words="", phase_crossovers=(PhaseCrossover(2.0, 0.5),), gain_crossovers=(crossover,),
        disk=None, peak_sensitivity=nothing, peak_sensitivity_hz=nothing, peak_complementary=nothing,
        peak_complementary_hz=nothing,
    )  # fmt: skip
    (table,) = _crossovers(found)
    assert [row[2] for row in table.rows] == ["phase 1.1°", "gain 6.021 dB"]
