"""What one FMU does to its process reaches nobody else, and whatever it answers is told in one line."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

import workbench as wb
from tests.mimic_fmus import build_mimic
from tests.misbehaving_fmus import CALLS, build_misbehaving
from tests.platforms import posix_signals
from workbench.cli.app import run
from workbench.jobs import worker_process as process

pytestmark = posix_signals

# What a failure of these cannot change, or what is not needed to simulate.
_NO_MATTER = {"instantiate", "freeInstance", "terminate", "getFMUstate"}


@pytest.mark.parametrize(
    ("interface", "call"), [(i, c) for i, calls in CALLS.items() for c in calls if c not in _NO_MATTER]
)
def test_a_status_that_fmi_does_not_know_is_one_line(interface: str, call: str, tmp_path: Path) -> None:
    """Negative ones are no sign of the workbench's own, such as for a function that the binary does not have."""
    with (
        wb.load(build_misbehaving(tmp_path, "negative", call), interface) as model,
        pytest.raises(wb.SimulationError, match=r"fmi2\w+ returned -1") as caught,
    ):
        wb.simulate(model, stop=1.0, inputs={"u": wb.Sine(amplitude=1.0, frequency=2.0)})
    assert f"fmi2{call[0].upper()}{call[1:]}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_an_fmu_answers_out_of_the_standard_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for way, words in {"past": "(chattering)", "never": "fmi2NewDiscreteStates gave is not a number"}.items():
        assert run(["simulate", str(build_misbehaving(tmp_path, way, "nowhere")), "--stop", "1"]) == 2
        told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("workbench: ")]
        assert len(told) == 1
        assert words in told[0]


def _lying(folder: Path, said: str, instead: str) -> Path:
    """Write an FMU that would run, if its description did not say something else."""
    honest, lying = build_misbehaving(folder, "nothing", "nowhere"), folder / "lying.fmu"
    with zipfile.ZipFile(honest) as there, zipfile.ZipFile(lying, "w") as here:
        for name in there.namelist():
            here.writestr(name, there.read(name).replace(said.encode(), instead.encode()))
    return lying


@pytest.mark.parametrize("count", ["-1", "2000000000", "99999999999999999999"])
def test_numbers_of_event_indicators_that_nobody_has_are_refused(
    count: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The kernel's arrays have this length."""
    lying = _lying(tmp_path, 'Indicators="1"', f'Indicators="{count}"')
    assert run(["simulate", str(lying), "--interface", "me", "--stop", "1"]) == 2
    assert f"and {count} event indicators; only 0 to" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["../x", "/usr/x", "a/b", "..\\x", "."])
