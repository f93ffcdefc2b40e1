"""What a nonlinear block is to the analyses of loops."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from workbench.core.values.arrays import Complex, Floats

__all__ = ["HARMONICS", "DescribedBlock"]


HARMONICS = 7


class DescribedBlock(ABC):
    """One input, one output; what it answers to a periodic input is periodic with the same period.

    Fourier coefficients are those of x(θ) = X[0] + Re Σ X[k] e^{jkθ}, so that A sin θ has X[1] = −jA.

    Obligations of a subclass:
      1. `answer` takes the coefficients of the input and returns those of the settled output.
      2. `real` says that the describing function has no imaginary part (no memory).
      3. `frequency_dependent` says that `answer` depends on the frequency.
      4. `static` returns the output at given inputs where there is no memory, else raises NotImplementedError.

    Attributes:
        name: for tables and pictures.
        real: see 2.
        frequency_dependent: see 3.
        centre: input at the operating point, from which inputs are counted.
        accuracy: relative accuracy of an answer; 0: rounding.
    """

    name: str
    real: bool = True
    frequency_dependent: bool = False
    accuracy: float = 0.0
    centre: float = 0.0

    @abstractmethod
    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        """Return the coefficients 0 … count of the output, shape (count + 1,).

        Args:
            v: coefficients of the input, shape (m,).
            frequency: frequency of the fundamental [Hz].
            count: highest harmonic.
        """

    def static(self, v: Floats) -> Floats:
        """Return the output of a block without memory, shape (n,).

        Args:
            v: inputs, shape (n,).
        """
        raise NotImplementedError

    def harmonics(self, amplitude: float, frequency: float = 1.0, count: int = HARMONICS) -> Complex:
        """Return the coefficients of the output for amplitude · sin θ, shape (count + 1,).

        Args:
            amplitude: amplitude of the sine.
            frequency: [Hz]; without effect where the block does not depend on it.
            count: highest harmonic.
        """
        return self.answer(np.array([0.0, -1j * amplitude]), frequency, count)

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        """Return the describing function N(amplitude): fundamental of the output over that of the input.

        Args:
            amplitude: amplitude of the sine.
            frequency: [Hz]; without effect where the block does not depend on it.
        """
        result = complex(self.harmonics(amplitude, frequency, 1)[1] / (-1j * amplitude))
        return complex(result.real) if self.real else result

    def gains(self, amplitudes: Floats, frequencies: Floats) -> Complex:
        """Return N, in the shape to which amplitudes and frequencies are broadcast.

        Args:
            amplitudes: of the sine at the block's input.
            frequencies: [Hz].
        """
        both = np.broadcast(amplitudes, frequencies)
        return np.array([self.gain(float(a), float(f)) for a, f in both], dtype=np.complex128).reshape(both.shape)

    def negated(self) -> DescribedBlock:
        """Return the block with the other sign at its output."""
        return Negated(self)


class Negated(DescribedBlock):
    """A block with the other sign at its output.

    Args:
        block: as it was.
    """

    def __init__(self, block: DescribedBlock) -> None:
        self.name, self.real, self.frequency_dependent = block.name, block.real, block.frequency_dependent
        self.centre = block.centre
        self._block = block

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        return -self._block.answer(v, frequency, count)

    def static(self, v: Floats) -> Floats:
        return -self._block.static(v)

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        return -self._block.gain(amplitude, frequency)

    def negated(self) -> DescribedBlock:
        return self._block
