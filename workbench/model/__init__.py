"""Models: what an analysis sees."""

from workbench.fmi.variable import Variable
from workbench.model.base import Model

__all__ = ["Model", "Variable"]
