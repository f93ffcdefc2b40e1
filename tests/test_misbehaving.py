"""FMUs that crash, end their process, hang, print: the caller gets the right error or the right numbers, and lives."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from scripts.misbehave import DEEDS, HANG, MEMORY, Case, expected
from tests.misbehaving_fmus import OUTSIDE, WAYS, build_misbehaving
from workbench.cli.app import run
from workbench.core.where import Worker

_CASES = [
    *((way, "doStep", "cs", "simulate") for way in WAYS),
    *((way, "getReal", "me", "trim") for way in ("abort", "exit0", "nan", "events", "descriptors", "cwd")),
    *((way, "terminate", "me", "lin") for way in ("segfault", "exit0", "hang")),
    *((way, "load", "me", "info") for way in ("segfault", "exit3", "hang")),
]
_ENDINGS = {"crashed": wb.CrashedError, "exited": wb.ExitedError, "timed out": wb.TimedOutError}


def _found(file: Path, interface: str, what: str, limits: Worker) -> Any:  # noqa: ANN401 - numbers
    with wb.load(file, interface) as model:
        return DEEDS[what](model, limits)


@pytest.fixture(scope="module")
def truths(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Any]:
    """What the FMU gives that behaves; `info` says so of its outputs even where a probe of its binary crashed."""
    file = build_misbehaving(tmp_path_factory.mktemp("well"), "nothing", "never")
    return {
        (i, what): _found(file, i, what, Worker()) for i in ("me", "cs") for what in ("simulate", "trim", "lin", "info")
    }


@pytest.mark.parametrize(("way", "call", "interface", "what"), _CASES)
def test_the_caller_is_told_and_lives(
    way: str,
    call: str,
    interface: str,
    what: str,
    tmp_path: Path,
    truths: dict[tuple[str, str], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MISBEHAVES", f"{{{way}@{call}}}" if call in OUTSIDE else "")
    limits = Worker(timeout=HANG if way == "hang" else None, memory_limit=MEMORY if way == "memory" else None)
    case = Case(way, call, interface, what)
    before = os.getcwd()  # noqa: PTH109 - as it is
    error: wb.WorkbenchError | None = None
    found = truth = truths.get((interface, what))
    try:
        found = _found(build_misbehaving(tmp_path, way, call), interface, what, limits)
    except wb.WorkbenchError as raised:
        error = raised
    assert os.getcwd() == before  # noqa: PTH109
    if error is None:
        assert _numbers(found) == _numbers(truth)
        assert "ok" in expected(case)
    else:
        assert error.kind in expected(case), str(error)
        assert "\n" not in str(error)
        assert isinstance(error, _ENDINGS.get(error.kind, wb.WorkbenchError))


def _numbers(found: object) -> object:
    return {k: v for k, v in found.items() if k != "model_sha256"} if isinstance(found, dict) else found


def test_the_code_of_a_thread_that_an_fmu_leaves_behind_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker lets go of models that were not used lately; the thread runs on while others are at work."""
    monkeypatch.setenv("MISBEHAVES", "")  # no other test's FMUs get this worker, to whose log the thread writes
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        file = build_misbehaving(folder, "thread", "instantiate")
        assert len({str(_found(file, "me", what, Worker())) for what in ("simulate", "lin", "trim")}) == 3
        for number in range(6):
            (folder / f"{number}").mkdir()
            well = build_misbehaving(folder / f"{number}", "nothing", "never")
            assert _found(well, "me", "simulate", Worker())[-1] > 0.0


def test_a_run_that_ends_before_its_first_row_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What there is so far is nothing, of which no page can be made."""
    file = str(build_misbehaving(tmp_path, "nan", "getReal"))
    assert run(["simulate", file, "--interface", "me", "--stop", "1", "--input", "u=2", "--json", "-"]) == 2
    out, err = capsys.readouterr()
    assert "failure" in json.loads(out)
    assert err.splitlines()[-1].startswith("workbench: ")


@pytest.mark.parametrize(("what", "kind"), [("trim", "exited"), ("simulate", "ok"), ("info", "ok")])
def test_what_is_right_is_written_down_for_each_case(what: str, kind: str) -> None:
    assert expected(Case("exit3", "getFMUstate", "me", what)) == {kind}
    assert "ok" not in expected(Case("hang", "getReal", "cs", "nfr"))
