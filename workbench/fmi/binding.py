"""The table that chooses the façade for an FMI version."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.fmi.fmi1 import Instance1
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.fmi3 import Instance3
from workbench.fmi.instance import Instance

__all__ = ["VERSIONS"]

VERSIONS: Mapping[int, type[Instance]] = {1: Instance1, 2: Instance2, 3: Instance3}
