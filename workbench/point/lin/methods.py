"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from workbench.point.lin.difference import difference
from workbench.point.lin.exact import exact
from workbench.point.lin.kalman_bertram import kalman_bertram
from workbench.point.lin.response import response
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import LinTask

__all__ = ["METHODS", "Method"]

Method = Callable[[LinTask], LinResult]

METHODS: Mapping[str, Method] = {
    "exact": exact,
    "difference": difference,
    "kalman-bertram": kalman_bertram,
    "response": response,
}
