from workbench.fmi.variable import Variable as Variable
from workbench.model.base import Model as Model
from workbench.model.described_model import DescribedModel as DescribedModel
from workbench.model.load import FmuModel as FmuModel
