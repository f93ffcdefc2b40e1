"""`--confine`: what a hostile FMU reaches from a worker process, with it and without."""

from __future__ import annotations

import json
import os
import pickle
import socket
from collections import OrderedDict, deque
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
from tests.worker_tasks import Trap, obey
from workbench.cli.app import run
from workbench.core import confine
from workbench.core.where import Limits, Worker, Workers
from workbench.workers import answers
from workbench.workers.answers import in_records, records_only
from workbench.workers.pool import Pool
from workbench.workers.runner import Lost

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
    monkeypatch.setattr("workbench.workers.pool.why_not", lambda: "it needs Linux, not Plan 9")
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


def test_answers_are_made_of_records_only(tmp_path: Path) -> None:
    for packing in (pickle.dumps, in_records):
        with pytest.raises(pickle.UnpicklingError, match="not part of a result"):
            records_only(packing(Trap(str(tmp_path / "sprung"))))
    assert not (tmp_path / "sprung").exists()
    for name in ("workbench.cli.app run", "workbench.store Store", "builtins eval", "workbench.workers.answers _class"):
        with pytest.raises(pickle.UnpicklingError):
            records_only(b"".join((b"\x80\x05", *map(text_of, name.split()), b"\x93.")))


def text_of(text: str) -> bytes:
    """Text as pickle writes it."""
    return b"\x8c" + bytes([len(text)]) + text.encode()


class Called:
    """Pickles as a call of a function."""

    def __init__(self, call: object, *arguments: object) -> None:
        self.made = call, arguments

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return self.made


def test_answers_arrive_as_they_were() -> None:
    numbers = np.arange(6.0).reshape(2, 3)
    plain = [1, 2.5, None, True, "é", b"x", (1, [2]), {"a": {3}}, frozenset({4}), 1j, range(3), slice(1), Path("a/b")]
    kept = records_only(in_records([*plain, deque([1], 2), OrderedDict(a=1), Limits(timeout=3.0, confine=True)]))
    assert kept == [*plain, deque([1], 2), OrderedDict(a=1), Limits(timeout=3.0, confine=True)]
    arrays: list[Any] = [
        numbers,
        numbers.T,
        numbers[:, 1],
        numbers > 2.0,
        np.zeros((0, 3)),
        numbers.astype(complex),
        np.int32(7),
    ]
    for sent, found in zip(arrays, records_only(in_records(arrays)), strict=True):
        assert (found.dtype, found.shape) == (sent.dtype, sent.shape)
        assert (found == sent).all()
    same = records_only(in_records([numbers, numbers]))
    same[0][0] = 9.0  # it may be written to, and what was one array still is
    assert same[0] is same[1]
    error = wb.SimulationError("the pump ran dry", time=1.5)
    error.before = Limits()
    again = records_only(in_records(error))
    assert (type(again), str(again), again.time, again.before) == (type(error), str(error), 1.5, Limits())


def test_an_answer_changes_no_class() -> None:
    """As pickle's instruction BUILD does, of a class, of a member of an enumeration, of a data type."""
    limits = pickle.dumps(Limits)[:-1]  # but its end
    with pytest.raises(pickle.UnpicklingError, match="BUILD"):
        records_only(limits + b"N}" + text_of("apart") + b"Ns\x86b.")
    assert Limits(confine=True).apart
    for harmless_otherwise in (np.dtype("f8"), np.arange(3.0), Limits()):
        with pytest.raises(pickle.UnpicklingError, match="BUILD"):
            records_only(pickle.dumps(harmless_otherwise))


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        (answers._array, ("O", (1,), b"12345678")),
        (answers._array, ("f8,O", (1,), b"1234567812345678")),
        (answers._array, ("V8", (1,), b"12345678")),
        (answers._array, ("f8", (1 << 60,), b"12345678")),
        (answers._record, ("workbench.core.where", "Limits", {"__class__": 1})),
        (answers._record, ("workbench.store", "Store", {})),
        (answers._record, ("workbench.core.where", "dataclass", {})),
        (answers._record, ("os", "path", {})),
        (answers._error, ("workbench.core.where", "Limits", (), {})),
        (answers._member, ("workbench.core.where", "Limits", "timeout")),
    ],
)
def test_what_may_be_called_takes_nothing_else(call: object, arguments: tuple[object, ...]) -> None:
    with pytest.raises((pickle.UnpicklingError, ValueError, TypeError)):
        records_only(pickle.dumps(Called(call, *arguments)))


def test_objects_in_an_array_are_not_sent() -> None:
    with pytest.raises(pickle.UnpicklingError, match="which are not numbers"):
        records_only(in_records(np.array([1, "a"], dtype=object)))


@needs_landlock
def test_a_confined_worker_that_sends_something_else_is_lost(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model, Pool(model.recipe, jobs=1, limits=Limits(confine=True)) as pool:
        (event,) = pool.run(obey, deque([("trap", str(tmp_path / "sprung"))]))
    assert isinstance(event, Lost)
    assert not (tmp_path / "sprung").exists()
