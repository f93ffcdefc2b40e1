"""What is asked of an identification, and the horizons through which a record is seen.

A short horizon cannot tell slow poles apart, a long one costs variance and time; what is best depends on the
unknown poles. In trials (orders 1 to 6, poles up to 0.995, 20 dB) a horizon of 2 n + 2 lost a factor of 100 against
30 to 50 block rows where poles were slow, and 50 lost a factor of two where they were fast. So several are tried, and
the one whose model simulates the record best is taken; of a record too long for that, n + 2 only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.subspace.projections import (
    HankelFactor,
    Projection,
    Subspace,
    basis_of,
    excitation,
    factorise,
    project,
    subspace,
)

__all__ = [
    "DEFAULT_METHOD",
    "DEFAULT_MOST",
    "HorizonView",
    "SubspaceSettings",
    "candidates",
    "check_interval",
    "check_order_wish",
    "first_trial",
    "largest_order",
    "look",
]

# In trials (36 systems, eight kinds of input, 20 dB) as good as n4sid for white and coloured inputs and up to ten times
# better for inputs without high frequencies, which make the oblique projection ill-conditioned (`oblique_loss`).
DEFAULT_METHOD = "moesp"
DEFAULT_MOST = 20  # largest order that the automatic choice considers


@dataclass(frozen=True, kw_only=True)
class SubspaceSettings:
    """Options of an identification.

    Attributes:
        order: number of states; None: automatic.
        method: name in `METHODS`.
        basis: name in `BASES`, None for the method's own; `weighting` is the one that holds.
        horizon: block rows of past and of future; None: automatic.
        most: largest order that the automatic choice considers.
        feedthrough: D is estimated.
        biased: regression on the state sequence.
        stable: unstable poles are moved.
    """

    order: int | None
    method: str
    basis: str | None
    horizon: int | None
    most: int
    feedthrough: bool
    biased: bool
    stable: bool

    def __post_init__(self) -> None:
        basis_of(self.method, self.basis)
        if self.most < 1:
            raise InputError(f"max_order must be 1 or more, not {self.most}")
        if self.horizon is not None and self.horizon < 2:
            raise InputError(f"horizon must be 2 or more, not {self.horizon}")

    @property
    def weighting(self) -> str:
        """Name of the basis that holds."""
        return basis_of(self.method, self.basis)


def check_order_wish(order: int | str) -> int | None:
    """Return the order, None for "auto".

    Args:
        order: a number, or "auto".

    Raises:
        InputError: anything else.
    """
    if isinstance(order, str):
        if order != "auto":
            raise InputError(f"order '{order}' is neither a number nor 'auto'")
        return None
    if order != int(order) or order < 0:
        raise InputError(f"order must be a whole number, 0 (a gain) or more, not {order}")
    return int(order)


def check_interval(dt: float) -> float:
    """Return the sampling interval [s].

    Args:
        dt: must be positive and finite.

    Raises:
        InputError: it is not.
    """
    if not (math.isfinite(dt) and dt > 0.0):
        raise InputError(f"dt must be positive, not {dt} s")
    return float(dt)


_ROOM = 12  # block rows beyond the largest order in the first look
_TRIED = (20, 40)
_EFFORT = 4e9  # samples × rows² allowed for a horizon that is not the least


def largest_horizon(samples: int, inputs: int, outputs: int) -> int:
    """Return the largest horizon that leaves as many columns as rows in the block Hankel matrix.

    Args:
        samples: N.
        inputs: m.
        outputs: p.
    """
    return (samples + 1) // (2 * (inputs + outputs + 1))


def largest_excitation(size: tuple[int, int, int]) -> int:
    """Return how many shifts of the input a record can show to be independent.

    Args:
        size: N, m and p.
    """
    samples, m, _ = size
    return (samples + 1) // (m + 1)


def largest_order(horizon: int, outputs: int) -> int:
    """Return the largest order that a horizon allows: all but one block row of the observability matrix.

    Args:
        horizon: i.
        outputs: p.
    """
    return outputs * (horizon - 1)


def least_horizon(order: int, outputs: int) -> int:
    """Return the least horizon for an order.

    Args:
        order: n.
        outputs: p.
    """
    return max(2, -(-order // outputs) + 1)


def check_length(horizon: int, size: tuple[int, int, int]) -> None:
    """Refuse a record that is too short for a horizon.

    Args:
        horizon: i.
        size: N, m and p.

    Raises:
        InputError: more rows than columns.
    """
    samples, m, p = size
    if horizon > largest_horizon(samples, m, p):
        need = 2 * horizon * (m + p + 1) - 1
        raise InputError(
            f"too few samples: {samples} for a horizon of {horizon} with {m} input(s) and {p} output(s); at least "
            f"{need} are needed"
        )


def first_horizon(order: int | None, most: int, size: tuple[int, int, int]) -> int:
    """Return the horizon of the first look at a record.

    Args:
        order: asked for; None: automatic.
        most: largest order that the automatic choice considers.
        size: N, m and p.

    Raises:
        InputError: too few samples, order too high for them.
    """
    limit, p = largest_horizon(*size), size[2]
    check_length(2, size)
    if order is None:
        return min(most + _ROOM, limit)
    if least_horizon(order, p) > limit:
        most_possible = largest_order(limit, p)
        raise InputError(f"order {order} is too high: {size[0]} samples of {p} output(s) allow {most_possible} at most")
    usual = 2 * order + 2
    return min(usual if _affordable(usual, size) else order + 2, limit)


def candidates(order: int, first: int, size: tuple[int, int, int]) -> tuple[int, ...]:
    """Return horizons to try besides the first, shortest first.

    Args:
        order: n.
        first: horizon of the first look.
        size: N, m and p.
    """
    limit = largest_horizon(*size) // 2
    wanted = {2 * order + 2, *(h for h in _TRIED if h > 2 * order + 2)} - {first}
    return tuple(h for h in sorted(wanted) if h <= limit and _affordable(h, size))


def _affordable(horizon: int, size: tuple[int, int, int]) -> bool:
    samples, m, p = size
    return samples * (2.0 * horizon * (m + p)) ** 2 <= _EFFORT


def within_excitation(excited: int, order: int | None, outputs: int) -> int:
    """Return the horizon that an input of limited excitation allows: 2 i + n block rows must be independent.

    Args:
        excited: independent block rows of the input.
        order: n; None: automatic.
        outputs: p.

    Raises:
        InputError: less than the order needs.
    """
    horizon = excited // 3 if order is None else (excited - order) // 2
    least = least_horizon(order or 1, outputs)
    if horizon < least:
        need = (order or 1) + 2 * least
        raise InputError(
            f"the inputs excite {excited} orders only, {need} are needed for a model of order {order or 1}: use a "
            "richer input (PRBS, more lines)"
        )
    return horizon


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
