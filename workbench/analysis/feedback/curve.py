"""G(jω) over frequencies dense enough for a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.analysis.nyquist.grid import adaptive_grid
from workbench.core.linear import Complex, LinearPart
from workbench.core.poles import natural_frequency_hz
from workbench.session.base import Floats

__all__ = ["curve"]

_POINTS = 2000


def curve(plant: LinearPart, frequencies: Sequence[float]) -> tuple[Floats, Complex]:
    """Return frequencies [Hz] and G there; a gap where G is infinite.

    Args:
        plant: G.
        frequencies: that must lie inside [Hz].
    """
    sizes = natural_frequency_hz(plant.continuous_poles)
    every = np.array([f for f in (*sizes.tolist(), *frequencies) if 0.0 < f < np.inf])
    every = every[every > 1e-9 * every.max(initial=0.0)]
    if not len(every):
        every = np.array([1.0])
    if plant.dt > 0.0:
        f = np.linspace(0.0, plant.highest_hz, _POINTS + 1)[1:]
        return f, plant.response(f)
    band = (float(every.min()) * 0.1, float(every.max()) * 10.0)
    f, value = adaptive_grid(plant, band)
    between = 0.5 * (f[1:] + f[:-1])  # a picture shows angles of 3°
    order = np.argsort(np.concatenate([f, between]), kind="stable")
    return np.concatenate([f, between])[order], np.concatenate([value, plant.response(between)])[order]
