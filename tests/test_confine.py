"""`--confine`: what a hostile FMU reaches from a worker process, with it and without."""

from __future__ import annotations

import json
import math
import os
import pickle
import socket
import tracemalloc
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from enum import IntFlag
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.fakes import EulerOscillator, FakeModel
from tests.misbehaving_fmus import build_misbehaving
from tests.record_examples import Maker
from tests.test_told_in_records import words_of
from tests.worker_tasks import Pretended, Trap, number, obey
from workbench.cli.app import run
from workbench.data.excite.run import _ExciteJob
from workbench.errors import LostError
from workbench.health.check.job import CheckJob
from workbench.health.info.result import FmuInfo
from workbench.jobs import answers, confine
from workbench.jobs.answers import Records, in_records
from workbench.jobs.job import Job
from workbench.jobs.options import Limits, Worker, Workers
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Lost, Reply, perform, yielded
from workbench.point.lin.result import LinResult
from workbench.point.lin.sweep import linearise_one
from workbench.requests.in_worker import _perform
from workbench.response.nfr.job import BranchesJob, PointsJob, StartJob, SurroundingsJob

needs_landlock = pytest.mark.skipif(bool(confine.why_not()), reason=confine.why_not())
posix = pytest.mark.skipif(
    os.name == "nt", reason="the FMU of this test opens files and sockets by functions of POSIX, which Windows lacks"
)


class Reached(IntFlag):
    """As tests/c/misbehaving has it."""

    WROTE = 1
    TCP = 2
    UDP = 4
    CHILD_WROTE = 8
    EMPTIED = 16
    SIGNALLED = 32
    OPENED_UP = 64
    OWN = 128


