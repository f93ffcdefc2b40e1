"""How many block rows past and future have."""

from __future__ import annotations

from workbench.errors import InputError

__all__ = ["DEFAULT_MOST", "choose_horizon", "largest_horizon", "largest_order"]

DEFAULT_MOST = 20  # largest order that the automatic choice considers
_LEAST = 5


def largest_horizon(samples: int, inputs: int, outputs: int) -> int:
    """Return the largest horizon that leaves as many columns as rows in the block Hankel matrix.

    Args:
        samples: N.
        inputs: m.
        outputs: p.
    """
    return (samples + 1) // (2 * (inputs + outputs + 1))


def largest_order(horizon: int, outputs: int) -> int:
    """Return the largest order that a horizon allows: all but one block row of the observability matrix.

    Args:
        horizon: i.
        outputs: p.
    """
    return outputs * (horizon - 1)


def choose_horizon(samples: int, inputs: int, outputs: int, order: int | None, given: int | None, most: int) -> int:
    """Return the horizon i.

    Twice the order and a little (in trials with noise neither n + 2 nor 3 n + 4 gave smaller errors of the poles), less
    where the record is short. With the automatic order, one that allows for the largest order considered.

    Args:
        samples: N.
        inputs: m.
        outputs: p.
        order: asked for; None: automatic.
        given: by the user; None: automatic.
        most: largest order that the automatic choice considers.

    Raises:
        InputError: too few samples, order too high.
    """
    limit = largest_horizon(samples, inputs, outputs)
    if given is not None:
        if given < 2:
            raise InputError(f"horizon must be 2 or more, not {given}")
        _check_length(given, limit, samples, inputs, outputs)
        _check_order(order, given, outputs, f"horizon {given}")
        return given
    _check_length(2, limit, samples, inputs, outputs)
    _check_order(order, limit, outputs, f"{samples} samples")
    wanted = most + 2 if order is None else 2 * order + 2
    return min(max(wanted, _LEAST), limit)


def _check_length(horizon: int, limit: int, samples: int, inputs: int, outputs: int) -> None:
    if horizon > limit:
        need = 2 * horizon * (inputs + outputs + 1) - 1
        raise InputError(
            f"too few samples: {samples} for horizon {horizon} with {inputs} inputs and {outputs} outputs; at least "
            f"{need} are needed"
        )


def _check_order(order: int | None, horizon: int, outputs: int, by: str) -> None:
    most = largest_order(horizon, outputs)
    if order is not None and order > most:
        raise InputError(f"order {order} is too high: {by} with {outputs} outputs allow {most} at most")
