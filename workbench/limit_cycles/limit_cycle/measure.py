"""Crossings of a block with a memory of its own: its describing function is measured where it matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.loops.describing.base import Block
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.nyquist.nyquist import nyquist
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.model.described_model import DescribedModel
from workbench.response.nfr.request import nfr

__all__ = ["measured_crossings", "measured_table"]

_AMPLITUDES, _FREQUENCIES = 10, 12
_ERRCRIT = 0.005
_NEAR_AMPLITUDE, _NEAR_FREQUENCY = 1.1, 1.05


def measured_crossings(
    block: DescribedModel,
    part: LinearPart,
    *,
    amplitudes: tuple[float, float],
    band: tuple[float, float],
    name: str,
    workers: Workers | None,
) -> NyquistResult:
    """Return all crossings of L with −1/N(A, f), N measured over a grid and again close to each crossing.

    Args:
        block: with the input `v` and the output `w`.
        part: L.
        amplitudes: lowest and highest.
        band: lowest and highest frequency [Hz].
        name: of the block.
        workers: where it is measured.

    Raises:
        InputError: a point of the grid cannot be measured.
    """
    table = measured_table(block, amplitudes=amplitudes, band=band, name=name, workers=workers)
    found = nyquist(part, table, band=band, amplitudes=np.geomspace(*amplitudes, 8 * _AMPLITUDES), name=name)
    crossings = [_closer(block, part, c, name, workers) if c.amplitude else c for c in found.crossings]
    return replace(found, crossings=tuple(crossings))


def measured_table(
    block: DescribedModel,
    *,
    amplitudes: tuple[float, float],
    band: tuple[float, float],
    name: str,
    workers: Workers | None,
) -> Block:
    """Return a block whose N(A, f) is measured over a grid.

    Args:
        block: with the input `v` and the output `w`.
        amplitudes: lowest and highest.
        band: lowest and highest frequency [Hz].
        name: of the block.
        workers: where it is measured.

    Raises:
        InputError: a point of the grid cannot be measured.
    """
    grid = np.geomspace(*amplitudes, _AMPLITUDES), np.geomspace(*band, _FREQUENCIES)
    return _table(block, *grid, name=name, workers=workers)


def _table(
    block: DescribedModel, amplitudes: Floats, frequencies: Floats, *, name: str, workers: Workers | None
) -> Block:
    response = nfr(block, "v", "w", frequencies, amplitudes, errcrit=_ERRCRIT, workers=workers)
    return MeasuredBlock(response, name=name)


def _closer(block: DescribedModel, part: LinearPart, c: Crossing, name: str, workers: Workers | None) -> Crossing:
    """Return a crossing found again with the block measured around it."""
    if c.amplitude is None:
        return c
    around = np.array([1.0 / _NEAR_AMPLITUDE, 1.0, _NEAR_AMPLITUDE])
    beside = np.array([1.0 / _NEAR_FREQUENCY, 1.0, _NEAR_FREQUENCY])
    try:
        table = _table(block, c.amplitude * around, c.frequency_hz * beside, name=name, workers=workers)
    except InputError:
        return c
    band = (c.frequency_hz / _NEAR_FREQUENCY, c.frequency_hz * _NEAR_FREQUENCY)
    amplitudes = np.geomspace(c.amplitude / _NEAR_AMPLITUDE, c.amplitude * _NEAR_AMPLITUDE, 24)
    again = [x for x in nyquist(part, table, band=band, amplitudes=amplitudes).crossings if x.amplitude is not None]
    return min(again, key=lambda x: abs(x.frequency_hz - c.frequency_hz)) if again else c
