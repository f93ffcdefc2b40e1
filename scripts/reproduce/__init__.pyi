from scripts.reproduce.request import reproduce as reproduce
from scripts.reproduce.result import ReproduceResult as ReproduceResult
from scripts.reproduce.result import TargetResult as TargetResult
from scripts.reproduce.targets import PublishedTarget as PublishedTarget
from scripts.reproduce.targets import read_targets as read_targets
