"""The C runtime around a hand-written model (tests/c/stub_core.c), compiled and driven through ctypes."""

import ctypes
import shutil
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from enum import IntEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any

import fmpy

from tests.compiled import contents, kept

RUNTIME = Path(__file__).parent.parent / "workbench" / "build" / "runtime"
STUB = Path(__file__).parent / "c"
HEADERS = Path(fmpy.__file__).parent / "c-code"
GUID = b"{stub-of-the-runtime-tests}"
FLAGS = [
    *("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes"),
    *("-Wvla", "-Werror", "-isystem", str(HEADERS), "-I", str(RUNTIME)),
]
OK, WARNING, DISCARD, ERROR = range(4)


class Vr(IntEnum):
    """Value references of the stub, in the order of its enumeration."""

    TIME, H, V, DER_H, DER_V, A, B, DER_A, DER_B, S, DER_S, U, Y, GAIN, G, E, COUNT, INCREMENT, ABOVE, ENABLE = range(
        20
    )
    MODE, PERIOD, LAST, W, DER_W, SLIDE, R, DER_R, FAULT, HELD, SPAN, WAVE = range(20, 32)


def runtime_sources() -> list[str]:
    """Every C file of the runtime but the core, which the stub replaces."""
    return sorted(str(path) for path in RUNTIME.glob("*.c") if path.name != "core.c")


def compile_library(
    folder: Path, *, name: str = "stub", target: str | None = None, defines: Sequence[str] = ()
) -> Path:
    """Compile the runtime and the stub into a shared library with the cross compiler of the build chain."""
    out = folder / f"{name}.library"
    aim = [] if target is None else ["-target", target]
    command = [sys.executable, "-m", "ziglang", "cc", *aim, "-shared", "-fPIC", *FLAGS]
    # The macros are the stub's own: with the same flags, the compiler takes the runtime from its cache.
    stub = folder / f"{name}_core.c"
    text = [f"#define {d.replace('=', ' ', 1)}\n" for d in defines] + [f'#include "{STUB.as_posix()}/stub_core.c"\n']
    stub.write_text("".join(text), encoding="utf-8")
    whole = [*command, *runtime_sources(), str(stub)]

    def make() -> None:
        done = subprocess.run([*whole, "-o", str(out)], capture_output=True, text=True, cwd=folder, check=False)
        if done.returncode != 0:
            message = f"the runtime does not compile: {done.stderr}"
            raise RuntimeError(message)

    key = [*command, *runtime_sources(), *text]
    kept([version("ziglang").encode(), *(w.encode() for w in key), *contents([RUNTIME, STUB, HEADERS])], out, make)
    return out


Logger2 = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
Logger3 = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
Update3 = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_double, ctypes.c_bool, ctypes.c_bool, ctypes.c_bool, ctypes.c_bool,
    ctypes.POINTER(ctypes.c_bool), ctypes.POINTER(ctypes.c_double),
)  # fmt: skip