ALL = Reached(255)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with something to lose, and somebody who listens."""
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / "precious").write_text("work of years")
    (folder / "precious").chmod(0o600)
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        monkeypatch.setenv("ESCAPE_HOME", str(folder))
        monkeypatch.setenv("ESCAPE_PORT", str(listener.getsockname()[1]))
        yield folder


def reached(fmu: Path, worker: Worker) -> Reached:
    with wb.load(fmu, "cs", step=0.01) as model:
        found = wb.simulate(model, stop=0.02, inputs={"u": 0.0}, verify_step=False, workers=worker)
    return Reached(round(float(found["y"][-1])))


@posix
def test_without_it_an_fmu_reaches_all(tmp_path: Path, home: Path) -> None:
    assert reached(build_misbehaving(tmp_path, "escape", "doStep"), Worker()) == ALL
    assert {p.name for p in home.iterdir()} == {"precious", "written", "by_child"}
    assert (home / "precious").read_text() == ""


@needs_landlock
@pytest.mark.parametrize("call", ["doStep", "instantiate"])
def test_with_it_only_its_own_folder(tmp_path: Path, home: Path, call: str) -> None:
    found = reached(build_misbehaving(tmp_path, "escape", call), Worker(confine=True))
    assert found & ~Reached.SIGNALLED == Reached.OWN
    if confine.landlock_version() >= confine.SIGNALS_SINCE:
        assert not found & Reached.SIGNALLED
    assert [p.name for p in home.iterdir()] == ["precious"]
    assert (home / "precious").read_text() == "work of years"
    assert (home / "precious").stat().st_mode & 0o777 == 0o600


LINES = {
    "simulate": ["--stop", "0.02", "--step", "0.01", "--interface", "cs"],
    "nfr": ["--input", "u", "--output", "y", "--freq", "1", "--amplitude", "1", "--interface", "cs", "--step", "0.01"],
    "lin": ["--interface", "me"],
    "trim": ["--interface", "me"],
    "info": [],
    "check": ["--only", "runs"],
    "excite": [
        "--input",
        "u",
        "--output",
        "y",
        "--prbs",
        "amplitude=1",
        "--step",
        "0.01",
        "--samples",
        "100",
        "--interface",
        "cs",
    ],
}


@needs_landlock
@pytest.mark.parametrize("command", LINES)
def test_every_command_confines(tmp_path: Path, home: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = build_misbehaving(tmp_path, "escape", "instantiate")
    assert run([command, str(fmu), *LINES[command], "--confine", "--json", str(tmp_path / "out.json")]) in (0, 1)
    assert (tmp_path / "out.json").exists(), capsys.readouterr().err
    assert [p.name for p in home.iterdir()] == ["precious"]


@needs_landlock
@pytest.mark.parametrize("command", ["limit-cycle", "feedback", "feed-forward", "onset", "loop", "lin --compare"])
def test_a_confined_process_begins_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    """What a command does in parts, or asks of other analyses, it does where it is."""
    monkeypatch.chdir(tmp_path)
    words = words_of(tmp_path, command, "nothing", "never")
    assert run([*words, "--confine", "--json", "out.json"]) == 0
    assert "cannot be started" not in Path("out.json").read_text()


@needs_landlock
def test_parts_of_a_confined_analysis_run_one_after_the_other(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["modes", "fmu:FirstOrderLag", "--vary", "tau=0.5:2", "--points", "3", "--jobs", "2", "--confine"]
    assert run([*line, "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any(note.startswith("a confined process begins no others") for note in found["notes"])
    assert run([*line[:-3], "--json", "-"]) == 0
    assert found["sets"] == json.loads(capsys.readouterr().out)["sets"]


@needs_landlock
def test_a_confined_probe_finds_what_another_finds() -> None:
    found, other = wb.info("fmu:Rudder", confine=True), wb.info("fmu:Rudder")
    assert isinstance(found, FmuInfo)
    assert isinstance(other, FmuInfo)
    assert found.capabilities == other.capabilities


@needs_landlock
def test_a_study_confines(tmp_path: Path, home: Path) -> None:
    fmu = build_misbehaving(tmp_path, "escape", "instantiate")
    study = tmp_path / "study.toml"
    study.write_text(
        f'models.one = "{fmu.name}"\n'
        'analyses.run = {command = "simulate", model = "one", stop = 0.1, csv = "run.csv"}\n'
        '[[requirements]]\nname = "r"\nanalysis = "run"\nkind = "value"\npath = "time"\nmin = 0.0\n'
    )
    found = wb.run_study(study, store=None, confine=True)
    assert not found.failed, found.failed
    assert (tmp_path / "run.csv").exists()
    assert [p.name for p in home.iterdir()] == ["precious"]


@needs_landlock
def test_results_are_the_same(tmp_path: Path) -> None:
    texts = []
    for words in ([], ["--confine"]):
        out = tmp_path / "out.json"
        assert run(["lin", "fmu:Rudder", "--inputs", "delC", *words, "--json", str(out)]) == 0
        texts.append({k: v for k, v in json.loads(out.read_text()).items() if k in ("A", "B", "C", "D", "x0")})
    assert texts[0] == texts[1]


# -- refused where it cannot be ----------------------------------------------------------------


def test_it_is_refused_where_it_cannot_be(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("workbench.jobs.pool.why_not", lambda: "it needs Linux, not Plan 9")
    assert run(["simulate", "fmu:FirstOrderLag", "--stop", "1", "--confine"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "workbench: --confine: not possible here: it needs Linux, not Plan 9"


@pytest.mark.parametrize(
    "command", [["lin", "fmu:Rudder"], ["nfr", "fmu:Rudder", *LINES["nfr"]], ["run", "study:rudder_specification"]]
)
def test_it_is_refused_on_a_cluster(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*command, "--confine", "--scheduler", "local:2"]) == 2
    assert "confinement needs the workbench's own worker processes" in capsys.readouterr().err.splitlines()[-1]


def test_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "darwin")
    assert "it needs Linux" in confine.why_not()
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    assert confine.why_not() == "it is not known for the processor riscv64, only for x86_64 and aarch64"
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    for version, words in ((-1, "has no Landlock"), (2, "only version 2")):
        monkeypatch.setattr(confine, "_syscall", lambda *_, v=version: v)
        assert words in confine.why_not()


def test_it_is_refused_in_this_process() -> None:
    with pytest.raises(wb.InputError, match="confine: this process cannot be confined"):
        Worker(confine=True, in_process=True)
    with pytest.raises(wb.InputError, match="confinement needs the workbench's own worker processes"):
        Workers(confine=True, executor=ThreadPoolExecutor(1))
    with pytest.raises(wb.InputError, match="a scheduler: confinement needs the workbench's own worker processes"):
        Workers(confine=True, scheduler="local:2")  # what comes from there is unpickled as it is
    with pytest.raises(wb.InputError, match=r"confine: not possible: .* exists only in this process"):
        wb.trim(FakeModel(EulerOscillator), confine=True)


@needs_landlock
def test_a_process_with_threads_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("os.listdir", lambda _: ["1", "2"])
    with pytest.raises(OSError, match="several threads"):
        confine.confine(str(tmp_path))
    assert not confine.confined()


# -- what comes back ---------------------------------------------------------------------------


def forged(tree: object, content: bytes = b"") -> Any:  # noqa: ANN401 - any result
    """Return what is made of a text that no writer wrote."""
    text = json.dumps(tree).encode()
    return Records()(len(text).to_bytes(8, "big") + text + content)


def again(item: object) -> Any:  # noqa: ANN401 - any result
    """Return what arrives."""
    return Records()(in_records(item))


def test_answers_are_made_of_records_only(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="cannot be part of"):
        in_records(Trap(str(tmp_path / "sprung")))
    for packed in (pickle.dumps(Trap(str(tmp_path / "sprung"))), pickle.dumps(Limits())):
        with pytest.raises((pickle.UnpicklingError, ValueError)):
            Records()(packed)
    assert not (tmp_path / "sprung").exists()


def test_answers_arrive_as_they_were() -> None:
    numbers = np.arange(6.0).reshape(2, 3)
    plain = [1, 2.5, None, True, "é", b"x", (1, [2]), {"a": {3}}, frozenset({4}), 1j, slice(1), Path("a/b")]
    kept = again([*plain, (), {}, {(1, "a"): [()]}, "\ud800", Limits(timeout=3.0, confine=True)])
    assert kept == [*plain, (), {}, {(1, "a"): [()]}, "\ud800", Limits(timeout=3.0, confine=True)]
    assert np.isnan(again((math.nan, math.inf))[0])
    arrays: list[Any] = [
        numbers,
        numbers.T,
        numbers[:, 1],
        numbers > 2.0,
        np.zeros((0, 3)),
        numbers.astype(complex),
        np.int32(7),
    ]
    for sent, found in zip(arrays, again(arrays), strict=True):
        assert (found.dtype, found.shape) == (sent.dtype, sent.shape)
        assert (found == sent).all()
    same = again([numbers, numbers])
    same[0][0] = 9.0  # it may be written to, and what was one array still is
    assert same[0] is same[1]
    error = wb.SimulationError("the pump ran dry", time=1.5)
    error.before = Limits()
    told = again(error)
    assert (type(told), str(told), told.time, told.before) == (type(error), str(error), 1.5, Limits())


FORGERIES: dict[str, tuple[object, bytes]] = {
    "objects": ({"array": ["O", [1], 0]}, bytes(8)),
    "objects in a structure": ({"array": ["f8,O", [1], 0]}, bytes(16)),
    "bytes that are anything": ({"array": ["V8", [1], 0]}, bytes(8)),
    "more numbers than were sent": ({"array": ["<f8", [1 << 60], 0]}, bytes(8)),
    "numbers before the first": ({"array": ["<f8", [1], -8]}, bytes(8)),
    "a negative length": ({"array": ["<f8", [-1], 0]}, bytes(8)),
    "very many axes": ({"array": ["<f8", [10**4000] * 10000, 0]}, bytes(8)),
    "an array as a list": ({"tuple": {"array": ["|i1", [8], 0]}}, bytes(8)),
    "bytes that were not sent": ({"bytes": [0, 9]}, bytes(8)),
    "an array that is not there": ({"again": 0}, b""),
    "a queue": ({"deque": [{"range": [10**11]}]}, b""),
    "a range": ({"range": [0, 10**11, 1]}, b""),
    "what is called": ({"call": ["builtins", "eval", "1"]}, b""),
    "two at once": ({"tuple": [], "set": []}, b""),
    "a class of its own": ({"record": ["workbench.jobs.options", "Limits", ["__class__"], [1]]}, b""),
    "another class": ({"record": ["workbench.jobs.store", "Store", [], []]}, b""),
    "what is not a class": ({"record": ["workbench.jobs.options", "dataclass", [], []]}, b""),
    "another's module": ({"record": ["os", "path", [], []]}, b""),
    "a record as an error": ({"error": ["workbench.jobs.options", "Limits", [], [], []]}, b""),
    "a record as a member": ({"member": ["workbench.jobs.options", "Limits", "timeout"]}, b""),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_forged_answers_are_refused(forgery: str) -> None:
    with pytest.raises((pickle.UnpicklingError, ValueError, TypeError, IndexError)):
        forged(*FORGERIES[forgery])
    assert Limits(confine=True).apart


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("A", [["x"]]),
        ("A", np.array([[1j]])),
        ("dt", "0.1"),
        ("state_names", (1, 2)),
        ("units", {"x": 3}),
        ("operating_point", {}),
        ("delayed", ()),
        ("notes", "text"),
    ],
)
def test_records_whose_parts_are_of_other_types_are_refused(name: str, value: object) -> None:
    """Whoever shows one would meet them far from here."""
    result = Maker(empty=False).record(LinResult)
    assert again(result).state_names == result.state_names
    object.__setattr__(result, name, value)
    with pytest.raises(pickle.UnpicklingError, match=f"LinResult, whose {name} is not what it should be"):
        again(result)


def test_a_record_without_its_fields_is_refused() -> None:
    with pytest.raises(pickle.UnpicklingError, match="whose name is not what it should be"):
        forged({"record": ["workbench.point.lin.result", "Zero", ["kind"], ["input"]]})


def test_text_that_is_nested_deeply_is_refused() -> None:
    text = b"[" * 1_000_000
    with pytest.raises((RecursionError, ValueError)):
        Records()(len(text).to_bytes(8, "big") + text)


def test_objects_in_an_array_are_not_sent() -> None:
    with pytest.raises(TypeError, match="cannot be part of"):
        in_records(np.array([1, "a"], dtype=object))


def test_answers_of_a_task_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each alone is small; an array that is sent once and named often counts each time, as it is met each time."""
    monkeypatch.setattr(answers, "MOST", 100_000)
    for packed in (in_records(np.zeros(1000)), in_records([[]] * 300)):
        records = Records()
        records(packed)
        for _ in range(9):
            records(packed)
            records.renew()
        with pytest.raises(pickle.UnpicklingError, match="sent more than"):
            [records(packed) for _ in range(20)]
        records.renew()
        records(packed)
    with pytest.raises(pickle.UnpicklingError, match="sent more than"):
        forged([{"array": ["<f8", [1000], 0]}, *[{"again": 0}] * 20], bytes(8000))
    with pytest.raises(wb.WorkbenchError, match="larger than"):
        in_records(np.zeros(20_000))


