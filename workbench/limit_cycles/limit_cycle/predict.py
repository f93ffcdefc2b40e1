"""Where describing functions predict limit cycles of a loop: its crossings, and the motions that belong to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.limit_cycles.limit_cycle.cut import SplitLoop, only_block
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle
from workbench.limit_cycles.limit_cycle.request import LimitCycles
from workbench.limit_cycles.limit_cycle.several_blocks import Gain, ManyBlocks, tabulated
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.nyquist.nyquist import AMPLITUDES, nyquist
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.model.described_model import DescribedModel
from workbench.response.nfr.request import nfr

__all__ = ["Prediction", "predict"]

_PER_DECADE = 10  # amplitudes of the first of several blocks that are looked at
_AMPLITUDES, _FREQUENCIES = 10, 12  # at which a block with a memory is measured
_ERRCRIT = 0.005
_NEAR_AMPLITUDE, _NEAR_FREQUENCY = 1.1, 1.05  # measured again so far around a crossing


@dataclass(frozen=True, eq=False)
class Prediction:
    """What describing functions say.

    Attributes:
        loop: as it was cut.
        curve: L with −1/N and the crossings.
        many: all blocks as one; None: there is one.
        notes: what the user should know.
    """

    loop: SplitLoop
    curve: NyquistResult
    many: ManyBlocks | None
    notes: tuple[str, ...] = ()

    def sine(self, frequency: float, amplitude: float) -> Cycle:
        """Return the motion of a crossing.

        Args:
            frequency: of the crossing [Hz].
            amplitude: of the first block's input.
        """
        if self.many is not None:
            v, w = (x[0] for x in self.many.motions(np.array([amplitude]), np.array([frequency])))
        else:
            v = np.array([-1j * amplitude])
            with np.errstate(all="ignore"):
                w = -v / self.loop.part.response(np.array([frequency]))
        zero = np.zeros(len(v))
        return Cycle(frequency, np.column_stack([zero, v]), np.column_stack([zero, w]))


def predict(system: DescribedModel, loop: SplitLoop, request: LimitCycles) -> Prediction:
    """Return all crossings of a loop in the band.

    Args:
        system: stays open.
        loop: of it.
        request: band, amplitudes, where blocks are measured.

    Raises:
        InputError: a block must be measured, and there are no amplitudes to measure it at.
    """
    known = [block or formula for block, formula in zip(loop.blocks, loop.formulas, strict=True)]
    missing = [p.component for p, b in zip(loop.every, known, strict=True) if b is None]
    if missing and request.amplitudes is None:
        raise InputError(
            f"{system.name}: block {', '.join(missing)} is not static and must be measured; "
            "give the lowest and the highest amplitude and frequency: `amplitudes` and `band`"
        )
    names = ", ".join(p.component for p in loop.every)
    name, band, amplitudes = f"{system.name}: loop through {names}", request.band, request.amplitudes
    if len(loop.every) > 1:
        return _several(system, loop, request, name)
    if known[0] is not None:
        curve = nyquist(loop.part, known[0], band=band, amplitudes=amplitudes or AMPLITUDES, name=name)
        return Prediction(loop, curve, None)
    with only_block(system, loop.ports, centre=loop.centre) as alone:
        table = _measured(alone, request, names)
        grid = np.geomspace(*(amplitudes or AMPLITUDES), 8 * _AMPLITUDES)
        curve = nyquist(loop.part, table, band=band, amplitudes=grid, name=names)
        crossings = [_closer(alone, loop.part, c, request, names) for c in curve.crossings]
    return Prediction(loop, replace(curve, crossings=tuple(crossings)), None)


def _several(system: DescribedModel, loop: SplitLoop, request: LimitCycles, name: str) -> Prediction:
    blocks = ", ".join(p.component for p in loop.every)
    many = ManyBlocks(loop.whole, _gains(system, loop, request), name=blocks)
    if loop.moving:
        note = f"the start is not at rest, so nothing is predicted for {blocks} together; give a point at rest (`at`)"
        return Prediction(loop, nyquist(many.part, band=request.band, name=name), many, (note,))
    low, high = request.amplitudes or AMPLITUDES
    count = max(2, round(_PER_DECADE * np.log10(high / low))) + 1
    curve = nyquist(many.part, many, band=request.band, amplitudes=np.geomspace(low, high, count), name=name)
    return Prediction(loop, curve, many)


def _gains(system: DescribedModel, loop: SplitLoop, request: LimitCycles) -> list[Gain]:
    """Return N of each block, measured where it has a memory."""
    result: list[Gain] = []
    known = zip(loop.every, loop.blocks, loop.formulas, loop.centres, strict=True)
    for ports, block, formula, centre in known:
        if (closed := block or formula) is not None:
            result.append(tabulated(closed))
            continue
        with only_block(system, ports, centre=centre) as alone:
            result.append(_measured(alone, request, ports.component).gains)
    return result


# -- a block with a memory of its own: its describing function is measured where it matters -------


def _measured(block: DescribedModel, request: LimitCycles, name: str) -> DescribedBlock:
    """Return a block, with the input v and the output w, whose N(A, f) is measured over a grid."""
    amplitudes = np.geomspace(*(request.amplitudes or AMPLITUDES), _AMPLITUDES)
    return _table(block, amplitudes, np.geomspace(*request.band, _FREQUENCIES), request, name)


def _table(
    block: DescribedModel, amplitudes: Floats, frequencies: Floats, request: LimitCycles, name: str
) -> DescribedBlock:
    response = nfr(block, "v", "w", frequencies, amplitudes, errcrit=_ERRCRIT, workers=request.workers)
    return MeasuredBlock(response, name=name)


def _closer(block: DescribedModel, part: LinearPart, c: Crossing, request: LimitCycles, name: str) -> Crossing:
    """Return a crossing found again with the block measured around it."""
    if c.amplitude is None:
        return c
    around = np.array([1.0 / _NEAR_AMPLITUDE, 1.0, _NEAR_AMPLITUDE])
    beside = np.array([1.0 / _NEAR_FREQUENCY, 1.0, _NEAR_FREQUENCY])
    try:
        table = _table(block, c.amplitude * around, c.frequency_hz * beside, request, name)
    except InputError:
        return c
    band = (c.frequency_hz / _NEAR_FREQUENCY, c.frequency_hz * _NEAR_FREQUENCY)
    amplitudes = np.geomspace(c.amplitude / _NEAR_AMPLITUDE, c.amplitude * _NEAR_AMPLITUDE, 24)
    again = [x for x in nyquist(part, table, band=band, amplitudes=amplitudes).crossings if x.amplitude is not None]
    return min(again, key=lambda x: abs(x.frequency_hz - c.frequency_hz)) if again else c
