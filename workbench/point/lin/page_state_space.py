"""The page of a linear model that python-control has; it is slow to import, and so has a module of its own."""

from __future__ import annotations

from workbench.point.lin.page import lin_page
from workbench.point.lin.state_space import LinearModel
from workbench.show.page import Page

__all__ = ["linear_model_page"]


def linear_model_page(model: LinearModel) -> Page:
    """Return the page of the linearisation behind a python-control model."""
    return lin_page(model.result)
