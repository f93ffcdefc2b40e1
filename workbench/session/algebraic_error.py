"""The errors of connections that the kernel and its twin in Python share: unsolved loops, values passed too early."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.errors import SimulationError

__all__ = ["UnsolvedError", "too_early", "unsolved"]


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


def too_early(label: str, time: float) -> SimulationError:
    """Return the error for a value read before an input that moves it without delay, though nothing declares that.

    Args:
        label: of the connection.
        time: [s].
    """
    source = label.split(" → ", maxsplit=1)[0]
    return SimulationError(
        f"{label} passes a value that has changed since: {source} depends on an input of its FMU, though the FMU's "
        'modelDescription.xml leaves that out; give the component dependencies = "all" in the system, and '
        "what it declares is ignored (the command check names the input)",
        time=time,
    )
