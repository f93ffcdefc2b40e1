"""What holds for all parameters in their ranges: what can be asked."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.forms import TEXTS, Band, File, Names, Ranges
from workbench.core.records.option import EACH, option
from workbench.errors import InputError
from workbench.jobs.options import InParts
from workbench.point.lin.request import METHOD_NAMES, PointOptions
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.loops.robust.result import RobustResult

__all__ = ["Robust", "robust"]


class Robust(PointOptions, InParts, ModelRequest["RobustResult"]):
    """Tell whether a model stays stable for all parameters in their ranges, how far beyond, and its worst-case gain.

    The model is linearised in the middle, at the ends and corners of the ranges and between, at an equilibrium of its
    own each time. The matrices become N(δ) = N₀ + L Δ (I - J Δ)⁻¹ R + W E V, Δ = diag(δᵢ I) with |δᵢ| ≤ 1; whatever the
    fraction, of low rank, leaves of the models found is held by W E V with any E of norm 1. This is a stable M in a
    loop with a structured perturbation, and no perturbation smaller than 1/µ(M) makes it unstable. The upper
    bound of µ, by scalings D and G, is proved over intervals of frequency, not on a grid, so that no peak hides between
    points. Where it does not decide on the ranges, they are divided, and each part is proved by itself.

    The *stability margin* is the size of the ranges, in multiples of those given, up to which the model is stable:
    `lower` is proved, `upper` is a parameter set found, at which the model linearised there has an unstable pole. The
    worst-case gain from inputs to outputs, or the worst-case disk margin of a loop that is opened, has both bounds as
    well. All holds for constant parameters and small motions.

    What is proved, is proved of the linear models between the points at which they were found as far as they go on
    as smoothly there. Not for parameters at which a model switches, for large motions (see `onset`, `branches`), nor
    for parameters that vary as fast as the model moves. Transport delays are Padé approximations.

    Raises:
        InputError: unknown name, a range that does not rise, input without output, models of different order.
        SimulationError: there is no linear model in the middle, or at another point of the ranges.

    Source: K. Zhou, J. C. Doyle, K. Glover, Robust and Optimal Control (1996), chapters 10 and 11; A. Packard, J.
    Doyle, The complex structured singular value, Automatica 29 (1993); P. Seiler, A. Packard, P. Gahinet, An
    introduction to disk margins, IEEE Control Systems 40 (2020).

    Examples:
        A gain k in a loop with 1/(s³ + 0.6 s² + s): stable up to 0.6, two thirds of the way from 0.4 to 0.7.

        >>> plant = {"numerator": [1.0], "denominator": [1.0, 0.6, 1.0, 0.0]}
        >>> loop = wb.connect(
        ...     {
        ...         "k": 0.4,
        ...         "plant": wb.BlockComponent(name="plant", kind="transfer_function", parameters=plant),
        ...         "error": wb.SumComponent(name="error", signs=(1, -1)),
        ...     },
        ...     [("plant.y", "error.u2"), ("error.y", "k.u"), ("k.y", "plant.u")],
        ... )
        >>> with loop:
        ...     margin = wb.robust(loop, {"k.gain": (0.1, 0.7)}).stability
        >>> print(f"{margin.lower:.2f} {margin.upper:.2f} {margin.worst.pole:.2f}")
        0.66 0.67 0.00+1.00j
    """

    command = "robust"
    algorithm = "workbench.loops.robust.run:run"
    example = (
        "workbench robust system:rudder_loop --uncertain plant.viscous=1600:2400 --uncertain plant.area=0.0032:0.0048"
    )
    counts = "linear models"

    uncertain: Ranges = option("Parameter, input or state that is uncertain, with its range.", of=EACH)
    _: KW_ONLY
    inputs: Names | None = option(
        "Inputs of the worst-case gain; with `outputs`.", flag="--input", metavar="U,..", default=None, first=True
    )
    outputs: Names | None = option(
        "Outputs or states of the worst-case gain.", flag="--output", metavar="Y,..", default=None, first=True
    )
    open: Names = option(
        "Connection of a system whose worst-case disk margin is sought, as in `loop`; several at the same time.",
        form=replace(TEXTS, metavar="PLANT.Y"),
        default=(),
        first=True,
    )
    band: Band | None = option(
        "Lowest and highest frequency of the worst-case gain; by default all.", unit="Hz", default=None, first=True
    )
    up_to: float = option(
        "Largest multiple of the ranges that is looked at.", metavar="K", positive=True, default=3.0, first=True
    )
    boxes: int = option(
        "Number of parts into which the ranges are divided where they are not decided on as a whole.",
        metavar="N",
        least=1,
        default=32,
    )
    hold: bool = option(
        "Hold the operating point as the parameters move; by default the model is trimmed at each.",
        default=False,
        first=True,
    )
    out: File | None = option(
        "Write a system file, .toml or .ssp, of the model with the worst parameter set.", default=None
    )
    method: str = option("Method of linearisation; auto chooses.", choices=METHOD_NAMES, default="auto")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.uncertain:
            raise InputError("uncertain: name a parameter with its range, NAME=LO:HI")
        if (self.inputs is None) != (self.outputs is None):
            missing = "outputs" if self.outputs is None else "inputs"
            raise InputError(f"{missing}: the worst-case gain needs inputs and outputs; give both")
        if self.open and self.inputs is not None:
            raise InputError("open: is for the margins of a loop; give either that or inputs and outputs")
        if self.out is not None and Path(self.out).suffix.lower() not in (".toml", ".ssp"):
            raise InputError(f"out: {self.out} is neither .toml nor .ssp")
        if self.band is not None and not 0.0 <= self.band[0] < self.band[1] < math.inf:
            raise InputError(f"band: {self.band[0]:g}:{self.band[1]:g} is not of the form LO:HI with 0 ≤ LO < HI [Hz]")

    def went_well(self, record: RobustResult) -> bool:
        """Return whether the model is proved to be stable for all parameters in their ranges.

        Args:
            record: of this request.
        """
        return record.stability.lower >= 1.0


robust = function(Robust)
