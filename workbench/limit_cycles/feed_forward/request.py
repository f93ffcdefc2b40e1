"""A filter that feeds a nonlinear block's output forward to a control input: what can be asked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING, Annotated

from workbench.core.records.forms import LISTED, MODEL, SPAN, Band, Form, Names, several
from workbench.core.records.option import option
from workbench.core.records.quantity import number
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.limit_cycles.feed_forward.result import FeedForwardResult  # noqa: F401 - the record's type, below

__all__ = ["FeedForward", "feed_forward"]

_FILTER = "Design of the filter"
_TRIALS = "Simulations, with --input"


def _split_gain(texts: Sequence[str]) -> tuple[str, str]:
    name, colon, gain = texts[-1].rpartition(":")
    if not (colon and name.strip()):
        raise ValueError(f"'{texts[-1]}' is not of the form NAME:GAIN, as in aircraft.outer_aileron_position:-1")
    return name.strip(), gain


def _gain(value: tuple[str, float]) -> tuple[str, float]:
    if len(value) != 2:
        raise ValueError(f"'{value}' is not a name and a gain")
    name, gain = value[0], number(value[1])
    if not math.isfinite(gain):
        raise ValueError(f"the gain must be a finite number, not {gain:g}")
    return str(name), gain


def _orders(value: Sequence[float]) -> tuple[int, int]:
    result = several(value)
    if len(result) != 2 or not all(x.is_integer() for x in result):
        raise ValueError(f"{','.join(f'{x:g}' for x in result)} is not two whole numbers G,H, as in 36,29")
    return int(result[0]), int(result[1])


_GAIN = Form(metavar="NAME:GAIN", read=_gain, layout=replace(SPAN, split=_split_gain), items=("string", "number"))
_ORDERS = Form(metavar="G,H", read=_orders, layout=LISTED, items=("integer",))

if TYPE_CHECKING:
    _Gain = tuple[str, float]
    _Orders = tuple[int, int]
else:
    _Gain = Annotated[object, _GAIN]
    _Orders = Annotated[object, _ORDERS]


class FeedForward(AtPoint, ModelRequest["FeedForwardResult"]):
    """Design a filter F ≈ H/G from a block's output to a control input, and try it.

    With v the block's input, w its output and u the control, the linear part is v = G u − H w. Fed with u = F w,
    F = H/G, the block would have no effect on its own input at all. Such a filter is large, and unstable where G has
    zeros right of the imaginary axis. So, in the order of the steps of the result: G and H, stabilised by a scalar
    feedback, are reduced separately (balanced, to `orders` or to Hankel singular values above `hankel`); they are
    joined by zeros and poles, not by polynomials; poles and zeros that nearly meet are cancelled; poles right of the
    axis are mirrored, which keeps the gain and changes the phase; the sign is changed where that turned the phase by
    180° at low frequency; a low-pass ends the band in which the filter holds.

    When not to use it: mirroring is exact in gain only. If poles were mirrored inside the band, w is not compensated
    around their frequencies, and may be amplified: `steps[-1].residual` above 1 says so. The block's output then
    acts through (G F/H − 1) H instead of −H; where this loop is unstable at high gain, a block that grows faster than
    linearly drives the system to infinity in finite time. Trials without actuator limits show it, limits turn it into
    a larger limit cycle.

    Source: the filter of chapter 8.6 of the source report; J.-J. Slotine, W. Li, Applied Nonlinear Control, chapter 6.

    Raises:
        InputError: no system, unknown names, orders or tolerances out of range.
        FmuError, SimulationError: the model cannot be opened or evaluated.

    Examples:
        The aircraft without its aileron's actuator has one pair of unstable poles; the published feedback removes it.

        >>> with wb.load("system:failed_aileron") as aircraft:
        ...     design = wb.feed_forward(
        ...         aircraft, block="damper", target="aircraft.inner_aileron", orders=(36, 29),
        ...         feedback=("aircraft.outer_aileron_position", -0.7),
        ...     )
        >>> print(len(design.open_unstable), len(design.closed_unstable))
        2 0
    """

    command = "feed-forward"
    written = "workbench.limit_cycles.feed_forward.written:FeedForwardFiles"
    algorithm = "workbench.limit_cycles.feed_forward.run:run"
    of_system = True
    example = (
        "workbench feed-forward system:failed_aileron --block damper --to aircraft.inner_aileron --feedback "
        "aircraft.outer_aileron_position:-1 --orders 36,29 --cancel 3e-3 --input pulse=pulse:value=0.8,duration=0.1 "
        "--closes-at 140 --actuator fmu:LimitedActuator --plot filter.png"
    )
    subject = replace(ModelRequest.subject, help="A system; it stays open.")
    counts = "simulations"

    _: KW_ONLY
    block: str = option("Name of the nonlinear block's component, with one input and one output.", metavar="COMPONENT")
    target: str = option(
        "Control input that the filter drives, component.variable, besides what drives it already.",
        flag="--to",
        metavar="NAME",
    )
    second: str | None = option(
        "Second control input that shares the filter's output, by the weights with which both come nearest to the "
        "block's effect.",
        flag="--and-to",
        metavar="NAME",
        default=None,
    )
    feedback: _Gain | None = option(
        "Variable and gain of a scalar feedback to the same input, which stays.", default=None, first=True
    )
    orders: _Orders | None = option(
        "Orders of the reduced G and H, e.g. 36,29; by default chosen by hankel.", default=None, first=True
    )
    hankel: float = option(
        "Without orders: smallest Hankel singular value that is kept, relative to the largest.",
        metavar="TOL",
        group=_FILTER,
        default=1e-4,
    )
    method: str = option(
        "Method of reducing G and H: match-dc keeps the gain at frequency 0, truncate the gain at high frequency.",
        choices=("match-dc", "truncate"),
        group=_FILTER,
        default="match-dc",
    )
    weighting: str = option(
        "With a second control input: the error that its weight makes least over the band; relative counts "
        "frequencies with a small effect as much as the peaks.",
        choices=("absolute", "relative"),
        group=_FILTER,
        default="absolute",
    )
    cancel: float = option(
        "Relative distance up to which a pole and a zero cancel; absolute below 1 rad/s.",
        metavar="TOL",
        group=_FILTER,
        default=1e-5,
    )
    low_pass: float = option(
        "Corner of the low-pass.", unit="Hz", metavar="F", positive=True, group=_FILTER, default=5.0
    )
    low_pass_order: int = option("Order of the low-pass; 0: none.", metavar="N", group=_FILTER, default=1)
    sign: str = option(
        "Sign of the filter after mirroring; auto decides by the number of mirrored real poles.",
        choices=("auto", "change", "keep"),
        group=_FILTER,
        default="auto",
    )
    band: Band | None = option(
        "Lowest and highest frequency in which errors count; by default from 0.1 Hz (or a fiftieth of the corner, if "
        "that is less) up to the corner.",
        unit="Hz",
        group=_FILTER,
        default=None,
    )
    inputs: Signals | None = option(
        "Start the motion by forcing an input, e.g. pulse:value=0.8,duration=0.1, and simulate it.",
        flag="--input",
        group=_TRIALS,
        default=None,
        first=True,
    )
    outputs: Names = option(
        "Variable to record in addition to the block's input, its output and the target.",
        flag="--output",
        metavar="NAME",
        group=_TRIALS,
        default=(),
    )
    closes_at: float = option(
        "Time at which feedback and filter are connected.", unit="s", metavar="T", group=_TRIALS, default=0.0
    )
    stop: float | None = option(
        "End of the simulations; by default that of the system.", unit="s", metavar="T", group=_TRIALS, default=None
    )
    actuator: str | None = option(
        "Actuator model with limits in front of the control input, with one input and one output: .fmu, fmu:NAME.",
        form=MODEL,
        group=_TRIALS,
        default=None,
    )
    crude: bool = option(
        "Also try a plain gain instead of the filter, without and with limits.", group=_TRIALS, default=False
    )
    time: float | None = option(
        "Time of the linearisation; by default that of the operating point, or the model's start time.",
        unit="s",
        python=True,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.counted
        if not 0.0 < low < high < math.inf:
            raise InputError(f"band: '{low:g}:{high:g}' is not a band; write the lower frequency first, above 0")

    @property
    def counted(self) -> tuple[float, float]:
        """Frequencies in which errors count [Hz]."""
        return self.band or (min(0.1, self.low_pass / 50.0), self.low_pass)


feed_forward = function(FeedForward)
