"""Linearise by central differences of derivatives and outputs."""

from __future__ import annotations

from workbench.point.lin.assemble import continuous_result
from workbench.point.lin.columns import PointColumns
from workbench.point.lin.result import Doubt, LinResult
from workbench.point.lin.task import LinTask, open_base

__all__ = ["difference"]


def difference(task: LinTask) -> LinResult:
    """Linearise a model exchange FMU by finite differences.

    ∂f/∂x_j ≈ (f(x + e_j·dx_j/2) − f(x − e_j·dx_j/2)) / dx_j, the given value being the TOTAL width; likewise
    for inputs. At each perturbed point relations (branches, floors) are evaluated anew, but discrete
    states keep their values: where a perturbation would make a `when` fire, the values before it are
    taken and the entries are marked doubtful.

    Widths that are not given are 2·ε^(1/3) times the larger of magnitude and nominal value (1e-2 where no
    nominal value is declared), and verified: all columns together at eight times the width, in one random direction;
    where that disagrees, each column for itself, and entries that depend on the width are marked doubtful. Of a
    variable without nominal value such a column is taken again over a width that suits how far the model is straight
    (a state of 1e-8 that nobody scaled), and a note says so. Entries
    that are 0 but not when the variable moves as far as its own scale are marked locally flat. With n
    states and m inputs this takes 2·(n + m) + 5 evaluations when there is nothing to doubt. Large models that declare
    their dependencies take a handful: columns of different rows move at once, as long as nothing is doubtful.

    Not for: co-simulation (no states); sampled models, whose discrete states do not move with a
    perturbation (use kalman-bertram); given widths are not verified, they are what the user wants.

    Args:
        task: the linearisation.

    Raises:
        InputError: the model has no derivatives, or a width is bad.
        SimulationError: the model cannot be evaluated at the point or at a perturbed point.

    Source: the source report, chapters 3.1.2 and 3.3.
    """
    with open_base(task) as point:
        columns = PointColumns(task, point)
        jacobian = columns.together()
        doubts: list[Doubt] = []
        if jacobian is None:
            jacobian = columns.central(columns.widths)
            doubts = columns.narrowed(jacobian, columns.doubts(jacobian))
        return continuous_result(columns, jacobian, doubts, method="difference")
