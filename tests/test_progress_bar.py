"""The progress bar in Python: in a notebook by itself, else only what `progress` says."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import workbench as wb
from workbench.requests import progress_bar as progress

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


def test_in_a_file_there_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr("workbench.requests.progress_bar.time.monotonic", lambda: now)
    monkeypatch.setattr(progress, "FIRST_LINE", 30.0)
    with progress.Bar(400.0) as bar:
        for second in range(0, 402, 2):
            now = float(second)
            bar.update(now, f"gain = {second}\n")
    lines = capsys.readouterr().err.splitlines()  # a name breaks no line
    times = [float(line.partition("gain = ")[2]) for line in lines]
    assert [line.partition("%")[0].strip() for line in lines] == [f"{time / 4.0:.0f}" for time in times]
    assert 30.0 < times[0] < 34.0  # what is quick says nothing
    gaps = np.diff(times).tolist()
    assert gaps == sorted(gaps)
    assert 40.0 < gaps[-1] < 64.0
