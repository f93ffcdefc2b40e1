"""Small systems with closed forms, for the tests of connected models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import control
import numpy as np

from workbench.core.values.arrays import Floats
from workbench.model.described_model import DescribedModel
from workbench.session.base import Recorded
from workbench.signals.kinds import Signal
from workbench.system.connect import connect
from workbench.system.description import SumComponent

__all__ = ["LAG", "difference", "loop_of_two_saturations", "run", "unity_feedback"]

LAG = control.tf([1.0], [1.0, 1.0])


def difference(name: str, *signs: float) -> SumComponent:
    return SumComponent(name=name, signs=signs)


def run(
    model: DescribedModel, until: float, signals: Mapping[str, Signal], record: Sequence[str], *, rows: int = 100
) -> Recorded:
    points: Floats = until * np.arange(1, rows + 1) / rows
    with model.open_session(signals=signals) as session:
        return session.advance(until, signals=signals, record=record, points=points)


def unity_feedback(plant: object, *, gain: float, tolerance: float = 1e-9) -> DescribedModel:
    """r → (+) → gain → plant → y, with −y fed back."""
    return connect(
        {"e": difference("e", 1.0, -1.0), "k": gain, "p": plant},
        [("e.y", "k.u"), ("k.y", "p.u"), ("p.y", "e.u2")],
        inputs={"r": "e.u1"},
        outputs={"y": "p.y", "u": "k.y"},
        tolerance=tolerance,
    )


def loop_of_two_saturations() -> DescribedModel:
    """Two FMUs with direct feed-through, FMI 2.0 and 3.0, in a loop: s.u = r − 2 g.y, g.u = 1.5 s.y."""
    return connect(
        {"e": difference("e", 1.0, -2.0), "s": "fmu:Saturation", "g": "fmu:Saturation@3"},
        [("e.y", "s.u"), ("s.y", "g.u", {"gain": 1.5}), ("g.y", "e.u2")],
        inputs={"r": "e.u1"},
        outputs={"y": "s.y", "z": "g.y"},
        tolerance=1e-8,
    )
