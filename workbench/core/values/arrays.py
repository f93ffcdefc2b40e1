"""Arrays of numbers: their types, and complex ones as real ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Complex", "Floats", "as_reals"]

Complex = NDArray[np.complex128]
Floats = NDArray[np.float64]


def as_reals(values: NDArray[np.complexfloating[Any, Any]]) -> Floats:
    """Return the real parts, then the imaginary parts, shape (2 k,)."""
    return np.concatenate([values.real, values.imag])
