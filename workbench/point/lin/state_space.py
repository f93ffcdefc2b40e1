"""A linear model as python-control has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import control

from workbench.core.values.operating_point import OperatingPoint
from workbench.point.lin.result import LinResult
from workbench.show.result import Reportable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


__all__ = ["LinearModel"]


class LinearModel(Reportable, control.StateSpace):  # type: ignore[misc]  # python-control has no types
    """A `control.StateSpace` with names that knows how it was made.

    Whatever python-control does with a StateSpace it does with this one; what comes out of such an
    operation (a series connection, a sampled model) is a plain StateSpace. python-control forbids dots in
    names: "plant.tau" is "plant_tau" there; `result` has the names as they are. It has no model without inputs: such a
    one has the input "no_input", which does nothing, and `result` none.

    Args:
        result: the linearisation.
        name: name of the model; None: its own.

    Attributes:
        result: the linearisation with its point, method, doubts and notes.
    """

    _page = "workbench.point.lin.page:linear_model_page"

    def __init__(self, result: LinResult, name: str | None = None) -> None:
        matrices, labels = result.for_control(name or result.model)
        super().__init__(*matrices, result.dt, **labels)
        self.result = result

    @property
    def operating_point(self) -> OperatingPoint:
        """Where the model was linearised."""
        return self.result.operating_point

    def balanced(self) -> control.StateSpace:
        """Return the same model with its states in units that make A even.

        python-control finds margins and transfer functions by polynomials. Where states differ by decades (pascals
        beside metres) they lose all digits: `control.margin` then answers infinite margins without a word.

        Examples:
            The margins of the rudder's position in a loop with a gain of 3.

            >>> import control
            >>> with wb.load("fmu:Rudder") as model:
            ...     G = wb.lin(model, inputs=["delC"], outputs=["del"])
            >>> gm, pm, _, _ = control.margin(3.0 * G.balanced())
            >>> print(f"{20.0 * math.log10(gm):.2f} dB, {pm:.1f} deg")
            7.31 dB, 41.5 deg
        """
        return self.result.balanced().to_state_space()

    def plot(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Return a picture: Bode and step response, one column per input.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
        """
        return self.result.plot(path, axes=axes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON."""
        return self.result.to_dict()

    def to_mat(self, path: str | Path) -> None:
        """Write matrices, names and the rest of `result` as variables of MATLAB, see `Record.to_mat`.

        Args:
            path: path of the file, .mat.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        self.result.to_mat(path)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LinearModel:
        """Return the model that `to_dict` or a file of `workbench lin --json` describes.

        Raises:
            InputError: a key is missing or holds something else.
        """
        return cls(LinResult.from_dict(data))
