"""Loops of systems: what can be asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING

from workbench.core.records.forms import ONE, Amounts, Band, Form, Numbers, Widths, several
from workbench.core.records.named import named
from workbench.core.records.option import DeclaredOption, option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InWorkers
from workbench.point.lin.request import METHOD_NAMES
from workbench.requests.request import ModelRequest, function
from workbench.response.nfr.frequency_grid import frequency_grid, positive_values

if TYPE_CHECKING:
    from workbench.loops.loop.result import LoopResult
    from workbench.model import Model

__all__ = ["Loop", "Open", "loop", "openings"]

_MEASURING = "Measuring at amplitudes"

Open = str | tuple[str, str]


def openings(value: Open | Sequence[Open]) -> list[Open]:
    """Return the places that are opened: a list names several, a pair is one connection.

    Args:
        value: as Python or a TOML file has it.
    """
    return [value] if isinstance(value, str | tuple) else list(value)


_CONNECTION = Form(
    metavar="PLANT.Y",
    layout=replace(
        ONE,
        split=lambda texts: texts[0] if len(texts) == 1 else list(texts),
        join=lambda value: [x if isinstance(x, str) else " -> ".join(x) for x in openings(value)],
    ),
    repeated=True,
)


class Loop(AtPoint, InWorkers, ModelRequest["LoopResult"]):
    """Open a system's loop at a connection: gain, phase, delay and disk margins, stability, crossovers.

    Convention: negative feedback. The connection is cut; z is passed on instead of the source, y returns at the
    source, all other loops stay closed. L = -Y/Z, wherever the minus sign is, and the closed loop is
    S = 1/(1 + L), T = L/(1 + L). A loop with positive feedback thus has L < 0 at low frequency.

    The linear L is that of `lin` for the opened system: exact, a state space, for sampled loops in z at their basic
    period. Its crossovers are found over all frequencies, not on a grid. Stability of the closed loop follows from all
    its poles; if it is not stable, margins are meaningless and NaN. The poles of a sampled loop are those of its own
    map over the basic period; margins are stated where L, closed again, has these. Where the signal acts several times
    in that period, they are those of a factor on it; where it acts between the samples too, there are none.

    With amplitudes, L is measured too, by sines (as by `nfr`), at an amplitude of the signal z that is passed on, once
    or both ways: "break" opens the loop at the operating point, z biased at its value there, and measures the
    describing function of the open loop; "inject" leaves the loop closed, adds a sine, and compares the signals on
    both sides, the sine adjusted until z has the amplitude. Between the frequencies points are added at the crossovers.
    Where a nonlinearity is not symmetric at the operating point, the sine moves the mean of z in closed loop, while the
    broken loop holds it: the two differ. The distortion of z and y is given for each point: margins of a loop whose z
    is far from a sine are not reliable. Stability at an amplitude is counted by Nyquist's criterion from the
    linear loop.

    Several places give L of each with the others closed, and disk margins: of each, of those at the outputs or inputs
    of one part, and of all at the same time, each place with a gain and phase of its own. They are proved over all
    frequencies by the upper bound of µ (see `robust`), which for up to three places is µ itself.

    Not for co-simulation parts (their communication steps are a part of the loop). Measured values of a sampled loop
    are those of its continuous signals, of which z-domain margins take the values at the samples only.

    Returns:
        The loop: `margins`, `loop`, `sensitivity` and `complementary` (python-control), `curves`, `plot()`.

    Raises:
        InputError: no system, no such connection, a connection that is in no loop, co-simulation parts, a value out of
            its range.
        SimulationError: the system cannot be evaluated at the point.

    Examples:
        With L = 3/(s + 1) the gain is 1 at √8 rad/s; the phase margin is 180 - arctan(√8) degrees.

        >>> loop = wb.connect(
        ...     {"lag": "fmu:FirstOrderLag", "gain": 3.0, "error": wb.SumComponent(name="error", signs=(1, -1))},
        ...     [("lag.y", "error.u2"), ("error.y", "gain.u"), ("gain.y", "lag.u")],
        ...     inputs={"reference": "error.u1"},
        ... )
        >>> with loop:
        ...     margins = wb.loop(loop, "lag.y").margins
        >>> print(f"{margins.phase_margin_deg:.2f} {180 - math.degrees(math.atan(math.sqrt(8))):.2f}")
        109.47 109.47
    """

    command = "loop"
    algorithm = "workbench.loops.loop.run:run"
    of_system = True
    example = "workbench loop system:rudder_loop --open plant.del --amplitude 1,4 --band 4:15 --plot loop.png"
    subject = replace(
        ModelRequest.subject, name="system", argument="model", help="What `connect` or `load` gave; it stays open."
    )
    # Tighter than for a time history, as for a frequency response.
    usual_tolerance = 1e-8

    open: Open | Sequence[Open] = option(
        "Connection at which the loop is opened: a source 'plant.y' (all its connections), an input 'controller.u' "
        "(the connection to it), one connection 'plant.y -> controller.u', or an output of the system. Given several "
        "times, or all: each by itself, and the disk margins of all at the same time.",
        form=_CONNECTION,
    )
    amplitudes: Amounts | None = option(
        "Also measure the loop at these amplitudes of the signal at the opened connection, in the unit of its source "
        "or in one of their own, as 0.05rad; by default only the linear loop is analysed.",
        of="open",
        change=True,
        flag="--amplitude",
        default=None,
        positive=True,
        first=True,
    )
    frequencies: Numbers | None = option(
        "Frequencies to measure at.",
        unit="Hz",
        flag="--freq",
        metavar="F,..",
        group=_MEASURING,
        default=None,
        first=True,
    )
    _: KW_ONLY
    band: Band | None = option(
        "Lowest and highest frequency to measure, instead of a list; by default around the linear crossovers.",
        unit="Hz",
        group=_MEASURING,
        default=None,
        first=True,
    )
    ratio: float = option("Ratio of each frequency in the band to the one below it.", group=_MEASURING, default=1.2)
    how: str = option(
        "Break the loop, or inject a sine into the closed loop; auto breaks loops that are stable when open.",
        choices=("auto", "break", "inject", "both"),
        group=_MEASURING,
        default="auto",
    )
    trim: bool = option("Trim the closed loop first, and open it at that point.", default=False, first=True)
    method: str = option("Method of linearisation; auto chooses.", choices=METHOD_NAMES, default="auto")
    dx: Widths | None = option("Total width of the perturbation of the states, as in `lin`.", python=True, default=None)
    du: float | None = option(
        "Total width of the perturbation of the signal at the opened connection, as in `lin`.",
        python=True,
        default=None,
    )
    refine: int = option(
        "Number of rounds that add points near the measured crossovers.",
        least=0,
        below=11,
        group=_MEASURING,
        default=2,
    )
    errcrit: float = option(
        "How accurately a point has to settle: its stated error is at most a tenth of this, 1 % at 0.1. A smaller "
        "value takes more periods.",
        positive=True,
        group=_MEASURING,
        default=0.1,
    )
    max_periods: int = option(
        "Number of periods after which a point that has not settled is averaged, and marked as such.",
        least=2,
        group=_MEASURING,
        default=20,
    )
    stopped: Callable[[], bool] | None = option(
        "Function that is called every few points; if it returns true the measurement ends, and what was measured so "
        "far is returned.",
        python=True,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.trim and self.at is not None:
            raise InputError("`at` and `trim`: only one of them")
        if self.amplitudes is None and (self.frequencies is not None or self.band is not None):
            name = "band" if self.frequencies is None else "frequencies"
            raise InputError(f"{name}: is for measuring with sines; give `amplitudes`, too, or leave it out")
        if self.amplitudes is not None:
            positive_values("amplitudes", several(self.amplitudes), unit="unit of the signal")
        if self.frequencies is not None or self.band is not None:
            frequency_grid(self.frequencies, self.band, self.ratio, falling=False)

    def variable_of(self, declared: DeclaredOption, subject: Model) -> str:
        """Return the name of the source of the connection that is opened.

        Args:
            declared: the option.
            subject: the system.

        Raises:
            InputError: there is no such connection.
        """
        result: str = named("workbench.loops.loop.cut:source_of")(subject, openings(self.open)[0])
        return result

    def went_well(self, record: LoopResult) -> bool:
        """Return whether no point failed.

        Args:
            record: of this request.
        """
        return not any(curve.failed for one in (record, *record.others) for curve in one.curves)


loop = function(Loop)
