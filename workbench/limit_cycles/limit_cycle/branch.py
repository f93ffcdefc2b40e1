"""A branch of limit cycles over a parameter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.show.result import Result

__all__ = ["Bifurcation", "Branch", "BranchPoint", "goes_on"]


def goes_on(end: str) -> bool:
    """Whether a branch goes on beyond where it was followed to, by why it ends there."""
    return end.startswith(("stopped", "no place"))


@dataclass(frozen=True, kw_only=True)
class BranchPoint:
    """One cycle of a branch.

    Attributes:
        value: value of the parameter.
        frequency_hz: [Hz].
        amplitude: half the peak-to-peak value of the block's input.
        fundamental: amplitude of its fundamental.
        mean: mean of the block's input, in its unit.
        stable: stability by Floquet multipliers; None: not computed, or it changes just there.
    """

    value: float
    frequency_hz: float
    amplitude: float
    fundamental: float
    mean: float
    stable: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Bifurcation(BranchPoint):
    """A cycle at which others begin.

    Attributes:
        kind: "period doubling", "Neimark-Sacker" or "branch point".
    """

    kind: str


@dataclass(frozen=True, kw_only=True)
class Branch(Result):
    """Limit cycles followed over a parameter, around folds.

    Attributes:
        parameter: its name; "gain": a factor on the linear part.
        points: along the branch, from one end to the other; the parameter need not rise.
        folds: where the branch turns back; two cycles meet and vanish there.
        hopf: where a cycle shrinks to a point, and an equilibrium begins to oscillate (a Hopf point).
        bifurcations: where other cycles begin: of twice the period, on a torus, or crossing.
        ends: why it ends, at the first and at the last point.
        start: the cycle that it was followed from; None: not known.
    """

    _page = "workbench.limit_cycles.limit_cycle.page:branch_page"
    _picture = "workbench.limit_cycles.limit_cycle.picture:plot_branch"

    parameter: str
    points: tuple[BranchPoint, ...]
    folds: tuple[BranchPoint, ...]
    ends: tuple[str, str]
    hopf: tuple[BranchPoint, ...] = ()
    bifurcations: tuple[Bifurcation, ...] = ()
    start: BranchPoint | None = None

    @property
    def truncated(self) -> bool:
        """Whether it goes on beyond an end, and was not followed there."""
        return any(map(goes_on, self.ends))

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each point."""
        yield tuple(BranchPoint.__dataclass_fields__)
        yield from (tuple(vars(p).values()) for p in self.points)
