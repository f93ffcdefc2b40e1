"""The error for an algebraic loop that has no solution; Newton's methods of the kernel and of Python share it."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.errors import SimulationError

__all__ = ["UnsolvedError", "unsolved"]


class UnsolvedError(SimulationError):
    """An algebraic loop has no solution at this point; `vkm` tries a shorter step first."""


def unsolved(labels: Sequence[str], worst: str, value: str, residual: float, time: float) -> UnsolvedError:
    """Return the error.

    Args:
        labels: of the loop's connections.
        worst: the connection with the largest residual, relative to its size.
        value: on it, as text.
        residual: left there.
        time: [s].
    """
    return UnsolvedError(
        f"no solution was found for the algebraic loop through {', '.join(labels)}: at best {worst} is {value} with a "
        f"residual of {residual:.3g}; put a lag or a delay into one of these connections, or check their gains and "
        "signs (a loop gain of exactly 1 has no solution)",
        time=time,
    )
