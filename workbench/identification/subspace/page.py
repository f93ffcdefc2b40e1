"""The page of a subspace estimate, and its parts."""

from __future__ import annotations

from workbench.identification.subspace.result import SubspaceEstimate
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import matrices, pole_table

__all__ = ["estimate_facts", "estimate_page", "matrices_section", "order_table", "pole_tables"]

_BAR = 40  # length of the longest bar [characters]


def estimate_facts(result: SubspaceEstimate) -> dict[str, str]:
    """Return by which method a model was estimated, as facts of a page."""
    biased = ", biased" if result.biased else ""
    return {
        "method": f"{result.method}, basis {result.basis}, horizon {result.horizon}{biased}",
        "order": str(result.order),
    }


def order_table(result: SubspaceEstimate) -> PageTable:
    """Return the first singular values with bars, which are full up to the order that was chosen."""
    values = result.singular_values[: max(2 * result.order, result.order + 4)].tolist()
    largest = values[0] or 1.0
    angles = result.principal_angles_deg.tolist()
    rows = [(str(k), f"{v:.4g}", f"{a:.2f}") for k, (v, a) in enumerate(zip(values, angles, strict=False), start=1)]
    bars = [
        ("█" if k < result.order else "░") * max(1, round(_BAR * value / largest))
        for k, value in enumerate(values[: len(rows)])
    ]
    return PageTable(("state", "singular value", "principal angle [deg]"), rows, bars=bars)


def pole_tables(estimate: SubspaceEstimate) -> list[PageTable]:
    """Return the table of the poles; none where there is no state."""
    model = estimate.model
    return [pole_table(model.poles.tolist(), model.dt, "Poles")] if model.order else []


def matrices_section(estimate: SubspaceEstimate) -> Section:
    """Return the matrices of the model."""
    model = estimate.model
    states = [f"x{k + 1}" for k in range(model.order)]
    names, known = (*model.input_names, *model.output_names), (*model.input_units, *model.output_units)
    units = dict(zip(names, known, strict=True))
    values = (model.A, model.B, model.C, model.D)
    return matrices(values, states, model.input_names, model.output_names, units=units, dt=model.dt)


def estimate_page(result: SubspaceEstimate) -> Page:
    """Return the page of a subspace estimate: order, poles, matrices."""
    model = result.model
    return Page(
        title=f"Linear model from {', '.join(model.input_names)} to {', '.join(model.output_names)}",
        lead=f"Order {result.order}: {result.order_reason}.",
        facts={**estimate_facts(result), "sampling interval": f"{model.dt:g} s"},
        sections=[
            Section("Model", tables=pole_tables(result)),
            matrices_section(result),
            Section("Order", tables=[order_table(result)], folded=True),
        ],
        notes=(*model.notes, *result.notes),
        kind="estimate",
    )
