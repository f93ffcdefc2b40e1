"""A loop of one input and one output, whoever made it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workbench.core.values.linear import Linear, LinearPart

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction

    from workbench.point.lin.state_space import LinearModel

__all__ = ["part_of"]


def part_of(loop: LinearPart | LinearModel | StateSpace | TransferFunction) -> LinearPart:
    """Return a loop as the workbench computes with it.

    Args:
        loop: of one input and one output; of python-control, of `lin`, or such a one.

    Raises:
        InputError: it has more.
    """
    if isinstance(loop, LinearPart):
        return loop
    from workbench.point.lin.state_space import LinearModel  # noqa: PLC0415 - loads python-control: a second

    return LinearPart.from_lin(loop.result if isinstance(loop, LinearModel) else Linear.from_state_space(loop))
