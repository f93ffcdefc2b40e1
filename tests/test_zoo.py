"""The corpus beside FMPy: every FMU is read and simulated as FMPy does, or refused for a reason that is true."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from scripts import zoo_oracle as oracle
from scripts.zoo import BAD, Row, page_of, zoo
from tests.corpus import CORPUS, Exhibit, build_corpus
from workbench.report.page import write_page

LIMITS = oracle.Limits(seconds=120.0, megabytes=2000.0)

# Those that misbehave, or break a promise, have tests of their own, and take their time.
QUICK = [e for e in CORPUS if not e.name.startswith(("hostile-", "lying-"))]

# A folder of further FMUs, where the environment names one.
ELSEWHERE = os.environ.get("WORKBENCH_ZOO", "")


def _bad(rows: Iterator[Row]) -> list[Row]:
    found = list(rows)
    assert found
    return [row for row in found if row.verdict in BAD]


@pytest.mark.parametrize("exhibit", QUICK, ids=lambda e: e.name)
def test_the_corpus(exhibit: Exhibit, tmp_path: Path) -> None:
    (name,) = build_corpus(tmp_path, [exhibit])
    assert _bad(zoo([tmp_path / name], ("simulate", "trim"), LIMITS)) == []


@pytest.mark.skipif(not ELSEWHERE, reason="WORKBENCH_ZOO names no folder of further FMUs")
def test_fmus_from_elsewhere() -> None:
    assert _bad(zoo(sorted(Path(ELSEWHERE).rglob("*.fmu")), ("simulate",), LIMITS)) == []


def test_what_differs_is_seen(tmp_path: Path) -> None:
    """An FMU that is another one with each run agrees with nobody; the page says so first."""
    (exhibit,) = (e for e in CORPUS if e.name == "hostile-random")
    (name,) = build_corpus(tmp_path, [exhibit])
    rows = list(zoo([tmp_path / name], ("simulate",), LIMITS))
    assert {r.verdict for r in rows if r.command == "simulate"} == {"disagrees"}
    write_page(page_of(rows), tmp_path / "zoo.html")
    text = (tmp_path / "zoo.html").read_text(encoding="utf-8")
    assert "hostile-random.fmu me simulate: disagrees" in text


def test_names_are_unique_and_told() -> None:
    assert len({e.name for e in CORPUS}) == len(CORPUS)
    assert all(e.source and e.mimics for e in CORPUS)