class Callbacks2(ctypes.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = (
        ("logger", Logger2),
        ("allocate", ctypes.c_void_p),
        ("free", ctypes.c_void_p),
        ("finished", ctypes.c_void_p),
        ("environment", ctypes.c_void_p),
    )


class EventInfo2(ctypes.Structure):
    """fmi2EventInfo."""

    _fields_ = (
        ("again", ctypes.c_int),
        ("terminate", ctypes.c_int),
        ("nominals", ctypes.c_int),
        ("states", ctypes.c_int),
        ("defined", ctypes.c_int),
        ("time", ctypes.c_double),
    )


def _as_c(argument: object) -> object:
    if isinstance(argument, bool):
        return ctypes.c_bool(argument)
    if isinstance(argument, float):
        return ctypes.c_double(argument)
    return argument


class Fmu(ABC):
    """One instance; calling it calls a function of the interface by its name without the prefix."""

    prefix = ""

    def __init__(self, library: Path) -> None:
        self.library = ctypes.CDLL(str(library))
        self.log: list[tuple[int, str, str]] = []
        self.component: ctypes.c_void_p | None = None

    def __call__(self, name: str, *arguments: object) -> int:
        function = self.library[self.prefix + name]  # a new object each time: no types shared
        function.restype = ctypes.c_int
        return int(function(self.component, *(_as_c(a) for a in arguments)))

    def must(self, name: str, *arguments: object) -> None:
        """Call and insist on OK."""
        status = self(name, *arguments)
        assert status == OK, (name, status, self.log[-3:])

    def free(self) -> None:
        self.library[self.prefix + "FreeInstance"](self.component)
        self.component = None

    @property
    def last(self) -> str:
        return self.log[-1][2]

    def snapshot(self) -> ctypes.c_void_p:
        state = ctypes.c_void_p()
        self.must(self.state_name("Get"), ctypes.byref(state))
        return state

    def restore(self, state: ctypes.c_void_p) -> None:
        self.must(self.state_name("Set"), state)

    def release(self, state: ctypes.c_void_p) -> None:
        self.must(self.state_name("Free"), ctypes.byref(state))

    def serialised(self) -> bytes:
        state, size = self.snapshot(), ctypes.c_size_t()
        self.must(self.state_name("Serialized", "Size"), state, ctypes.byref(size))
        data = ctypes.create_string_buffer(size.value)
        self.must(self.state_name("Serialize"), state, data, size)
        self.release(state)
        return data.raw

    @abstractmethod
    def state_name(self, before: str, after: str = "") -> str:
        """Return the name of a function about saved states."""


def _references(references: Sequence[int]) -> ctypes.Array[ctypes.c_uint]:
    return (ctypes.c_uint * len(references))(*references)


class Fmu2(Fmu):
    """An FMI 2.0 instance of the stub."""

    prefix = "fmi2"

    def __init__(self, library: Path, kind: str = "cs", *, guid: bytes = GUID, logging: bool = True) -> None:
        super().__init__(library)
        self.callbacks = Callbacks2(logger=Logger2(self._log))
        instantiate = self.library["fmi2Instantiate"]
        instantiate.restype = ctypes.c_void_p
        pointer = instantiate(
            b"stub", int(kind == "cs"), guid, None, ctypes.byref(self.callbacks), 0, int(logging)
        )  # fmt: skip
        self.component = ctypes.c_void_p(pointer) if pointer else None

    def _log(self, _environment: object, _name: bytes, status: int, category: bytes, message: bytes) -> None:
        self.log.append((status, category.decode(), message.decode()))

    def state_name(self, before: str, after: str = "") -> str:
        return f"{before}FMUstate{after}"

    def initialise(self, *, start: float = 0.0, stop: float | None = None, tolerance: float | None = None) -> None:
        self.must(
            "SetupExperiment", int(tolerance is not None), tolerance or 0.0, start, int(stop is not None), stop or 0.0
        )
        self.must("EnterInitializationMode")
        self.must("ExitInitializationMode")

    def get(self, *references: int) -> list[float]:
        values = (ctypes.c_double * len(references))()
        self.must("GetReal", _references(references), ctypes.c_size_t(len(references)), values)
        return list(values)

    def set(self, reference: int, value: float) -> int:
        return self("SetReal", _references([reference]), ctypes.c_size_t(1), (ctypes.c_double * 1)(value))

    def whole(self, kind: str, reference: int) -> int:
        value = (ctypes.c_int * 1)()
        self.must("Get" + kind, _references([reference]), ctypes.c_size_t(1), value)
        return int(value[0])

    def set_whole(self, kind: str, reference: int, value: int) -> int:
        return self("Set" + kind, _references([reference]), ctypes.c_size_t(1), (ctypes.c_int * 1)(value))

    def step(self, point: float, size: float) -> int:
        return self("DoStep", point, size, 1)

    def input_derivatives(self, reference: int, *derivatives: float) -> int:
        n = len(derivatives)
        return self(
            "SetRealInputDerivatives", _references([reference] * n), ctypes.c_size_t(n),
            (ctypes.c_int * n)(*range(1, n + 1)), (ctypes.c_double * n)(*derivatives),
        )  # fmt: skip


class Fmu3(Fmu):
    """An FMI 3.0 instance of the stub."""

    prefix = "fmi3"

    def __init__(
        self, library: Path, kind: str = "cs", *, token: bytes = GUID, logging: bool = True,
        event_mode: bool = False, early_return: bool = False, update: Callable[..., None] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(library)
        self._logger = Logger3(self._log)
        self._update = Update3(update) if update is not None else Update3()  # without an argument: null
        common = (b"stub", token, None, ctypes.c_bool(False), ctypes.c_bool(logging))
        if kind == "cs":
            function = self.library["fmi3InstantiateCoSimulation"]
            flags = (ctypes.c_bool(event_mode), ctypes.c_bool(early_return), None, ctypes.c_size_t(0))
            arguments = (*common, *flags, None, self._logger, self._update)
        else:
            function = self.library["fmi3InstantiateModelExchange"]
            arguments = (*common, None, self._logger)  # type: ignore[assignment]
        function.restype = ctypes.c_void_p
        pointer = function(*arguments)
        self.component = ctypes.c_void_p(pointer) if pointer else None

    def _log(self, _environment: object, status: int, category: bytes, message: bytes) -> None:
        self.log.append((status, category.decode(), message.decode()))

    def state_name(self, before: str, after: str = "") -> str:
        return f"{before}FMUState{after}"

    def initialise(self, *, start: float = 0.0, stop: float | None = None, tolerance: float | None = None) -> None:
        defined = (tolerance is not None, tolerance or 0.0, start, stop is not None, stop or 0.0)
        self.must("EnterInitializationMode", *defined)
        self.must("ExitInitializationMode")

    def get(self, *references: int) -> list[float]:
        n = ctypes.c_size_t(len(references))
        values = (ctypes.c_double * len(references))()
        self.must("GetFloat64", _references(references), n, values, n)
        return list(values)

    def set(self, reference: int, value: float) -> int:
        one = ctypes.c_size_t(1)
        return self("SetFloat64", _references([reference]), one, (ctypes.c_double * 1)(value), one)

    def whole(self, kind: str, reference: int) -> int:
        one = ctypes.c_size_t(1)
        value: Any = (_WHOLE[kind] * 1)()
        self.must("Get" + kind, _references([reference]), one, value, one)
        return int(value[0])

    def set_whole(self, kind: str, reference: int, value: int) -> int:
        one = ctypes.c_size_t(1)
        return self("Set" + kind, _references([reference]), one, (_WHOLE[kind] * 1)(value), one)

    def step(self, point: float, size: float) -> tuple[int, bool, bool, bool, float]:
        """Status, event handling needed, terminate, early return, last successful time."""
        event, terminate, early, time = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double()
        pointers = (ctypes.byref(event), ctypes.byref(terminate), ctypes.byref(early), ctypes.byref(time))
        status = self("DoStep", point, size, True, *pointers)
        return status, event.value, terminate.value, early.value, time.value

    def update_discrete_states(self) -> tuple[bool, bool, bool, float | None]:
        """Once more, terminate, states changed, next event time."""
        flags = [ctypes.c_bool() for _ in range(5)]
        time = ctypes.c_double()
        self.must("UpdateDiscreteStates", *(ctypes.byref(f) for f in flags), ctypes.byref(time))
        again, terminate, _, states, defined = (f.value for f in flags)
        return again, terminate, states, time.value if defined else None


_WHOLE: dict[str, Any] = {"Int32": ctypes.c_int32, "Int64": ctypes.c_int64, "Boolean": ctypes.c_bool}


def build_driver(
    folder: Path, objects: Path, *, defines: Sequence[str] = (), driver: str = "driver.c", model: Sequence[Path] = ()
) -> tuple[Path, str]:
    """Compile a driver of tests/c with the best sanitizers found here; the program and what watches it.

    Args:
        folder: where the program goes.
        objects: for the objects of the runtime, the same for all drivers; those that are there are taken.
        defines: macros of the driver and of the model.
        driver: the file with `main`.
        model: what stands beside the runtime; the stub by default.
    """
    out = folder / "driver.exe"
    own = [*map(str, model or [STUB / "stub_core.c"]), str(STUB / driver)]
    common = ["-std=c11", "-O1", "-g", "-isystem", str(HEADERS), "-I", str(RUNTIME)]
    libraries = [] if sys.platform == "win32" else ["-lm"]
    complaint = ""
    for number, (name, command) in enumerate(_sanitizers()):
        place = objects / str(number)
        made = [str(place / f"{Path(source).stem}.o") for source in runtime_sources()]
        whole = [*command, *common, *(f"-D{d}" for d in defines), *own, *made, "-o", str(out), *libraries]
        steps = [(folder, whole)]
        if not all(Path(file).exists() for file in made):
            place.mkdir(exist_ok=True)
            steps.insert(0, (place, [*command, *common, "-c", *runtime_sources()]))
        for where, step in steps:
            done = subprocess.run(step, capture_output=True, text=True, cwd=where, check=False)
            if done.returncode != 0:
                complaint += done.stderr
                break
        else:
            return out, name
    message = f"no compiler makes the driver: {complaint}"
    raise RuntimeError(message)


def _sanitizers() -> list[tuple[str, list[str]]]:
    """Compilers to try: the system's with the address sanitizer and failing allocations, then the build chain's."""
    watch = ["-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]
    wrapped = ["-DWRAP_CALLOC", "-Wl,--wrap=calloc,--wrap=realloc"]
    found = [shutil.which(name) for name in ("gcc", "clang", "cc")]
    system = [("address", [path, *watch, *wrapped]) for path in found if path is not None]
    trap = ["-fsanitize=undefined", "-fsanitize-trap=undefined"]
    return [*system, ("undefined", [sys.executable, "-m", "ziglang", "cc", *trap])]
