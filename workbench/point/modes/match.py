"""Which mode is which: modes of two neighbouring models matched by their eigenvectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.modal import Poles

__all__ = ["Match", "ModeCluster", "closeness", "coincide", "match", "passing", "turning"]

_RELATED = 0.25  # closeness that makes two modes candidates for each other
_CLEAR = 0.75  # closeness at which a mode is the same mode
_PASSING = 0.5  # of the distance at both ends of a step: two poles that come nearer in between are looked at
_TOGETHER = 1e-5  # of the size of two poles: nearer than that they have met
_MARGIN = 0.02  # of a step: what lies nearer to its ends is not put in between


@dataclass(frozen=True)
class ModeCluster:
    """Modes before and after a step that the vectors do not tell apart.

    Attributes:
        before: positions in the model before.
        after: positions in the model after.
        kind: "real axis" (a pair becomes two real poles, or the reverse), "equal" (poles that coincide within rounding:
            any vectors of theirs would do), "unclear".
    """

    before: tuple[int, ...]
    after: tuple[int, ...]
    kind: str


@dataclass(frozen=True, eq=False)
class Match:
    """Which mode before is which after.

    Attributes:
        pairs: (before, after), each position at most once.
        groups: those among them that are not certain, or have no partner.
    """

    pairs: tuple[tuple[int, int], ...]
    groups: tuple[ModeCluster, ...]

    @property
    def clear(self) -> bool:
        """Whether a smaller step would tell nothing more."""
        return all(g.kind != "unclear" for g in self.groups)


def closeness(before: Poles, after: Poles) -> Floats:
    """Return |wᵢᴴ xⱼ · yⱼᴴ vᵢ|, shape (before, after): 1 for the same mode, 0 for one that is not coupled with it.

    v and w are the right and left vectors before, x and y those after. Unlike the modal assurance criterion, which
    compares right vectors alone, it does not depend on the units of the states, and it sums to 1 over all modes.

    Args:
        before: poles and vectors.
        after: those of the other model.

    Source: Seyranian & Mailybaev, Multiparameter Stability Theory with Mechanical Applications, chapter 2
    (biorthogonality); Allemang, Sound and Vibration 37 (2003), 14-23, for the criterion it replaces.
    """
    there, back = before.left.conj().T @ after.right, after.left.conj().T @ before.right
    return np.asarray(np.abs(there * back.T), dtype=np.float64)


def match(before: Poles, after: Poles) -> Match:
    """Match the modes of two models; what is not certain is said.

    Args:
        before: modes, with vectors that belong to their branches.
        after: modes of the other model.
    """
    close = np.minimum(np.nan_to_num(closeness(before, after), nan=1.0), 1.0)
    rows, columns = linear_sum_assignment(-close)
    pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
    groups = []
    for left, right in _related(close, pairs):
        if len(left) == len(right) == 1 and close[left[0], right[0]] >= _CLEAR:
            continue
        groups.append(ModeCluster(left, right, _kind(before, after, left, right)))
    return Match(tuple(pairs), tuple(groups))


def _related(close: Floats, pairs: Sequence[tuple[int, int]]) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return the connected sets of modes that are candidates for each other.

    Of a mode that has no clear partner all are candidates that it takes to account for it: where several poles cross in
    one point, rounding mixes their vectors there, and the share of each may be small.
    """
    m, k = close.shape
    linked = (close >= _RELATED) | _largest(close) | _largest(close.T).T
    for i, j in pairs:
        linked[i, j] = True
    graph = np.zeros((m + k, m + k), dtype=bool)
    graph[:m, m:] = linked
    count, label = connected_components(csr_matrix(graph), directed=False)
    result = []
    for number in range(count):
        members = np.flatnonzero(label == number)
        result.append((tuple(members[members < m].tolist()), tuple((members[members >= m] - m).tolist())))
    return result


def _largest(close: Floats) -> NDArray[np.bool_]:
    """Return which modes after, taken in falling closeness, make up what is clear of each mode before."""
    order = np.argsort(-close, axis=1)
    falling = np.take_along_axis(close, order, axis=1)
    sums = np.cumsum(falling, axis=1)
    needed = sums - falling < _CLEAR * sums[:, -1:]
    result = np.zeros(close.shape, dtype=bool)
    np.put_along_axis(result, order, needed, axis=1)
    return result


def _kind(before: Poles, after: Poles, left: tuple[int, ...], right: tuple[int, ...]) -> str:
    if coincide(before, left) or coincide(after, right):
        return "equal"
    if {len(left), len(right)} == {1, 2}:
        pair, apart = ((before, left), (after, right)) if len(left) == 1 else ((after, right), (before, left))
        if not pair[0].real[pair[1][0]] and all(apart[0].real[list(apart[1])]):
            return "real axis"
    return "unclear"


def coincide(poles: Poles, places: tuple[int, ...]) -> bool:
    """Whether several poles coincide within what rounding may have done to them.

    Args:
        poles: all of them.
        places: those that may coincide.
    """
    if len(places) < 2:
        return False
    value: Complex = poles.value[list(places)]
    return bool(np.abs(value - value.mean()).max() <= 2.0 * poles.uncertain[list(places)].max())


def passing(before: Poles, after: Poles, matched: Match) -> float:
    """Return where in a step two modes pass each other most closely, 0 … 1; 0: none do, or it has been looked at.

    Modes that couple weakly veer within so short a way that the vectors at both ends look as if they had crossed. A
    model where the straight lines between their poles come closest shows which: mixed vectors, or none.

    Args:
        before: modes at the beginning of the step.
        after: modes at its end.
        matched: their match.
    """
    settled = {i for g in matched.groups for i in g.before}
    pairs = [(i, j) for i, j in matched.pairs if i not in settled]
    first = before.value[[i for i, _ in pairs]]
    last = after.value[[j for _, j in pairs]]
    begin, end = first[:, None] - first, last[:, None] - last
    change = end - begin
    length = np.abs(change) ** 2
    share = np.where(length > 0.0, -(begin * change.conj()).real / np.where(length > 0.0, length, 1.0), 0.0)
    ends = np.minimum(np.abs(begin), np.abs(end))
    size = np.abs(first)[:, None] + np.abs(first)
    close = (np.abs(begin + share * change) < _PASSING * ends) & (ends > _TOGETHER * size)
    shown = close & (share > 0.0) & (share < 1.0)
    inside = share[shown]
    return float(np.clip(inside.min(), _MARGIN, 1.0 - _MARGIN)) if len(inside) else 0.0


def turning(before: Poles, after: Poles, matched: Match) -> bool:
    """Whether a pair becomes two real poles within a step, and one of them changes its stability there, too.

    Half of a pair has no pole of its own on the other side: only a smaller step shows where that one changes.

    Args:
        before: modes at the beginning of the step.
        after: modes at its end.
        matched: their match.
    """
    for group in matched.groups:
        if group.kind == "real axis":
            ends = ((before, group.before), (after, group.after))
            poles = [(p.value[i].real, p.uncertain[i]) for p, places in ends for i in places]
            if len({r > 0.0 for r, u in poles if abs(r) > u}) > 1:
                return True
    return False
