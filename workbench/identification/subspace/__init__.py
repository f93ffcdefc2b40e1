"""Subspace identification (the source report's `sds`)."""

from workbench.identification.subspace.estimate import estimate
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.subspace.settings import DEFAULT_METHOD
from workbench.identification.subspace.weightings import BASES, METHODS

__all__ = ["BASES", "DEFAULT_METHOD", "METHODS", "SubspaceEstimate", "estimate"]
