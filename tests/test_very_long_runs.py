"""A run of very many steps says so before it begins."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

import workbench as wb
from tests.reference_fmus import build_reference
from workbench.jobs.job import Job
from workbench.response.simulate.request import Simulate


class _SaidError(Exception):
    """Ends a run before it begins."""


def _said(text: str) -> None:
    raise _SaidError(text)


def _with_own_step(folder: Path) -> Path:
    """Return an FMU whose solver has steps of 1 ms, as its description says."""
    plain, path = build_reference(folder, "feedthrough", 3), folder / "own_step.fmu"
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(path, "w") as made:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b"<CoSimulation ", b'<CoSimulation fixedInternalStepSize="1e-3" ')
            made.writestr(name, content)
    return path


def test_very_many_steps_are_told_first(tmp_path: Path) -> None:
    job = Job()
    job.say = _said
    with wb.load(_with_own_step(tmp_path), interface="cs") as model:
        words = r"1e\+11 steps of 0.001 s to stop 1e\+08 s may take very long; give `stop`, or `interface=me`"
        with pytest.raises(_SaidError, match=words):
            Simulate(stop=1e8).run(model, job)
        assert Simulate(stop=1.0, in_process=True).run(model, job).time[-1] == 1.0
    with (
        wb.load("fmu:Rudder", interface="cs", step=1e-8) as model,
        pytest.raises(_SaidError, match=r"1e\+08 steps of 1e-08 s to stop 1 s"),
    ):
        Simulate(stop=1.0).run(model, job)
    with wb.load("fmu:FirstOrderLag", interface="me") as model:  # which chooses its own
        assert Simulate(stop=1e8, in_process=True).run(model, job).time[-1] == 1e8
