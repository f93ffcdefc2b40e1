"""Random-phase multisines on full, odd and random-odd grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import FilterDesign, Sequences, SignalPart
from workbench.errors import InputError

__all__ = ["Lines", "RandomPhase", "lines_of"]

Numbers = NDArray[np.intp]

_GROUP = 4  # odd lines of which one is left out


@dataclass(frozen=True, eq=False)
class Lines:
    """Multiples of the fundamental.

    Attributes:
        excited: shape (k,).
        odd: odd ones that are not excited, between the first and the last.
        even: even ones likewise, with 0 < k.
    """

    excited: Numbers
    odd: Numbers
    even: Numbers


def lines_of(kind: str, first: int, last: int, seed: int) -> Lines:
    """Return the lines of a grid.

    Args:
        kind: "all", "odd" or "random-odd".
        first: lowest line.
        last: highest line.
        seed: which lines are left out.

    Raises:
        InputError: fewer than three lines.
    """
    every = np.arange(max(first, 1), last + 1, dtype=np.intp)
    odd, even = every[every % 2 == 1], every[every % 2 == 0]
    if kind == "all":
        excited = every
    else:
        excited = odd
        if kind == "random-odd":
            random = np.random.default_rng(seed)
            groups = [odd[k : k + _GROUP] for k in range(0, len(odd) - _GROUP + 1, _GROUP)]
            gone = [int(random.choice(group)) for group in groups]
            excited = odd[~np.isin(odd, gone)]
    if len(excited) < 3:
        raise InputError(f"the band holds {len(excited)} lines, at least three are needed: widen it")
    return Lines(excited, np.setdiff1d(odd, excited), np.setdiff1d(even, excited))


@dataclass(frozen=True, kw_only=True)
class RandomPhase(FilterDesign):
    """A multisine of equal amplitudes and random phases.

    Attributes:
        rms: root mean square.
        length: samples of a period.
        excited: multiples of the fundamental.
        periods: recorded.
        transient: periods before.
        seed: which phases.
        offset: middle; None: the operating point's input.
    """

    rms: float
    length: int
    excited: tuple[int, ...]
    periods: int
    transient: int
    seed: int
    offset: float | tuple[float, ...] | None = None

    def sequences(self, inputs: int, *, dt: float, samples: int, validation: int) -> Sequences:
        """Return what is played; `samples` and `validation` are those of the design."""
        one = self.period()
        played = np.tile(one, self.transient + self.periods)[:, None]
        f = 1.0 / (self.length * dt)
        return Sequences(
            identification=SignalPart(np.repeat(played, inputs, axis=1), skip=self.transient * self.length),
            validation=None, kind="multisine", period=self.length * dt, clock=None, order=None,
            band=(self.excited[0] * f, self.excited[-1] * f), lines=len(self.excited),
        )  # fmt: skip

    def period(self) -> Floats:
        """Return one period, shape (length,)."""
        random = np.random.default_rng(self.seed)
        spectrum = np.zeros(self.length // 2 + 1, dtype=np.complex128)
        phase = random.uniform(0.0, 2.0 * np.pi, len(self.excited))
        # n lines of amplitude a have the root mean square a √(n/2).
        spectrum[list(self.excited)] = np.exp(1j * phase) * self.rms / np.sqrt(2.0 * len(self.excited)) * self.length
        return np.asarray(np.fft.irfft(spectrum, self.length))
