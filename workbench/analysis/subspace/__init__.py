"""Subspace identification (the source report's `sds`)."""

from workbench.analysis.subspace.estimate import estimate
from workbench.analysis.subspace.result import SubspaceEstimate
from workbench.analysis.subspace.settings import DEFAULT_METHOD
from workbench.analysis.subspace.weightings import BASES, METHODS

__all__ = ["BASES", "DEFAULT_METHOD", "METHODS", "SubspaceEstimate", "estimate"]
