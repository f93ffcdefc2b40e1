"""Which plant and which disturbance: models of several structures are refined, and the Bayesian criterion decides.

    N log det Λ + f log N

with Λ the covariance of the one-step prediction's error and f the numbers fitted (Ljung 1999, section 16.4). As every
candidate has a model of its disturbance, the errors are white where the structure has room enough, and the criterion
means what its theory says. The order of the disturbance is first looked for in what the plant leaves of the output; the
order of the plant starts from what the subspaces of the whitened signals show, and goes up or down by one as long as
that is better. In a closed loop the subspaces mislead; there the search begins at order 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.special

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.prediction.innovations import Innovations, errors_of
from workbench.identification.prediction.refine import Refined, refine
from workbench.identification.prediction.start import (
    Plant,
    disturbance,
    realised,
    started,
    whitened,
    with_own,
    with_shared,
)
from workbench.identification.subspace.estimate import estimate
from workbench.identification.subspace.order import cost

__all__ = ["Candidate", "Chosen", "SelectionOptions", "choose", "noise_alone"]

Record = tuple[Floats, Floats]
_MOST_NOISE = 4  # states of the disturbance that auto tries for one output
_IN_A_ROW = 2  # orders of the disturbance without an improvement that end the search
_LONG = 20000  # samples on which choices are made; the whole record is used for the last refinement only
_QUICK = 25  # steps of candidates
_PAIR, _SIGNIFICANT = 2, 0.05  # orders above the chosen one that may change its regions, and at which probability


@dataclass(frozen=True, kw_only=True)
class Candidate(RecordPart):
    """One structure that was tried.

    Attributes:
        order: states of the plant.
        noise_order: states of the disturbance.
        shared: the disturbance has the plant's poles, and no states of its own.
        criterion: Bayesian, smallest is best.
        freedom: numbers fitted.
    """

    order: int
    noise_order: int
    shared: bool
    criterion: float
    freedom: int

    @property
    def structure(self) -> tuple[int, int, bool]:
        """What makes it another candidate."""
        return self.order, self.noise_order, self.shared


@dataclass(frozen=True, eq=False)
class Chosen:
    """The best model, and what else was tried.

    Attributes:
        refined: the model.
        tried: all candidates, in the order in which they were tried, each with the best of its starts.
        agree: probability that data as far from the gains that are held come by chance, where they are right
            (likelihood ratio with the same structure, its gains free); None: none are held, or not known.
        above: a model of a higher order that explains more than chance does, though not as much more as the Bayesian
            criterion asks for; None: the order was given, or there is none.
    """

    refined: Refined
    tried: tuple[Candidate, ...]
    agree: float | None = None
    above: Refined | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class SelectionOptions:
    """What is asked for.

    Attributes:
        order: states of the plant; None: to be found.
        noise: states of the disturbance; None: to be found; "shared": the plant's poles.
        most: largest order.
        feedthrough: D is free.
        stable: the plant is stable.
        closed_loop: the inputs react to the outputs: subspaces of the past and future inputs are biased.
        gains: shape (p, m), steady gains of the plant that are held, not a number where one is free; None: all are.
    """

    order: int | None
    noise: int | str | None
    most: int
    feedthrough: bool
    stable: bool
    closed_loop: bool = False
    gains: Floats | None = None


def choose(record: Record, plants: Sequence[Plant], wish: SelectionOptions) -> Chosen | None:
    """Return the best model of all structures that the wish allows.

    Args:
        record: u (N, m) and y (N, p), of size one.
        plants: models to start from besides, of the order asked for.
        wish: what is asked for.

    Returns:
        None where nothing can be refined.
    """
    u, y = record
    short = (u[:_LONG], y[:_LONG])
    search = _ModelSearch(short, tuple(plants), wish)
    best = search.run()
    if best is None:
        return None
    model = best.model
    # The last steps on the whole record, from near the end.
    final = refine(model, record, stable=wish.stable)
    if final is None:
        return None
    agree = None if wish.gains is None else _agreement(final, record, search)
    above = None if wish.order is not None else search.above(best)
    if above is not None:
        above = refine(above.model, record, stable=wish.stable)
    return Chosen(final, tuple(search.tried.values()), agree, above)


def _agreement(result: Refined, record: Record, search: _ModelSearch) -> float | None:
    """Return the probability of the likelihood ratio; the free model is searched for anew: steps may not lead there."""
    model, wish = result.model, search.wish
    structure = replace(
        wish, gains=None, order=model.plant, noise="shared" if model.shared else model.disturbance
    )  # fmt: skip
    anew = _ModelSearch(search.record, search.plants, structure).run()
    starts = [replace(model, gains=None), *(() if anew is None else (anew.model,))]
    free = [refine(start, record, stable=wish.stable) for start in starts]
    costs = [one.cost for one in free if one is not None]
    if not costs or wish.gains is None:
        return None
    count = int(np.sum(~np.isnan(wish.gains)))
    return float(scipy.special.chdtrc(count, max(result.samples * (result.cost - min(costs)), 0.0)))


class _ModelSearch:
    """Tries structures, and remembers what it tried."""

    def __init__(self, record: Record, plants: tuple[Plant, ...], wish: SelectionOptions) -> None:
        self.record, self.plants, self.wish = record, plants, wish
        u, y, self.arx = whitened(*record)
        self.white = u, y
        self.tried: dict[tuple[int, int, bool], Candidate] = {}
        self._known: dict[int, Refined | None] = {}

    def run(self) -> Refined | None:
        if self.wish.order is not None:
            return self._at(self.wish.order)
        n = 0 if self.wish.closed_loop else self._first()
        best = self._at(n)
        for way, patience in ((1, 2 if self.wish.closed_loop else 1), (-1, 1)):
            k = n + way
            while 0 <= k <= self.wish.most and abs(k - n) <= patience:
                other = self._at(k)
                if _better(other, best):
                    best, n = other, k
                k += way
        return best

    def above(self, best: Refined) -> Refined | None:
        """Return the model of a higher order that explains significantly more, by Akaike's criterion the best; or None.

        Under the order that was chosen, N times the difference in log det has χ² with as many degrees of freedom as
        numbers are fitted more. A pair of poles takes two orders, and one alone may explain nothing.
        """
        n, result = best.model.plant, list[tuple[float, Refined]]()
        for k in range(n + 1, min(n + _PAIR, self.wish.most) + 1):
            other = self._at(k)
            if other is None:
                continue
            more = max(other.freedom - best.freedom, 1)
            gained = other.samples * (best.cost - other.cost)
            if scipy.special.chdtrc(more, max(gained, 0.0)) < _SIGNIFICANT:
                result.append((2.0 * more - gained, other))
        return min(result, key=lambda pair: pair[0])[1] if result else None

    def _first(self) -> int:
        """Return the order that the subspaces of the whitened signals show."""
        try:
            return estimate(*self.white, 1.0, max_order=self.wish.most, feedthrough=self.wish.feedthrough).order
        except InputError:
            return min(2, self.wish.most)

    def _at(self, n: int) -> Refined | None:
        if n not in self._known:
            self._known[n] = self._refined_at(n)
        return self._known[n]

    def _refined_at(self, n: int) -> Refined | None:
        result: list[Refined | None] = []
        if self.wish.noise != "shared":
            result += self._own(n)
        if self.wish.noise in (None, "shared") and n > 0:
            result += self._shared(n)
        return min((r for r in result if r is not None), key=lambda r: r.criterion, default=None)

    # -- disturbance with poles of its own -----------------------------------------------------------

    def _own(self, n: int) -> list[Refined | None]:
        starts = [started(self.record, plant) for plant in self._plants(n)]
        starts = [s for s in starts if np.all(np.isfinite(s.left))]
        if not starts:
            return []
        least = min(starts, key=lambda s: float(np.linalg.slogdet(s.left.T @ s.left + 1e-300)[1]))
        wished = self.wish.noise
        alone = noise_alone(least.left, wished if isinstance(wished, int) else None)
        d = 0 if alone is None else len(alone.model.A)
        begun = []
        for start in starts:
            noise = disturbance(start.left, d)
            if noise is not None:
                begun.append(with_own(start, noise, feedthrough=self.wish.feedthrough))
        if self.wish.order is None:  # many orders are tried: of each the start that predicts best
            begun = sorted(begun, key=lambda model: cost(errors_of(model, self.record)))[:1]
        return [self._refined(model) for model in begun]

    def _plants(self, n: int) -> list[Plant]:
        """Return plants of an order to start from."""
        given = [plant for plant in self.plants if len(plant[0]) == n]
        signals = [self.white]
        if not given:
            signals.append(self.record)
        for u, y in signals:
            try:
                model = estimate(u, y, 1.0, order=n, feedthrough=self.wish.feedthrough).model
            except InputError:
                continue
            given.append((model.A, model.B, model.C, model.D))
        return given

    # -- disturbance with the plant's poles ----------------------------------------------------------

    def _shared(self, n: int) -> list[Refined | None]:
        result = realised(self.arx, n, feedthrough=self.wish.feedthrough)
        if result is None:
            return []
        return [self._refined(with_shared(*result, feedthrough=self.wish.feedthrough))]

    def _refined(self, start: Innovations) -> Refined | None:
        result = refine(replace(start, gains=self.wish.gains), self.record, stable=self.wish.stable)
        if result is not None:
            model = result.model
            tried = Candidate(
                order=model.plant, noise_order=model.disturbance, shared=model.shared, criterion=result.criterion,
                freedom=result.freedom,
            )  # fmt: skip
            known = self.tried.get(tried.structure)
            if known is None or tried.criterion < known.criterion:
                self.tried[tried.structure] = tried
        return result


def noise_alone(left: Floats, order: int | None) -> Refined | None:
    """Return a model of a disturbance alone; its order by the Bayesian criterion where none is given.

    Args:
        left: shape (N, p), the disturbance.
        order: d; None: to be found.
    """
    p = left.shape[1]
    nothing = np.zeros((len(left), 0))
    best: Refined | None = None
    worse = 0
    for d in range(_MOST_NOISE * p + 1) if order is None else (order,):
        noise = disturbance(left, d)
        if noise is None:
            break
        A, K, C = noise
        alone = with_shared((A, np.zeros((d, 0)), C, np.zeros((p, 0))), K, feedthrough=False)
        result = refine(alone, (nothing, left), most=_QUICK)
        if result is not None and _better(result, best):
            best, worse = result, 0
        else:
            worse += 1
        if worse > _IN_A_ROW:
            break
    return best


def _better(one: Refined | None, other: Refined | None) -> bool:
    return one is not None and (other is None or one.criterion < other.criterion)
