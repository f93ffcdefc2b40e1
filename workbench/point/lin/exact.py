"""Linearise by the FMU's own directional derivatives."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.point.lin.columns import AGREE, ROUNDING, PointColumns
from workbench.point.lin.difference import continuous_result
from workbench.point.lin.result import Doubt, LinResult
from workbench.point.lin.task import LinTask, columns_of, open_base, pass_states

__all__ = ["NoDerivativesError", "exact"]


class NoDerivativesError(SimulationError):
    """Directional derivatives that an FMU offers fail at the point."""


def exact(task: LinTask) -> LinResult:
    """Linearise a model exchange FMU by directional derivatives.

    One call per state and input. What the FMU says is not believed: all columns together are compared with a
    central difference in random directions; where that disagrees, each entry is compared with its own
    difference and reported with both values. The row of an output that is a state is known, whatever the FMU says.
    Inputs that are not continuous reals have no exact derivative; their columns are differences, and a note says so.

    Not for: FMUs without directional derivatives; points on a kink or inside a quantiser, where the exact
    derivative (0) describes nothing (such entries are marked locally flat); sampled models
    (kalman-bertram).

    Args:
        task: the linearisation.

    Raises:
        InputError: the FMU offers no directional derivatives, or widths were given.
        NoDerivativesError: the FMU fails when it is asked for them.
        SimulationError: the model cannot be evaluated at the point.

    Source: the source report, chapter 3.1.1; FMI 2.0.4, section 2.1.9.
    """
    if task.dx is not None or task.du is not None:
        raise InputError("method exact: it has no widths; leave out dx and du, or use method difference")
    with open_base(task) as point:
        why = point.why_not_exact()
        if why:
            raise InputError(f"method exact: {why}; use method difference")
        n = len(point.states)
        try:
            jacobian = point.jacobian()[:, [*range(n), *(n + i for i in columns_of(task, point))]]
        except SimulationError as error:
            raise NoDerivativesError(f"method exact: {error}; use method difference") from error
        columns = PointColumns(task, point)
        pass_states(point, jacobian)
        notes = _fill(columns, jacobian)
        doubts = [] if _probed(columns, jacobian) else _disagreements(columns, jacobian)
        return continuous_result(columns, jacobian, doubts, method="exact", notes=(*notes, *_warning(doubts)))


def _warning(doubts: list[Doubt]) -> tuple[str, ...]:
    if not doubts or all(d.about == "kink" for d in doubts):
        return ()  # each says it of itself
    return (f"directional derivatives disagree with differences in {len(doubts)} entries; use method difference",)


def _fill(columns: PointColumns, jacobian: Floats) -> tuple[str, ...]:
    """Put differences where there is no exact derivative."""
    missing = np.flatnonzero(np.isnan(jacobian).any(axis=0)).tolist()
    for j in missing:
        jacobian[:, j] = columns.pair(j, columns.widths[j]).slope
    names = ", ".join(columns.names[j] for j in missing)
    return (f"{names}: no continuous real, so its column is a difference",) if missing else ()


def _probed(columns: PointColumns, jacobian: Floats) -> bool:
    """Whether differences in two random directions go as the matrix says."""
    random = np.random.default_rng(2)
    shifts = (0.5 * columns.widths * random.choice([-1.0, 1.0], len(columns.names)) for _ in range(2))
    return all(columns.goes_along(jacobian, shift) for shift in shifts)


def _disagreements(columns: PointColumns, jacobian: Floats) -> list[Doubt]:
    """Compare every entry with its difference; columns without a scale over the one that the model shows, too."""
    columns.central(columns.widths)
    result = []
    for j in range(len(columns.names)):
        apart, before = _apart(columns, jacobian, j), columns.column(j)
        if apart and columns.rescale(j):
            again = _apart(columns, jacobian, j)
            if len(again) < len(apart):
                apart = again
            else:
                columns.put_back(j, before)
        result += apart
    return sorted(result, key=lambda d: (columns.rows.index(d.row), columns.names.index(d.column)))


def _apart(columns: PointColumns, jacobian: Floats, j: int) -> list[Doubt]:
    """Compare the entries of a column with its difference."""
    result, other, exact = [], columns.column(j).slope, jacobian[:, j]
    noise = ROUNDING * np.abs(columns.here) / columns.widths[j]
    apart = np.abs(other - exact) > AGREE * np.maximum(np.abs(other), np.abs(exact)) + 4.0 * noise
    for i in np.flatnonzero(apart).tolist():
        value, measured = float(exact[i]), float(other[i])
        below, above = columns.halves(i, j)
        sides = [abs(value - side) <= AGREE * abs(side) + 4.0 * noise[i] for side in (below, above)]
        if sum(sides) == 1:
            side = "below" if sides[0] else "above"
            reason = f"a kink at the point: slope {below:.6g} below, {above:.6g} above; the one {side} is taken"
        else:
            reason = f"the FMU's directional derivative is {value:.6g}, a difference gives {measured:.6g}"
        about = "kink" if sum(sides) == 1 else "value"
        result.append(Doubt(columns.rows[i], columns.names[j], value, measured, reason, about))
    return result
