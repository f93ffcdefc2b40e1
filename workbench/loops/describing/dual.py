"""Dual-input describing functions: what a block makes of a sine beside a bias, or beside another sine."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.fourier import coefficients
from workbench.loops.describing.static import StaticBlock

__all__ = ["beside_sine", "gain_beside_bias"]


def gain_beside_bias(
    block: DescribedBlock, amplitude: float, bias: float, *, frequency: float = 1.0
) -> tuple[float, complex]:
    """Return the mean of a block's output for bias + amplitude · sin θ, and the describing function of that sine.

    With f the block about its operating point, the mean is (1/2π) ∫ f(B + A sin θ) dθ, and N = Y₁/(−jA) of the
    fundamental Y₁. A loop oscillates about a bias where both balances hold; the bias is not free then.

    Args:
        block: any whose `answer` takes a mean, so not one that was measured.
        amplitude: of the sine, above 0.
        bias: mean of the input.
        frequency: [Hz]; without effect where the block does not depend on it.

    Raises:
        InputError: an amplitude that is not above 0.

    Source: A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, 1968, chapter
    6.

    Examples:
        A relay beside half the amplitude as a bias gives a third of its level on average.

        >>> mean, gain = wb.gain_beside_bias(wb.standard_block("relay"), 2.0, 1.0)
        >>> print(f"{mean:.6f} {gain.real:.6f}")
        0.333333 0.551329
    """
    _check(amplitude)
    result = block.answer(np.array([bias, -1j * amplitude]), frequency, 1)
    return float(result[0].real), complex(result[1] / (-1j * amplitude))


def beside_sine(block: DescribedBlock, amplitude: float) -> StaticBlock:
    """Return the block as another signal sees it beside a sine of a fixed amplitude: averaged over that sine.

    f̄(v) = (1/2π) ∫ f(v + B sin φ) dφ: the mean over the sine, whose frequency has no common multiple with the other's
    that matters. Its describing function is the dual-input one, N_A(A, B); with a dither of high frequency it is the
    block that the loop sees, in `nyquist` or wherever a block can stand.

    Args:
        block: static.
        amplitude: of the sine that is averaged over, above 0.

    Raises:
        InputError: an amplitude that is not above 0, or a block with a memory.

    Source: A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, 1968, chapter
    5.

    Examples:
        v³ beside a sine of amplitude B is v³ + 3/2 B² v: its gain is 3/4 A² + 3/2 B².

        >>> dithered = wb.beside_sine(wb.standard_block("cubic"), 2.0)
        >>> print(f"{dithered.gain(1.0).real:.6f}")
        6.750000
    """
    _check(amplitude)
    if not isinstance(block, StaticBlock):
        raise InputError(f"block {block.name}: a mean over a sine is that of a static block, and this one is not")

    def averaged(v: Floats) -> Floats:
        return np.array([_mean(block, x, amplitude) for x in v.tolist()], dtype=np.float64)

    reach = amplitude * 1e3
    own = block.levels_within(reach)
    levels = np.concatenate([own - amplitude, own + amplitude])
    return StaticBlock(averaged, name=f"{block.name} beside a sine of {amplitude:g}", levels=levels.tolist())


def _mean(block: StaticBlock, bias: float, amplitude: float) -> float:
    levels = block.levels_within(abs(bias) + amplitude)
    return float(coefficients(block.static, np.array([bias, -1j * amplitude]), levels, 0)[0].real)


def _check(amplitude: float) -> None:
    if not amplitude > 0.0:
        raise InputError(f"amplitude {amplitude:g} is not above 0")
