"""Loops with closed forms, for the tests of loop analysis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

import control
import numpy as np

from workbench.core.values.linear import LinearPart
from workbench.model.described_model import DescribedModel
from workbench.system.connect import connect
from workbench.system.description import SumComponent

__all__ = ["SATURATION", "S", "saturation_gain", "transfer", "unity"]

S = control.tf("s")

# fmu:Saturation without its dynamics: y = u between -1 and 1.
SATURATION = {"s.C[1]": 0.0, "s.C[2]": 0.0, "s.D": 1.0}


def transfer(system: control.lti.LTI) -> LinearPart:
    """Return a system of python-control as a transfer function."""
    s = control.ss(system)
    return LinearPart(np.array(s.A), np.array(s.B), np.array(s.C), np.array(s.D), dt=float(s.dt or 0.0))


def unity(
    parts: Mapping[str, object],
    gain: float,
    *,
    start_values: Mapping[str, float] | None = None,
    tolerance: float = 1e-9,
    signs: tuple[float, float] = (1.0, -1.0),
) -> DescribedModel:
    """r → e → k → parts in series → y, fed back into e."""
    names = ["e", "k", *parts]
    chain = [(f"{a}.y", f"{b}.u") for a, b in pairwise(names)]
    return connect(
        {"e": SumComponent(name="e", signs=signs), "k": gain, **parts},
        [*chain, (f"{names[-1]}.y", "e.u2")],
        inputs={"r": "e.u1"},
        outputs={"out": f"{names[-1]}.y"},
        start_values=dict(start_values or {}),
        tolerance=tolerance,
    )


def saturation_gain(amplitude: float) -> float:
    """Return the describing function of a saturation at 1 with slope 1 (Gelb and Vander Velde, table B.1)."""
    if amplitude <= 1.0:
        return 1.0
    a = 1.0 / amplitude
    return 2.0 / math.pi * (math.asin(a) + a * math.sqrt(1.0 - a * a))
