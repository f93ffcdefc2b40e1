"""The gain that settles fastest: smallest value of a polynomial through measured settling times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Polynomial

from workbench.limit_cycles.feedback.result import GainRun, Optimum

__all__ = ["optimum_of"]

_NOTHING = 1e-11  # of the largest coefficient


def optimum_of(runs: Sequence[GainRun], threshold: float, order: int) -> Optimum:
    """Return the gain at which a polynomial through the settling times is smallest.

    Args:
        runs: rising in the gain.
        threshold: one that all of them know.
        order: of the polynomial.
    """
    times = [(r.gain, r.settled[threshold]) for r in runs]
    found = [(gain, seconds) for gain, seconds in times if seconds is not None]
    missing = len(runs) - len(found)
    fastest: tuple[float | None, float | None] = min(found, key=lambda p: p[1]) if found else (None, None)
    if len(found) < order + 1:
        return Optimum(
            threshold=threshold, gain=None, seconds=None, at_end=False, fastest_gain=fastest[0],
            fastest_seconds=fastest[1], unsettled=missing,
        )  # fmt: skip
    g, t = np.array(found).T
    fit = Polynomial.fit(g, t, order)
    slope = fit.deriv()
    # Over its domain scaled to −1 … 1 a coefficient so small is rounding; its far roots would spoil the near ones.
    slope = slope.trim(_NOTHING * float(np.abs(slope.coef).max()))
    inner = [float(r.real) for r in slope.roots() if abs(r.imag) < 1e-9 and g[0] < r.real < g[-1]]
    best = min([float(g[0]), float(g[-1]), *inner], key=lambda x: float(fit(x)))
    return Optimum(
        threshold=threshold,
        gain=best,
        seconds=float(fit(best)),
        at_end=best not in inner,
        fastest_gain=fastest[0],
        fastest_seconds=fastest[1],
        unsettled=missing,
        coefficients=tuple(fit.convert().coef.tolist()),
        misfit=float(np.sqrt(np.mean((fit(g) - t) ** 2))),
    )
