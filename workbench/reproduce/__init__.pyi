from workbench.reproduce.request import reproduce as reproduce
from workbench.reproduce.result import Outcome as Outcome
from workbench.reproduce.result import ReproduceResult as ReproduceResult
from workbench.reproduce.targets import Target as Target
from workbench.reproduce.targets import read_targets as read_targets
