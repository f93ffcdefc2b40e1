"""Motions of several models side by side: what can be asked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Annotated, Any

from workbench.core.records.forms import SPAN, TEXTS, Form, Layout, Names, two_numbers
from workbench.core.records.option import option
from workbench.core.values.operating_point import At
from workbench.jobs.options import InWorker
from workbench.requests.request import Request, Subject, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.model.described_model import DescribedModel  # noqa: F401 - the subject's type, below
    from workbench.response.compare.result import MotionComparison

__all__ = ["CompareMotions", "compare_motions"]


def _windows(value: Any) -> tuple[tuple[float, float], ...]:  # noqa: ANN401
    result = tuple(map(two_numbers, value))
    for begin, end in result:
        if not 0.0 <= begin < end < math.inf:
            raise ValueError(f"the window {begin:g}:{end:g} must rise, from 0 on, as 120:140 does")
    return result


_WINDOWS = Form(
    metavar="BEGIN:END",
    read=_windows,
    layout=Layout(
        kind="list",
        split=lambda texts: [SPAN.split([text]) for text in texts],
        join=lambda value: [text for window in value for text in SPAN.join(window)],
    ),
    items=("array", "string"),
    repeated=True,
)
if TYPE_CHECKING:
    Windows = Sequence[tuple[float, float]]
else:
    Windows = Annotated[object, _WINDOWS]


class CompareMotions(InWorker, Request["Mapping[str, DescribedModel]", "MotionComparison"]):
    """Simulate several models under the same signals, and compare peak and rms of variables in windows of time.

    Not for statistics of random motions: a window is one record, its peak one value.

    Returns:
        A run that fails (an FMU that crashes, a motion that grows without bound) is reported, with what it recorded
        until then; the others count.

    Raises:
        InputError: unknown name, a window that is empty or outside the run, a unit that no signal has.

    Examples:
        The step responses 1 - exp(-t/tau) after 1 s, for tau = 1 s and 2 s.

        >>> with wb.load("fmu:FirstOrderLag") as fast, wb.load("fmu:FirstOrderLag", start_values={"tau": 2.0}) as slow:
        ...     found = wb.compare_motions(
        ...         {"fast": fast, "slow": slow}, outputs=["y"], windows=[(0, 1)], inputs={"u": wb.Constant(1.0)}
        ...     )
        >>> print({motion.system: round(motion.measure.peak, 4) for motion in found.motions})
        {'fast': 0.6321, 'slow': 0.3935}
    """

    command = "simulate"
    called = "compare_motions"
    case = "several models"
    algorithm = "workbench.response.compare.run:run"
    example = (
        "workbench simulate system:failed_aileron system:failed_aileron_feedback --output z_wing_tip "
        "--input pulse=pulse:value=0.8,duration=0.1 --window 120:140 --window 200:260"
    )
    subject = Subject(
        name="systems",
        type="Mapping[str, DescribedModel]",
        help="Name for tables and pictures → FMU or system; they stay open. The first is what the others are compared "
        "with.",
        metavar="MODEL..",
        argument="models",
        words="Systems (.toml, .ssp, system:NAME) or FMUs; the first is the reference.",
        several=True,
        opened=True,
    )
    counts = "models"

    _: KW_ONLY
    outputs: Names | None = option(
        "Variables to compare, which each of the models has, of systems also component.variable; by default all "
        "outputs that the models have in common.",
        flag="--output",
        metavar="NAME",
        default=None,
    )
    windows: Windows = option(
        "Part of the runs to measure, begin and end; by default the whole run.", unit="s", flag="--window", default=()
    )
    inputs: Signals = option(
        "Force an input, which each of the models has: pulse:value=1,duration=0.1, gust:.., file.csv. The other inputs "
        "keep their start values.",
        flag="--input",
        default_factory=dict,
    )
    label: Sequence[str] = option(
        "Label of each model, in their order, for tables and pictures; by default the name of its file, or in Python "
        "its key.",
        form=TEXTS,
        metavar="TEXT",
        default=(),
    )
    at: Mapping[str, At] | Sequence[At] | None = option(
        "Operating point of each model, in their order, as from trim; in Python also by label, and those that are "
        "left out start where they do by themselves.",
        form=TEXTS,
        metavar="POINT.JSON",
        default=None,
    )
    unit: str | None = option(
        "Unit in which signals are shown as well, if they can be converted; g is the standard gravity.", default=None
    )
    stop: float | None = option(
        "End of the runs; by default that of the last window, or of the first model's default experiment.",
        unit="s",
        metavar="T",
        default=None,
    )
    interval: float | None = option(
        "Interval between rows; by default 1/40000 of the run; of co-simulation a multiple of its step, which would be "
        "shorter else.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
    )

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether several models are given.

        Args:
            given: as the command line names it.
        """
        return len(given) > 1

    def went_well(self, record: MotionComparison) -> bool:
        """Return whether no run ended early.

        Args:
            record: of this request.
        """
        return not record.failed


compare_motions = function(CompareMotions)
