"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from workbench.analysis.lin.difference import difference
from workbench.analysis.lin.exact import exact
from workbench.analysis.lin.kalman_bertram import kalman_bertram
from workbench.analysis.lin.response import response
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.task import LinTask

__all__ = ["METHODS", "Method"]

Method = Callable[[LinTask], LinResult]

METHODS: Mapping[str, Method] = {
    "exact": exact,
    "difference": difference,
    "kalman-bertram": kalman_bertram,
    "response": response,
}
