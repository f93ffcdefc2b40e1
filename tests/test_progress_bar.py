"""The progress bar in Python: in a notebook by itself, else only what `progress` says."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

import workbench as wb
from workbench.core import progress

SHELLS = {"notebook": SimpleNamespace(kernel=None), "terminal": SimpleNamespace(), "script": None}


@pytest.mark.parametrize(("shell", "widgets", "shown"), [
    ("notebook", True, True), ("notebook", False, False), ("terminal", True, False), ("script", True, False),
])  # fmt: skip
def test_a_notebook_shows_a_bar(monkeypatch: pytest.MonkeyPatch, shell: str, widgets: bool, shown: bool) -> None:
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: SHELLS[shell]))
    monkeypatch.setattr(progress, "find_spec", lambda _: "found" if widgets else None)
    told: list[float] = []
    monkeypatch.setattr(progress.Bar, "update", lambda _self, done, _text: told.append(done))
    with wb.load("fmu:FirstOrderLag") as model:
        wb.lin_over(model, {"tau": [0.1, 0.2]})
    assert bool(told) == shown