@pytest.mark.parametrize(
    "part",
    [
        "[],",
        '"ab",',
        "1.5,",
        '{"tuple":[]},',
        '{"set":[]},',
        '{"dict":[[0],[0]]},',
        '{"complex":[1,2]},',
        '{"array":["<f8",[1],0]},',
    ],
)
def test_memory_is_in_proportion(part: str) -> None:
    """What each byte of text makes is less than what it is counted for."""
    text = ("[" + part * 2000)[:-1].encode() + b"]"
    packed = len(text).to_bytes(8, "big") + text + bytes(8)
    records = Records()
    tracemalloc.start()
    try:
        made = records(packed)
        size, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(made) == 2000
    assert size < answers._OF_TEXT * len(text)


@needs_landlock
@pytest.mark.parametrize("kind", ["forged", "no tuple", "an array for a kind"])
def test_a_confined_worker_that_sends_something_else_is_lost(kind: str) -> None:
    """As the FMU can, which finds the channel and its mark in the memory of its process."""
    with wb.load("fmu:FirstOrderLag") as model, Pool(model.recipe, jobs=1, limits=Limits(confine=True)) as pool:
        (event,) = pool.run(obey, deque([("forge", kind)]))
    assert isinstance(event, Lost)
    assert "its worker's answer cannot be read" in event.reason


