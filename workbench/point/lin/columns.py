"""Perturbed columns: what every method of linearisation moves, how widely, and what it sees far away."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.matrices import light
from workbench.errors import SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model import DescribedModel
from workbench.point.lin.result import Doubt
from workbench.point.lin.task import LinTask, columns_of, moving_note, width_for
from workbench.point.lin.zero_entries import DECLARED, ELSEWHERE, NOT_CONNECTED, LargePerturbation
from workbench.point.scales import straight_over
from workbench.session.forcing import convert
from workbench.session.point import Evaluation, ModelPoint

__all__ = ["AGREE", "ROUNDING", "UNDECLARED", "Columns", "PointColumns", "relative_width", "size_of", "total_width"]

Indices = NDArray[np.intp]
Group = tuple[Indices, Indices, Indices]
"""Columns that may move at once, the rows that they move, the column of each row."""

AGREE = 1e-3  # of an entry (and of its row, at the scales of the columns): differences beyond it are doubtful
FAR = (0.1, 1.0, 10.0)  # of a variable's own size: how far one looks behind a zero
ROUNDING = 64.0 * float(np.finfo(float).eps)
UNDECLARED = 1e-2  # least scale of a variable whose nominal value is not declared
SECOND = 8.0  # the second width, over the first
MOVING = 1e-4  # of the scales of states and inputs: derivatives that so small a move would make count as 0
STANDS = 1e-12  # of a state's scale [1/s]: the limit where no state and no input changes a derivative
FEW = 4  # columns that are looked at one by one, not in halves


def relative_width(error: float) -> float:
    """Return the total width over the scale of a variable: truncation and errors of a central difference are alike.

    Args:
        error: relative error of what is evaluated.

    Source: Nocedal and Wright, Numerical Optimization, 2nd ed., section 8.1.
    """
    return 2.0 * float(error ** (1.0 / 3.0))


def total_width(variable: Variable, value: float, relative: float, undeclared: float = UNDECLARED) -> float:
    """Return the total width by which a variable is moved; whole numbers by one to both sides, as nothing less does."""
    if variable.type not in FLOAT_TYPES:
        return 2.0
    return relative * max(abs(value), variable.nominal or undeclared)


class Columns(ABC):
    """What a linear model depends on, one column each, and the rows that change when a column is moved.

    Attributes:
        names: of the columns: states, then the task's inputs, shape (k,).
        rows: of the rows: states, then outputs, shape (n + q,).
        widths: total widths, shape (k,).
        chosen: those that were not given, shape (k,).
        sizes: how far a variable moves when it moves far, shape (k,).
    """

    names: list[str]
    rows: list[str]
    widths: Floats
    chosen: NDArray[np.bool_]
    sizes: Floats

    @abstractmethod
    def values(self, shift: Floats) -> Floats:
        """Return the rows at the point shifted along the columns, shape (n + q,)."""

    @property
    @abstractmethod
    def here(self) -> Floats:
        """The rows at the point itself, shape (n + q,)."""

    def alone(self, columns: Iterable[int]) -> list[Group]:
        """Return columns as groups of one, each of which may move all rows."""
        rows = np.arange(len(self.rows))
        return [(np.array([j]), rows, np.full(len(rows), j)) for j in columns]

    def look_far(self, jacobian: Floats, groups: Iterable[Group], reach: LargePerturbation) -> None:
        """Write into `reach` which zero entries of some columns move when their variables move far."""
        for members, rows, by in groups:
            for direction, moved in ((1.0, reach.above), (-1.0, reach.below)):
                for far in FAR:
                    shift = np.zeros(len(self.names))
                    shift[members] = direction * far * self.sizes[members] * self.chosen[members]
                    moved[rows, by] |= self._moves(shift)[rows] & (jacobian[rows, by] == 0.0)

    def _moves(self, shift: Floats) -> NDArray[np.bool_]:
        """Return which rows move; none where the model cannot be evaluated so far away."""
        try:
            moved = self.values(shift) - self.here
        except SimulationError:
            return np.zeros(len(self.rows), dtype=bool)
        return np.asarray(np.abs(moved) > ROUNDING * np.abs(self.here))

    def flat(self, reach: LargePerturbation) -> list[Doubt]:
        """Return the entries that are 0 here but not when their variable moves far."""
        result = []
        for i, j in np.argwhere(reach.above | reach.below):
            where, far = reach.where(i, j), FAR[-1] * self.sizes[j]
            reason = f"locally flat: 0 here, but it moves when {self.names[j]} {where} by up to {far:.3g}"
            result.append(Doubt(self.rows[i], self.names[j], 0.0, None, reason))
        return result


def size_of(variable: Variable, value: float) -> float:
    """Return how far a variable moves when it moves far."""
    return max(abs(value), variable.nominal or 0.0) or 1.0


_RELATIVE = relative_width(float(np.finfo(float).eps))


@dataclass(frozen=True)
class _PerturbationPair:
    """Both sides of a perturbation; shape (n + q,) each."""

    above: Floats
    below: Floats
    span: float
    latched: bool

    @property
    def slope(self) -> Floats:
        return (self.above - self.below) / self.span


class PointColumns(Columns):
    """Differences of derivatives and outputs along the states and the chosen inputs of a point.

    Args:
        task: the linearisation.
        point: its model, standing at the point.

    Attributes:
        scales: by which widths are chosen, shape (k,).
        base: the evaluation at the point itself.
        narrow: columns that nothing is declared of → the scale that the model showed.
    """

    def __init__(self, task: LinTask, point: ModelPoint) -> None:
        self.task, self.point = task, point
        inputs = columns_of(task, point)
        n = len(point.states)
        self.variables: list[Variable] = [*point.states, *(point.inputs[i] for i in inputs)]
        self.names = [v.name for v in self.variables]
        self.rows = [v.name for v in (*point.states, *point.outputs)]
        self._places = [*range(n), *(n + i for i in inputs)]
        state_names = self.names[:n]
        values = np.concatenate([point.x0, point.u0])[self._places]
        self.scales = np.array(
            [max(abs(x), v.nominal or UNDECLARED) for v, x in zip(self.variables, values, strict=True)]
        )
        self.scales[:n] = np.where(point.nominal != 1.0, np.maximum(point.nominal, np.abs(point.x0)), self.scales[:n])
        self.sizes = np.array([size_of(v, x) for v, x in zip(self.variables, values, strict=True)])
        given = np.concatenate([width_for(task.dx, state_names, what="dx"),
                                width_for(task.du, task.inputs, what="du")])  # fmt: skip
        self.chosen = np.isnan(given)
        self.widths: Floats = np.where(self.chosen, self._default(), given)
        self.base = self._at(np.zeros(len(self.names)))
        self.narrow: dict[int, float] = {}
        silent = np.array([v.nominal is None and v.type in FLOAT_TYPES for v in self.variables], dtype=bool)
        self._unscaled = self.chosen & silent & (self.scales == UNDECLARED)
        self._pairs: dict[int, _PerturbationPair] = {}
        self._light: tuple[Floats, Any] | None = None

    def _default(self) -> Floats:
        """Integer inputs move by one to both sides; nothing less would move them."""
        whole = np.array([v.type not in FLOAT_TYPES for v in self.variables], dtype=bool)
        return np.where(whole, 2.0, _RELATIVE * self.scales)

    def _shifted(self, shift: Floats) -> tuple[Floats, Floats]:
        full = np.concatenate([self.point.x0, self.point.u0])
        full[self._places] += shift
        n = len(self.point.states)
        return full[:n], full[n:]

    def _at(self, shift: Floats) -> Evaluation:
        return self.point.at(*self._shifted(shift))

    def _unit(self, column: int, length: float) -> Floats:
        shift = np.zeros(len(self.names))
        shift[column] = length
        return shift

    def pair(self, column: int, width: float) -> _PerturbationPair:
        """Return both sides of one column at a total width."""
        sides = [self._at(self._unit(column, sign * width / 2.0)) for sign in (1.0, -1.0)]
        above, below = (np.concatenate([s.dx, s.y]) for s in sides)
        return _PerturbationPair(above, below, self._span(column, width), any(s.latched for s in sides))

    def _span(self, column: int, width: float) -> float:
        """Return the width that the model really saw: rounded where the variable is not real."""
        variable, place = self.variables[column], self._places[column]
        value = float(np.concatenate([self.point.x0, self.point.u0])[place])
        high, low = value + width / 2.0, value - width / 2.0
        if variable.type not in FLOAT_TYPES:
            high, low = float(convert(variable, high)), float(convert(variable, low))
        return (high - low) or width

    def light(self, jacobian: Floats) -> Any:  # noqa: ANN401 - SciPy's sparse arrays have no types
        """Return the matrix as a sparse array where it is one; the last one is kept."""
        if self._light is None or self._light[0] is not jacobian:
            self._light = (jacobian, light(jacobian))
        return self._light[1]

    def together(self) -> Floats | None:
        """Return the matrix of central differences, columns that move different rows, as declared, moved at once.

        None: the model is small, or does not declare it; the widths were given; or there is a doubt about any entry.
        """
        groups = self._groups
        if not groups or not self.chosen.all():
            return None
        jacobian, f0 = np.zeros((len(self.rows), len(self.names))), self.here
        for members, rows, by in groups:
            shift = np.zeros(len(self.names))
            shift[members] = 0.5 * self.widths[members]
            sides = [self._at(s * shift) for s in (1.0, -1.0)]
            above, below = (np.concatenate([s.dx, s.y]) for s in sides)
            spans = np.array([self._span(int(j), float(self.widths[j])) for j in members])
            width = np.zeros(len(self.names))
            width[members] = spans
            jacobian[rows, by] = (above - below)[rows] / width[by]
            bend = np.abs(above - 2.0 * f0 + below)
            allowed = ROUNDING * (np.abs(above) + np.abs(f0))
            allowed[rows] += AGREE * np.abs(jacobian[rows, by]) * width[by]
            if any(s.latched for s in sides) or (bend > allowed).any():
                return None
        return jacobian if self._goes_on(jacobian) else None

    @cached_property
    def _groups(self) -> list[Group]:
        """Columns that may move at once; empty: not known."""
        pattern = self.point.pattern
        if pattern is None:
            return []
        column = np.full(len(self.point.states) + len(self.point.inputs), -1)
        column[self._places] = np.arange(len(self._places))
        result = []
        for members, rows, by in pattern.groups():
            mine = column[by] >= 0
            chosen = column[members]
            if (chosen >= 0).any():
                result.append((chosen[chosen >= 0], rows[mine].astype(np.intp), column[by[mine]]))
        return result

    def central(self, widths: Floats) -> Floats:
        """Return the matrix of central differences, shape (n + q, k); remembers both sides."""
        self._pairs = {j: self.pair(j, w) for j, w in enumerate(widths.tolist())}
        slopes = [self._pairs[j].slope for j in range(len(self.names))]
        return np.column_stack(slopes) if slopes else np.zeros((len(self.rows), 0))

    def halves(self, row: int, column: int) -> tuple[float, float]:
        """Return the slopes of an entry below and above the point, after `central`."""
        pair, here, half = self._pairs[column], self.here[row], 0.5 * float(self.widths[column])
        return float((here - pair.below[row]) / half), float((pair.above[row] - here) / half)

    def moving(self, jacobian: Floats) -> tuple[str, ...]:
        """Return a remark where the point is not at rest: derivatives beyond what a small part of the scales makes."""
        n = len(self.point.states)
        allowed = MOVING * (abs(self.light(jacobian)) @ self.scales)[:n] + STANDS * self.scales[:n]
        result = np.flatnonzero(np.abs(self.base.dx) > allowed)
        return moving_note([f"der({self.names[i]}) = {self.base.dx[i]:.4g}" for i in result])

    # -- what may be wrong ----------------------------------------------------------------

    def doubts(self, jacobian: Floats) -> list[Doubt]:
        """Return the entries that a second width does not confirm, or that a `when` cuts short."""
        result = [d for j in range(len(self.names)) if self._pairs[j].latched for d in self._latches(jacobian, j)]
        if self.chosen.any() and not self._confirmed(jacobian):
            result += [d for j in np.flatnonzero(self.chosen) for d in self._second(jacobian, int(j))]
        return result

    def _latches(self, jacobian: Floats, j: int) -> list[Doubt]:
        why = "a discrete state would change within the perturbation; it is held"
        rows = np.flatnonzero(jacobian[:, j])
        return [Doubt(self.rows[i], self.names[j], float(jacobian[i, j]), None, why) for i in rows]

    def _confirmed(self, jacobian: Floats) -> bool:
        """Whether columns have no kink, and go together as the matrix says."""
        return not self._kinked(jacobian) and self._goes_on(jacobian)

    def _goes_on(self, jacobian: Floats) -> bool:
        """Whether all columns together, moved by the second width in a random direction, go as the matrix says."""
        random = np.random.default_rng(0)
        signs = random.choice([-1.0, 1.0], len(self.names)) * random.uniform(0.5, 1.0, len(self.names))
        try:
            return self.goes_along(jacobian, np.where(self.chosen, 0.5 * SECOND * self.widths * signs, 0.0))
        except SimulationError:
            return False

    def goes_along(self, jacobian: Floats, shift: Floats) -> bool:
        """Whether the difference between both sides of the point is what the matrix says.

        Args:
            jacobian: the matrix.
            shift: of all columns to one side, shape (k,).
        """
        above, below = (self.values(s * shift) for s in (1.0, -1.0))
        matrix = self.light(jacobian)
        expected, scale = 2.0 * (matrix @ shift), 2.0 * (abs(matrix) @ np.abs(shift))
        noise = ROUNDING * (np.abs(above) + np.abs(below))
        return bool((np.abs(above - below - expected) <= AGREE * 1e-2 * scale + noise).all())

    def _kinked(self, jacobian: Floats) -> bool:
        """Whether the two halves of any perturbation have different slopes."""
        f0 = self.here
        for j, pair in self._pairs.items():
            if self.chosen[j]:
                bend = np.abs(pair.above - 2.0 * f0 + pair.below)
                noise = ROUNDING * (np.abs(pair.above) + np.abs(f0))
                if (bend > AGREE * np.abs(jacobian[:, j]) * self.widths[j] + noise).any():
                    return True
        return False

    @cached_property
    def here(self) -> Floats:
        return np.concatenate([self.base.dx, self.base.y])

    def values(self, shift: Floats) -> Floats:
        result = self._at(shift)
        return np.concatenate([result.dx, result.y])

    def _second(self, jacobian: Floats, j: int) -> list[Doubt]:
        """Compare one column with itself at the second width, and its two halves with each other."""
        try:
            wide = self.pair(j, SECOND * self.widths[j])
        except SimulationError:
            wide = self.pair(j, self.widths[j] / SECOND)
        pair, f0, w = self._pairs[j], self.here, float(self.widths[j])
        noise = ROUNDING * (np.abs(pair.above) + np.abs(f0)) / w
        other = wide.slope
        apart = np.abs(other - jacobian[:, j]) > AGREE * np.maximum(np.abs(other), np.abs(jacobian[:, j])) + noise
        right, left = 2.0 * (pair.above - f0) / w, 2.0 * (f0 - pair.below) / w
        bend, bend2 = (np.abs(p.above - 2.0 * f0 + p.below) * 2.0 / p.span for p in (pair, wide))
        steeper = np.maximum(np.abs(right), np.abs(left))
        # The bend of a smooth curve grows with the width, that of a kink does not, that of a jump falls.
        kink = (bend > AGREE * steeper + 4.0 * noise) & (bend2 < 2.0 * bend)
        result = []
        for i in np.flatnonzero(apart | kink):
            value = float(jacobian[i, j])
            if kink[i]:
                reason = f"a kink or jump at the point: slope {left[i]:.6g} below, {right[i]:.6g} above"
            else:
                reason = f"it depends on the width: {other[i]:.6g} over {wide.span:.3g}"
            result.append(Doubt(self.rows[i], self.names[j], value, float(other[i]), reason))
        return result

    # -- scales of what is not declared ------------------------------------------------------

    def narrowed(self, jacobian: Floats, doubts: list[Doubt]) -> list[Doubt]:
        """Take doubtful columns without a scale again over the one that the model shows; return what is left in doubt.

        Args:
            jacobian: changed in place, where fewer entries of a column are doubtful then.
            doubts: about it.
        """
        left = list(doubts)
        for j in sorted({self.names.index(d.column) for d in doubts}):
            before, name = self._pairs[j], self.names[j]
            if not self.rescale(j):
                continue
            trial = jacobian.copy()
            trial[:, j] = self._pairs[j].slope
            mine = [d for d in left if d.column == name]
            now = [*(self._latches(trial, j) if self._pairs[j].latched else []), *self._second(trial, j)]
            if len(now) < len(mine):
                jacobian[:, j] = trial[:, j]
                left = [*(d for d in left if d.column != name), *now]
            else:
                self.put_back(j, before)
        return left

    def rescale(self, j: int) -> bool:
        """Give a column of which nothing is declared the scale that the model shows; False: that is no narrower.

        Args:
            j: number of the column.
        """
        if not self._unscaled[j]:
            return False
        size = straight_over(lambda w: self._one_sided(j, w), self.here, UNDECLARED)
        if size >= UNDECLARED:
            return False
        self.narrow[j] = size
        self._set_scale(j, size)
        self._pairs[j] = self.pair(j, float(self.widths[j]))
        return True

    def put_back(self, j: int, pair: _PerturbationPair) -> None:
        """Undo `rescale`.

        Args:
            j: number of the column.
            pair: its sides before.
        """
        del self.narrow[j]
        self._set_scale(j, UNDECLARED)
        self._pairs[j] = pair

    def column(self, j: int) -> _PerturbationPair:
        """Return both sides of a column, after `central`."""
        return self._pairs[j]

    def _set_scale(self, j: int, scale: float) -> None:
        self.scales[j], self.widths[j] = scale, _RELATIVE * scale

    def _one_sided(self, j: int, width: float) -> Floats:
        try:
            return np.asarray((self.values(self._unit(j, width)) - self.here) / width, dtype=np.float64)
        except SimulationError:
            return np.full(len(self.rows), np.nan)

    def notes(self) -> tuple[str, ...]:
        """Return a remark on columns that were scaled by the model."""
        words = [f"{self.names[j]} ({size:.1g})" for j, size in sorted(self.narrow.items())]
        if not words:
            return ()
        short = f"no nominal value is declared and the model is linear only over a short range: {', '.join(words)}"
        return (f"{short}; perturbed by {_RELATIVE:.1g} of that range",)

    # -- zeros ----------------------------------------------------------------------------

    def reach(self, jacobian: Floats) -> LargePerturbation:
        """Return which zero entries move when their variables move far, shape (n + q, k) for each direction."""
        if not self.task.explained:
            return LargePerturbation.none(self.rows, self.names)
        dead = {self.names[j]: self._why_dead(int(j)) for j in np.flatnonzero(~jacobian.any(axis=0))}
        reach = replace(LargePerturbation.none(self.rows, self.names), dead=dead)
        suspects = [j for j in range(len(self.names)) if self.chosen[j] and not jacobian[:, j].all()]
        left = self._curved(jacobian, suspects)
        if left:
            self.look_far(jacobian, self._groups or self.alone(left), reach)
        return reach

    def _curved(self, jacobian: Floats, suspects: list[int]) -> list[int]:
        """Return the columns whose zeros may hide something: of the others, the rows go as the matrix says.

        Where all together do not, each half is asked, so that a few among n take a multiple of log n evaluations.
        """
        if not suspects or all(self._linear_far(jacobian, suspects, far) for far in FAR[1:]):
            return []
        if self._groups or len(suspects) <= FEW:
            return suspects
        middle = len(suspects) // 2
        return [j for half in (suspects[:middle], suspects[middle:]) for j in self._curved(jacobian, half)]

    def _why_dead(self, j: int) -> str:
        """Return what is known of a column without effect: whether it has one where all others have moved."""
        random = np.random.default_rng(3)
        for far in FAR:
            shift = far * self.sizes * random.uniform(0.5, 1.0, len(self.names))
            shift[j] = 0.0
            try:
                moved = self.values(shift + self._unit(j, far * self.sizes[j]))
                still = self.values(shift)
            except SimulationError:
                continue
            if (np.abs(moved - still) > ROUNDING * np.abs(still)).any():
                return ELSEWHERE
        return self._declared(self.names[j])

    def _declared(self, name: str) -> str:
        """Return what the FMU declares of a variable that nothing seems to depend on; empty: nothing."""
        model = self.task.model
        if not isinstance(model, DescribedModel):
            return ""
        rows = [*model.description.derivatives, *(v for v in model.outputs if v.is_number)]
        for row in rows:
            if row.dependencies is not None and name in row.dependencies:
                return DECLARED.format(row.name)
        return "" if not rows or any(row.dependencies is None for row in rows) else NOT_CONNECTED

    def _linear_far(self, jacobian: Floats, suspects: list[int], far: float) -> bool:
        """Whether the rows go as the matrix says when all suspects move far: then no zero hides anything."""
        random = np.random.default_rng(1)
        shift = np.zeros(len(self.names))
        shift[suspects] = far * self.sizes[suspects] * random.uniform(0.5, 1.0, len(suspects))
        try:
            sides = [self.values(s * shift) - self.here for s in (1.0, -1.0)]
        except SimulationError:
            return False
        matrix = self.light(jacobian)
        expected, scale = matrix @ shift, abs(matrix) @ np.abs(shift)
        noise = ROUNDING * np.abs(self.here) + 1e-6 * scale
        return bool((np.abs(sides[0] - expected) <= noise).all() and (np.abs(sides[1] + expected) <= noise).all())
