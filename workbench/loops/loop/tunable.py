"""A loop with its linear blocks taken out: other parameters of them need no other linearisation."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.loops.loop.cut import PASSED, RETURNED, cut_loop
from workbench.loops.loop.request import Open
from workbench.loops.loop.result import Opening
from workbench.loops.opened_system import Ports, find_ports, linear_between, without_block
from workbench.model import Model
from workbench.point.lin.result import LinResult
from workbench.system.block_table.base import BlockStateSpace
from workbench.system.block_table.limits import Pi, Pid
from workbench.system.description import BlockComponent, Component, GainComponent, SystemDescription
from workbench.system.model import SystemModel

__all__ = ["TunableLoop", "linear_block", "ports_of_blocks", "tunable_loop"]

_GIVEN, _TAKEN = "tuned.{}", "tuned.{}.u"  # inputs and outputs of the rest: what a block gives, and what it takes


def _controller(block: Pi | Pid) -> BlockStateSpace:
    """Return a controller within its limits, by the equations of its kind."""
    if isinstance(block, Pi):
        return BlockStateSpace(*_matrices([[0.0]], [[block.integral]], [[1.0]], [[block.proportional]]))
    pace = 1.0 / block.filter
    return BlockStateSpace(
        *_matrices(
            [[0.0, 0.0], [0.0, -pace]], [[block.integral], [pace]], [[1.0, -block.derivative * pace]],
            [[block.proportional + block.derivative * pace]],
        )
    )  # fmt: skip


def _matrices(*rows: list[list[float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    a, b, c, d = (np.array(r) for r in rows)
    return a, b, c, d


# Kinds of the kernel that are linear within their limits → their matrices there.
_INSIDE: Mapping[str, Callable[..., BlockStateSpace]] = {
    "pi": _controller,
    "pid": _controller,
    "integrator": lambda block: BlockStateSpace(*_matrices([[0.0]], [[block.gain]], [[1.0]], [[0.0]])),
}


def linear_block(component: Component) -> BlockStateSpace | None:
    """Return the matrices of a continuous linear block with one input; None: it is none.

    A controller or an integrator is taken within its limits.

    Args:
        component: of a system.
    """
    if isinstance(component, GainComponent):
        none = np.zeros((0, 0))
        return BlockStateSpace(none, np.zeros((0, 1)), np.zeros((1, 0)), np.array([[component.gain]]))
    if not isinstance(component, BlockComponent) or len(component.block.inputs) != 1:
        return None
    inside = _INSIDE.get(component.kind)
    result = component.block.matrices() if inside is None else inside(component.block)
    return None if result is None or result.dt > 0.0 else result


@dataclass(frozen=True, eq=False)
class TunableLoop:
    """What is left of a loop when its linear blocks are taken out, linearised once.

    Attributes:
        place: the connections that are opened.
        rest: linear model; inputs: the signal passed on at the place, then what each block gives; outputs: what comes
            back, then what each block takes.
        components: those that were taken out.
    """

    place: Opening
    rest: LinResult
    components: tuple[Component, ...]

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the components that were taken out."""
        return tuple(c.name for c in self.components)

    def loop(self, values: Mapping[str, float]) -> LinearPart:
        """Return the loop transfer L with other parameters, for negative feedback.

        With e the inputs of the blocks and v their outputs, e = C x + D v of the rest and v = Cₖ xₖ + Dₖ e of the
        blocks are solved for e.

        Args:
            values: full name of a parameter of `blocks` → value.

        Raises:
            InputError: a value that the parameter cannot have, one of another component, or blocks in an algebraic loop
                without a solution.
        """
        own = dict(zip(self.blocks, self.components, strict=True))
        for full, value in values.items():
            name, _, parameter = full.rpartition(".")
            if name not in own:
                raise InputError(f"{full}: not a parameter of a linear block; the loop has to be linearised with it")
            own[name] = _changed(own[name], parameter, value)
        taken_out = [k for component in own.values() if (k := linear_block(component)) is not None]
        none = np.zeros((0, 0))
        a, b, c, d = (block_diag(none, *(getattr(k, part) for k in taken_out)) for part in "abcd")
        rest, n = self.rest, len(self.rest.A)
        b0, bv, c0, ce = rest.B[:, :1], rest.B[:, 1:], rest.C[:1], rest.C[1:]
        d00, d0v, de0, dev = rest.D[:1, :1], rest.D[:1, 1:], rest.D[1:, :1], rest.D[1:, 1:]
        size = np.eye(len(dev)) - dev @ d
        if len(dev) and np.linalg.cond(size) > 1.0 / np.finfo(float).eps:
            raise InputError("the blocks are in an algebraic loop that has no solution with these values")
        ex, ek, ez = (np.linalg.solve(size, m) for m in (ce, dev @ c, de0))  # e by x, by the blocks' states, by z
        vx, vk, vz = d @ ex, c + d @ ek, d @ ez
        state = np.block([[rest.A + bv @ vx, bv @ vk], [b @ ex, a + b @ ek]]) if n + len(a) else np.zeros((0, 0))
        return LinearPart(
            state, np.vstack([b0 + bv @ vz, b @ ez]), -np.hstack([c0 + d0v @ vx, d0v @ vk]), -(d00 + d0v @ vz)
        )


