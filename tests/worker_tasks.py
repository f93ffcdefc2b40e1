"""Tasks that worker processes can import: each does what its job says, well or badly."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.option import option
from workbench.errors import SimulationError, WorkbenchError
from workbench.jobs.job import Job
from workbench.jobs.process_state import state
from workbench.jobs.runner import Remark
from workbench.jobs.worker_main import _WorkerState
from workbench.model import Model
from workbench.requests.request import ModelRequest

if TYPE_CHECKING:
    from workbench.point.trim.result import TrimResult  # noqa: F401 - the record's type, below


def obey(model: Model, job: tuple[Any, ...]) -> Iterator[Any]:
    """Jobs are tuples: a word, then its arguments."""
    word, *arguments = job
    yield from _DEEDS[word](model, *arguments)


def number(model: Model, job: tuple[Any, ...]) -> Iterator[int]:
    """Do the same, and declare what is right only for numbers."""
    yield from obey(model, job)


class Pretended(ModelRequest["TrimResult"]):
    """A request whose answer is another's."""

    command = "pretended"
    algorithm = "tests.worker_tasks:pretend"
    example = "workbench pretended"

    _: KW_ONLY
    when: str = option("When the other record is told.", default="at its end")


def surroundings(_: Model | None, parent: int) -> Iterator[tuple[object, ...]]:
    """Yield what a worker has of its process: state, open files, and what it is to its parent."""
    files = sorted(file.readlink().name.partition(":")[0] for file in Path("/proc/self/fd").iterdir() if file.exists())
    own = {**state(), "environment": set(os.environ) | set(sys.path), "folder": Path.cwd()}
    yield own, files, (os.getsid(0) == os.getpid(), os.getppid() == parent)


def pretend(model: Model, asked: Pretended, job: Job) -> object:
    """Return, or tell on the way, a record that nobody asked for."""
    other = Remark("another")
    if asked.when == "on its way":
        job.partial = lambda: other
        job.done("a part", 1, 2)
    return other


def _say(model: Model, *values: int) -> Iterator[Any]:
    yield from values


def _name(model: Model) -> Iterator[Any]:
    with model.open_session() as session:
        yield model.name, sorted(session.values([v.name for v in model.outputs])), os.getpid()


def _signal(model: Model, number: int) -> Iterator[Any]:
    yield "before"
    os.kill(os.getpid(), number)
    yield "still here"


def _segfault(model: Model) -> Iterator[Any]:
    ctypes.string_at(0)
    yield "never"


def _exit(model: Model, code: int) -> Iterator[Any]:
    if code >= 0:
        os._exit(code)
    yield "never"


def _sleep(model: Model, *seconds: float) -> Iterator[Any]:
    for s in seconds:
        time.sleep(s)
        yield s


def _start(model: Model, then: str = "sleep") -> Iterator[Any]:
    """Start another process, as an FMU that wraps a program does."""
    yield subprocess.Popen(["sleep", "1000"], stdin=subprocess.DEVNULL).pid
    yield from _DEEDS[then](model, *([1000.0] if then == "sleep" else []))


def _warn(_: Model) -> Iterator[Any]:
    """Warn as libraries of Python do, of an overflow or of what will go."""
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)
    yield "warned"


def _endless_in_c(model: Model) -> Iterator[Any]:
    """Sit in C code, as an FMU that hangs does."""
    yield "before"
    ctypes.CDLL(None).pause()
    yield "never"


def _endless_with_lock(model: Model) -> Iterator[Any]:
    """Sit in C code that keeps Python's lock."""
    yield "before"
    ctypes.PyDLL(None).pause()
    yield "never"


def _allocate(model: Model, megabytes: int) -> Iterator[Any]:
    yield len(bytearray(megabytes * 1_000_000))


def _malloc(model: Model, megabytes: int) -> Iterator[Any]:
    """Write where malloc said NULL, as careless C code does."""
    library = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    address = library.malloc(ctypes.c_size_t(megabytes * 1_000_000))
    ctypes.memset(address or 0, 1, 1)
    yield "allocated"


def _fail(model: Model) -> Iterator[Any]:
    yield from ()
    raise SimulationError("fmi2DoStep returned error", time=1.5)


def _bug(model: Model) -> Iterator[Any]:
    nothing: dict[str, int] = {}
    yield nothing["nosuch"]


def _modules(model: Model) -> Iterator[Any]:
    yield sorted(name.partition(".")[0] for name in sys.modules)


def _stdout(model: Model) -> Iterator[Any]:
    os.write(1, b"written by the FMU\n")
    yield None


def _last_words(model: Model, *texts: str) -> Iterator[Any]:
    """Print, and crash."""
    for text in texts:
        os.write(2, text.encode() + b"\n")
    ctypes.string_at(0)
    yield "never"


def _raise(model: Model, name: str) -> Iterator[Any]:
    """Raise what ends a generator, a thread or a process elsewhere."""
    yield "before"
    raise {"StopIteration": StopIteration, "GeneratorExit": GeneratorExit, "SystemExit": SystemExit}[name]


def _noise(model: Model, where: str) -> Iterator[Any]:
    """Write into the channel, in its messages and between them, or close it."""
    files = {int(file.name): str(file.resolve()) for file in Path("/proc/self/fd").iterdir()}
    links = [n for n, file in files.items() if n > 2 and "socket:" in file]
    for link in links:
        if where == "closed":
            os.close(link)
        else:
            os.write(link, b"noise" * 1000)
    yield "after"


class _OddError(Exception):
    """Cannot be made again from what is left of it."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__("odd")


def _odd(model: Model) -> Iterator[Any]:
    yield _OddError(1, 2)


class _LargeError(WorkbenchError):
    """Takes more memory to be told than there is."""

    def __reduce__(self) -> tuple[Any, ...]:
        raise MemoryError


def _too_large(model: Model) -> Iterator[Any]:
    yield "before"
    raise _LargeError("large")


class Trap:
    """Whoever unpickles it makes a folder."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (self.path,)


def _trap(model: Model, path: str) -> Iterator[Any]:
    yield Trap(path)


def _forge(model: Model, kind: str) -> Iterator[Any]:
    """Say what no worker says, with its own channel, as an FMU can that looks through the memory of its process."""
    texts = {
        "forged": b'{"tuple":["item",{"deque":[{"range":[100000000000]}]}]}',
        "no tuple": b"[1,2,3]",
        "an array for a kind": b'{"tuple":[{"array":["<f8",[2],0]},1]}',
    }
    channel = _WorkerState.channel
    if channel is not None:
        channel.put(len(texts[kind]).to_bytes(8, "big") + texts[kind] + bytes(16))
    yield from ()


_DEEDS = {name.lstrip("_"): deed for name, deed in list(globals().items()) if name.startswith("_") and callable(deed)}
