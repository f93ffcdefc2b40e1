"""Limit cycles that the describing function predicts with the filter, and with the feedback alone."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import WorkbenchError
from workbench.limit_cycles.feed_forward.plant import Plant
from workbench.limit_cycles.limit_cycle.cut import cut
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.nyquist.nyquist import nyquist
from workbench.loops.nyquist.result import Crossing
from workbench.model.described_model import DescribedModel

__all__ = ["Remaining", "remaining", "with_filter"]

_PLACES = 200
_ROUNDING = 1e-6  # of H: what a filter that compensates exactly leaves


@dataclass(frozen=True, kw_only=True)
class Remaining(RecordPart):
    """Limit cycles by the describing function, without limits of an actuator.

    Attributes:
        without: with the scalar feedback alone (or nothing).
        with_filter: with the filter, too.
    """

    without: tuple[Crossing, ...]
    with_filter: tuple[Crossing, ...]

    def words(self, unit: str | None) -> list[str]:
        """What follows for the motion, one line each.

        Args:
            unit: of the block's input.
        """
        stable = [_told(c, unit) for c in self.with_filter if c.stable]
        unstable = [c for c in self.with_filter if c.amplitude is not None and not c.stable]
        lines = []
        if stable:
            lines.append(f"with the filter a limit cycle is predicted at {', '.join(stable)}; {self._alone()}")
        if unstable:
            least = min(unstable, key=lambda c: c.amplitude or 0.0)
            lines.append(
                f"with the filter motions at {least.frequency_hz:.3g} Hz grow from {_size(least, unit)} on (describing "
                "function, without limits of the actuator)"
            )
        return lines

    def _alone(self) -> str:
        return "without it, too" if any(c.stable for c in self.without) else "without it there is none"


def remaining(
    model: DescribedModel,
    block: str,
    plant: Plant,
    part: LinearPart,
    *,
    band: tuple[float, float],
    at: OperatingPoint | None,
    time: float,
) -> Remaining | str:
    """Return the limit cycles that are predicted, or in words why they cannot be.

    Args:
        model: the system; it stays open.
        block: name of the block's component.
        plant: with the scalar feedback.
        part: the filter.
        band: frequencies looked at [Hz].
        at: operating point; None: the start values.
        time: session time [s].
    """
    with ExitStack() as keep:
        try:
            whole = cut(model, block, at=at, time=time, keep=keep)
        except WorkbenchError as error:
            return f"limit cycles were not predicted: {error}"
        if whole.block is None:
            return "limit cycles were not predicted: the block is not static"
        without, with_it = (
            _cycles(loop.negated() if whole.turned else loop, whole.block, band, size=size)
            for loop, size in ((plant.H, 0.0), (with_filter(plant, part), _size_of(plant.H, band)))
        )
    return Remaining(without=without, with_filter=with_it)


def _cycles(loop: LinearPart, block: DescribedBlock, band: tuple[float, float], *, size: float) -> tuple[Crossing, ...]:
    """Return the crossings to which an amplitude belongs; of a loop that is nothing but rounding there are none."""
    if _size_of(loop, band) <= _ROUNDING * size:
        return ()
    return tuple(c for c in nyquist(loop, block, band=band).crossings if c.amplitude is not None)


def _size_of(loop: LinearPart, band: tuple[float, float]) -> float:
    return float(np.max(np.abs(loop.response(np.geomspace(*band, _PLACES)))))


def with_filter(plant: Plant, part: LinearPart) -> LinearPart:
    """Return L = H − G F: with it the loop is 1 + N·L = 0, N the block's gain.

    Args:
        plant: G and H.
        part: F.
    """
    G, H = plant.G, plant.H
    n, m = len(G.A), len(part.A)
    A = np.block([[G.A, G.B @ part.C], [np.zeros((m, n)), part.A]])
    B = np.concatenate([H.B - G.B @ part.D, -part.B])
    return LinearPart(A, B, np.hstack([G.C, G.D @ part.C]), H.D - G.D @ part.D)


def _told(c: Crossing, unit: str | None) -> str:
    return f"{_size(c, unit)}, {c.frequency_hz:.3g} Hz"


def _size(c: Crossing, unit: str | None) -> str:
    return f"{c.amplitude:.3g}" + (f" {unit}" if unit and unit != "1" else "")
