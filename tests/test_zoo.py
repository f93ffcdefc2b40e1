"""The corpus beside FMPy: every FMU is read and simulated as FMPy does, or refused for a reason that is true."""

from __future__ import annotations

import os
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scripts import zoo as zoo_script
from scripts import zoo_oracle as oracle
from scripts.zoo import BAD, Row, page_of, zoo
from tests.corpus import CORPUS, Exhibit, build_corpus
from tests.hostile_fmus import build_hostile
from tests.lying_fmus import build_lying
from workbench.show.page import write_page

# Without a limit of memory, under which each FMU takes a worker process of its own.
LIMITS = oracle.Limits(seconds=120.0)

# Those that misbehave, or break a promise, have tests of their own, and take their time.
QUICK = [e for e in CORPUS if not e.name.startswith(("hostile-", "lying-"))]

# Others' co-simulation that has no equilibrium: a trim is 15,000 of its runs or 400,000 of its steps; "slow" ends at
# the time limit. The same verdicts are those of Hybrid_cs here, of tests/test_trim_verdicts.py and of
# tests/test_jobs_everywhere.py; `scripts/zoo.py` asks these for it, too.
LONG_TRIMS = {"CoupledClutches_CS_linux64", "FMU3Model", "slow"}

# A folder of further FMUs, where the environment names one.
ELSEWHERE = os.environ.get("WORKBENCH_ZOO", "")


def _bad(rows: Iterator[Row]) -> list[Row]:
    found = list(rows)
    assert found
    return [row for row in found if row.verdict in BAD]


@pytest.mark.parametrize("exhibit", QUICK, ids=lambda e: e.name)
def test_the_corpus(exhibit: Exhibit, tmp_path: Path) -> None:
    (name,) = build_corpus(tmp_path, [exhibit])
    commands = ("simulate",) if exhibit.name in LONG_TRIMS else ("simulate", "trim")
    assert _bad(zoo([tmp_path / name], commands, LIMITS)) == []


@pytest.mark.skipif(not ELSEWHERE, reason="WORKBENCH_ZOO names no folder of further FMUs")
def test_fmus_from_elsewhere() -> None:
    assert _bad(zoo(sorted(Path(ELSEWHERE).rglob("*.fmu")), ("simulate",), LIMITS)) == []


@pytest.mark.parametrize(
    ("end", "shift", "verdict"),
    [(1.0, 0.0, "ok"), (1.0, 5e-4, "ok"), (1.0, 5e-3, "disagrees"), (0.5, 0.0, "disagrees")],
)
def test_what_differs_is_seen(end: float, shift: float, verdict: str, tmp_path: Path) -> None:
    """A value may be off by 1e-3 of its range; a run that ends earlier is another one. The page says so first."""
    asked = oracle.Asked(start=0.0, stop=1.0, step=0.01)
    time = np.linspace(0.0, 1.0, 101)
    theirs = oracle.Run(time=time, signals={"y": 4.0 * time})
    kept = time[time <= end]
    found, reason = zoo_script._compared({"time": kept.tolist(), "signals": {"y": 4.0 * (kept + shift)}}, theirs, asked)
    assert found == verdict
    row = Row("some.fmu", "a tool", "2.0", "me", "simulate", found, reason)
    write_page(page_of([row]), tmp_path / "zoo.html")
    text = (tmp_path / "zoo.html").read_text(encoding="utf-8")
    assert ("some.fmu me simulate: disagrees" in text) == (verdict == "disagrees")


def test_an_oracle_that_crashes_is_no_oracle(tmp_path: Path) -> None:
    """Each interface is asked for in a child of its own where the child of both has died, and nothing is believed."""
    described, runs = oracle.consult(build_hostile(tmp_path, "segfault"), LIMITS)
    assert set(described.interfaces) == set(runs) == {"me", "cs"}
    assert all(run.fails.startswith("its process ended with exit code") for run in runs.values())


def test_a_refused_bomb_must_be_one(tmp_path: Path) -> None:
    (true,) = (true for said, true in zoo_script.OF_FILES if "bombs" in said)
    answers = []
    for megabytes in (60, 70):  # either shrinks a thousand times
        file = tmp_path / f"{megabytes}.fmu"
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("zeros", bytes(megabytes << 20))
        answers.append(true(file))
    assert answers == [False, True]


def test_names_are_unique_and_told() -> None:
    assert len({e.name for e in CORPUS}) == len(CORPUS)
    assert all(e.source and e.mimics for e in CORPUS)


def test_what_is_left_out_is_the_reason_of_a_no() -> None:
    page, out = "Linear model of X (cs)\nx1 output 0.002\n", "note: order 2\nnote: k1 is left out: it does not act\n"
    done = subprocess.CompletedProcess((), 1, page, out)
    assert zoo_script._verdict(done) == ("no", "k1 is left out: it does not act")
    done = subprocess.CompletedProcess((), 1, page + "failed: 1 point\n", out)
    assert zoo_script._verdict(done) == ("no", "failed: 1 point")


def test_what_fmpy_is_not_sure_of_is_no_disagreement(tmp_path: Path) -> None:
    """A stiff model is more accurate here; one that counts its steps has no answer; not-a-number is a true reason."""
    stiff, counter = (build_lying(tmp_path, name) for name in ("diverging", "counter"))
    nan = build_hostile(tmp_path, "nan-output")
    found = {
        (r.fmu, r.interface): r for r in zoo([stiff, counter, nan], ("simulate",), LIMITS) if r.command == "simulate"
    }
    assert found[stiff.name, "me"].verdict == "ok"
    assert "at a hundredth of its tolerance" in found[stiff.name, "me"].reason
    assert found[counter.name, "me"].verdict == "no"
    assert "two runs of FMPy differ" in found[counter.name, "me"].reason
    assert {found[nan.name, side].verdict for side in ("me", "cs")} == {"refused"}
