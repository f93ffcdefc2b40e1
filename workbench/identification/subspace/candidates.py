"""The subspaces that a record shows at a horizon."""

from __future__ import annotations

from dataclasses import dataclass, replace

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.subspace.hankel import HankelFactor, excitation, factorise
from workbench.identification.subspace.horizon import (
    check_length,
    first_horizon,
    largest_excitation,
    largest_order,
    within_excitation,
)
from workbench.identification.subspace.settings import SubspaceSettings
from workbench.identification.subspace.weightings import Projection, Subspace, project, subspace

__all__ = ["HorizonView", "first_trial", "look"]


@dataclass(frozen=True, eq=False)
class HorizonView:
    """A record seen through one horizon.

    Attributes:
        factor: of the block Hankel matrix.
        parts: projections.
        space: singular values and states of the weighting.
        fixed: no other horizon is to be tried.
        note: why the horizon is shorter than usual; empty if it is not.
    """

    factor: HankelFactor
    parts: Projection
    space: Subspace
    fixed: bool = False
    note: str = ""


def first_trial(record: tuple[Floats, Floats], settings: SubspaceSettings) -> HorizonView:
    """Return the first look, with a shorter horizon where the input does not excite the usual one.

    Args:
        record: u and y, of size one.
        settings: of the identification.

    Raises:
        InputError: too few samples, too little excitation, order too high.
    """
    size = _size(record)
    horizon = first_horizon(settings.order, settings.most, size) if settings.horizon is None else settings.horizon
    check_length(horizon, size)
    _check_allowed(settings.order, horizon, size[2])
    wanted = 2 * horizon + (settings.order or horizon)
    excited = excitation(record[0], min(wanted, largest_excitation(size)))
    if excited >= min(wanted, largest_excitation(size)):
        trial = look(record, horizon, settings)
        return replace(trial, fixed=settings.horizon is not None or not trial.space.noisy)
    shorter = min(within_excitation(excited, settings.order, size[2]), horizon)
    note = (
        f"the inputs excite {excited} orders only: horizon {shorter} instead of {horizon}" if shorter < horizon else ""
    )
    return replace(look(record, shorter, settings), fixed=True, note=note)


def look(record: tuple[Floats, Floats], horizon: int, settings: SubspaceSettings) -> HorizonView:
    """Return what the record shows at a horizon.

    Args:
        record: u and y, of size one.
        horizon: block rows of past and of future.
        settings: of the identification.
    """
    factor = factorise(*record, horizon)
    parts = project(factor)
    return HorizonView(factor, parts, subspace(parts, settings.method, settings.weighting))


def _size(record: tuple[Floats, Floats]) -> tuple[int, int, int]:
    return len(record[0]), record[0].shape[1], record[1].shape[1]


def _check_allowed(order: int | None, horizon: int, outputs: int) -> None:
    most = largest_order(horizon, outputs)
    if order is not None and order > most:
        raise InputError(f"order {order} is too high: a horizon of {horizon} with {outputs} output(s) allows {most}")
