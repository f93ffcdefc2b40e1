"""Measure the loop transfer with the loop broken: a sine is passed on, what returns is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.analysis.loop.bench import Bench
from workbench.analysis.loop.cut import PASSED, RETURNED
from workbench.analysis.loop.measured import LoopPoint
from workbench.analysis.loop.settings import Settings
from workbench.analysis.nfr.point import NfrPoint

__all__ = ["broken"]


def broken(bench: Bench, settings: Settings, wanted: Sequence[tuple[float, float]]) -> list[LoopPoint]:
    """Measure points of the broken loop.

    The signal passed on is a pure sine around its value at the operating point: L is the describing function of the
    loop, exactly. Not for loops that run away when they are open (an unstable part, an integrator on a mean that
    is not quite zero): inject there.

    Args:
        bench: on the opened system.
        settings: how long to wait.
        wanted: frequency [Hz] and amplitude of the signal passed on.
    """
    tasks = [settings.task(PASSED, RETURNED, f, a) for f, a in wanted]
    return [_point(p, settings.value) for p in bench.measure(tasks)]


def _point(found: NfrPoint, mean: float) -> LoopPoint:
    known = found.certificate
    return LoopPoint(
        frequency_hz=found.frequency,
        amplitude=math.nan if found.response is None else found.amplitude,
        value=None if found.response is None else -found.response,
        mean=None if found.response is None else mean,
        thd_passed=None if found.response is None else 0.0,
        thd_returned=None if known is None else known.thd,
        harmonics=() if known is None else known.harmonics,
        status=found.status,
        periods=found.periods,
        reason=found.reason,
    )
