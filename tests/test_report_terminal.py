"""A page as text: no line beyond the terminal, no name or number broken, and in a pipe a row is a line."""

from __future__ import annotations

import random

import pytest

from workbench.report.page import Page, Section, Table
from workbench.report.terminal import text_of

NAMES = [f"component[{k}].signal_{k}" for k in range(12)]
NUMBERS = [[f"{10.0**k * (-1) ** k:.6g}" for k in range(12)] for _ in range(4)]
MATRIX = Table(("row", *NAMES), [(f"state_{i}", *row) for i, row in enumerate(NUMBERS)], right=range(1, 13))
WORDS = " ".join(random.Random(1).choices(["pressure", "of", "the", "chamber", "rises", "beyond", "2e7", "Pa"], k=60))


def page(*tables: Table) -> Page:
    return Page("A page", WORDS, {"what": "a fact"}, [Section("Tables", tables=list(tables))])


@pytest.mark.parametrize("width", [60, 80, 132])
def test_a_terminal_is_kept_and_nothing_is_broken(width: int) -> None:
    table = Table(("check", "evidence", "value"), [("runs", WORDS, "1.5e-07"), ("reset", "equal", "2")], right=(2,))
    lines = text_of(page(MATRIX, table), width).splitlines()
    assert max(map(len, lines)) <= width
    words = " ".join(lines).split()
    for whole in (*NAMES, *NUMBERS[0], "state_3", "1.5e-07"):
        assert whole in words
    assert " ".join(words).count("state_2") > 1  # each block of columns names its rows


def test_a_row_is_a_line_in_a_pipe() -> None:
    lines = text_of(page(MATRIX), None).splitlines()
    rows = [line.split() for line in lines if line.startswith("state_")]
    assert rows == [[f"state_{i}", *row] for i, row in enumerate(NUMBERS)]
    assert WORDS in lines