def test_a_library_outside_of_the_fmu_is_refused_with_the_reason(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lying = _lying(tmp_path, 'Identifier="misbehaving"', f'Identifier="{name}"')
    told = f"modelIdentifier '{name}' does not name a file in the FMU; refused"
    assert run(["simulate", str(lying), "--stop", "1"]) == 2
    assert told in capsys.readouterr().err
    assert run(["info", str(lying)]) == 0  # what is written there can be read nevertheless
    shown = capsys.readouterr()
    assert "does not run here" in shown.out
    assert told in shown.err


_CHANGES = (
    *("arithmetic", "data", "stack", "size", "umask", "mask", "handler", "timer", "environment"),
    *("mappings", "fork"),
)
_LEAVE_IT = ("arithmetic", "handler", "fork")  # what is put back, is for the same FMU only, or is nothing to replace


def _motion() -> list[float]:
    """Return the rudder's, which is to be the same whatever ran before, to the last bit."""
    with wb.load("fmu:Rudder") as rudder:
        found: list[float] = wb.simulate(rudder, stop=0.5, inputs={"delC": wb.Sine(amplitude=1.0, frequency=2.0)})[
            "del"
        ].tolist()
        return found


def _workers() -> list[int]:
    return [worker.pid for worker in process._idle if worker.usable]


@pytest.mark.parametrize("way", _CHANGES)
def test_what_an_fmu_changes_of_its_process_ends_with_it(way: str, tmp_path: Path) -> None:
    before = _motion()
    used = _workers()[-1]
    with wb.load(build_misbehaving(tmp_path, f"_{way}", "newDiscreteStates"), "me") as model:
        result = wb.simulate(model, stop=1.0)
    assert _motion() == before
    if way not in _LEAVE_IT:
        assert used not in _workers()
    assert any("changed the arithmetic" in note for note in result.notes) == (way == "arithmetic")


@pytest.mark.parametrize("name", ["fast-math", "handles"])
def test_what_an_fmu_may_leave_behind_costs_it_no_new_process(name: str, tmp_path: Path) -> None:
    """Arithmetic is put back; handlers of signals stay with the FMU that set them, and away from others."""
    with wb.load(build_mimic(tmp_path, name)) as model:
        first = wb.simulate(model, stop=1.0)
        used = _workers()
        again = [wb.simulate(model, stop=1.0)["y"].tolist() for _ in range(3)]
    assert _workers() == used
    assert again == [first["y"].tolist()] * 3
    before = _motion()
    with wb.load(tmp_path / f"{name}.fmu", "cs") as model:
        wb.simulate(model, stop=1.0)
    assert _motion() == before


@pytest.mark.parametrize("call", ["terminate", "freeInstance"])
def test_a_copy_of_the_process_answers_nothing(call: str, tmp_path: Path) -> None:
    """Both copies return from the call; neither the result nor the next FMU is lost, and no copy stays."""
    before = _motion()
    for number in range(5):
        folder = tmp_path / str(number)
        folder.mkdir()
        with wb.load(build_misbehaving(folder, "_fork", call), "me") as model:
            assert wb.simulate(model, stop=1.0)["y"][-1] > 0.5
        assert _motion() == before


def test_a_warm_worker_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that the workbench itself does in a worker looks as if an FMU had changed it."""
    monkeypatch.delenv("KMP_DUPLICATE_LIB_OK", raising=False)  # as where this process has not loaded threadpoolctl
    _motion()
    used = _workers()[-1]
    with wb.load("fmu:Rudder") as rudder, wb.load(build_misbehaving(tmp_path, "nothing", "nowhere"), "me") as model:
        wb.lin(rudder)
        wb.trim(model)
        wb.nfr(rudder, "delC", "del", [1.0], 1.0, workers=wb.Workers(jobs=1))
        wb.simulate(model, stop=1.0)
    assert used in _workers()


@pytest.mark.parametrize(
    ("way", "kind", "words"),
    [
        ("close", "failed", "closed the connection to its process"),
        ("hangup", "exited", "exit code 119"),
    ],
)
def test_how_a_worker_ended_is_told_rightly(way: str, kind: str, words: str, tmp_path: Path) -> None:
    with (
        wb.load(build_misbehaving(tmp_path, f"_{way}", "newDiscreteStates"), "me") as model,
        pytest.raises(wb.WorkbenchError, match=words) as caught,
    ):
        wb.simulate(model, stop=1.0)
    assert caught.value.kind == kind


def test_what_is_to_run_in_this_process_begins_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a worker process is begun")

    with wb.load("fmu:FirstOrderLag") as model:
        monkeypatch.setattr("workbench.jobs.worker_process.WorkerProcess.__init__", refuse)
        monkeypatch.setattr("workbench.jobs.worker_process._idle", [])
        assert wb.trim(model, u0={"u": 2.0}, in_process=True).operating_point.x["x"] == pytest.approx(2.0)
        assert wb.simulate(model, stop=1.0, in_process=True).signals["y"][-1] == pytest.approx(0.0)
        with pytest.raises(AssertionError, match="is begun"):
            wb.trim(model, u0={"u": 2.0})
