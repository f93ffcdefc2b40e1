"""Loops of one block and a linear part, for the tests of limit cycles."""

from __future__ import annotations

import control

from workbench.model.described_model import DescribedModel
from workbench.system.connect import connect

__all__ = ["LAG", "around", "chain"]

LAG = control.tf([1.0], [1.0, 3.0, 3.0, 1.0])


def around(block: object, plant: control.TransferFunction, *, gain: float = -1.0) -> DescribedModel:
    return connect(
        {"block": block, "plant": control.ss(plant)},
        [("plant.y", "block.u"), ("block.y", "plant.u", {"gain": gain})],
        outputs={"y": "plant.y"},
    )


def chain() -> DescribedModel:
    return connect(
        {"block": "fmu:Saturation", "a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag", "c": "fmu:FirstOrderLag@3"},
        [("c.y", "block.u", {"gain": -10.0}), ("block.y", "a.u"), ("a.y", "b.u"), ("b.y", "c.u")],
        outputs={"y": "c.y"},
        start_values={"block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0},
    )
