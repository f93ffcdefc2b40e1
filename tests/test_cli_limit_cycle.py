"""The command `limit-cycle`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command_lines import LOOP
from workbench.cli.program import command_of
from workbench.errors import InputError


def run(*arguments: str) -> object:
    return command_of("limit-cycle").main(list(arguments), "workbench limit-cycle", standalone_mode=False)


@pytest.fixture
def loop(tmp_path: Path) -> str:
    path = tmp_path / "loop.toml"
    path.write_text(LOOP, encoding="utf-8")
    return str(path)


def test_json_csv_and_picture(loop: str, tmp_path: Path) -> None:
    out, table, picture = (tmp_path / name for name in ("out.json", "out.csv", "out.png"))
    options = ["--output", "y", "--output", "b.y", "--json", str(out), "--csv", str(table), "--plot", str(picture)]
    assert run(loop, "--block", "block", "--vary", "gain=0.99:1.01", *options) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    (crossing,) = found["crossings"]
    assert crossing["real"] == pytest.approx(-1.25)
    assert (crossing["stable"], crossing["unstable_below"], crossing["unstable_above"]) == (True, 0, 2)
    assert [c["method"] for c in found["limit_cycles"]] == [
        "describing function", "harmonic balance", "shooting", "simulation",
    ]  # fmt: skip
    assert found["simulated"]["frequency_hz"] == pytest.approx(0.275045, rel=1e-5)
    assert set(found["simulated"]["amplitude"]) == {"block.u", "y", "b.y"}
    assert found["branches"][0]["parameter"] == "gain"
    assert table.read_text(encoding="utf-8").startswith("crossing,method,frequency_hz,amplitude")
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--block", "blok"], "did you mean block"),
        (["--block", "block", "--band", "3"], "LO:HI"),
        (["--block", "block", "--vary", "gain=2:1"], "LO < HI"),
        (["--block", "block", "--vary", "gain=2"], "--vary: gain: 2 is not of the form LO:HI with LO < HI"),
        (["--block", "block", "--vary", "gain=2:"], "--vary: gain: '' is not a number"),
        (["--block", "block", "--vary", "gain"], "--vary: 'gain' is not of the form NAME=LO:HI"),
        (["--block", "block", "--method", "shoting"], "did you mean shooting"),
    ],
)
def test_mistakes_are_one_line(loop: str, arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(loop, *arguments)
