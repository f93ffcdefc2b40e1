"""The C functions of one shared library, with FMPy's signatures."""

from __future__ import annotations

import _ctypes
import ctypes
import inspect
import os
import re
import shutil
import sys
import threading
import types
import typing
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from workbench.core.machine.arithmetic import kept_arithmetic
from workbench.core.machine.scratch import remove, scratch_folder
from workbench.errors import FmuError
from workbench.fmi.fmpy_access import fmi1, fmi2, fmi3

__all__ = ["Library", "functions_of", "load_alone", "load_library"]

_CLASSES: Mapping[tuple[int, str], Any] = {
    (1, "me"): fmi1.FMU1Model,
    (1, "cs"): fmi1.FMU1Slave,
    (2, "me"): fmi2.FMU2Model,
    (2, "cs"): fmi2.FMU2Slave,
    (3, "me"): fmi3._FMU3,  # noqa: SLF001  holds every function of FMI 3.0
    (3, "cs"): fmi3._FMU3,  # noqa: SLF001
}
_TEXT = ("Version", "TypesPlatform")
_KEY = "mmc_thread_data_key"  # of OpenModelica's runtime

Function = Callable[..., int]


def _ctype(annotation: Any) -> Any:
    if isinstance(annotation, types.UnionType):
        annotation = typing.get_args(annotation)[0]
    return {int: ctypes.c_int, bytes: ctypes.c_char_p}.get(annotation, annotation)


@lru_cache(maxsize=8)
def _signatures(version: int, interface: str) -> dict[str, tuple[Any, list[Any]]]:
    """Function name → (result type, argument types), from the annotations of FMPy's methods."""
    signatures = {}
    for name, member in inspect.getmembers(_CLASSES[version, interface], inspect.isfunction):
        if not name.startswith(f"fmi{version}"):
            continue
        signature = inspect.signature(member)
        arguments = [_ctype(p.annotation) for p in list(signature.parameters.values())[1:]]
        result = _ctype(signature.return_annotation)
        # FMPy declares FMI 1.0 status results as strings; an error status would be read as an
        # address and end the process.
        if result is ctypes.c_char_p and not name.endswith(_TEXT):
            result = ctypes.c_int
        signatures[name] = (result, arguments)
    return signatures


def functions_of(version: int) -> tuple[str, ...]:
    """Return the names of all functions of FMI 2.0 or 3.0."""
    return tuple(sorted({n for major, kind in _CLASSES if major == version for n in _signatures(major, kind)}))


class _Binary:
    """A loaded binary, let go when the last of its holders has closed.

    OpenModelica's FMUs take a thread-specific key (POSIX threads) at each instantiation, use the newest one for all
    instances, and give none back. A process has some 1024, and a binary that never got one takes the first key of the
    process, which is Python's: Python crashes. So the older ones are given back here.
    One that has not taken a key yet shows 0, which is Python's, too: what it shows when it is loaded is left alone.
    """

    def __init__(self, dll: ctypes.CDLL | None) -> None:
        self._dll = dll
        self._shown = self._key_shown()  # after the last instantiation
        self._key: int | None = None  # that it has taken
        self._threads = _threads()  # that ran before
        self.copied: Path | None = None  # folder that was made for it
        self.holders = 0
        self.addresses: dict[str, int | None] = {}

    def reclaim_key(self) -> None:
        """Give back the key that the binary had before the instantiation that is just over, if it took another."""
        shown = self._key_shown()
        if shown != self._shown:
            self._give_back()
            self._key = self._shown = shown

    def _key_shown(self) -> int | None:
        try:
            return None if self._dll is None else ctypes.c_uint.in_dll(self._dll, _KEY).value
        except ValueError:  # another tool's
            return None

    def _give_back(self) -> None:
        if self._key is not None and sys.platform != "win32":
            _loader().pthread_key_delete(self._key)

    def drop(self) -> None:
        self.holders -= 1
        if self.holders == 0 and self._dll is not None:
            if not _threads() - self._threads:  # one that it left behind would run on in code that is gone
                self._give_back()
                with kept_arithmetic():  # its destructors may set that of the workbench, too
                    _unload(self._dll._handle)  # noqa: SLF001  ctypes has no public name for it
            if self.copied is not None:
                remove(self.copied)


class Library:
    """C functions by their FMI name (`fmi2DoStep`); FMI 1.0 names carry the prefix `fmi1`.

    Several may share a binary (`held`); it is unloaded when all of them are closed, unless somebody else in
    the process has loaded it, too: the system counts.

    Args:
        functions: by name.
        dll: the binary; None: there is none behind the functions.
    """

    def __init__(self, functions: Mapping[str, Function], dll: ctypes.CDLL | None = None) -> None:
        self._functions = functions
        self._hold(_Binary(dll))

    def _hold(self, binary: _Binary) -> None:
        self._binary = binary
        self._open = True
        binary.holders += 1

    def held(self) -> Library:
        """Return a second hold on the binary, so that it stays loaded when this one is closed."""
        other = object.__new__(Library)
        other._functions = self._functions
        other._hold(self._binary)
        return other

    def close(self) -> None:
        """Let go of the binary; none of its functions may be called any more. Any number of times."""
        if self._open:
            self._open = False
            self._binary.drop()

    def removes(self, folder: Path) -> None:
        """Remove a folder that was made for the binary, when that is let go."""
        self._binary.copied = folder

    def reclaim_key(self) -> None:
        """Give back what the instantiation that is just over has made superfluous."""
        self._binary.reclaim_key()

    def __getitem__(self, name: str) -> Function:
        return self._functions[name]

    def has(self, name: str) -> bool:
        """Whether the binary exports the function."""
        function = self._functions.get(name)
        return function is not None and not getattr(function, "missing", False)

    def address(self, name: str) -> int | None:
        """Return where the function begins, for compiled callers; None where the binary has none."""
        known = self._binary.addresses
        if name not in known:
            known[name] = _address(self._functions.get(name))
        return known[name]


