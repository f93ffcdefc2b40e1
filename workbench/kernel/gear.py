"""SUNDIALS' C functions by address, out of the libraries that FMPy ships, for the compiled `gear`."""

from __future__ import annotations

import ctypes
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from workbench.fmi.platforms import host

__all__ = ["GEAR_FUNCTIONS", "GearLibrary", "gear_library", "why_missing"]

# Function and the library that has it, in the order of `Sundials` in cvode.h.
GEAR_FUNCTIONS: tuple[tuple[str, str], ...] = (
    ("SUNContext_Create", "core"),
    ("SUNContext_Free", "core"),
    ("SUNContext_ClearErrHandlers", "core"),
    ("SUNContext_PushErrHandler", "core"),
    ("N_VNew_Serial", "nvecserial"),
    ("N_VEnableFusedOps_Serial", "nvecserial"),
    ("N_VGetArrayPointer", "core"),
    ("N_VDestroy", "core"),
    ("SUNDenseMatrix", "sunmatrixdense"),
    ("SUNMatDestroy", "core"),
    ("SUNLinSol_Dense", "sunlinsoldense"),
    ("SUNLinSolFree", "core"),
    ("CVodeCreate", "cvode"),
    ("CVodeInit", "cvode"),
    ("CVodeReInit", "cvode"),
    ("CVodeSetUserData", "cvode"),
    ("CVodeWFtolerances", "cvode"),
    ("CVodeSetLinearSolver", "cvode"),
    ("CVodeSetMaxHnilWarns", "cvode"),
    ("CVodeSetMaxConvFails", "cvode"),
    ("CVodeSetMaxErrTestFails", "cvode"),
    ("CVodeSetInitStep", "cvode"),
    ("CVodeSetMaxStep", "cvode"),
    ("CVodeSetStopTime", "cvode"),
    ("CVode", "cvode"),
    ("CVodeGetDky", "cvode"),
    ("CVodeGetNumErrTestFails", "cvode"),
    ("CVodeFree", "cvode"),
    ("CVodeSetJacFn", "cvode"),
    ("SUNMatNewEmpty", "core"),
    ("SUNMatFreeEmpty", "core"),
    ("SUNLinSolNewEmpty", "core"),
    ("SUNLinSolFreeEmpty", "core"),
    ("SUNMatGetID_Dense", "sunmatrixdense"),
    ("SUNMatClone_Dense", "sunmatrixdense"),
    ("SUNMatDestroy_Dense", "sunmatrixdense"),
    ("SUNMatZero_Dense", "sunmatrixdense"),
    ("SUNMatCopy_Dense", "sunmatrixdense"),
    ("SUNMatScaleAddI_Dense", "sunmatrixdense"),
    ("SUNLinSolGetType_Dense", "sunlinsoldense"),
    ("SUNLinSolGetID_Dense", "sunlinsoldense"),
    ("SUNLinSolSetup_Dense", "sunlinsoldense"),
    ("SUNLinSolSolve_Dense", "sunlinsoldense"),
)

MAJOR = 7  # the signatures in cvode.h are those of SUNDIALS 7

# Others need these loaded before them.
_LIBRARIES = ("core", "nvecserial", "sunmatrixdense", "sunlinsoldense", "cvode")
_SUFFIXES = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}
_UNIVERSAL = {"x86_64-darwin": "aarch64-darwin"}  # the libraries of that folder hold code for both


class GearLibrary(ctypes.Structure):
    """The C structure `GearLibrary` of solver.h."""

    _fields_ = (("functions", ctypes.POINTER(ctypes.c_void_p)), ("n_functions", ctypes.c_size_t))


@dataclass(frozen=True)
class _Loaded:
    """The addresses, and what must live as long as they are used; or why there are none."""

    table: GearLibrary
    owned: tuple[object, ...] = ()
    missing: str = ""


def gear_library() -> GearLibrary:
    """Return the table of addresses for `solver_gear`; it lives as long as the process.

    Where SUNDIALS is missing the table is empty, and `solver_gear` cannot be created: see `why_missing`.
    """
    return _load().table


def why_missing() -> str:
    """Return why `gear` cannot be used here, in one line; empty if it can."""
    return _load().missing


@lru_cache(maxsize=1)
def _load() -> _Loaded:
    return _load_from(_folder())


def _load_from(folder: Path | None) -> _Loaded:
    """Load the libraries in `folder`; what goes wrong stands in the result."""
    if folder is None:
        return _none(f"FMPy ships no SUNDIALS libraries for this platform {host()}")
    try:
        libraries = {name: ctypes.CDLL(str(folder / f"sundials_{name}{_suffix()}")) for name in _LIBRARIES}
        _check_version(libraries["core"])
        addresses = [_address(libraries, *entry) for entry in GEAR_FUNCTIONS]
    except OSError as error:
        return _none(f"FMPy's SUNDIALS libraries cannot be loaded ({error})")
    except AttributeError as error:
        return _none(f"FMPy's SUNDIALS libraries lack a function ({error})")
    except _VersionError as error:
        return _none(str(error))
    array = (ctypes.c_void_p * len(addresses))(*addresses)
    table = GearLibrary(ctypes.cast(array, ctypes.POINTER(ctypes.c_void_p)), len(addresses))
    return _Loaded(table, (array, *libraries.values()))


def _none(why: str) -> _Loaded:
    return _Loaded(GearLibrary(), missing=why)


def _suffix() -> str:
    return _SUFFIXES.get(host().rpartition("-")[2], ".so")


def _folder() -> Path | None:
    """Return where FMPy keeps SUNDIALS for this platform, without importing FMPy (it is slow to load)."""
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        return None
    folder = Path(spec.origin).parent / "sundials" / _UNIVERSAL.get(host(), host())
    return folder if folder.is_dir() else None


def _address(libraries: Mapping[str, ctypes.CDLL], name: str, library: str) -> int:
    address = ctypes.cast(libraries[library][name], ctypes.c_void_p).value
    if not address:
        raise AttributeError(name)
    return address


class _VersionError(Exception):
    """Another SUNDIALS than the one whose signatures cvode.h declares."""


def _check_version(core: ctypes.CDLL) -> None:
    numbers = [ctypes.c_int() for _ in range(3)]
    label = ctypes.create_string_buffer(32)
    core["SUNDIALSGetVersionNumber"](*(ctypes.byref(number) for number in numbers), label, len(label))
    result = ".".join(str(number.value) for number in numbers)
    if numbers[0].value != MAJOR:
        raise _VersionError(f"FMPy ships SUNDIALS {result}; gear needs version {MAJOR}")
