"""Blocks that the kernel computes, as instances: FMUs of FMI 2.0 whose binary is the kernel.

Python calls the same functions as the kernel does, so there is no second implementation.
"""

# ruff: noqa: ANN401 - C buffers come in here as ctypes gives them
from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any, NoReturn

from workbench.errors import SimulationError
from workbench.fmi.description import Capabilities, ModelDescription
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.library import Library
from workbench.fmi.variable import Variable
from workbench.kernel.native_blocks import block_functions, new_element
from workbench.system.block_table.base import Block
from workbench.system.blocks import described
from workbench.system.description import BlockComponent

__all__ = ["ElementInstance", "element_description"]


class ElementInstance(Instance2):
    """One block of the kernel.

    Args:
        component: the block.
        description: its variables, from `element_description`.
    """

    def __init__(self, component: BlockComponent, description: ModelDescription) -> None:
        block = self._block = component.block
        counts = (len(block.inputs), len(block.states), block.indicators)
        self._native, self.memory, self._kept = new_element(
            block.number, counts, block.packed(), block.grids(), block.first_mode()
        )
        nu, nx, _ = counts
        self.memory[nu : nu + nx] = block.starts()
        super().__init__(
            description, Path(), interface="me", source=description.model_name, library=Library(block_functions())
        )

    def _instantiate(self, *, logging: bool) -> Any:
        return ctypes.addressof(self._native)

    @property
    def has_history(self) -> bool:
        return self._block.number == "delay"

    @property
    def longest_address(self) -> int | None:
        if not self.has_history:
            return None
        field: Any = type(self._native).longest
        return ctypes.addressof(self._native) + int(field.offset)

    def fail(self, name: str, status: int) -> NoReturn:
        """Raise for a bad status: a table that ends where its input goes on."""
        for port, grid, value in zip(self._block.inputs, self._block.grids(), self.memory.tolist(), strict=False):
            if not grid[0] < value < grid[-1]:
                near = 1e-6 * (grid[-1] - grid[0])
                inside = grid[0] - near <= value <= grid[-1] + near
                leaves = "at the end of the table" if inside else "beyond the table"
                raise SimulationError(
                    f"{self.description.model_name}: {port} = {value:.10g} is {leaves}, {grid[0]:g} … {grid[-1]:g}, "
                    "and goes on from there; widen the table, or let extrapolation be 'hold' or 'linear'",
                    time=self.time,
                )
        super().fail(name, status)


def element_description(component: BlockComponent) -> ModelDescription:
    """Return what a block of the kernel says about itself, in an FMU's words."""
    block = component.block
    variables, states, rates = _variables(block, component)
    able = Capabilities("", state=True, directional_derivatives=True, completed_step=block.number == "delay")
    return described(component.name, able, variables, states, rates, block.indicators)


def _variables(
    block: Block, component: BlockComponent
) -> tuple[tuple[Variable, ...], tuple[Variable, ...], tuple[Variable, ...]]:
    """Return all variables, states and derivatives; by value reference inputs, states, output, derivatives, modes."""
    nu, nx, units = len(block.inputs), len(block.states), component.units
    inputs = tuple(
        Variable(n, unit=units.get(n), start=0.0, causality="input", value_reference=i)
        for i, n in enumerate(block.inputs)
    )
    states = tuple(
        Variable(n, start=start, value_reference=nu + i)
        for i, (n, start) in enumerate(zip(block.states, block.starts(), strict=True))
    )
    through = (*(block.inputs if block.feeds else ()), *block.states)
    output = Variable("y", unit=units.get("y"), causality="output", value_reference=nu + nx, dependencies=through)
    rates = tuple(
        Variable(
            f"der({s.name})", value_reference=nu + nx + 1 + i, derivative_of=s.name,
            dependencies=(*block.inputs, *block.states),
        )
        for i, s in enumerate(states)
    )  # fmt: skip
    modes = tuple(
        Variable(n, start=start, variability="discrete", value_reference=nu + 2 * nx + 1 + i)
        for i, (n, start) in enumerate(block.remembers.items())
    )
    return (*inputs, *states, output, *modes), states, rates
