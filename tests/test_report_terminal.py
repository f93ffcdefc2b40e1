"""A page as text: no line beyond the terminal, no name or number broken, and in a pipe a row is a line."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from workbench.limit_cycles.limit_cycle import page as limit_cycle
from workbench.limit_cycles.limit_cycle.result import SimulatedCycle
from workbench.response.simulate import page as simulate
from workbench.response.simulate.result import SimulationResult
from workbench.show.page import Page, PageTable, Section, write_page
from workbench.show.terminal import text_of

NAMES = [f"component[{k}].signal_{k}" for k in range(12)]
NUMBERS = [[f"{10.0**k * (-1) ** k:.6g}" for k in range(12)] for _ in range(4)]
MATRIX = PageTable(("row", *NAMES), [(f"state_{i}", *row) for i, row in enumerate(NUMBERS)], right=range(1, 13))
WORDS = " ".join(random.Random(1).choices(["pressure", "of", "the", "chamber", "rises", "beyond", "2e7", "Pa"], k=60))


def page(*tables: PageTable) -> Page:
    return Page("A page", WORDS, {"what": "a fact"}, [Section("Tables", tables=list(tables))])


@pytest.mark.parametrize("width", [60, 80, 132])
def test_a_terminal_is_kept_and_nothing_is_broken(width: int) -> None:
    table = PageTable(("check", "evidence", "value"), [("runs", WORDS, "1.5e-07"), ("reset", "equal", "2")], right=(2,))
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


def test_bars_are_drawn_by_a_terminal_alone(tmp_path: Path) -> None:
    """A page has a picture of the same numbers."""
    shown = page(PageTable(("order", "value"), [("1", "2.5"), ("2", "0.1")], bars=["████", "░"]))
    lines = [line.split() for line in text_of(shown, 80).splitlines()]
    assert ["1", "2.5", "████"] in lines
    assert ["2", "0.1", "░"] in lines
    write_page(shown, tmp_path / "p.html")
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "2.5" in text
    assert "█" not in text


def test_a_mean_that_is_rounding_is_shown_as_0() -> None:
    cycle = SimulatedCycle(
        crossing=1, frequency_hz=2.6, amplitude={"a": 0.2, "b": 3.0}, fundamental={"a": 0.2, "b": 3.0},
        mean={"a": 1.4e-11, "b": -0.5}, units={"a": "rad/s"}, steady=True, periods=40, time=np.zeros(1), values={},
        predicted_frequency_hz=2.6, predicted_amplitude=0.2,
    )  # fmt: skip
    (table,) = limit_cycle._simulated(cycle, "rad/s").tables
    assert [row[-1] for row in table.rows] == ["0", "-0.5"]


def test_a_sine_that_ends_after_whole_periods_ends_at_0() -> None:
    time = np.linspace(0.0, 2.0, 201)
    result = SimulationResult(
        time=time, signals={"u": np.sin(2.0 * np.pi * time), "lost": np.full(201, np.nan)},
        units={"u": "rad", "lost": None}, model="M", interface="me", solver="gear",
    )  # fmt: skip
    _, values = simulate.simulate_page(result).sections
    assert values.tables[0].rows == [("u", "rad", "0", "0", "-1", "1"), ("lost", "", *["–"] * 4)]
