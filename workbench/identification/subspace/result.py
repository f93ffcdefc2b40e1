"""What a subspace identification returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.identification.identified.model import IdentifiedModel
from workbench.show.result import Result

__all__ = ["SubspaceEstimate"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SubspaceEstimate(Result):
    """An identified model and how it came about.

    Attributes:
        model: discrete state space with gain K and initial state.
        method: "n4sid", "moesp" or "cva".
        basis: "combined" (principal angles show the order) or "unscaled" (singular values do).
        biased: the model comes from the regression on the state sequence.
        order: order of the dynamics, delays not counted.
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

    _page = "workbench.identification.subspace.page:estimate_page"
    _picture = "workbench.identification.subspace.picture:plot_order"

    model: IdentifiedModel = field(metadata=entry(inline=True))
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
    notes: tuple[str, ...] = field(default=(), metadata=entry(key="estimate_notes"))

    def with_model(self, model: IdentifiedModel) -> SubspaceEstimate:
        """Return the same with another model, e.g. one with names.

        Args:
            model: takes the place of `model`.
        """
        return replace(self, model=model)

    def derived(self) -> dict[str, Any]:
        """Return all notes."""
        notes = self.model.notes
        return {"model_notes": notes, "notes": (*notes, *self.notes)}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the notes of the model apart from those of the estimate."""
        return {**data, "notes": data["model_notes"]}
