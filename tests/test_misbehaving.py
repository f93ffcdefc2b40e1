"""FMUs that crash, end their process, hang, print: the caller gets the right error or the right numbers, and lives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from scripts.misbehave import DEEDS, LIE, LIES, ME, Case, build, expected, in_python, truth_of
from tests.misbehaving_fmus import WAYS, build_misbehaving
from workbench.cli.app import run
from workbench.errors import SimulationError
from workbench.jobs.options import Workers
from workbench.limit_cycles.feedback import run as feedback_run

# Each way once, and each analysis with what ends or fools it; `scripts/misbehave.py` tries all with all.
_CASES = [
    *((way, "doStep", "cs", "simulate") for way in WAYS),
    *((way, "getReal", "me", "trim") for way in ("nan", "descriptors", "cwd")),
    *((way, "terminate", "me", "lin") for way in ("segfault", "hang")),
    *((way, "load", "me", "info") for way in ("exit3", "hang")),
    *(("segfault", "getDerivatives", "me", what) for what in ("compare", "modes", "excite")),
    *(("exit0", "doStep", "cs", what) for what in ("compare", "delays", "excite")),
    ("abort", "getReal", "cs", "check"),
    ("segfault", "getFMUstate", "cs", "run"),
    ("hang", "getFMUstate", "me", "check"),
    ("nan", "getFMUstate", "cs", "delays"),  # its steps have one length then, and a note says so
    ("segfault", "terminate", "me", "check"),
    ("exit0", "freeInstance", "cs", "check"),
    ("descriptors", "getReal", "me", "loop"),  # its worker begins others, whose lifelines it holds
    ("events", "getDerivatives", "me", "trim"),
    ("events", "getDerivatives", "me", "modes"),
    ("memory", "doStep", "cs", "lin"),
    ("memory", "getDerivatives", "me", "run"),  # a study whose analyses have a limit of their own
    ("segfault", "load", "cs", "export"),
    *((way, "exitInitialization", "me", "lin") for way in ("_data", "_traps", "_arithmetic")),
    ("_space", "load", "me", "lin"),
    ("_few", "load", "me", "limit-cycle"),  # the binary of another FMU cannot be loaded any more
    ("rounding", "enterEventMode", "me", "check"),  # its second instance begins in the arithmetic of the first
    *((lie, LIE, interface, "nfr") for lie, interface in zip(LIES, ("me", "cs") * len(LIES), strict=False)),
    ("unset", LIE, "cs", "simulate"),
]


@pytest.fixture(scope="module")
def truths(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str, bool], Any]:
    """What the FMU gives that behaves; `info` says so of its outputs even where a probe of its binary crashed."""
    folder = tmp_path_factory.mktemp("well")
    every = {(interface, what, call == LIE): Case(way, call, interface, what) for way, call, interface, what in _CASES}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MISBEHAVES", "")
        return {key: truth_of(folder, case, program=False) for key, case in every.items()}


@pytest.mark.parametrize(("way", "call", "interface", "what"), _CASES)
def test_the_caller_is_told_and_lives(
    way: str,
    call: str,
    interface: str,
    what: str,
    tmp_path: Path,
    truths: dict[tuple[str, str, bool], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MISBEHAVES", "")  # to be as it was
    if (way, call) == ("hang", "terminate"):
        monkeypatch.setattr("workbench.jobs.worker_process.AFTERWARDS", 3.0)
    case = Case(way, call, interface, what)
    seen = in_python(build(tmp_path, case), case, truths[interface, what, call == LIE])
    assert seen.right, seen
    assert "\n" not in seen.words


def _numbers(file: Path, what: str) -> Any:  # noqa: ANN401 - as they are
    return DEEDS[what].numbers(DEEDS[what].function(file, "me", Workers(jobs=1)).to_dict())


@pytest.mark.parametrize("way", ["rounding", "_arithmetic"])
def test_an_fmu_that_makes_room_changes_no_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str) -> None:
    """A worker lets go of the model that was not used for longest, whose destructor rounds upwards from then on."""
    monkeypatch.setenv("MISBEHAVES", f"{{{way}@unload}}")
    found = []
    for number in range(7):
        (tmp_path / f"{number}").mkdir()
        found.append(_numbers(build_misbehaving(tmp_path / f"{number}", "nothing", "never"), "simulate"))
    assert all(np.array_equal(numbers, found[0]) for numbers in found[1:])


def test_the_code_of_a_thread_that_an_fmu_leaves_behind_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker lets go of models that were not used lately; the thread runs on while others are at work."""
    monkeypatch.setenv("MISBEHAVES", "")  # no other test's FMUs get this worker, to whose log the thread writes
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        file = build_misbehaving(folder, "thread", "instantiate")
        assert len({str(_numbers(file, what)) for what in ("simulate", "lin", "trim")}) == 3
        for number in range(6):
            (folder / f"{number}").mkdir()
            well = build_misbehaving(folder / f"{number}", "nothing", "never")
            assert _numbers(well, "simulate")[-1] > 0.0


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


