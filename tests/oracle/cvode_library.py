"""SUNDIALS' C functions out of the libraries that FMPy ships, with the signatures used here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_double, c_int, c_int64, c_long, c_void_p
from functools import lru_cache
from typing import Any

__all__ = ["ERROR_HANDLER", "RHS", "ROOTS", "WEIGHTS", "functions", "why_missing"]

RHS = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
ROOTS = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
WEIGHTS = CFUNCTYPE(c_int, c_void_p, c_void_p, c_void_p)
ERROR_HANDLER = CFUNCTYPE(None, c_int, c_char_p, c_char_p, c_char_p, c_int, c_void_p, c_void_p)

_V = c_void_p
_SIGNATURES: Mapping[str, tuple[str, Any, tuple[Any, ...]]] = {
    "SUNContext_Create": ("core", c_int, (c_int, POINTER(_V))),
    "SUNContext_Free": ("core", c_int, (POINTER(_V),)),
    "SUNContext_ClearErrHandlers": ("core", c_int, (_V,)),
    "SUNContext_PushErrHandler": ("core", c_int, (_V, ERROR_HANDLER, _V)),
    "N_VNew_Serial": ("nvecserial", _V, (c_int64, _V)),
    "N_VGetArrayPointer": ("core", _V, (_V,)),
    "N_VDestroy": ("core", None, (_V,)),
    "SUNDenseMatrix": ("sunmatrixdense", _V, (c_int64, c_int64, _V)),
    "SUNMatDestroy": ("core", None, (_V,)),
    "SUNLinSol_Dense": ("sunlinsoldense", _V, (_V, _V, _V)),
    "SUNLinSolFree": ("core", c_int, (_V,)),
    "CVodeCreate": ("cvode", _V, (c_int, _V)),
    "CVodeInit": ("cvode", c_int, (_V, RHS, c_double, _V)),
    "CVodeReInit": ("cvode", c_int, (_V, c_double, _V)),
    "CVodeWFtolerances": ("cvode", c_int, (_V, WEIGHTS)),
    "CVodeSetLinearSolver": ("cvode", c_int, (_V, _V, _V)),
    "CVodeSetMaxStep": ("cvode", c_int, (_V, c_double)),
    "CVodeSetMaxNumSteps": ("cvode", c_int, (_V, c_long)),
    "CVodeSetStopTime": ("cvode", c_int, (_V, c_double)),
    "CVodeSetNoInactiveRootWarn": ("cvode", c_int, (_V,)),
    "CVodeRootInit": ("cvode", c_int, (_V, c_int, ROOTS)),
    "CVode": ("cvode", c_int, (_V, c_double, _V, POINTER(c_double), c_int)),
    "CVodeGetDky": ("cvode", c_int, (_V, c_double, c_int, _V)),
    "CVodeFree": ("cvode", None, (POINTER(_V),)),
}


@lru_cache(maxsize=1)
def _load() -> tuple[Mapping[str, Callable[..., Any]], str]:
    try:
        from fmpy.sundials import libraries
    except (OSError, ImportError, AttributeError) as error:
        return {}, f"FMPy ships no SUNDIALS libraries for this platform ({error})"
    found = {}
    for name, (library, result, arguments) in _SIGNATURES.items():
        # Indexing makes a function object of our own; attributes would share FMPy's signatures.
        function = getattr(libraries, f"sundials_{library}")[name]
        function.restype = result
        function.argtypes = list(arguments)
        found[name] = function
    return found, ""


def functions() -> Mapping[str, Callable[..., Any]]:
    """Return the C functions by name; empty where there are none."""
    return _load()[0]


def why_missing() -> str:
    """Return why `gear` cannot be used here; empty if it can."""
    return _load()[1]
