"""How many block rows past and future have.

A short horizon cannot tell slow poles apart, a long one costs variance and time; what is best depends on the
unknown poles. In trials (orders 1 to 6, poles up to 0.995, 20 dB) a horizon of 2 n + 2 lost a factor of 100 against
30 to 50 block rows where poles were slow, and 50 lost a factor of two where they were fast. So several are tried, and
the one whose model simulates the record best is taken; of a record too long for that, n + 2 only.
"""

from __future__ import annotations

from workbench.errors import InputError

__all__ = [
    "candidates",
    "check_length",
    "first_horizon",
    "largest_excitation",
    "largest_order",
    "least_horizon",
    "within_excitation",
]

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