def _changed(component: Component, parameter: str, value: float) -> Component:
    """Return a block with another parameter."""
    if isinstance(component, GainComponent) and parameter == "gain":
        return replace(component, gain=value)
    if isinstance(component, BlockComponent):
        return replace(component, parameters={**component.parameters, parameter: value})
    raise InputError(f"component {component.name}: '{parameter}' is not a parameter")


def tunable_loop(
    model: Model,
    where: Open,
    *,
    point: OperatingPoint | None = None,
    in_process: bool = False,
    only: Collection[str] | None = None,
) -> TunableLoop:
    """Take the linear blocks with one connected input and output out of a loop, and linearise the rest.

    Args:
        model: the system; it stays open.
        where: see `find_place`.
        point: of the closed loop; None: where the system starts.
        in_process: see `lin`.
        only: names of the components that may be taken out; None: all.

    Raises:
        InputError: see `cut_loop`, and of a sampled loop.
        SimulationError: the system cannot be evaluated there.
    """
    cut = cut_loop(model, where, point=point)
    ports = [p for p in ports_of_blocks(cut.model) if only is None or p.component in only]
    with cut.model.open_at(time=cut.time, values={} if point is None else point.values) as session:
        given = session.values([p.w for p in ports]) if ports else {}
    outputs = {RETURNED: cut.place.source, **{_TAKEN.format(p.component): p.v for p in ports}}

    def change(opened: SystemDescription) -> SystemDescription:
        for p in ports:
            opened = without_block(cut.model, opened, p, _GIVEN.format(p.component), outputs)
        return opened

    inputs = {PASSED: cut.value, **{_GIVEN.format(p.component): float(given[p.w]) for p in ports}}
    x, u = ({}, {}) if point is None else ({**point.x, **point.discrete}, dict(point.u))
    with cut.opened(change) as opened:
        rest = linear_between(
            opened, inputs, list(outputs), x=x, u=u, time=cut.time, in_process=in_process
        )  # fmt: skip
    if rest.delayed is not None:
        raise InputError("the loop has transport delays: it is linearised as a whole")
    if rest.dt > 0.0:
        raise InputError(f"{cut.model.name}: the loop is sampled; it cannot be linearised without its blocks")
    known = {c.name: c for c in cut.model.system.components}
    return TunableLoop(cut.place, rest, tuple(known[p.component] for p in ports))


def ports_of_blocks(model: SystemModel) -> list[Ports]:
    """Return the ports of the blocks that can be taken out: linear, with one connected input and output.

    Args:
        model: the system.
    """
    result = []
    for component in model.system.components:
        if linear_block(component) is not None:
            with suppress(InputError):  # not connected by one input and one output
                result.append(find_ports(model, component.name))
    return result
