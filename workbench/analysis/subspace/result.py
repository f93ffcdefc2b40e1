"""What a subspace identification returns."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from workbench.analysis.identified.model import IdentifiedModel
from workbench.core.record import Record
from workbench.session.base import Floats

__all__ = ["SubspaceEstimate"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SubspaceEstimate(Record):
    """An identified model and how it came about.

    Attributes:
        model: discrete state space with gain K and initial state.
        method: "n4sid", "moesp" or "cva".
        basis: "combined" (principal angles show the order) or "unscaled" (singular values do).
        biased: the model comes from the regression on the state sequence.
        order: of the dynamics, delays not counted.
        order_reason: in one line.
        order_criterion: shape (k + 1,), of the orders 0 … k, smallest is best; NaN where an order could
            not be the best any more, empty where the criterion was not needed.
        singular_values: shape (k,), falling; of the weighted projection; cosines of the principal angles where the
            basis is combined.
        principal_angles_deg: shape (k,), rising; between past and future, the future input's part taken off [deg].
            Small: a direction that the past determines; 90: noise.
        floor: singular values at or below are rounding.
        horizon: block rows of past and of future [samples].
        stabilised: number of poles that were moved into the unit circle.
        notes: doubts, one line each.
    """

    model: IdentifiedModel
    method: str
    basis: str
    biased: bool
    order: int
    order_reason: str
    order_criterion: Floats
    singular_values: Floats
    principal_angles_deg: Floats
    floor: float
    horizon: int
    stabilised: int
    notes: tuple[str, ...] = ()

    def with_model(self, model: IdentifiedModel) -> SubspaceEstimate:
        """Return the same with another model, e.g. one with names.

        Args:
            model: takes the place of `model`.
        """
        return replace(self, model=model)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON: the model's keys and those of this result."""
        own = {
            "method": self.method,
            "basis": self.basis,
            "biased": self.biased,
            "order": self.order,
            "order_reason": self.order_reason,
            "order_criterion": [c if math.isfinite(c) else None for c in self.order_criterion.tolist()],
            "singular_values": self.singular_values.tolist(),
            "principal_angles_deg": self.principal_angles_deg.tolist(),
            "horizon": self.horizon,
            "stabilised": self.stabilised,
        }
        return {**self.model.to_dict(), **own, "notes": [*self.model.notes, *self.notes]}
