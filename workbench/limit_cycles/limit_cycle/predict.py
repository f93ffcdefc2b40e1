"""Where describing functions predict limit cycles of a loop: its crossings, and the motions that belong to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError
from workbench.limit_cycles.limit_cycle.cut import SplitLoop, only_block
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle
from workbench.limit_cycles.limit_cycle.measure import measured_crossings, measured_table
from workbench.limit_cycles.limit_cycle.request import LimitCycles
from workbench.limit_cycles.limit_cycle.several_blocks import Gain, ManyBlocks, tabulated
from workbench.loops.nyquist.nyquist import AMPLITUDES, nyquist
from workbench.loops.nyquist.result import NyquistResult
from workbench.model.described_model import DescribedModel

__all__ = ["Prediction", "predict"]

_PER_DECADE = 10  # amplitudes of the first of several blocks that are looked at


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


def predict(system: DescribedModel, loop: SplitLoop, asked: LimitCycles) -> Prediction:
    """Return all crossings of a loop in the band.

    Args:
        system: stays open.
        loop: of it.
        asked: band, amplitudes, where blocks are measured.

    Raises:
        InputError: a block must be measured, and there are no amplitudes to measure it at.
    """
    known = [block or formula for block, formula in zip(loop.blocks, loop.formulas, strict=True)]
    missing = [p.component for p, b in zip(loop.every, known, strict=True) if b is None]
    if missing and asked.amplitudes is None:
        raise InputError(
            f"{system.name}: block {', '.join(missing)} has a memory of its own and must be measured; "
            "give the lowest and the highest amplitude (--amplitude LO:HI) and a band (--band LO:HI)"
        )
    names = ", ".join(p.component for p in loop.every)
    name, band, amplitudes = f"{system.name}: loop through {names}", asked.band, asked.amplitudes
    if len(loop.every) > 1:
        return _several(system, loop, asked, name)
    if known[0] is not None:
        curve = nyquist(loop.part, known[0], band=band, amplitudes=amplitudes or AMPLITUDES, name=name)
        return Prediction(loop, curve, None)
    with only_block(system, loop.ports, centre=loop.centre) as alone:
        curve = measured_crossings(
            alone, loop.part, amplitudes=amplitudes or AMPLITUDES, band=band, name=names, workers=asked.workers
        )
    return Prediction(loop, curve, None)


def _several(system: DescribedModel, loop: SplitLoop, asked: LimitCycles, name: str) -> Prediction:
    blocks = ", ".join(p.component for p in loop.every)
    many = ManyBlocks(loop.whole, _gains(system, loop, asked), name=blocks)
    if loop.moving:
        note = f"the start is not at rest, so nothing is predicted for {blocks} together; give --at a point at rest"
        return Prediction(loop, nyquist(many.part, band=asked.band, name=name), many, (note,))
    low, high = asked.amplitudes or AMPLITUDES
    count = max(2, round(_PER_DECADE * np.log10(high / low))) + 1
    curve = nyquist(many.part, many, band=asked.band, amplitudes=np.geomspace(low, high, count), name=name)
    return Prediction(loop, curve, many)


def _gains(system: DescribedModel, loop: SplitLoop, asked: LimitCycles) -> list[Gain]:
    """Return N of each block, measured where it has a memory."""
    found: list[Gain] = []
    known = zip(loop.every, loop.blocks, loop.formulas, loop.centres, strict=True)
    for ports, block, formula, centre in known:
        if (closed := block or formula) is not None:
            found.append(tabulated(closed))
            continue
        with only_block(system, ports, centre=centre) as alone:
            table = measured_table(
                alone, amplitudes=asked.amplitudes or AMPLITUDES, band=asked.band, name=ports.component,
                workers=asked.workers,
            )  # fmt: skip
        found.append(table.gains)
    return found
