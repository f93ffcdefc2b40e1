"""Poles that a feedback does not move: not reached by its input, or not seen by its output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.linear import LinearPart
from workbench.core.poles import growth_rates

__all__ = ["fixed_modes"]

_STAYS = 1e-7  # relative movement over the gains that counts as none
_BORDER = 1e-8


def fixed_modes(plant: LinearPart, gains: Sequence[float]) -> tuple[complex, ...]:
    """Return the open-loop poles that do not decay and that no gain moves [1/s] (in z if sampled); upper half-plane.

    With one of them no gain stabilises the system. Poles that move by less than 1e-7 of their size count as fixed: so
    weakly coupled a pole asks for gains that nobody would use.

    Args:
        plant: G.
        gains: some, from all intervals between crossings.
    """
    open_loop = plant.poles
    size = np.ones(len(open_loop)) if plant.dt > 0.0 else np.maximum(np.abs(open_loop), 1e-6)
    border = _BORDER / plant.dt if plant.dt > 0.0 else _BORDER * size
    candidates = [
        (complex(p), float(s))
        for p, s, rate, near in zip(
            open_loop, size, growth_rates(open_loop, plant.dt), np.broadcast_to(border, size.shape), strict=True
        )
        if p.imag >= 0.0 and rate > -near
    ]
    if not candidates:
        return ()
    moved = [plant.poles_at(g) for g in gains if plant.solvable(g) and g != 0.0]
    fixed = [p for p, s in candidates if all(np.abs(m - p).min() < _STAYS * s for m in moved)]
    return tuple(sorted(fixed, key=lambda p: (p.imag, p.real)))
