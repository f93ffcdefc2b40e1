"""The algorithm that CONTRIBUTING.md shows runs as it is written there."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.names import check_variables
from workbench.model.operating_point import bias_of, standing, start_at
from workbench.requests.request import ModelRequest
from workbench.show.result import Result
from workbench.signals.kinds import Constant

TEXT = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@dataclass(frozen=True)
class NameResult(Result):
    model: str
    time: Any
    y: Any
    notes: tuple[str, ...]
    operating_point: wb.OperatingPoint


class Name(AtPoint, ModelRequest["NameResult"]):
    """Answer to a step of 1."""

    input: str = option("Input that steps.")
    output: str = option("Output to record.")
    _: KW_ONLY
    stop: float = option("Length of the run.", unit="s", default=1.0)


def shown() -> Callable[[wb.Model, Name, Job], NameResult]:
    """The function, with the names that it imports."""
    code = next(block for block in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL) if "def run" in block)
    known: dict[str, Any] = {"np": np, **{k.__name__: k for k in (Model, Job, Constant, Name, NameResult)}}
    known |= {f.__name__: f for f in (bias_of, check_variables, standing, start_at)}
    exec(textwrap.dedent(code), known)  # noqa: S102 - our own page
    run: Callable[[wb.Model, Name, Job], NameResult] = known["run"]
    return run


@pytest.mark.parametrize("options", [{}, {"interface": "cs"}, {"start": 2.0}, {"bias": {"u": 1.0}}])
def test_the_algorithm_runs(options: dict[str, Any]) -> None:
    job = Job()
    with wb.load("fmu:FirstOrderLag", **options) as model:
        found = shown()(model, Name("u", "y"), job)
    assert found.time[[0, -1]] == pytest.approx(np.array([0.0, 1.0]) + options.get("start", 0.0))
    held = options.get("bias", {}).get("u", 0.0)
    assert found.y == pytest.approx((1.0 + held) * (1.0 - np.exp(found.time[0] - found.time)), abs=1e-5)
    assert job.partial() is found  # set before the last `done`


def test_a_wrong_name_is_told() -> None:
    with (
        wb.load("fmu:FirstOrderLag") as model,
        pytest.raises(InputError, match="output: FirstOrderLag has no output or state 'yy'; did you mean y"),
    ):
        shown()(model, Name("u", "yy"), Job())