def test_a_comparison_without_its_runs_does_not_end_as_if_all_were_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = str(build_misbehaving(tmp_path, "segfault", "getDerivatives"))
    line = ["--label", "a", "--label", "b", "--output", "y", "--window", "0:1", "--interface", "me", "--json", "-"]
    assert run(["simulate", bad, bad, *line]) == 1
    assert [f["system"] for f in json.loads(capsys.readouterr().out)["failed"]] == ["a", "b"]


@pytest.mark.parametrize("what", ["simulate", "nfr", "excite", "compare", "run", "loop"])
def test_a_crash_when_all_was_told_is_a_note(what: str, tmp_path: Path) -> None:
    """The result is there, and right; that the FMU crashes in `terminate` is not kept from who asked."""
    case = Case("segfault", "terminate", "me", what)
    found = DEEDS[what].function(build(tmp_path, case), "me", Workers(jobs=1))
    notes = (*getattr(found, "notes", ()), *getattr(found, "warnings", ()))
    assert any("when all was told, the FMU crashed" in note for note in notes), notes


def test_a_crossover_that_is_not_known_has_its_reason(tmp_path: Path) -> None:
    """Co-simulation parts lend their equations of model exchange to the loop."""
    case = Case("nan", "getDerivatives", "cs", "delays")
    found = DEEDS["delays"].function(build(tmp_path, case), "cs", Workers(jobs=1))
    assert found.loops[0].crossover_hz is None
    assert any("its crossover is not known" in note for note in found.notes)


def test_a_block_that_cannot_be_cut_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise SimulationError("not a finite number")

    monkeypatch.setattr(feedback_run, "cut_at", fail)
    with wb.load(build(tmp_path, Case("nothing", "never", "me", "feed-forward"))) as model:
        found = wb.feedback(model, source="mass.rate", target="plant.u", in_process=True)
    assert any("the remaining cycles are not predicted: damper: not a finite number" in n for n in found.notes)


@pytest.mark.parametrize("what", ["modes", "limit-cycle", "feed-forward"])
def test_what_needs_equations_says_so_of_co_simulation(what: str, tmp_path: Path) -> None:
    assert DEEDS[what].interfaces == ME
    file = build(tmp_path, Case("nothing", "never", "cs", what))
    with pytest.raises(wb.InputError, match=r'co-simulation.*give interface "me" to plant'):
        DEEDS[what].function(file, "cs", Workers(jobs=1))


def test_modes_of_one_fmu_of_co_simulation_name_what_to_do(tmp_path: Path) -> None:
    with (
        wb.load(build_misbehaving(tmp_path, "nothing", "never"), "cs") as model,
        pytest.raises(wb.InputError, match="use interface me"),
    ):
        wb.modes(model, vary="u", values=[1.0, 2.0])
    with (
        wb.load(build_misbehaving(tmp_path, "nothing", "never"), "me") as model,
        pytest.raises(wb.InputError, match="use another method"),
    ):
        wb.modes(model, vary="u", values=[1.0, 2.0], method="response")


@pytest.mark.parametrize("way", ["rounding", "files"])
def test_what_an_fmu_changes_of_its_process_does_not_reach_the_next_one(way: str, tmp_path: Path) -> None:
    def motion() -> list[float]:
        with wb.load("fmu:Rudder") as rudder:
            found: list[float] = wb.simulate(rudder, stop=1.0, inputs={"delC": 3.0})["del"].tolist()
            return found

    before = motion()
    with wb.load(build_misbehaving(tmp_path, way, "terminate")) as model:
        wb.simulate(model, stop=1.0, inputs={"u": 2.0})
    assert motion() == before


@pytest.mark.parametrize("what", ["lin", "trim", "info", "check"])
def test_an_fmu_that_opens_all_files_is_one_line(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = run([what, str(build_misbehaving(tmp_path, "files", "instantiate")), "--json", "-"])
    out, err = capsys.readouterr()
    assert json.loads(out)
    assert "Traceback" not in err
    assert code in {0, 1, 2}
