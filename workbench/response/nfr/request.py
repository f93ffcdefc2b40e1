"""Nonlinear frequency response: gain, phase and offset over frequency and amplitude."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import Amounts, Band, File, Names, Numbers
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InWorkers
from workbench.requests.request import ModelRequest, function
from workbench.response.nfr.frequency_grid import frequency_grid, positive_values

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from workbench.response.nfr.result import NfrResult

__all__ = ["Nfr", "nfr"]


class Nfr(AtPoint, InWorkers, ModelRequest["NfrResult"]):
    """Measure gain, phase and offset over frequency and amplitude (nonlinear frequency response).

    At each amplitude m and frequency f the input moves by m·sin(2πft) about its value at the operating point, or its
    start value, and the model is run one period at a time, each resumed from the last. With P = ∫ y sin dt and
    Q = ∫ y cos dt over a period the gain is 2·f·√(P² + Q²)/m and the phase atan2(Q, P): the sinusoidal-input describing
    function of the model, which is stated with its error; the offset is the mean of y. Periods are run until the
    response has settled, or up to `max_periods`, after which the mean of P, Q and offset over the last half of them is
    taken and the point is marked averaged. The phase is followed along the frequency.

    Where it departs from the source report, and why:
      - 200 rows per period, events as double rows, in place of 30: P and Q of a settled linear
        model are good to 1e-3.
      - The fundamental of the input that the model really saw takes the place of m (and of phase
        zero): a co-simulation holds its input over a step, which alone would cost half a step of delay.
      - A transient that can be identified is removed and the point is then settled; the published test
        alone stops while a slow or lightly damped transient still falsifies the value (see
        `workbench.response.nfr.settling.Settling` and `workbench.response.nfr.transient.remove_transient`).
      - Each point states its error (see `workbench.response.nfr.error`), and nothing is called settled whose error is
        above errcrit/10.
      - Co-simulation is repeated with smaller communication steps (see
        `workbench.response.nfr.communication_step.refine`).

    Not for a model without a periodic response: an unstable one fails point by point, a limit
    cycle of the model's own gives averaged points that mean little. Gain and phase are those of the first
    harmonic; the others are in the certificates.

    Returns:
        The response; points that failed are NaN and listed with their reasons.

    Raises:
        InputError: unknown variable, a value out of its range.
        FmuError, SimulationError: the FMU cannot be started.

    Source: the source report, chapter 4 and appendix 11.2; the carried variant chapter 4.3.

    Examples:
        The corner frequency of 1/(s + 1) is 1/(2π) Hz; there the gain is 1/√2, and the output lags by 45 degrees.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     response = wb.nfr(lag, "u", "y", frequencies=[0.5 / math.pi], amplitudes=[1.0])
        >>> print(f"{response.gain_db[0, 0]:.2f} dB, {response.phase_deg[0, 0]:.1f} deg")
        -3.01 dB, -45.0 deg
    """

    command = "nfr"
    written = "workbench.response.nfr.written:NfrFiles"
    isolated = False  # its points run in worker processes, whatever happens to one of them
    algorithm = "workbench.response.nfr.run:run"
    example = "workbench nfr fmu:Rudder --input delC --output del --band 0.5:20 --amplitude 1,4 --plot bode.png"
    # Tighter than for a time history: the response may be a small part of a large output or transient.
    usual_tolerance = 1e-8

    input: str = option("Input to force.", metavar="U")
    output: str = option("Output or state to measure.", metavar="Y")
    frequencies: Numbers | None = option(
        "Frequencies to measure, in place of a band.",
        unit="Hz",
        flag="--freq",
        metavar="F,..",
        default=None,
        first=True,
    )
    amplitudes: Amounts | None = option(
        "Amplitudes of the sine, in the unit of the input or in one of their own, as 0.05rad.",
        of="input",
        change=True,
        flag="--amplitude",
        metavar="A,..",
        default=None,
        positive=True,
        needed="a nonlinear model's response depends on it",
        first=True,
    )
    _: KW_ONLY
    band: Band | None = option("Lowest and highest frequency.", unit="Hz", default=None, first=True)
    bandwidth: float | None = option(
        "Also measure where the gain is so much below that at the lowest frequency, where the phase lags by 90 "
        "degrees, and resonance.",
        unit="dB",
        metavar="DB",
        default=None,
        positive=True,
        first=True,
    )
    least_bandwidth: float | None = option(
        "Also measure the amplitude at which the bandwidth, of 3 dB by default, falls below this.",
        unit="Hz",
        metavar="F",
        default=None,
        positive=True,
        first=True,
    )
    ratio: float = option("Ratio of each frequency in the band to the one below it.", default=1.2)
    errcrit: float = option(
        "How accurately a point has to settle: its stated error is at most a tenth of this, 1 % at 0.1. A smaller "
        "value takes more periods.",
        default=0.1,
        positive=True,
    )
    max_periods: int = option(
        "Number of periods that a run waits for the response to settle; a point that has not settled by then is "
        "averaged, and marked as such. Periods that solving for the response takes (method auto) count apart.",
        default=20,
        least=2,
    )
    method: str = option(
        "auto: solve for the periodic response where the model's states can be set; settle: always wait for it.",
        choices=("auto", "settle"),
        default="auto",
    )
    branches: bool = option(
        "Also follow all periodic responses over the band, stable or not, around their folds.", default=False
    )
    carry: bool = option(
        "Carry the state over from each frequency to the next, in their order; a band may then be falling (HI:LO).",
        default=False,
    )
    step: float | None = option(
        "Communication step of co-simulation; by default found by halving.",
        unit="s",
        default=None,
        positive=True,
    )
    verify: bool = option("Model exchange: repeat each point with a hundredth of the tolerance.", default=False)
    drift_check: bool = option("Run the model with zero input first, and warn if it moves.", default=True)
    store: File | None = option(
        "Folder in which finished points are kept; the same command continues from there.", metavar="DIR", default=None
    )
    redo: Names = option(
        "Points of the store to measure again: averaged, failed, settled.", metavar="STATUS,..", default=()
    )
    executor: Executor | None = option(
        "Executor to use instead of worker processes; it stays open.", default=None, python=True
    )
    previous: NfrResult | None = option(
        "Earlier result whose points are kept, instead of a store or in addition to it.", default=None, python=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        grid = frequency_grid(self.frequencies, self.band, self.ratio, falling=self.carry)
        positive_values("amplitudes", self.amplitudes or (), unit="unit of the input")
        if self.carry and (self.bandwidth, self.least_bandwidth) != (None, None):
            raise InputError("bandwidth: a carried sweep measures its points in their order, and none between them")
        if self.least_bandwidth is not None and not min(grid) < self.least_bandwidth <= max(grid):
            low, high = min(grid), max(grid)
            raise InputError(
                f"least_bandwidth: {self.least_bandwidth:g} Hz is not inside the band, {low:g} to {high:g} Hz"
            )

    def went_well(self, record: NfrResult) -> bool:
        """Return whether no point failed.

        Args:
            record: record of this request.
        """
        return not record.failed


nfr = function(Nfr)
