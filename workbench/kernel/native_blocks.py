"""Blocks of a system as the kernel's structures: nonlinear ones and delays (blocks.h), linear ones (lti.h)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from ctypes import POINTER, c_double, c_int, c_int32, c_size_t, c_uint, c_void_p
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.fmpy_access import fmi2
from workbench.kernel.library import kernel
from workbench.kernel.structs import Element, Lti

__all__ = ["NUMBERS", "Lti", "block_functions", "call_back", "lti_addresses", "new_element"]

# In the order of BlockNumber in blocks.h.
_ORDER = (
    "saturation", "dead_band", "relay", "quantiser", "friction", "lookup", "lookup_2d", "product", "extreme", "switch",
    "integrator", "rate_limiter", "backlash", "pid", "delay",
)  # fmt: skip
NUMBERS: Mapping[str, int] = {name: number for number, name in enumerate(_ORDER)}

_VECTOR = [POINTER(c_double), c_size_t]
_VALUES = [POINTER(c_uint), c_size_t, POINTER(c_double)]
_STATE = [POINTER(c_void_p)]
_DIRECTIONAL = [POINTER(c_uint), c_size_t, POINTER(c_uint), c_size_t, POINTER(c_double), POINTER(c_double)]
# What an FMU calls it → the kernel's function, and its arguments behind the component.
_FUNCTIONS: Mapping[str, tuple[str, list[Any]]] = {
    "fmi2SetupExperiment": ("block_setup", [c_int, c_double, c_double, c_int, c_double]),
    "fmi2EnterInitializationMode": ("block_nothing", []),
    "fmi2ExitInitializationMode": ("block_nothing", []),
    "fmi2Terminate": ("block_nothing", []),
    "fmi2FreeInstance": ("block_free", []),
    "fmi2SetTime": ("block_set_time", [c_double]),
    "fmi2SetContinuousStates": ("block_set_states", _VECTOR),
    "fmi2GetContinuousStates": ("block_get_states", _VECTOR),
    "fmi2GetDerivatives": ("block_get_derivatives", _VECTOR),
    "fmi2GetEventIndicators": ("block_get_indicators", _VECTOR),
    "fmi2CompletedIntegratorStep": ("block_completed_step", [c_int, POINTER(c_int), POINTER(c_int)]),
    "fmi2EnterEventMode": ("block_enter_event_mode", []),
    "fmi2EnterContinuousTimeMode": ("block_enter_continuous_mode", []),
    "fmi2NewDiscreteStates": ("block_update", [POINTER(fmi2.fmi2EventInfo)]),
    "fmi2GetDirectionalDerivative": ("block_get_directional", _DIRECTIONAL),
    "fmi2GetFMUstate": ("block_get_fmu_state", _STATE),
    "fmi2SetFMUstate": ("block_set_fmu_state", [c_void_p]),
    "fmi2FreeFMUstate": ("block_free_fmu_state", _STATE),
    "fmi2GetReal": ("block_get_real", _VALUES),
    "fmi2SetReal": ("block_set_real", _VALUES),
}


@lru_cache(maxsize=1)
def block_functions() -> Mapping[str, Callable[..., int]]:
    """Return the kernel's functions for blocks, by the names that FMUs give them."""
    library, result = kernel(), {}
    for name, (own, arguments) in _FUNCTIONS.items():
        function = getattr(library, own)
        function.restype = None if own == "block_free" else c_int
        function.argtypes = [c_void_p, *arguments]
        result[name] = function
    return result


def new_element(
    number: str,
    counts: tuple[int, int, int],
    parameters: Sequence[float],
    grids: Sequence[Sequence[float]],
    mode: Sequence[float],
) -> tuple[Element, NDArray[np.float64], object]:
    """Return a block, its memory (inputs, states, the output), and what must live as long as it.

    Args:
        number: a name in `NUMBERS`.
        counts: of inputs, states and event indicators.
        parameters: as the kind takes them.
        grids: arrays of a table.
        mode: before the first event.
    """
    nu, nx, nz = counts
    memory = np.zeros(nu + nx + 1)
    kept = [np.array(values, dtype=np.float64) for values in (parameters, *grids)]
    element = Element(
        p=kept[0].ctypes.data, memory=memory.ctypes.data, nu=nu, nx=nx, nz=nz, longest=np.inf, kind=NUMBERS[number],
        event_mode=1,
    )  # fmt: skip
    for i, grid in enumerate(kept[1:]):
        element.grids[i], element.sizes[i] = grid.ctypes.data, grid.size
    for i, value in enumerate(mode):
        element.mode[i] = value
    return element, memory, kept


_CALL_BACK = ctypes.CFUNCTYPE(c_int32, POINTER(c_double), POINTER(c_double))

# What an FMU calls it → the kernel's function.
_LINEAR_FUNCTIONS: Mapping[str, str] = {
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
    callback = _CALL_BACK(function)
    native.function = ctypes.cast(callback, c_void_p)
    return callback


@lru_cache(maxsize=1)
def lti_addresses() -> Mapping[str, int | None]:
    """Return where the kernel's functions begin, by the names that FMUs give them."""
    library = kernel()
    return {fmi: ctypes.cast(getattr(library, own), c_void_p).value for fmi, own in _LINEAR_FUNCTIONS.items()}