def _address(function: Any) -> int | None:
    if function is None or getattr(function, "missing", False):
        return None
    return ctypes.cast(function, ctypes.c_void_p).value


def load_alone(path: Path, *, version: int, interface: str, identifier: str) -> Library:
    """Load the shared library at `path` with static variables of its own, for an FMU of one instance in a process.

    Where it is loaded already, or could not be unloaded, a copy of its folder is loaded: to the system that is another
    library. Libraries beside it are copied, too; what an FMU shares with others elsewhere in the process it still does.

    Raises:
        FmuError: see `load_library`.
    """
    if not _is_loaded(path):
        return load_library(path, version=version, interface=interface, identifier=identifier)
    copied = scratch_folder("alone")
    try:
        path = shutil.copytree(path.parent, copied / path.parent.name) / path.name
        library = load_library(path, version=version, interface=interface, identifier=identifier)
    except BaseException:
        remove(copied)
        raise
    library.removes(copied)
    return library


def load_library(path: Path, *, version: int, interface: str, identifier: str) -> Library:
    """Load the shared library at `path`.

    A function that it does not export becomes one that raises when it is called: third-party
    binaries often lack optional ones.

    Raises:
        FmuError: the system cannot load it, e.g. a library it needs is absent.
    """
    if not _has_key_left():
        why = "an FMU has used them up and not released them; use a new process, such as a worker process"
        raise FmuError(f"{path.name}: no thread-specific key is left in this process: {why}")
    try:
        with kept_arithmetic():  # compiled with -ffast-math it would set that of the workbench, too
            dll = _load(path)
    except OSError as error:
        why = str(error).removeprefix(f"{path}: ")  # in a folder of ours
        absent = re.match(r"(\S+): cannot open shared object file", why) or re.search(r"Library not loaded: (\S+)", why)
        todo = f"; install {absent[1]}, or ask its maker for an export that contains it" if absent else ""
        raise FmuError(f"{path.name}: the system cannot load this FMU's binary: {why}{todo}") from None
    functions = {}
    for name, (result, arguments) in _signatures(version, interface).items():
        prefixed = f"{identifier}_fmi{name[4:]}" if version == 1 else f"{identifier}_{name}"
        # From FMI 2.0 on a prefix is meant for static linking, but 20-sim's libraries have it, too.
        symbol = prefixed if version == 1 or (not hasattr(dll, name) and hasattr(dll, prefixed)) else name
        functions[name] = _bind(dll, symbol, result, arguments)
    return Library(functions, dll)


# The functions of `ctypes` keep Python's lock while the library's constructors and destructors run; one that hangs
# would stop every thread, also the one that watches for the end of the parent process. Calls through ctypes let go of
# it. (On Windows so does ctypes itself.)


def _load(path: Path) -> ctypes.CDLL:
    if sys.platform == "win32":
        return ctypes.CDLL(str(path))
    handle = _loader().dlopen(os.fsencode(path), os.RTLD_NOW | os.RTLD_LOCAL)
    if not handle:
        raise OSError((_loader().dlerror() or b"it does not say why").decode(errors="replace"))
    return ctypes.CDLL(str(path), handle=handle)


def _is_loaded(path: Path) -> bool:
    """Whether the process has the library already."""
    if sys.platform == "win32":
        find = ctypes.windll.kernel32.GetModuleHandleW
        find.restype = ctypes.c_void_p
        return bool(find(str(path)))
    handle = _loader().dlopen(os.fsencode(path), os.RTLD_NOLOAD | os.RTLD_LAZY)
    if handle:
        _loader().dlclose(handle)
    return bool(handle)


def _unload(handle: int) -> None:
    if sys.platform == "win32":
        _ctypes.FreeLibrary(handle)
    else:
        _loader().dlclose(handle)


def _threads() -> set[int]:
    """Return the threads of this process that are not Python's; Linux, elsewhere none is known."""
    try:
        return {int(name) for name in os.listdir("/proc/self/task")} - {t.native_id for t in threading.enumerate()}  # noqa: PTH208
    except OSError:
        return set()


def _has_key_left() -> bool:
    """Whether this process would get another thread-specific key."""
    if sys.platform == "win32":
        return True
    key = ctypes.c_ulong(0)  # unsigned int or unsigned long
    result: bool = _loader().pthread_key_create(ctypes.byref(key), None) == 0
    if result:
        _loader().pthread_key_delete(key)
    return result


@lru_cache(maxsize=1)
def _loader() -> ctypes.CDLL:
    """Return the system's own functions for loading libraries."""
    own = ctypes.CDLL(None)
    own.dlopen.restype, own.dlopen.argtypes = ctypes.c_void_p, [ctypes.c_char_p, ctypes.c_int]
    own.dlclose.restype, own.dlclose.argtypes = ctypes.c_int, [ctypes.c_void_p]
    own.dlerror.restype, own.dlerror.argtypes = ctypes.c_char_p, []
    own.pthread_key_delete.argtypes = [ctypes.c_ulong]
    return own


def _bind(dll: ctypes.CDLL, symbol: str, result: Any, arguments: list[Any]) -> Function:
    function: Any = getattr(dll, symbol, None)
    if function is None:
        return _missing(symbol)
    function.restype = result
    function.argtypes = arguments
    return typing.cast("Function", function)


def _missing(symbol: str) -> Function:
    def missing(*_: object) -> int:
        raise FmuError(f"{symbol}: the FMU's binary does not have this function")

    missing.missing = True  # type: ignore[attr-defined]
    return missing
