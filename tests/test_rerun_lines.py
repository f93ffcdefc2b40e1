"""The report of a call in Python also tells the command line, and that gives the same numbers."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import workbench as wb
from workbench.cli.app import run
from workbench.requests.kept import origin_of


def line_of(record: object) -> str:
    origin = origin_of(record)
    assert origin is not None
    return origin.line


def test_the_line_gives_the_same_numbers(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag", start_values={"tau": 0.5}) as model:
        found = wb.nfr(model, "u", "y", frequencies=[0.5], amplitudes=[1.0])
    line, out = line_of(found), tmp_path / "out.json"
    assert run([*shlex.split(line)[1:], "--json", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["gain"] == found.to_dict()["gain"]
    found.report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "wb.nfr(" in page
    assert "workbench nfr fmu:FirstOrderLag" in page


def test_what_a_shell_cannot_say_has_no_line() -> None:
    part = wb.GainComponent(name="k", gain=2.0)
    with wb.connect({"k": part}, [], inputs={"u": "k.u"}, outputs={"y": "k.y"}) as system:
        assert not line_of(wb.simulate(system, stop=1.0, inputs={"u": 1.0}))
    with wb.load("fmu:FirstOrderLag") as lag:
        assert not line_of(wb.lin_over(lag, {"tau": [0.5, 1.0]}))  # the command has other words for it
