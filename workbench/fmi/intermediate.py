"""Intermediate update of FMI 3.0: the memory of one co-simulation instance that its callback works on."""

from __future__ import annotations

import ctypes

__all__ = ["Intermediate"]


class Intermediate(ctypes.Structure):
    """intermediate.h: handed to the FMU as its environment; the FMU hands it back when it asks for inputs.

    Attributes:
        system: the kernel's system that is being stepped; None: nobody answers.
        who: number of the component in it.
        answers: whether all its forced inputs may be set between communication points.
        answered: whether they were, in this step.
    """

    system: int | None
    who: int
    answers: int
    answered: int
    _fields_ = (
        ("system", ctypes.c_void_p),
        ("who", ctypes.c_int32),
        ("answers", ctypes.c_int32),
        ("answered", ctypes.c_int32),
    )
