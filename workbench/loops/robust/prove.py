"""Proofs: up to which size of the ranges a model is stable, and whether it is in parts of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.errors import SimulationError
from workbench.loops.mu.peak import Peak, peak
from workbench.loops.robust.family import Place, UncertainFamily
from workbench.loops.robust.uncertain import Box, UncertainModel, uncertain_model
from workbench.loops.robust.worst import is_stable, is_unstable

__all__ = ["ProvedMargin", "ProvedParts", "divided", "needed", "proved_margin"]

_ROUNDS = 5  # sizes that are tried
_CLOSE = 0.03  # relative: how near the margin is to the largest one that the bounds prove
_LEVEL = 0.01  # and how near a level is to the least one; whether 1 suffices is told apart from that
_BELOW = 0.995  # the next size beside the one that a bound suggests


@dataclass(frozen=True, eq=False)
class ProvedMargin:
    """What is proved of boxes around the middle.

    Attributes:
        size: of the largest one that is proved; 0: none is.
        most: largest size at which there are linear models, as far as was looked.
        models: size → uncertain model over that box.
        peaks: size → frequency at which most is needed of it [Hz].
        notes: one line each.
    """

    size: float
    most: float
    models: dict[float, UncertainModel]
    peaks: dict[float, float]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ProvedParts:
    """What is proved of the ranges as they are given.

    Attributes:
        proved: uncertain models over parts whose union they are; empty: it is not proved.
        unstable: deviations at which the model is unstable; None: none were met.
    """

    proved: tuple[UncertainModel, ...]
    unstable: Place | None = None


def needed(model: UncertainModel, *, least: float = 0.0) -> Peak:
    """Return the level that the stability over a box needs: 1 or less proves it; infinite: the middle is not stable.

    Args:
        model: over the box.
        least: a level that is not told from a lower one.
    """
    system, blocks = model.stability()
    if not is_stable(replace(system, B=system.B[:, :0], C=system.C[:0], D=np.zeros((0, 0)))):
        return Peak(math.inf, math.nan, 0)
    found = peak(system, blocks, close=_LEVEL, least=min(least, 1.0))
    if 1.0 < found.level <= (1.0 + _LEVEL) ** 3 and proves(model):
        return replace(found, level=1.0)
    return found


def proves(model: UncertainModel) -> bool:
    """Whether the bounds prove the stability over a box whose middle is stable."""
    return peak(*model.stability(), least=1.0, enough=1.0).level <= 1.0


def proved_margin(family: UncertainFamily, most: float) -> ProvedMargin:
    """Return the largest box around the middle that is proved to be stable.

    The level that a box needs tells the size of the next one: what grows with it exactly only where the matrices are
    linear in the parameters, so that each box is proved with models of its own.

    Args:
        family: of linear models.
        most: largest size.
    """
    count = len(family.parameters)
    models: dict[float, UncertainModel] = {}
    peaks: dict[float, float] = {}
    notes: list[str] = []
    size, best, limit, refused = 1.0, 0.0, most, math.inf
    for _ in range(_ROUNDS):
        try:
            model = uncertain_model(family, Box.of_size(count, size))
        except SimulationError as error:
            if size <= 1.0:
                raise
            notes.append(f"ranges {size:.3g} times as wide are not looked at: {error}")
            limit = refused = size
            size = math.sqrt(size * max(best, 1.0))
            continue
        models[size] = model
        if not model.bounded:
            ranks = ", ".join(f"{p.name} {k}" for p, k in zip(family.parameters, model.fraction.ranks, strict=True))
            proved = f"no more than {best:.3g} times the ranges" if best > 0.0 else "nothing"
            notes.append(
                f"{proved} is proved: the parameters act in too many ways for bounds in useful time (times in the "
                f"perturbation: {ranks}); unstable sets are sought. Narrower ranges may act in fewer ways"
            )
            return ProvedMargin(best, limit, {1.0: models[1.0]}, {1.0: peaks.get(1.0, math.nan)}, tuple(notes))
        found = needed(model, least=0.99 * size / limit)
        level, peaks[size] = found.level, found.frequency_hz
        if level <= 1.0:
            best = max(best, size)
        else:
            refused = min(refused, size)
        if best >= limit:
            break
        # What the level suggests, unless that is known already: then between what is proved and what is not.
        following = min(limit, size / level * _BELOW if level > 0.0 else limit)
        if not best * (1.0 + _CLOSE) < following < refused:
            following = math.sqrt(best * min(refused, limit)) if best > 0.0 else 0.5 * size
        if refused <= best * (1.0 + _CLOSE) or (best > 0.0 and following <= best * (1.0 + _CLOSE)):
            break
        size = following
    return ProvedMargin(best, limit, models, peaks, tuple(notes))


def divided(family: UncertainFamily, whole: UncertainModel, boxes: int) -> ProvedParts:
    """Prove the stability over the ranges in parts: what is not proved is halved, along what acts most.

    Args:
        family: of linear models.
        whole: over the ranges.
        boxes: parts at most.
    """
    todo, proved = [whole], list[UncertainModel]()
    while todo:
        model = todo.pop()
        (middle,) = family.at([model.box.centre])
        if middle is not None and is_unstable(middle):
            return ProvedParts((), model.box.centre)
        if middle is not None and is_stable(middle) and model.bounded and proves(model):
            proved.append(model)
            continue
        if len(proved) + len(todo) + 2 > boxes:
            return ProvedParts(())
        todo += [uncertain_model(family, half) for half in model.box.halves(int(np.argmax(model.acts)))]
    return ProvedParts(tuple(proved))
