"""Blocks of a system as the kernel's structure: lti.h."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from ctypes import POINTER, c_double, c_int32, c_void_p
from functools import lru_cache
from typing import Any

from workbench.kernel.library import kernel
from workbench.kernel.structs import Lti

__all__ = ["Lti", "call_back", "lti_addresses"]

_FUNCTION = ctypes.CFUNCTYPE(c_int32, POINTER(c_double), POINTER(c_double))

# What an FMU calls it → the kernel's function.
_NAMES: Mapping[str, str] = {
    "fmi2SetTime": "lti_set_time",
    "fmi2SetContinuousStates": "lti_set_states",
    "fmi2GetContinuousStates": "lti_get_states",
    "fmi2GetDerivatives": "lti_get_derivatives",
    "fmi2EnterEventMode": "lti_enter_event_mode",
    "fmi2EnterContinuousTimeMode": "lti_enter_continuous_mode",
    "fmi2NewDiscreteStates": "lti_update",
    "fmi2GetDirectionalDerivative": "lti_get_directional",
    "fmi2GetFMUstate": "lti_get_fmu_state",
    "fmi2SetFMUstate": "lti_set_fmu_state",
    "fmi2FreeFMUstate": "lti_free_fmu_state",
    "fmi2GetReal": "lti_get_real",
    "fmi2SetReal": "lti_set_real",
}


def call_back(native: Lti, function: Callable[[Any, Any], int]) -> object:
    """Let a block's outputs be `function(u, y)`; returns what must live as long as the block."""
    callback = _FUNCTION(function)
    native.function = ctypes.cast(callback, c_void_p)
    return callback


@lru_cache(maxsize=1)
def lti_addresses() -> Mapping[str, int | None]:
    """Return where the kernel's functions begin, by the names that FMUs give them."""
    library = kernel()
    return {fmi: ctypes.cast(getattr(library, own), c_void_p).value for fmi, own in _NAMES.items()}
