"""Modes followed along a parameter, through crossings and meetings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.modal import Poles
from workbench.errors import InputError
from workbench.point.modes.match import Match, ModeCluster, closeness, coincide, match, passing, turning
from workbench.point.modes.result import ModesMeeting

__all__ = ["Frame", "ModeTracks", "track"]

Family = Callable[[float], Poles | None]

_DEEPEST = 14  # halvings of a step
_MOST = 600  # models
_OURS = 0.25  # of a mode that the wanted ones account for, where not all are followed


@dataclass(frozen=True, eq=False)
class Frame:
    """The modes at one value.

    Attributes:
        value: of the parameter.
        poles: with vectors.
        branch: position of each of them among the branches.
    """

    value: float
    poles: Poles
    branch: tuple[int, ...]

    def place(self, branch: int) -> int | None:
        """Return where a branch stands among the poles; None: it does not exist here.

        Args:
            branch: its position.
        """
        return self.branch.index(branch) if branch in self.branch else None


@dataclass(frozen=True, eq=False)
class ModeTracks:
    """All modes over the parameter.

    Attributes:
        frames: rising in the parameter, with those that were put between to tell modes apart.
        meetings: rising in the parameter.
        count: number of branches.
    """

    frames: tuple[Frame, ...]
    meetings: tuple[ModesMeeting, ...]
    count: int

    @property
    def values(self) -> Floats:
        """The parameter, shape (k,)."""
        return np.array([f.value for f in self.frames])

    def table(self) -> tuple[Complex, Floats]:
        """Return poles and their uncertainty, shape (k, branches); NaN where a branch does not exist."""
        poles = np.full((len(self.frames), self.count), complex(np.nan, np.nan), dtype=np.complex128)
        uncertain = np.full(poles.shape, np.nan)
        for row, frame in enumerate(self.frames):
            poles[row, list(frame.branch)] = frame.poles.value
            uncertain[row, list(frame.branch)] = frame.poles.uncertain
        return poles, uncertain


def track(family: Family, values: Sequence[float], *, count: int | None = None, about: float = 0.0) -> ModeTracks:
    """Follow all modes through a list of values; where the vectors leave a doubt, models are put in between.

    Modes that cross without coupling keep their vectors and cross; those that couple and veer exchange them gradually
    and do not. A step is halved up to fourteen times until the match is clear; what stays unclear is a `ModesMeeting`.

    Args:
        family: parameter → poles; None: no model there.
        values: rising.
        count: follow so many modes only, those nearest to a frequency at the first value; None: all.
        about: that frequency [Hz].

    Raises:
        InputError: fewer than two values have a linear model, or the number of states changes.
    """
    return _Tracking(family, values, count, about).run()


class _Tracking:
    def __init__(self, family: Family, values: Sequence[float], count: int | None, about: float) -> None:
        self._wanted, self._aim = count, 2j * np.pi * about
        self._family, self._pending = family, list(reversed(values))
        self._frames: list[Frame] = []
        self._meetings: list[ModesMeeting] = []
        self._count = self._made = 0
        self._smallest = (values[-1] - values[0]) / max(len(values) - 1, 1) / 2.0**_DEEPEST
        self._partner: dict[int, int] = {}

    def run(self) -> ModeTracks:
        while self._pending:
            value = self._pending[-1]
            self._made += 1
            poles = self._family(value)
            if poles is None:
                self._pending.pop()
            elif not self._frames:
                self._begin(value, poles)
            else:
                self._step(self._frames[-1], value, poles)
        if len(self._frames) < 2:
            raise InputError("modes: there is a linear model at fewer than two values; modes cannot be followed")
        return ModeTracks(tuple(self._frames), tuple(self._meetings), self._count)

    def _begin(self, value: float, poles: Poles) -> None:
        self._pending.pop()
        poles = poles if self._wanted is None else poles.nearest(self._wanted, self._aim)
        self._count = len(poles)
        self._frames.append(Frame(value, poles, tuple(range(len(poles)))))

    def _step(self, here: Frame, value: float, poles: Poles) -> None:
        if len(here.poles.left) != len(poles.left):
            raise InputError(
                f"modes: {len(here.poles.left)} states at {here.value:g} and {len(poles.left)} at {value:g}; "
                "modes of models of different order cannot be followed"
            )
        if self._wanted is not None:
            # What the wanted modes do not account for is another mode: closeness sums to 1 over all of them.
            poles = poles.some(np.flatnonzero(closeness(here.poles, poles).sum(axis=0) >= _OURS))
        result = match(here.poles, poles)
        halve = not result.clear or turning(here.poles, poles, result)
        share = 0.5 if halve else passing(here.poles, poles, result)
        between = here.value + share * (value - here.value)
        if share and value - here.value > 1.5 * self._smallest and self._made < _MOST:
            self._pending.append(between)
            return
        self._pending.pop()
        self._frames.append(self._continued(here, value, poles, result))

    def _continued(self, here: Frame, value: float, poles: Poles, matched: Match) -> Frame:
        branch: dict[int, int] = {j: here.branch[i] for i, j in matched.pairs}
        for group in matched.groups:
            self._settle(here, group, branch)
            if group.kind == "equal" and coincide(poles, group.after):
                poles = _aligned(here.poles, poles, group, matched.pairs)
        for j in range(len(poles)):
            if j not in branch:
                branch[j] = self._new()
        for group in matched.groups:
            if group.kind != "equal":
                modes = {*(here.branch[i] for i in group.before), *(branch[j] for j in group.after)}
                numbers = tuple(m + 1 for m in sorted(modes))
                width = value - here.value
                self._note(ModesMeeting(value=here.value + 0.5 * width, width=width, modes=numbers, kind=group.kind))
        return Frame(value, poles, tuple(branch[j] for j in range(len(poles))))

    def _note(self, new: ModesMeeting) -> None:
        """Keep a meeting; one that goes on from the step before is the same."""
        last = self._meetings[-1] if self._meetings else None
        if last is not None and (last.modes, last.kind) == (new.modes, new.kind):
            low, high = last.value - 0.5 * last.width, new.value + 0.5 * new.width
            if high - low < 1.01 * (last.width + new.width):
                self._meetings[-1] = replace(new, value=0.5 * (low + high), width=high - low)
                return
        self._meetings.append(new)

    def _settle(self, here: Frame, group: ModeCluster, branch: dict[int, int]) -> None:
        """Number what splits and what joins: the lower number is that of the pair."""
        before = [here.branch[i] for i in group.before]
        if len(group.before) == 2 and len(group.after) == 1:
            low, high = sorted(before)
            branch[group.after[0]] = low
            self._partner[low] = high
        if len(group.before) == 1 and len(group.after) == 2:
            (free,) = (j for j in group.after if j not in branch)
            branch[free] = self._partner.pop(before[0], -1)
            if branch[free] < 0:
                branch[free] = self._new()

    def _new(self) -> int:
        self._count += 1
        return self._count - 1


def _aligned(before: Poles, after: Poles, group: ModeCluster, pairs: Sequence[tuple[int, int]]) -> Poles:
    """Give poles that coincide the vectors that continue those before: their projections on the common subspace."""
    inside = [(i, j) for i, j in pairs if i in group.before and j in group.after]
    places = list(group.after)
    if len(group.before) != len(group.after) or len(inside) != len(places):
        return after
    projector = after.right[:, places] @ after.left[:, places].conj().T
    right = projector @ before.right[:, [i for i, _ in inside]]
    left = projector.conj().T @ before.left[:, [i for i, _ in inside]]
    across = left.conj().T @ right
    if not np.isfinite(across).all() or np.linalg.cond(across) > 1e6:
        return after
    new_right, new_left = after.right.copy(), after.left.copy()
    new_right[:, [j for _, j in inside]] = right @ np.linalg.inv(across)
    new_left[:, [j for _, j in inside]] = left
    return replace(after, right=new_right, left=new_left)
