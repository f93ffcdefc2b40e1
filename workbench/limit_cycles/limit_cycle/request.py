"""Limit cycles of a system with nonlinear blocks: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING

from workbench.core.records.forms import Band, Names, Ranges
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError, suggest
from workbench.jobs.options import InWorkers
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.limit_cycles.limit_cycle.result import LimitCycleResult  # noqa: F401 - the record's type, below

__all__ = ["METHODS", "LimitCycles", "limit_cycle"]

DESCRIBING_FUNCTION, HARMONIC_BALANCE, SHOOTING, SIMULATION = (
    "describing function", "harmonic balance", "shooting", "simulation",
)  # fmt: skip
METHODS = (DESCRIBING_FUNCTION, HARMONIC_BALANCE, SHOOTING, SIMULATION)


class LimitCycles(AtPoint, InWorkers, ModelRequest["LimitCycleResult"]):
    """Predict limit cycles from the crossings of L(jω) with −1/N(A), refine them, and confirm them by simulation.

    The system is cut at the block. The part from the block's output to its input is linearised (`workbench.lin`);
    the block's describing function is computed by quadrature if the block is static, otherwise measured. Harmonic
    balance drives the block with all harmonics of the motion and measures those of its output. Several blocks are cut
    out together and balanced together. Then, for each crossing of L(jω) with −1/N(A) in the band:

    - describing function: frequency, amplitude, stability by counting poles on both sides;
    - harmonic balance with several harmonics, stability by Floquet multipliers of the linear part with the block
      (not for a measured block, whose states are unknown: shooting gives it);
    - shooting on the simulated system itself (unstable cycles too), stability by its Floquet multipliers;
    - simulation from the predicted state, for those that are stable.

    The first two treat everything around the block as linear; shooting and simulation do not, and show the error of
    that. If no cycle is predicted, the system is run from disturbed operating points (`observed`), and what keeps
    oscillating is reported. Other cycles that no crossing predicts are not found.
    Not for sampled or co-simulated parts.

    Returns:
        Crossings, limit cycles and the simulation; `simulated` is that of the first stable cycle.

    Raises:
        InputError: no system, unknown block, variable or method, a block with several inputs or outputs in the loop.
        FmuError, SimulationError: a part cannot be opened or evaluated.

    Source: Slotine & Li, Applied Nonlinear Control, chapter 5; the source report, chapter 8.3.

    Examples:
        The published limit cycle of the failed aileron has 2.64 Hz.

        >>> with wb.load("system:failed_aileron") as aircraft:
        ...     result = wb.limit_cycle(aircraft, block="damper", methods=["describing function"])
        >>> print(f"{result.limit_cycles[0].frequency_hz:.2f} Hz")
        2.64 Hz
    """

    command = "limit-cycle"
    algorithm = "workbench.limit_cycles.limit_cycle.run:run"
    of_system = True
    example = "workbench limit-cycle system:failed_aileron --block damper --output z_wing_tip --plot cycle.png"
    details = (
        "Several blocks, one with states, in connections that close at 140 s: `workbench limit-cycle "
        "system:failed_aileron_feedforward --block damper --block actuator --amplitude 0.01:1 --time 150 --band 1:10`"
    )
    counts = "steps"
    subject = replace(
        ModelRequest.subject,
        name="system",
        argument="model",
        type="DescribedModel",
        help="Connected model exchange parts; it stays open.",
    )

    _: KW_ONLY
    block: Names = option(
        "Nonlinear block: the name of its component; several if they all matter, that of most interest first.",
        metavar="COMPONENT",
    )
    outputs: Names | None = option(
        "Variables whose amplitudes are measured in the simulation; by default all outputs.",
        flag="--output",
        metavar="NAME",
        default=None,
        first=True,
    )
    band: Band = option("Lowest and highest frequency of the search.", unit="Hz", default=(0.01, 1000.0), first=True)
    amplitudes: Band | None = option(
        "Lowest and highest amplitude at the block's input; required for a block with states, which is measured.",
        flag="--amplitude",
        positive=True,
        default=None,
        first=True,
    )
    harmonics: int = option("Number of harmonics in harmonic balance.", metavar="K", least=1, default=7)
    methods: Names = option(
        "Method to use: describing function, harmonic balance, shooting or simulation; by default all.",
        flag="--method",
        metavar="NAME",
        default=METHODS,
    )
    max_periods: int = option("Maximum length of the simulation.", unit="periods", metavar="N", least=1, default=400)
    vary: Ranges = option(
        "Follow the cycles that shooting finds over a parameter, also around folds, to where they shrink to a point; "
        "gain is a factor on the output of the block.",
        default_factory=dict,
        first=True,
    )
    run_until: float | None = option(
        "Also simulate from the start up to this time, and follow frequency and amplitude of the block's input.",
        unit="s",
        flag="--free-run",
        metavar="T",
        default=None,
    )
    inputs: Signals = option(
        "Force an input in the run of --free-run, e.g. pulse:value=1,duration=0.1.",
        flag="--input",
        default_factory=dict,
    )
    time: float | None = option(
        "Time of the analysis; by default that of the operating point, or the system's start time. Connections that "
        "close later are open.",
        unit="s",
        metavar="T",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.block or len(set(self.block)) < len(self.block):
            raise InputError("block: name one or several components, each once")
        for method in self.methods:
            if method not in METHODS:
                raise InputError(f"method '{method}' is unknown; {suggest(method, METHODS)}")
        if self.inputs and self.run_until is None:
            raise InputError("inputs force the run from rest; give its end, run_until")


limit_cycle = function(LimitCycles)
