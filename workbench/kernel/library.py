"""Find and load the kernel's shared library for this machine."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import c_char_p, c_double, c_int32, c_int64, c_size_t, c_ssize_t, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.fmi.platforms import SUFFIXES, host
from workbench.kernel.structs import FUNCTIONS, STRUCTURES, name_in_c

__all__ = ["KernelMissingError", "intermediate_update", "kernel", "kernel_path", "why_kernel_missing"]

VERSION = 22  # KERNEL_VERSION in kernel.h
FOLDER = Path(__file__).parent / "lib"
_REMEDY = "install the package again, which compiles it: pip install . in its folder (pip install -e . to work on it)"

_RUN = [c_void_p, c_double, c_void_p, c_size_t, c_void_p, c_int32]
_SIGNATURES: Mapping[str, tuple[Any, list[Any]]] = {
    "kernel_system_open": (c_int32, [c_void_p]),
    "kernel_me_open": (c_int32, [c_void_p]),
    "kernel_me_restart": (c_int32, [c_void_p]),
    "kernel_me_run": (c_int32, _RUN),
    "kernel_me_go_on": (c_int32, [c_void_p]),
    "kernel_cs_go_on": (c_int32, [c_void_p]),
    "kernel_me_close": (None, [c_void_p]),
    "kernel_cs_run": (c_int32, _RUN),
    "kernel_control_doubles": (c_size_t, [c_void_p]),
    "kernel_time_steps": (c_size_t, [c_void_p, c_double, c_double, c_size_t, c_double, c_void_p]),
    "kernel_record_columns": (None, [c_void_p, c_void_p]),
    "kernel_record_free": (None, [c_void_p]),
    "kernel_signal_value": (c_double, [c_void_p, c_double]),
    "kernel_signal_next_break": (c_double, [c_void_p, c_double]),
    "kernel_fourier": (None, [c_void_p, c_void_p, c_size_t, c_size_t, c_void_p]),
    "kernel_arithmetic": (c_int64, []),
    "kernel_end_with": (None, [c_ssize_t, c_int64, c_int32]),
    "kernel_predict": (None, [c_void_p, c_size_t, *[c_void_p] * 5]),
    "kernel_sensitivities": (None, [c_void_p, c_void_p, *[c_size_t] * 4, *[c_void_p] * 3]),
    "kernel_fourier_result": (None, [c_void_p, c_void_p]),
    "kernel_fourier_rough": (None, [c_void_p, c_void_p]),
    "kernel_intermediate_update": (None, [c_void_p, c_double, *[ctypes.c_bool] * 4, c_void_p, c_void_p]),
}


class KernelMissingError(WorkbenchError):
    """The compiled kernel, without which no model can be loaded, is missing or does not fit; `message` says why."""


def kernel_path() -> Path:
    """Return where the library for this machine should be."""
    name = host()
    suffix = SUFFIXES.get(name.rpartition("-")[2], ".so")
    return FOLDER / name / f"workbench_kernel{suffix}"


def kernel() -> ctypes.CDLL:
    """Return the loaded library, its functions with their signatures.

    Raises:
        KernelMissingError: it is not there, or of another version than this package.
    """
    library, why = _load()
    if library is None:
        raise KernelMissingError(why)
    return library


def intermediate_update() -> int:
    """Return the address of what answers FMUs of FMI 3.0 that ask for inputs inside a step.

    Raises:
        KernelMissingError: see `kernel`.
    """
    return ctypes.cast(kernel().kernel_intermediate_update, c_void_p).value or 0


def why_kernel_missing() -> str:
    """Return why the compiled kernel cannot be used and what to do; empty if it can."""
    return _load()[1]


@lru_cache(maxsize=1)
def _load() -> tuple[ctypes.CDLL | None, str]:
    path = kernel_path()
    if not path.is_file():
        return None, f"the compiled kernel for {host()} is not in this installation; {_REMEDY}"
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        return None, f"{path}: the system cannot load the compiled kernel: {error}; {_REMEDY}"
    why = _misfit(library)
    if why:
        return None, f"{path}: {why}; {_REMEDY}"
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)  # subscripts would give a new object each time
        function.restype, function.argtypes = result, arguments
    return library, ""


def _misfit(library: ctypes.CDLL) -> str:
    """Return in what the library differs from what this package expects; empty if it fits."""
    version = getattr(library, "kernel_version", lambda: 0)()
    if version != VERSION:
        return f"the kernel has version {version}, this package needs {VERSION}"
    library.kernel_sizeof.restype, library.kernel_sizeof.argtypes = c_size_t, [c_char_p]
    for structure in STRUCTURES:
        if library.kernel_sizeof(name_in_c(structure).encode()) != ctypes.sizeof(structure):
            return f"the kernel's structure {name_in_c(structure)} has another size"
    library.kernel_function_name.restype, library.kernel_function_name.argtypes = c_char_p, [c_size_t]
    names = tuple((library.kernel_function_name(i) or b"").decode() for i in range(len(FUNCTIONS)))
    return "" if names == FUNCTIONS else "the kernel calls other functions"
