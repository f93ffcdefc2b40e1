"""The examples in the docstrings of the public names: each public function and signal has one, and all run.

An example sees `wb` and `math`, and a folder of its own. What it prints is known from theory or from the source report.
"""

from __future__ import annotations

import contextlib
import doctest
import inspect
import math
from operator import attrgetter
from pathlib import Path

import pytest

import workbench as wb

OPTIONS = doctest.NORMALIZE_WHITESPACE
SIGNALS = {"Constant", "Prbs", "Sine", "Step", "Table"}
FUNCTIONS = {name for name in wb.__all__ if inspect.isfunction(getattr(wb, name)) and name[0].islower()}


METHODS = {
    f"{name}.{method}"
    for name in wb.__all__
    if inspect.isclass(known := getattr(wb, name))
    for method, _ in inspect.getmembers(known, inspect.isfunction)
    if method in vars(known)
}


def example_of(name: str) -> doctest.DocTest:
    names = {"wb": wb, "math": math}
    return doctest.DocTestParser().get_doctest(inspect.getdoc(attrgetter(name)(wb)) or "", names, name, name, 0)


@pytest.mark.parametrize(
    "name",
    [n for n in (*wb.__all__, *sorted(METHODS)) if n in FUNCTIONS | SIGNALS or example_of(n).examples],
)
def test_example_of_a_docstring(name: str, tmp_path: Path) -> None:
    example = example_of(name)
    assert any(line.want for line in example.examples), f"{name}: its docstring has no example that shows a result"
    said: list[str] = []
    with contextlib.chdir(tmp_path):
        result = doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=said.append)
    assert result.failed == 0, "".join(said)
