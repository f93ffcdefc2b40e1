"""Types of arrays of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Complex", "Floats"]

Complex = NDArray[np.complex128]
Floats = NDArray[np.float64]
