"""Best linear approximation of a model: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.analysis.nfr.frequency_grid import positive_values
from workbench.analysis.request import Analysis, function
from workbench.core.forms import Band, Numbers
from workbench.core.operating_point import AtPoint
from workbench.core.option import option
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.analysis.bla.result import BlaResult  # noqa: F401 - the record's type, below

__all__ = ["Bla", "bla"]


class Bla(AtPoint, Analysis["BlaResult"]):
    """Measure the best linear approximation, and what it leaves: noise, odd and even distortion.

    Random-phase multisines of a chosen power, several realisations of the phases and several periods of each. The
    response Y/U averaged over realisations is the linear model with the least mean-square error for signals of this
    power and spectrum. What changes from period to period is noise; what changes from realisation to realisation
    beyond that is nonlinear distortion; what appears at lines that are not excited shows whether it is odd or even.

    Of the sampled model whose input is held, as `identify` finds it. Not for models that do not answer a periodic input
    with its period (subharmonics, chaos): they look noisy. Not a describing function: that is of a single sine (`nfr`).

    Returns:
        Response with 95 % errors, levels of noise and distortion, and up to which power a linear model is worth having.

    Raises:
        InputError: unknown name, a band that does not fit, an operating point of another model.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running.

    Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters 3 to 5.

    Examples:
        A lag is linear: no distortion, and the gain of its sampled model, 1 − exp(−dt) over z − exp(−dt).

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     found = wb.bla(lag, "u", "y", rms=[1.0], band=(0.05, 1.0), realisations=2)
        >>> z = np.exp(2j * np.pi * found.frequency_hz * found.dt)
        >>> a = math.exp(-found.dt)
        >>> print(np.allclose(found.response[0], (1 - a) / (z - a), atol=1e-5))
        True
    """

    command = "bla"
    algorithm = "workbench.analysis.bla.run:run"
    example = "workbench bla fmu:Rudder --input delC --output del --band 0.2:10 --rms 1,5,20 --plot rudder_bla.png"
    usual_tolerance = 1e-8
    counts = "realisations"

    input: str = option("Input to force. Other inputs keep their value at the operating point.", metavar="U")
    output: str = option("Output to record, or any other variable.", metavar="Y")
    _: KW_ONLY
    rms: Numbers = option("Root mean squares of the multisine, each measured.", metavar="R,..")
    band: Band = option("Lowest and highest frequency; lines are as far apart as the lowest.", unit="Hz")
    lines: str = option(
        "Which lines are excited: random-odd (odd ones, one of four left out at random, which show odd distortion), "
        "odd, or all (which tells no odd from even).",
        choices=("random-odd", "odd", "all"),
        default="random-odd",
    )
    realisations: int = option("Number of different random phases.", metavar="M", least=2, default=7)
    periods: int = option("Number of recorded periods of each.", metavar="P", least=2, default=2)
    transient: int = option("Number of periods before that, until the response is periodic.", least=0, default=1)
    dt: float | None = option(
        "Sampling interval; by default an eighth of the shortest period, or the period of a sampled model.",
        unit="s",
        flag="--step",
        metavar="DT",
        positive=True,
        default=None,
    )
    seed: int = option("Seed of the phases and of the lines left out.", least=0, default=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_values("rms", self.rms, unit="unit of the input")
        low, high = self.band
        if not 0.0 < low < high:
            raise InputError(f"band must rise from above 0 Hz, not be {low:g}:{high:g}")


bla = function(Bla)
