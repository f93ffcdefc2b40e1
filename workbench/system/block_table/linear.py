"""Blocks that are linear: transfer functions, lead–lag, notch, sampled ones; and delays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.system.block_table.base import Block, BlockStateSpace, Values, ordered

__all__ = [
    "PADE",
    "PAST",
    "Biquad",
    "Delay",
    "DelayBlock",
    "DiscreteTransfer",
    "LeadLag",
    "Notch",
    "TransferFunction",
    "VariableDelay",
    "ZeroOrderHold",
    "realised",
]

_DYNAMIC = "dynamic"
_SAMPLED = "sampled"
_DELAYS = "delays"
PAST = "Input before the start; left out: what it is at the start."
PADE = "Order of the Padé approximation in linear models."


def realised(numerator: Sequence[float], denominator: Sequence[float], dt: float = 0.0) -> BlockStateSpace:
    """Return a transfer function as matrices, highest power first.

    Args:
        numerator: coefficients.
        denominator: coefficients.
        dt: sample period [s]; 0: continuous.

    Raises:
        InputError: it has no realisation.
    """
    if not len(numerator):
        raise InputError("numerator holds no coefficient")
    above, below = np.trim_zeros(np.array(numerator), "f"), np.trim_zeros(np.array(denominator), "f")
    if not len(below):
        raise InputError("denominator holds no coefficient but 0")
    if len(above) > len(below):
        raise InputError("the numerator's degree exceeds the denominator's; such a system cannot be simulated")
    if len(below) == 1:
        gain = float(above[0] / below[0]) if len(above) else 0.0
        return BlockStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[gain]]), dt)
    # Controller canonical form; scipy.signal has it, too, and is slow to import, which every command would wait for.
    n = len(below) - 1
    above = np.concatenate([np.zeros(len(below) - len(above)), above]) / below[0]
    below = below[1:] / below[0]
    a = np.vstack([-below, np.eye(n - 1, n)])
    return BlockStateSpace(a, np.eye(n, 1), (above[1:] - above[0] * below)[None], above[:1, None], dt)


class _LinearBlock(Block):
    def check(self) -> None:
        self.matrices()

    @property
    def states(self) -> tuple[str, ...]:
        result = self.matrices()
        return tuple(f"x{k}" for k in range(1, len(result.a) + 1)) if result is not None else ()


class TransferFunction(_LinearBlock):
    """Transfer function in s."""

    kind = "transfer_function"
    group = _DYNAMIC
    equations = "y = (numerator(s) / denominator(s)) u"
    sample: ClassVar[Mapping[str, Any]] = {"numerator": [1.0], "denominator": [0.1, 1.0]}
    numerator: Values = option("Coefficients of the numerator, highest power of s first.")
    denominator: Values = option("Coefficients of the denominator, highest power of s first.")

    def matrices(self) -> BlockStateSpace:
        return realised(self.numerator, self.denominator)


class LeadLag(_LinearBlock):
    """Lead–lag: raises or lowers the phase between two corner frequencies."""

    kind = "lead_lag"
    group = _DYNAMIC
    equations = "y = gain (lead s + 1) / (lag s + 1) u"
    gain: float = option("Gain at low frequencies.", default=1.0)
    lead: float = option("Time constant of the numerator.", default=0.1, unit="s")
    lag: float = option("Time constant of the denominator.", default=0.01, unit="s", positive=True)

    def matrices(self) -> BlockStateSpace:
        return realised([self.gain * self.lead, self.gain], [self.lag, 1.0])


class Notch(_LinearBlock):
    """Notch filter: lowers the gain around one frequency."""

    kind = "notch"
    group = _DYNAMIC
    equations = (
        "w = 2π frequency\ny = (s² + 2 depth · width · w s + w²) / (s² + 2 width · w s + w²) u, the gain at w is depth"
    )
    frequency: float = option("Middle of the notch.", default=1.0, unit="Hz", positive=True)
    width: float = option("Damping ratio of the denominator.", default=0.5, positive=True)
    depth: float = option("Gain in the middle.", default=0.0, least=0.0)

    def matrices(self) -> BlockStateSpace:
        w = 2.0 * math.pi * self.frequency
        middle = 2.0 * self.width * w
        return realised([1.0, self.depth * middle, w * w], [1.0, middle, w * w])


class Biquad(_LinearBlock):
    """Two zeros and two poles by frequency and damping: a stable transfer function of second order, for tuning."""

    kind = "biquad"
    group = _DYNAMIC
    equations = (
        "z = 2π zero_frequency, p = 2π pole_frequency\n"
        "y = gain (s²/z² + 2 zero_damping s/z + 1) / (s²/p² + 2 pole_damping s/p + 1) u"
    )
    gain: float = option("Gain at low frequencies.", default=1.0)
    zero_frequency: float = option("Natural frequency of the zeros.", default=1.0, unit="Hz", positive=True)
    zero_damping: float = option("Damping ratio of the zeros; negative: right of the axis.", default=0.5)
    pole_frequency: float = option("Natural frequency of the poles.", default=10.0, unit="Hz", positive=True)
    pole_damping: float = option("Damping ratio of the poles.", default=0.7, positive=True)

    def matrices(self) -> BlockStateSpace:
        z, p = 2.0 * math.pi * self.zero_frequency, 2.0 * math.pi * self.pole_frequency
        above = [self.gain * (p / z) ** 2, 2.0 * self.gain * self.zero_damping * p * p / z, self.gain * p * p]
        return realised(above, [1.0, 2.0 * self.pole_damping * p, p * p])


class ZeroOrderHold(_LinearBlock):
    """Sampler with zero-order hold: the input at the last multiple of the period."""

    kind = "zero_order_hold"
    group = _SAMPLED
    equations = "y = u at the whole multiples of the period, and stands between them"
    period: float = option("Sample period.", default=0.1, unit="s", positive=True)

    def matrices(self) -> BlockStateSpace:
        return realised([1.0], [1.0], self.period)


class DiscreteTransfer(_LinearBlock):
    """Sampled transfer function in z, with a hold at its output."""

    kind = "discrete_transfer_function"
    group = _SAMPLED
    equations = "y = (numerator(z) / denominator(z)) u at the whole multiples of the period"
    sample: ClassVar[Mapping[str, Any]] = {"numerator": [0.5], "denominator": [1.0, -0.5]}
    numerator: Values = option("Coefficients of the numerator, highest power of z first.")
    denominator: Values = option("Coefficients of the denominator, highest power of z first.")
    period: float = option("Sample period.", default=0.1, unit="s", positive=True)

    def matrices(self) -> BlockStateSpace:
        return realised(self.numerator, self.denominator, self.period)


class DelayBlock(Block):
    """A delay, and what is linear behind it.

    Obligations of a subclass: options `past` and `pade`, and `times`.
    """

    group = _DELAYS
    number = "delay"
    past: float | None
    pade: int

    @property
    def times(self) -> tuple[float, float]:
        """Longest and shortest delay [s]."""
        raise NotImplementedError

    def filter(self) -> BlockStateSpace:
        """Return the linear system that the delayed input drives, of two states at most."""
        return realised([1.0], [1.0])

    def check(self) -> None:
        self.filter()

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(f"x{k}" for k in range(1, len(self.filter().a) + 1))

    def packed(self) -> tuple[float, ...]:
        past = (0.0, 0.0) if self.past is None else (1.0, self.past)
        return *self.times, *past, *(float(x) for m in self.filter()[:4] for x in m.ravel())

    def first_mode(self) -> tuple[float, ...]:
        return (-math.inf,)


class Delay(DelayBlock):
    """Transport delay.

    The input is kept at the solver's steps, with a polynomial of third order between them, whose error is about 1e-6
    of the largest input, and which never reaches across an event. A jump comes out at an event of its own. The
    solver's steps are no longer than the delay.
    """

    kind = "delay"
    equations = "y(t) = u(t − delay); before that past, or u at the start where no past is given"
    delay: float = option("Delay.", default=0.1, unit="s", positive=True)
    past: float | None = option(PAST, default=None)
    pade: int = option(PADE, default=4, least=1, below=21)

    @property
    def times(self) -> tuple[float, float]:
        return self.delay, self.delay


class VariableDelay(DelayBlock):
    """Transport delay whose time is a second input, u2.

    It must not grow faster than time passes. See `delay`.
    """

    kind = "variable_delay"
    equations = "y(t) = u1(t − min(max(u2, smallest), largest))"
    largest: float = option("Largest delay.", default=1.0, unit="s", positive=True)
    smallest: float = option("Smallest delay.", default=0.01, unit="s", positive=True)
    past: float | None = option(PAST, default=None)
    pade: int = option(PADE, default=4, least=1, below=21)

    def check(self) -> None:
        ordered(self.smallest, self.largest, ("smallest", "largest"))

    @property
    def inputs(self) -> tuple[str, ...]:
        return "u1", "u2"

    @property
    def indicators(self) -> int:
        return 1

    @property
    def times(self) -> tuple[float, float]:
        return self.largest, self.smallest
