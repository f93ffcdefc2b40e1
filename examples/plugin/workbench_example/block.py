"""The block `second_order`: a linear block says by its matrices what it computes."""

from __future__ import annotations

import math

import numpy as np

from workbench.core.records.option import option
from workbench.system.block_table.base import Block, BlockStateSpace


class SecondOrder(Block):
    """Second-order lag, as of an actuator: its natural frequency and damping ratio."""

    kind = "second_order"
    group = "dynamic"
    equations = "w = 2π frequency\ny = gain w² / (s² + 2 damping w s + w²) u"
    gain: float = option("Gain at low frequencies.", default=1.0)
    frequency: float = option("Natural frequency.", default=1.0, unit="Hz", positive=True)
    damping: float = option("Damping ratio.", default=0.7, least=0.0)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: the output and its rate."""
        return ("y_state", "y_rate")

    def matrices(self) -> BlockStateSpace:
        """Return the block as a linear system."""
        w = 2.0 * math.pi * self.frequency
        a = np.array([[0.0, 1.0], [-w * w, -2.0 * self.damping * w]])
        return BlockStateSpace(a, np.array([[0.0], [self.gain * w * w]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
