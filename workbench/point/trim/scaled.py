"""A trim without units: unknowns in nominal values, each equation over the change that these make in it."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.point.trim.problem import TrimProblem

__all__ = ["ScaledEquations"]

Indices = NDArray[np.intp]
Group = tuple[Indices, Indices, Indices]

HELD = 1e-3  # of what is held: by so much it is moved to see whether an equation reacts to it
_BENT = 0.01  # second difference over first: over the usual width it is 1e-5 of what bends over one nominal value
_NARROWER = 0.1  # of the width before
_FALLS = 0.9  # slope over the one before: closer together, both serve
_NARROWINGS = 12  # of ten each: from the usual width, 1e-5, to rounding
_KEPT = 4  # Jacobians: a search asks for that of a point again when it steps from there, and when it judges it


class ScaledEquations:
    """Residuals and Jacobian by w = unknowns / nominal values; required equations come first.

    Args:
        problem: what to scale.
        exact: whether the balance's own Jacobian is used where it has one, else central differences.

    Attributes:
        low, high: shape (k,), bounds of w.
        hard: number of required equations.
        nominals: shape (e,), nominal value of each residual, per second for a derivative.
    """

    def __init__(self, problem: TrimProblem, *, exact: bool) -> None:
        self.problem = problem
        self.nominal = np.array([k.slot.nominal for k in problem.unknowns], dtype=np.float64)
        self.low = np.array([k.low for k in problem.unknowns]) / self.nominal
        self.high = np.array([k.high for k in problem.unknowns]) / self.nominal
        self.hard = len(problem.equations)
        self._equations = (*problem.equations, *problem.floating)
        self.nominals = np.array([e.nominal for e in self._equations])
        self._rows = np.array([e.row for e in self._equations], dtype=np.intp)
        self._wanted = np.array([e.low for e in self._equations]), np.array([e.high for e in self._equations])
        self._exact = exact
        self._jacobians: dict[bytes, Floats] = {}  # of the points that were asked for last

    def residuals(self, w: Floats) -> Floats:
        """Return all residuals in their units, shape (e,); NaN where the model cannot be evaluated."""
        values = self.problem.evaluate(w * self.nominal)[self._rows]
        return np.asarray(values - np.clip(values, *self._wanted))

    def jacobian(self, w: Floats) -> Floats:
        """Return ∂residuals/∂w, shape (e, k); zero for an interval that is kept."""
        key = w.tobytes()
        result = self._jacobians.pop(key, None)
        self._jacobians[key] = self._slopes_at(w) if result is None else result
        if len(self._jacobians) > _KEPT:
            del self._jacobians[next(iter(self._jacobians))]
        return self._jacobians[key].copy()

    def _slopes_at(self, w: Floats) -> Floats:
        full = self._given(w) if self._exact else None
        jacobian = (self._differences(w) if full is None else full)[self._rows]
        jacobian[~np.isfinite(jacobian)] = 0.0
        if any(e.low < e.high for e in self._equations):
            inside = self.residuals(w) == 0.0
            jacobian[[i and e.low < e.high for i, e in zip(inside, self._equations, strict=True)]] = 0.0
        return jacobian

    @cached_property
    def groups(self) -> list[Group]:
        """Unknowns that may move at once, the residuals that they move, the unknown of each; empty: not declared."""
        pattern = self.problem.balance.pattern
        if pattern is None or len(set(self._rows.tolist())) < len(self._rows):
            return []
        balance, columns = self.problem.balance, self.problem.columns
        unknown = np.full(len(balance.states) + len(balance.inputs), -1)
        unknown[columns] = np.arange(len(columns))
        residual = np.full(len(balance.states) + len(balance.outputs), -1)
        residual[self._rows] = np.arange(len(self._rows))
        result = []
        for members, rows, by in pattern.groups():
            own, mine = unknown[members], (unknown[by] >= 0) & (residual[rows] >= 0)
            if (own >= 0).any():
                result.append((own[own >= 0], residual[rows[mine]], unknown[by[mine]]))
        return result

    def scales(self, jacobian: Floats) -> Floats:
        """Return what each residual is measured by: its change for one nominal value of each unknown.

        Where nothing changes it, its nominal value: per second for a derivative.
        """
        change = np.abs(jacobian).sum(axis=1)
        return np.where(change > 1e-12 * self.nominals, change, self.nominals)

    def rounding(self, w: Floats) -> Floats:
        """Return the rounding errors of the residuals, shape (e,), as far as their own arithmetic makes them."""
        balance = self.problem.balance
        rates = balance.rounding(self.problem.at(w * self.nominal)[0])
        return np.concatenate([rates, np.zeros(len(balance.outputs))])[self._rows]

    def inside(self, w: Floats) -> Floats:
        """Return the point within the bounds that is nearest to `w`."""
        return np.clip(w, self.low, self.high)

    def held_change(self) -> Floats:
        """Return ∂residuals/∂(what is held) by its size, shape (e, h): how far the equations react to anything."""
        problem, balance = self.problem, self.problem.balance
        unknown = {k.column for k in problem.unknowns}
        slots = (*balance.states, *balance.inputs)
        held = [i for i, s in enumerate(slots) if i not in unknown and s.settable and not s.whole]
        n = len(balance.states)
        here = np.concatenate(balance.evaluate(problem.base[:n], problem.base[n:]))
        columns = []
        for i in held:
            moved = problem.base.copy()
            size = abs(moved[i]) or slots[i].nominal
            moved[i] += HELD * size
            result = np.concatenate(balance.evaluate(moved[:n], moved[n:]))
            columns.append(np.nan_to_num((result - here)[self._rows] / HELD))
        return np.array(columns).reshape(-1, len(self._rows)).T

    def _given(self, w: Floats) -> Floats | None:
        full = self.problem.balance.jacobian(*self.problem.at(w * self.nominal))
        return None if full is None else full[:, self.problem.columns] * self.nominal

    def _differences(self, w: Floats) -> Floats:
        """Return differences of all rates and outputs, central; one-sided at a bound or where the model fails."""
        balance = self.problem.balance
        here = self.problem.evaluate(w * self.nominal)
        columns = [self._column(w, here, i, balance.precision ** (1.0 / 3.0)) for i in range(len(w))]
        return np.column_stack(columns) if columns else np.zeros((len(here), 0))

    def _column(self, w: Floats, here: Floats, i: int, width: float) -> Floats:
        """Return the slopes over `width`, and over less where they bend and thereby fall.

        Near a root without slope, −(x − a)⁴, the differences reach farther than the root: too steep, and steps to it
        come to a halt. Narrower differences of rounding errors would be steeper.
        """
        h = width * max(1.0, abs(w[i]))
        slopes, bent = self._slopes(w, here, i, h)
        for _ in range(_NARROWINGS):
            if not bent.any():
                break
            h *= _NARROWER
            narrow, bends = self._slopes(w, here, i, h)
            falls = bent & (narrow != 0.0) & (np.abs(narrow) < _FALLS * np.abs(slopes))
            slopes, bent = np.where(falls, narrow, slopes), falls & bends
        return slopes

    def _slopes(self, w: Floats, here: Floats, i: int, h: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Return slopes from -h to h, and which of them are not those of a straight line."""
        (above, upper), (below, lower) = (self._beside(w, here, i, step) for step in (h, -h))
        if above == below:
            return np.zeros_like(here), np.zeros(len(here), dtype=bool)
        rise = upper - lower
        return rise / (above - below), np.abs(upper - 2.0 * here + lower) > _BENT * np.abs(rise)

    def _beside(self, w: Floats, here: Floats, i: int, step: float) -> tuple[float, Floats]:
        """Return where unknown `i` could be moved to, and the rates and outputs there."""
        moved = w.copy()
        moved[i] = min(max(w[i] + step, self.low[i]), self.high[i])
        values = self.problem.evaluate(moved * self.nominal)
        return (float(moved[i]), values) if np.isfinite(values).all() else (float(w[i]), here)
