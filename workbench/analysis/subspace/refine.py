"""Among several horizons the one whose model simulates the record best."""

from __future__ import annotations

from workbench.analysis.subspace.delivered import cost, deliver
from workbench.analysis.subspace.horizon import candidates, largest_order
from workbench.analysis.subspace.matrices import radius
from workbench.analysis.subspace.settings import Settings
from workbench.analysis.subspace.trial import Trial, look
from workbench.session.base import Floats

__all__ = ["best_trial"]


def best_trial(record: tuple[Floats, Floats], first: Trial, order: int, settings: Settings) -> Trial:
    """Return the horizon whose model of the given order simulates the record best.

    Args:
        record: u and y, of size one.
        first: from `first_trial`.
        order: n.
        settings: of the identification.
    """
    if first.fixed:
        return first
    size = len(record[0]), record[0].shape[1], record[1].shape[1]
    others = [look(record, h, settings) for h in candidates(order, first.factor.horizon, size)]
    usable = [t for t in (first, *others) if order <= min(t.space.rank, largest_order(t.factor.horizon, size[2]))]
    if len(usable) < 2:
        return first
    return min(usable, key=lambda t: _merit(record, t, order, settings))


def _merit(record: tuple[Floats, Floats], trial: Trial, order: int, settings: Settings) -> tuple[bool, float]:
    """Return what is smaller for the better horizon: one with a stable model before one without, then the error."""
    found = deliver(record, trial, order, settings)
    return found.moved > 0 or radius(found.A) >= 1.0, cost(found.error)
