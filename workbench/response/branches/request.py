"""Branches of periodic responses: what can be asked."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import Amounts, Band, Numbers, Ranges, several
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.response.branches.result import BranchesResult  # noqa: F401 - the record's type, below

__all__ = ["Branches", "branches"]


class Branches(AtPoint, ModelRequest["BranchesResult"]):
    """Follow all periodic responses to a sine, stable or not, around their folds.

    A periodic response is a fixed point of the period map φ(x), which takes the states at the begin of a period to
    those at its end. Its branch over frequency, amplitude or a parameter p is followed by pseudo-arclength
    continuation of φ(x, p) − x = 0, which does not mind folds; on it, folds, period doublings, Neimark-Sacker points
    and branch points are located. At a period doubling the branch of twice the period is followed, too. What is not
    connected with the branches from both ends (isolas) is looked for from random states.

    Not for co-simulation, whose states cannot be set while it runs, nor for models that sample. Where the
    flow jumps at events the derivative comes from differences of whole periods, for up to 24 states. Isolas that no
    start leads to are not found.

    Returns:
        Branches with gain, phase and stability, folds and bifurcations, and where it begins to jump.

    Raises:
        InputError: unknown variable, a value out of its range, a model that cannot be followed.
        FmuError, SimulationError: the model cannot be started, or has no periodic response at either end.

    Source: R. Seydel, Practical Bifurcation and Stability Analysis, 4 and 7; M. Krack, J. Gross, Harmonic Balance for
    Nonlinear Vibration Problems, 4.

    Examples:
        Between its folds, Duffing's oscillator has three periodic responses, the middle one unstable.

        >>> with wb.load("fmu:Duffing") as model:
        ...     found = wb.branches(model, "u", "y", [0.1], band=(0.15, 0.3), seeds=0)
        >>> print(", ".join(f"{fold.frequency_hz:.4f} Hz" for fold in found.folds))
        0.2422 Hz, 0.1858 Hz
    """

    command = "branches"
    algorithm = "workbench.response.branches.run:run"
    example = "workbench branches fmu:Duffing --input u --output y --amplitude 0.1 --band 0.1:0.4 --plot branches.png"
    counts = "places"
    # Tighter than for a time history: multipliers and folds are derivatives of what is integrated.
    usual_tolerance = 1e-9

    input: str = option("Input to force.", metavar="U")
    output: str = option("Output or state to measure.", metavar="Y")
    amplitudes: Amounts | None = option(
        "Amplitudes of the sine, in the unit of the input or in one of their own, as 0.05rad; a branch over frequency "
        "for each.",
        of="input",
        change=True,
        flag="--amplitude",
        metavar="A,..",
        positive=True,
        default=None,
        first=True,
    )
    _: KW_ONLY
    band: Band | None = option("Lowest and highest frequency.", unit="Hz", default=None, first=True)
    vary: Ranges = option(
        "Follow the response over this instead of the frequency: amplitude, or a parameter of the model.",
        default_factory=dict,
        first=True,
    )
    frequencies: Numbers | None = option(
        "Frequencies at which all responses are listed; where another quantity is varied, the one at which it is.",
        unit="Hz",
        flag="--freq",
        metavar="F,..",
        default=None,
        first=True,
    )
    order: int = option(
        "Follow responses that repeat only after so many periods at most.", metavar="M", least=1, default=2
    )
    seeds: int = option("Number of random starts from which further responses are looked for.", least=0, default=6)
    onset: bool = option(
        "Also find the amplitude from which on the response jumps, at or below the largest one given.",
        default=False,
        first=True,
    )
    places: int = option("Largest number of places on a branch.", least=10, default=600)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.vary) > 1:
            raise InputError("vary: one quantity at a time")
        if self.vary and (self.band is not None or len(several(self.frequencies or ())) != 1):
            raise InputError("vary: give the one frequency at which it is varied (`frequencies`), and no band")
        if not self.vary and self.band is None:
            raise InputError(
                "band: give the lowest and the highest frequency, around those that matter, or `vary` something else"
            )
        if self.band is not None:
            _check_band(self.band, several(self.frequencies or ()))
        if self.vary.get("amplitude", (1.0, 1.0))[0] <= 0.0:
            raise InputError("vary: amplitudes are positive; without a sine there is no response")
        if "amplitude" not in self.vary and not self.amplitudes:
            raise InputError("amplitudes: give one or several; the response depends on it")
        if self.onset and self.vary:
            raise InputError("onset: it is found over frequency; give a band, and nothing to vary")


def _check_band(band: tuple[float, float], frequencies: tuple[float, ...]) -> None:
    low, high = band
    if not 0.0 < low < high < math.inf:
        raise InputError(f"band: {low:g}:{high:g} is not of the form LO:HI with 0 < LO < HI [Hz]")
    for f in frequencies:
        if not low <= f <= high:
            raise InputError(f"frequencies: {f:g} Hz lies outside the band {low:g}:{high:g} Hz")


branches = function(Branches)
