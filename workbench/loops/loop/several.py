"""Several loops at the same time: what gain and phase each tolerates while the others vary, too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.decibels import decibels
from workbench.core.values.linear import Linear
from workbench.core.values.margins import disk_of
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.loops.loop.cut import INJECTED, PASSED, RETURNED, injected_at, loop_sources
from workbench.loops.loop.request import Open
from workbench.loops.loop.result import LoopDisk, Opening
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.mu.peak import peak
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.point.lin.request import lin_result

__all__ = ["all_places", "difference", "disk_margins"]

_CLOSE = 1e-5  # relative: how near the disk is to the largest one that is proved


def disk_margins(
    model: Model, wheres: Sequence[Open], *, point: OperatingPoint | None, method: str
) -> tuple[tuple[LoopDisk, ...], tuple[str, ...]]:
    """Return the disk margins of loops one at a time, at the outputs and inputs of a part, and of all; and notes.

    A factor (2 + δᵢ)/(2 - δᵢ) on the signal at each place brings the loops to the border where det(I - Δ N/2) = 0,
    with N = S - T of all of them: from what is injected at the places to z + y. The smallest size of Δ is 2/µ(N), µ for
    one complex number a place: its upper bound, proved over all frequencies, which is µ itself for up to three places.

    Args:
        model: the system; it stays open.
        wheres: places, see `find_place`.
        point: of the closed loops; None: where the system starts.
        method: of `lin`.

    Raises:
        InputError: see `injected_at`.
        SimulationError: the system cannot be evaluated.

    Source: P. Seiler, A. Packard, P. Gahinet, An introduction to disk margins, IEEE Control Systems 40 (2020).
    """
    with injected_at(model, wheres, point=point) as (opened, places, notes):
        n, more = difference(opened, len(places), point, method)
    words = (*notes, *more)
    if n is None:
        return (), (*words, "there are transport delays: common disk margins would be those of approximations")
    if n.dt > 0.0 and not all(p.discrete for p in places):
        return (), (*words, "a signal that is opened acts between the samples: there are no common disk margins")
    if not n.is_stable:
        return (), (*words, "the closed loop is not stable: there are no disk margins")
    with one_thread():
        return tuple(_disk(n, name, chosen) for name, chosen in _groups(places).items()), words


def difference(
    opened: DescribedModel, count: int, point: OperatingPoint | None, method: str
) -> tuple[Linear | None, tuple[str, ...]]:
    """Return S - T of the loops of a system into which signals are injected, and notes; None: it has transport delays.

    Args:
        opened: see `injected_at`.
        count: number of places.
        point: of the closed loops; None: where the system starts.
        method: of `lin`.
    """
    numbers = range(1, count + 1)
    x, u = ({}, {}) if point is None else ({**point.x, **point.discrete}, dict(point.u))
    linear = lin_result(
        opened, inputs=[f"{INJECTED}.{k}" for k in numbers],
        outputs=[f"{name}.{k}" for name in (RETURNED, PASSED) for k in numbers],
        x0=x, u0=u, time=None if point is None else point.time, method=method, in_process=True,
    )  # fmt: skip
    if linear.delayed is not None:
        return None, linear.notes
    c, d = linear.C[:count] + linear.C[count:], linear.D[:count] + linear.D[count:]
    return Linear(linear.A, linear.B, c, d, dt=linear.dt), linear.notes


def _groups(places: Sequence[Opening]) -> Mapping[str, tuple[int, ...]]:
    """Return name → numbers of the places: each alone, outputs or inputs of one part, all."""
    result: dict[str, tuple[int, ...]] = {place.label: (k,) for k, place in enumerate(places)}
    if len(places) < 2:
        return result
    result.update(_sides(places))
    return {**result, "all at the same time": tuple(range(len(places)))}


def _sides(places: Sequence[Opening]) -> Iterator[tuple[str, tuple[int, ...]]]:
    sources = [{p.source.partition(".")[0]} for p in places]
    targets = [{d.partition(".")[0] for d in p.destinations} for p in places]
    for words, sides in (("outputs of", sources), ("inputs of", targets)):
        for part in sorted(set().union(*sides)):
            chosen = tuple(k for k, side in enumerate(sides) if part in side)
            if 1 < len(chosen) < len(places):
                yield f"{words} {part}", chosen


def _disk(n: Linear, where: str, chosen: tuple[int, ...]) -> LoopDisk:
    some = list(chosen)
    part = Linear(n.A, n.B[:, some], n.C[some], n.D[np.ix_(some, some)], dt=n.dt)
    found = peak(part, [MuBlock(size=1)] * len(some), close=_CLOSE)
    disk = disk_of(found.level, found.frequency_hz)
    return LoopDisk(
        where=where,
        alpha=disk.alpha,
        gain_db=float(decibels(disk.high)),
        phase_deg=disk.phase_deg,
        frequency_hz=disk.frequency_hz,
    )


def all_places(model: Model) -> list[Open]:
    """Return a place for each signal of the loops of a system: the source of each, but for gains and sums.

    Args:
        model: the system.

    Raises:
        InputError: no system, or nothing of it is in a loop.
    """
    found = loop_sources(model)
    if not found:
        raise InputError(f"open: no connection of {model.name} is in a loop")
    return [*found]
