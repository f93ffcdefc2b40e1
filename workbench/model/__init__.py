"""Models: what an analysis sees. Names are loaded when they are first used, so that a recipe is quick to import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from workbench.fmi.variable import Variable
    from workbench.model.base import Model
    from workbench.model.described import DescribedModel
    from workbench.model.fmu_model import FmuModel

__all__ = ["DescribedModel", "FmuModel", "Model", "Variable"]

_HOME = {
    "DescribedModel": "workbench.model.described",
    "FmuModel": "workbench.model.fmu_model",
    "Model": "workbench.model.base",
    "Variable": "workbench.fmi.variable",
}


def __getattr__(name: str) -> object:
    """Import a public name from the module it lives in."""
    if name not in _HOME:
        raise AttributeError(f"module 'workbench.model' has no attribute '{name}'")
    value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value
