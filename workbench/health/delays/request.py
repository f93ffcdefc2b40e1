"""Delays of a system with co-simulation parts: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.health.delays.result import DelayReport, NoDelays  # noqa: F401 - the record's type, below

__all__ = ["Delays", "delays"]


class Delays(AtPoint, ModelRequest["DelayReport | NoDelays"]):
    """Report which connections of a system carry a delay, the phase lost there, and the error of the response.

    For systems with co-simulation parts. The system runs three times, with the step, half of it and a quarter. A value
    that is held over a step of length h is h/2 late on average, which turns a sine of frequency f by 360·f·h/2 [deg].

    Returns:
        The report; of model exchange parts alone, that there is no delay.

    Raises:
        InputError: one co-simulation FMU, an unknown input, a value out of its range.
        FmuError, SimulationError: as for a run.

    Source: G. Franklin, J. Powell, M. Workman, Digital Control of Dynamic Systems, 3rd ed., section 6.3.3.

    Examples:
        Model exchange parts of a system are one differential equation: no connection carries a delay.

        >>> with wb.load("system:rudder_loop") as system:
        ...     print(type(wb.delays(system)).__name__)
        NoDelays
    """

    command = "check"
    called = "delays"
    case = "delays of a system"
    chosen_by = "--delays"
    algorithm = "workbench.health.delays.run:run"
    of_system = True
    example = "workbench check system:rudder_loop --stop 2 --input reference=1 --step 0.01 --delays"
    withheld = ("step",)
    unwritten = ("csv", "mat", "plot")

    _: KW_ONLY
    stop: float | None = option(
        "Length of each run; by default that of the default experiment, or 500 steps.",
        unit="s",
        metavar="T",
        positive=True,
        default=None,
    )
    inputs: Signals = option(
        "Force an input: a number, with a unit or without (2deg), sine:amplitude=1,frequency=2, step:time=1,value=2, "
        "file.csv; of an enumeration or a Boolean the name of a value, as Off or true. Other inputs keep their start "
        "value or that of the operating point.",
        flag="--input",
        default_factory=dict,
    )
    step: float | None = option(
        "Communication step; by default the one that `simulate` would use, whether it is controlled or not.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
    )
    frequency: float | None = option(
        "Frequency at which to report the lost phase; by default the crossover of each loop, if the parts also have "
        "model exchange, which gives it.",
        unit="Hz",
        flag="--freq",
        metavar="F",
        positive=True,
        default=None,
    )


delays = function(Delays)
