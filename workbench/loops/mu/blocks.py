"""The structure of a perturbation: its blocks along the diagonal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex, Floats

__all__ = ["MuBlock", "places", "scaled"]


@dataclass(frozen=True, kw_only=True)
class MuBlock:
    """One block of a perturbation Δ, of norm 1 at most.

    Attributes:
        size: of its rows and columns.
        real: it is δ·I with one real number δ; else it is any complex matrix.
        varies: its size grows with the level that is sought; else it stays 1.
    """

    size: int
    real: bool = False
    varies: bool = True


def places(blocks: Sequence[MuBlock]) -> Iterator[tuple[MuBlock, slice]]:
    """Yield each block with its place on the diagonal.

    Args:
        blocks: the structure.
    """
    begin = 0
    for block in blocks:
        yield block, slice(begin, begin + block.size)
        begin += block.size


def scaled(matrix: Complex, blocks: Sequence[MuBlock], level: float) -> Complex:
    """Return M·S with the columns of the blocks that vary divided by a level, as if these were larger by 1/level.

    Args:
        matrix: M, or any matrix with its columns, shape (…, n).
        blocks: the structure.
        level: of those that vary.
    """
    return np.asarray(matrix * columns(blocks, level))


def columns(blocks: Sequence[MuBlock], level: float) -> Floats:
    """Return the factor of each column, shape (n,)."""
    return np.concatenate([np.full(b.size, 1.0 / level if b.varies else 1.0) for b in blocks] or [np.zeros(0)])
