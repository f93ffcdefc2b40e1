"""The worst case by search: differential evolution over the whole envelope, then a local search."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, minimize
from scipy.stats import qmc

from workbench.core.values.arrays import Floats

__all__ = ["Searched", "search"]

# Margins at places of the unit cube, shape (m, d) → (m,); NaN: nothing was measured there.
Margins = Callable[[Floats], Floats]

_LOCAL = 0.3  # of the evaluations are for the local search
_LEAST = 5  # members of a population, as scipy needs
_GENERATIONS = 6  # at least, where the evaluations suffice
_FIRST = 0.04  # size of the local search's first simplex, of the range
_BENIGN = 1.0  # what a failed point is worth: this much more than the best known margin


@dataclass(frozen=True, kw_only=True)
class Searched:
    """What a search found.

    Attributes:
        place: of the smallest margin, in the unit cube, shape (d,).
        margin: there; inf: nothing was measured anywhere.
        evaluations: how many places were looked at, each once.
        failed: at how many of them nothing was measured.
    """

    place: Floats
    margin: float
    evaluations: int
    failed: int


class _EnoughError(Exception):
    """The evaluations are spent."""


class _Counted:
    """Margins with a limit on their number; each place is looked at once."""

    def __init__(self, margins: Margins, limit: int) -> None:
        self._margins, self._limit = margins, limit
        self.known: dict[bytes, float] = {}
        self.place, self.margin = np.zeros(0), math.inf
        self.failed = 0

    def remember(self, places: Floats, margins: Floats) -> None:
        """Take what is known already; it is not counted."""
        for place, margin in zip(places, margins, strict=True):
            self.known[place.tobytes()] = float(margin)
            if margin < self.margin:
                self.place, self.margin = place.copy(), float(margin)

    def __call__(self, places: Floats) -> Floats:
        """Return margins, with a benign number in place of NaN."""
        places = np.clip(places, 0.0, 1.0)
        new = list({p.tobytes(): p for p in places if p.tobytes() not in self.known}.values())
        if len(new) > self._limit:
            raise _EnoughError
        if new:
            self._limit -= len(new)
            result = self._margins(np.array(new))
            self.failed += int(np.isnan(result).sum())
            self.remember(np.array(new), result)
        finite = [m for m in self.known.values() if math.isfinite(m)]
        benign = (max(finite) if finite else 0.0) + _BENIGN
        result = np.array([self.known[p.tobytes()] for p in places])
        return np.where(np.isfinite(result), result, benign)


def search(margins: Margins, dimensions: int, *, known: tuple[Floats, Floats], evaluations: int, seed: int) -> Searched:
    """Return the smallest margin that a search finds; it is never larger than the smallest known one.

    Differential evolution begins at the worst of the known places and a Latin hypercube; Nelder and Mead's method goes
    on from the best place with the last part of the evaluations. Neither proves that there is no smaller margin: what
    is found bounds the true worst case from one side.

    Args:
        margins: of places.
        dimensions: of the cube.
        known: places and margins known already, shapes (k, d) and (k,).
        evaluations: most places that are looked at.
        seed: the same seed and margins give the same search.

    Source: R. Storn, K. Price, J. Global Optimization 11 (1997) 341-359; J. A. Nelder, R. Mead, Computer J. 7 (1965)
    308-313, by `scipy.optimize`.
    """
    counted = _Counted(margins, evaluations)
    counted.remember(*known)
    members = max(_LEAST, min(15 * dimensions, evaluations // (_GENERATIONS + 1)))
    budget = evaluations - int(_LOCAL * evaluations)
    try:
        generations = budget // members - 1
        if generations >= 1:
            differential_evolution(
                lambda x: counted(x.T),
                [(0.0, 1.0)] * dimensions,
                init=_first(known, members, dimensions, seed),
                maxiter=generations,
                tol=0.0,
                polish=False,
                vectorized=True,
                updating="deferred",
                seed=seed,
            )
        _local(counted, dimensions)
    except _EnoughError:
        pass
    spent = len(counted.known) - len({p.tobytes() for p in known[0]})
    return Searched(place=counted.place, margin=counted.margin, evaluations=spent, failed=counted.failed)


def _first(known: tuple[Floats, Floats], members: int, dimensions: int, seed: int) -> Floats:
    """Return the first population: the worst known places, half of it at most, and a Latin hypercube."""
    places, margins = known
    order = [k for k in np.argsort(margins) if math.isfinite(margins[k])][: members // 2]
    spread = qmc.LatinHypercube(dimensions, seed=seed).random(members - len(order))
    return np.vstack([places[order].reshape(-1, dimensions), spread])


def _local(counted: _Counted, dimensions: int) -> None:
    if not len(counted.place):
        return
    begin = counted.place
    inward = np.where(begin > 0.5, -_FIRST, _FIRST)
    simplex = np.vstack([begin, *(begin + np.eye(dimensions)[k] * inward[k] for k in range(dimensions))])
    minimize(
        lambda x: float(counted(np.atleast_2d(x))[0]),
        begin,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * dimensions,
        options={"initial_simplex": simplex, "maxfev": 1_000_000, "xatol": 1e-6, "fatol": 0.0},
    )
