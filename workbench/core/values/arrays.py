"""Arrays of numbers: their types, and complex ones as real ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Complex", "Floats", "as_reals", "filtered"]

Complex = NDArray[np.complex128]
Floats = NDArray[np.float64]


def as_reals(values: NDArray[np.complexfloating[Any, Any]]) -> Floats:
    """Return the real parts, then the imaginary parts, shape (2 k,)."""
    return np.concatenate([values.real, values.imag])


def filtered(signals: Floats, taps: Floats) -> Floats:
    """Return Σ taps[i]·s[k − i] of signals, shape (n,) or (n, m), from the first k at which all of it is known.

    Args:
        signals: s.
        taps: shape (t,); t − 1 samples are left out.
    """
    return np.apply_along_axis(np.convolve, 0, signals, taps, "valid")
