"""Models: what an analysis sees."""

from workbench.fmi.variable import Variable
from workbench.model.base import Model
from workbench.model.described import DescribedModel
from workbench.model.fmu_model import FmuModel
from workbench.model.load import load

__all__ = ["DescribedModel", "FmuModel", "Model", "Variable", "load"]