@needs_landlock
def test_an_item_of_another_kind_than_the_task_declares_is_refused() -> None:
    with wb.load("fmu:FirstOrderLag") as model, Pool(model.recipe, jobs=1, limits=Limits(confine=True)) as pool:
        good, lost = pool.run(number, deque([("say", 3), ("name",)]))
    assert (good.value if isinstance(good, Reply) else None) == 3
    assert isinstance(lost, Lost)
    assert lost.reason == "its worker's answer cannot be read: part of it is missing, or was not asked for"


@needs_landlock
@pytest.mark.parametrize("when", ["on its way", "at its end"])
def test_a_record_of_another_kind_than_was_asked_for_is_refused(when: str) -> None:
    """It is whole and sound, and would fail wherever it is used."""
    told = "its worker's answer cannot be read: it is a Remark, not a TrimResult"
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(LostError, match=f"^{told}$"):
        Pretended(when=when, confine=True).run(model, Job())


def test_every_task_declares_what_it_yields() -> None:
    jobs = (PointsJob, StartJob, SurroundingsJob, BranchesJob, CheckJob, _ExciteJob)
    for kind in jobs:
        assert yielded(perform, object.__new__(kind)) is not Any
    for task in (linearise_one, _perform):
        assert yielded(task, None) is not Any
