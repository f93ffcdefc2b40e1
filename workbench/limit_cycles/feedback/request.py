"""A scalar output feedback on a system, over its gain: what can be asked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING, Annotated

from workbench.core.records.forms import MODEL, SPAN, Form, Names, two_numbers
from workbench.core.records.option import option
from workbench.core.records.quantity import quantity
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InParts
from workbench.point.lin.request import METHOD_NAMES
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.result import FeedbackResult  # noqa: F401 - the record's type, below

__all__ = ["Feedback", "Range", "feedback"]

_ANALYSIS = "Linear model and limit cycles"
_MOTION = "Motion that the feedback closes on"
_SETTLING = "Settling times, with --settle"
_RUN = "One simulation, with --gain"
_ACTUATOR = "Between gain and target"


def _range(value: Sequence[float]) -> tuple[float, float]:
    low, high = two_numbers(value)
    if not low < high:
        raise ValueError(f"{low:g}:{high:g} is not of the form LO:HI with LO < HI, as in -2:0.5")
    return low, high


def _checked_quantity(value: float | str) -> float | str:
    quantity(value)
    return value


_RANGE = Form(metavar="LO:HI", read=_range, layout=SPAN, items=("number",))
_SIZE = Form(metavar="X", read=_checked_quantity, items=("number", "string"))

if TYPE_CHECKING:
    Range = tuple[float, float]
    _Size = float | str
else:
    Range = Annotated[object, _RANGE]
    _Size = Annotated[object, _SIZE]


class Feedback(AtPoint, InParts, ModelRequest["FeedbackResult"]):
    """Feed an output back to an input, u = g·y: stabilising gains, their effect on a limit cycle, settling times.

    The system is linearised at rest from the target to the source, a nonlinear block by its slope there.
    All gains at which a pole reaches the border of stability are found exactly
    (`workbench.limit_cycles.feedback.gains`), and the unstable poles are counted between them. Then, if requested or if
    there is a nonlinear block:
    - limit cycles left: for gains in the stable intervals, the crossings of the linear part that the block sees (the
      feedback closed) with −1/N(A), and whether small and large motions grow;
    - settling: the feedback closes on a limit cycle of the nonlinear system, once for each of several gains; the time
      until the mean magnitude over a cycle stays below a part of what it was, a polynomial through these times, and
      its minimum;
    - one simulation in which the feedback closes (`gain`).

    Signals that already act on the target stay; the feedback is added to them, as g times the deviation of the source
    from rest. In a sampled or co-simulated system the feedback is sampled with the period of the linear model.
    Stable gains are valid for small motions: if the block weakens or strengthens the loop, see the remaining cycles.

    Returns:
        Stable gains, crossings, poles over the gain, cycles left; `settling` and `run` where they were asked for.

    Raises:
        InputError: unknown names, an input as source, no stable gain to settle with, nothing that oscillates.
        FmuError, SimulationError: a part cannot be opened, evaluated or simulated.

    Source: the source report, chapters 8.4 and 8.5; Slotine & Li, Applied Nonlinear Control, chapter 5.

    Examples:
        With dx/dt = -x + u and u = g·x the system is stable for g < 1.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     result = wb.feedback(lag, source="y", target="u")
        >>> print(result.stable_gains)
        ((-inf, 1.0),)
    """

    command = "feedback"
    written = "workbench.limit_cycles.feedback.written:FeedbackFiles"
    algorithm = "workbench.limit_cycles.feedback.run:run"
    example = (
        "workbench feedback system:failed_aileron --from aircraft.outer_aileron_position --to aircraft.inner_aileron "
        "--settle --plot feedback.png"
    )
    subject = replace(
        ModelRequest.subject, name="system", argument="model", help="A system, or one FMU; it stays open."
    )
    counts = "gains"
    parts = ("settling", "run")

    _: KW_ONLY
    source: str = option(
        "Output that is fed back: component.variable, or an output of the system or of a single FMU.",
        flag="--from",
        metavar="A.Y",
    )
    target: str = option("Input that the feedback acts on, named in the same way.", flag="--to", metavar="B.U")
    gains: Range = option(
        "Lowest and highest gain to consider; by default all gains.",
        default=(-math.inf, math.inf),
        infinite=True,
        first=True,
    )
    settle: bool = option("Measure settling times over the stable gains.", default=False, first=True)
    gain: float | None = option(
        "Simulate the feedback with this gain, and keep the time histories.",
        metavar="G",
        default=None,
        first=True,
    )
    block: str | None = option(
        "Component to treat as the nonlinear block; by default the only static nonlinear component.",
        metavar="COMPONENT",
        group=_ANALYSIS,
        default=None,
        first=True,
    )
    time: float | None = option(
        "Time of the analysis; by default that of the operating point, or the system's start time. Connections that "
        "close later are open.",
        unit="s",
        metavar="T",
        group=_ANALYSIS,
        default=None,
    )
    method: str = option(
        "Method of linearisation; auto chooses.", choices=METHOD_NAMES, group=_ANALYSIS, default="auto"
    )
    count: int = option(
        "Number of gains for which remaining cycles are predicted and settling times measured.",
        metavar="N",
        least=1,
        group=_ANALYSIS,
        default=15,
    )
    signals: Signals | None = option(
        "Excite the motion from rest, e.g. pulse:duration=0.1,value=1; by default the motion is a predicted limit "
        "cycle.",
        flag="--pulse",
        metavar="INPUT=SIGNAL",
        group=_MOTION,
        default=None,
    )
    start_after: float | None = option(
        "Time from the start of the excitation to the closing of the feedback.",
        unit="s",
        metavar="T",
        positive=True,
        group=_MOTION,
        default=None,
    )
    watch: str | None = option(
        "Variable whose magnitude decides that the motion has settled; by default the block's input, or the source.",
        metavar="NAME",
        group=_MOTION,
        default=None,
    )
    settle_gains: Range | None = option(
        "Lowest and highest gain for which settling times are measured; by default the stable interval nearest to 0, "
        "less 3 % at each end.",
        group=_SETTLING,
        default=None,
    )
    threshold: float = option(
        "Fraction of the initial magnitude below which the motion has settled.",
        metavar="PART",
        positive=True,
        below=1.0,
        group=_SETTLING,
        default=0.01,
    )
    order: int = option("Order of the polynomial through the settling times.", least=2, group=_SETTLING, default=4)
    longest: float | None = option(
        "Longest duration of a run; by default 250 cycles.",
        unit="s",
        metavar="S",
        positive=True,
        group=_SETTLING,
        default=None,
    )
    stop: float | None = option(
        "Time at which the simulation ends; by default 250 cycles after closing.",
        unit="s",
        metavar="T",
        group=_RUN,
        default=None,
    )
    outputs: Names = option("Additional variable to record.", flag="--output", metavar="NAME", group=_RUN, default=())
    limit: _Size | None = option(
        "Maximum deflection of the target in either direction, e.g. 25deg; a plain number is in the target's unit.",
        group=_ACTUATOR,
        default=None,
    )
    rate_limit: _Size | None = option(
        "Maximum rate of the target, e.g. 40deg/s; a plain number is in the target's unit per second.",
        group=_ACTUATOR,
        default=None,
    )
    actuator: str | None = option(
        "FMU with one input and one output, instead of the limits.",
        metavar="FMU",
        form=MODEL,
        group=_ACTUATOR,
        default=None,
    )
    band: Range | None = option(
        "Lowest and highest frequency of the search for limit cycles; by default 0.01 to 1000.",
        unit="Hz",
        python=True,
        default=None,
    )
    amplitudes: Range | None = option(
        "Smallest and largest amplitude at the block's input in the search for limit cycles; by default 1e-4 to 1e4.",
        python=True,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.signals is None) != (self.start_after is None):
            raise InputError("a signal that excites the motion (pulse) and start_after go together; give both or none")
        if self.actuator is not None and not (self.limit is self.rate_limit is None):
            raise InputError("actuator: it has its own limits; leave limit and rate_limit out")


feedback = function(Feedback)
