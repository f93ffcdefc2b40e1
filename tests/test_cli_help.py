"""What the program says to somebody who does not know it: called alone, and the help of a command on one screen."""

from __future__ import annotations

import re

import click
import pytest

from workbench.cli.app import BAD_INPUT, run
from workbench.cli.program import COMMANDS, program

COLUMNS, SCREEN = 80, 40
MANY = 14  # options that a page describes in full


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))


def shown(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert run(words) == 0
    return capsys.readouterr().out


def height(text: str) -> int:
    """Lines of a terminal, which breaks those that are too wide."""
    return sum(max(1, -(-len(line) // COLUMNS)) for line in text.splitlines())


def flags_of(name: str) -> set[str]:
    return {p.opts[0] for p in program(name).params if isinstance(p, click.Option)}


def described(text: str) -> set[str]:
    """Options that have a row of their own."""
    return set(re.findall(r"^  (?:-h, )?(--[\w-]+)", text.partition("\nMore options")[0], re.MULTILINE))


def test_called_alone_it_says_what_to_do_first(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == BAD_INPUT
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= COLUMNS
    assert [line.split()[1] for line in lines if line.startswith("  workbench ")] == ["info", "check", "nfr"]
    assert "--help" in " ".join(lines)


def test_the_help_of_nfr_fits_a_screen(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(["nfr", "--help"], capsys)
    assert height(text) <= SCREEN
    assert {"--input", "--output", "--amplitude", "--freq", "--band", "--at"} <= described(text)
    assert "--errcrit" not in described(text)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_every_option_once_and_describes_what_is_required(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = shown([name, "--help"], capsys)
    first, rest = described(text), re.findall(r"--[\w-]+", text.partition("\nMore options, described by --help-all")[2])
    assert len(rest) == len(set(rest))
    assert set(rest).isdisjoint(first)
    assert first | set(rest) == flags_of(name) | {"--help"} | ({"--help-all"} if rest else set())
    assert {p.opts[0] for p in program(name).params if isinstance(p, click.Option) and p.required} <= first
    assert bool(rest) == (len(flags_of(name)) > MANY)
    assert len(first) <= MANY + 5
    assert height(text) <= SCREEN + 15


@pytest.mark.parametrize("name", COMMANDS)
def test_help_all_describes_every_option(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = shown([name, "--help-all"], capsys)
    assert described(text) == flags_of(name) | {"--help"}
    assert "More options" not in text
