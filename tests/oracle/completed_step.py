"""Tell a model exchange instance that a step was accepted; the kernel does so itself."""

from __future__ import annotations

import ctypes
from ctypes import byref

from tests.oracle.steps import never_back
from workbench.fmi.access import decode_flag
from workbench.fmi.instance import Instance
from workbench.system.composite import CompositeInstance

__all__ = ["completed_step"]


def completed_step(instance: Instance) -> tuple[bool, bool]:
    """Report an accepted step to all parts that want to hear of it; returns (enter event mode, terminate)."""
    if isinstance(instance, CompositeInstance):
        instance.refresh()
    answers = [_told(part) for part in instance.parts if part.capabilities.completed_step]
    return any(event for event, _ in answers), any(end for _, end in answers)


def _told(part: Instance) -> tuple[bool, bool]:
    if part.version == 1:
        flag = ctypes.c_char(b"\0")
        part.call("fmi1CompletedIntegratorStep", byref(flag))
        return decode_flag(flag.value), False
    if part.version == 2:
        asked, ended = ctypes.c_int(), ctypes.c_int()
        part.call("fmi2CompletedIntegratorStep", int(never_back(part)), byref(asked), byref(ended))
        return bool(asked.value), bool(ended.value)
    event, terminate = ctypes.c_bool(), ctypes.c_bool()
    part.call("fmi3CompletedIntegratorStep", never_back(part), byref(event), byref(terminate))
    return bool(event.value), bool(terminate.value)
