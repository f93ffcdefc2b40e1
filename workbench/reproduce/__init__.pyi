from workbench.reproduce.request import reproduce as reproduce
from workbench.reproduce.result import ReproduceResult as ReproduceResult
from workbench.reproduce.result import TargetResult as TargetResult
from workbench.reproduce.targets import PublishedTarget as PublishedTarget
from workbench.reproduce.targets import read_targets as read_targets
