"""Rate-limit onset of a loop: what can be asked."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING

from workbench.core.records.forms import Amounts, Band
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.loops.onset.result import OnsetResult  # noqa: F401 - the record's type, below

__all__ = ["RateOnset", "onset"]


class RateOnset(AtPoint, ModelRequest["OnsetResult"]):
    """Find where a rate limiter in a loop begins to act, and whether the loop then jumps (open-loop onset point, OLOP).

    A sine of amplitude A at the input moves the limiter's output at the rate 2πf·A·|F(f)|, with F the linear closed
    loop from the input to the limiter's output. The *onset frequency* is the lowest at which that is the limit. From
    there on the limiter adds phase lag, and the response of the closed loop may jump. The *onset point* is the open
    loop L, cut at the limiter's output, at that frequency: the farther above a boundary in the Nichols chart it lies,
    the more a jump has to be expected, and with a pilot in the loop an oscillation of category II.

    The boundary is empirical, and published from -180° to -60°; outside nothing is said. It was drawn for aircraft with
    limiters in the forward path. With `jump`, the periodic responses of the model itself are followed over frequency
    (as by `branches`), and their folds are where it does jump.

    A limiter may also be sampled, such as one in a control law: it then limits the change from one sample to the next,
    and F is the fundamental of its staircase, of which the formula holds as it is. Its samples must be those with the
    loop's longest period.

    Not for a loop that is unstable below the limit, for co-simulation parts, or for a limiter between the samples of
    other parts.

    Returns:
        For each amplitude the onset frequency, the onset point and the verdict; F and L over frequency; bandwidth and
        phase delay of an attitude where `attitude` names one.

    Raises:
        InputError: no system, no such component or variable, a limiter whose rate is not known, a loop that is not
            stable.
        FmuError, SimulationError: the system cannot be evaluated at the point.

    Source: H. Duda, Prediction of pilot-in-the-loop oscillations due to rate saturation, J. Guidance, Control, and
    Dynamics 20 (1997) 3; boundary as in G. Gilbreath, AFIT/GAE/ENY/01M-02 (2001); bandwidth and phase delay:
    MIL-STD-1797.

    Examples:
        An integrator behind a limiter of 1/s, closed by the gain 2: F = 2s/(s + 2), and with an amplitude of 0.5 the
        limit is reached where ω⁴ = ω² + 4.

        >>> loop = wb.connect(
        ...     {
        ...         "error": wb.SumComponent(name="error", signs=(1, -1)),
        ...         "gain": 2.0,
        ...         "limiter": wb.BlockComponent(name="limiter", kind="rate_limiter", parameters={"rising": 1.0}),
        ...         "plant": wb.BlockComponent(name="plant", kind="integrator"),
        ...     },
        ...     [("error.y", "gain.u"), ("gain.y", "limiter.u"), ("limiter.y", "plant.u"), ("plant.y", "error.u2")],
        ...     inputs={"r": "error.u1"},
        ... )
        >>> with loop:
        ...     point = wb.onset(loop, "r", limiter="limiter", amplitudes=[0.5]).points[0]
        >>> print(f"{point.frequency_hz:.4f} {math.sqrt((1 + math.sqrt(17)) / 2) / (2 * math.pi):.4f} Hz")
        0.2546 0.2547 Hz
    """

    command = "onset"
    algorithm = "workbench.loops.onset.run:run"
    of_system = True
    example = "workbench onset system:pitch_rate_limit --input stick --limiter limiter --amplitude 0.5,1.1 --plot o.png"
    subject = replace(
        ModelRequest.subject, name="system", argument="model", type="DescribedModel",
        help="What `connect` or `load` gave; it stays open.",
    )  # fmt: skip

    input: str = option("Input by which the command enters.", metavar="U")
    _: KW_ONLY
    limiter: str = option("Rate limiter: the name of its component.", metavar="COMPONENT")
    amplitudes: Amounts = option(
        "Amplitudes of a sine at the input, in its unit or in one of their own, as 0.05rad.",
        of="input",
        change=True,
        flag="--amplitude",
        positive=True,
    )
    rate: float | None = option(
        "Limit of the rate of the limiter's output, in its unit per second; a block rate_limiter tells its own.",
        metavar="R",
        positive=True,
        default=None,
    )
    attitude: str | None = option(
        "Output that the pilot closes the loop on, an attitude: its bandwidth and phase delay are reported, too.",
        metavar="Y",
        default=None,
        first=True,
    )
    band: Band = option("Lowest and highest frequency of the search.", unit="Hz", default=(0.01, 100.0), first=True)
    jump: bool = option(
        "Also follow the periodic responses of the model itself around each onset, and tell where they jump.",
        default=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.band
        if not 0.0 < low < high < math.inf:
            raise InputError(f"band: {low:g}:{high:g} is not of the form LO:HI with 0 < LO < HI [Hz]")


onset = function(RateOnset)
