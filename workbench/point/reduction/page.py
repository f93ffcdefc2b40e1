"""The page of a balanced reduction."""

from __future__ import annotations

import numpy as np

from workbench.point.reduction.balanced import BalancedReduction
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, pole_table

__all__ = ["reduction_page"]


def reduction_page(result: BalancedReduction) -> Page:
    """Return the page of a reduced system: Hankel singular values, error bound, poles."""
    values = result.hankel[:60]
    kept = result.order - result.unstable
    largest = float(np.max(result.hankel, initial=0.0)) or 1.0
    rows = [
        (str(k), f"{v:.5g}", f"{v / largest:.3g}", "kept" if k <= kept else "left out")
        for k, v in enumerate(values.tolist(), start=1)
    ]
    headings = ("state", "Hankel singular value", "of the largest", "")
    return Page(
        title=f"Reduction from order {result.full_order} to {result.order}",
        lead=f"No gain of the difference exceeds {result.bound:.4g} at any frequency.",
        facts={"method": result.method, "unstable poles": f"{counted(result.unstable, 'pole')}, all kept"},
        sections=[
            Section("Singular values", tables=[PageTable(headings, rows)]),
            Section("Poles", tables=[pole_table(result.part.poles.tolist(), 0.0)]),
        ],
        kind="balanced-reduction",
    )
