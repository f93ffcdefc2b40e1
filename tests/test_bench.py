"""`dev.py bench`: its rows have the shape that the table needs; how long they take is nobody's test."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip(
    "resource", reason="CPU time and memory of processes are measured with resource, which Windows has not"
)

from scripts import bench
from scripts.bench_process import ROOT, Cost, Lab, Side


def rows(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]


@pytest.mark.parametrize("against", [False, True])
def test_the_cheapest_bench_becomes_a_table_in_a_page(
    against: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cheap(lab: Lab) -> Iterator[bench.Row]:
        for n in (1000, 2000):
            ours, peer = (Side(by, "csv", {"rows": n, "by": by}, by) for by in ("to_csv", "savetxt"))
            yield bench.Row(f"{n} rows", ours, peer, bench.ratio, "×", 1e9, size=n)
        absent = Side("nobody", "identification", {"samples": 10, "by": "nfoursid"})
        broken = Side("broken", "csv", {"rows": "x", "by": "to_csv"})
        for peer in () if against else (absent, broken):
            yield bench.Row(peer.what, bench.command("--version", fresh=True), peer, bench.ratio, "×", 1e9)

    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n{bench.MARK}\n\nof before\n", encoding="utf-8")
    monkeypatch.setattr(bench, "BENCHES", {"cheap": cheap})
    monkeypatch.setattr(bench, "STEEPEST", 1e9)  # two measurements of milliseconds on a busy machine
    words = ["--quick", "--table", str(page), *(["--against", str(ROOT)] if against else [])]
    assert bench.main(words) == int(not against)  # what is broken counts as missed
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"# Page\n\n{bench.MARK}\n\nA quick run of ")
    assert "of before" not in text
    heads, _, first, second, *others, to_csv, savetxt = rows(text)
    assert {len(row) for row in rows(text)} == {len(heads)}
    assert [row[0] for row in (first, second)] == ["1000 rows", "2000 rows"]
    for row in (first, second):
        cost = row[2 if against else 1].split()
        assert float(cost[0]) > 0.0
        assert cost[3] == "MiB"
        assert float(row[-3].removesuffix(" ×")) > 0.0
        assert row[-2:] == ["≤ 1e+09 ×", "ok"]
    assert [to_csv[0], savetxt[0]] == ["exponent: to_csv", "exponent: savetxt"]
    if not against:
        assert others[0][2:] == ["nobody: nfoursid is not installed", "", "≤ 1e+09 ×", ""]
        assert others[1][-1] == "MISSED"


def test_an_exponent_is_that_of_the_large_sizes() -> None:
    side = Side("", "", {}, "family")
    measured = [(bench.Row("", side, size=n), [[Cost(1e-6 * n**1.5)], [Cost(3.0 * n)]]) for n in (100.0, 500.0, 2000.0)]
    measured.append((bench.Row("", side, size=1.0), [[Cost(10.0)], [Cost(10.0)]]))  # a constant cost, left out
    ((family, found),) = bench.exponents(measured)
    assert family == "family"
    assert found == pytest.approx([1.5, 1.0])


def test_what_was_not_measured_is_no_number() -> None:
    row = bench.Row("", Side("", "", {}), Side("peer", "", {}), bench.faster, "×", least=2.0)
    assert bench.lines_of(row, [[Cost(1.0, 50.0), Cost(4.0, 60.0)]])[-3:] == ("4 ×", "≥ 2 ×", "ok")
    assert bench.lines_of(row, [[Cost(1.0, 50.0), Cost(1.0, 60.0)]])[-1] == "MISSED"
    assert bench.lines_of(row, [[Cost(1.0, 50.0), Cost(problem="x is not installed")]])[-3:] == ("", "≥ 2 ×", "")
    assert math.isnan(bench.value(Cost(1.0)))
