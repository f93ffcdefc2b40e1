"""What the caller of `estimate` asked for, checked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.errors import InputError
from workbench.identification.subspace.weightings import basis_of

__all__ = ["DEFAULT_METHOD", "DEFAULT_MOST", "SubspaceSettings", "check_interval", "check_order_wish"]

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
