"""What a study must not pass over: requirements that apply nowhere, and paths that lead nowhere."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.health.check.job import CheckJob
from workbench.health.check.run import _lost
from workbench.study.schema import schema

STUDY = """
name = "q"
models.lag = "fmu:FirstOrderLag"
[configurations.nominal]
[grid]
"lag.tau" = [1.0, 2.0]
[analyses.linear]
command = "lin"
model = "lag"
[[requirements]]
name = "a"
analysis = "linear"
kind = "pole frequency"
max = 1
[[requirements]]
name = "b"
analysis = "linear"
"""


def study(folder: Path, text: str) -> Path:
    path = folder / "q.toml"
    path.write_text(STUDY + text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("nowhere", "told"), [("configurations = []", "configurations"), ('grid = {"lag.tau" = []}', "grid: lag.tau")]
)
def test_a_requirement_that_applies_nowhere_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], nowhere: str, told: str
) -> None:
    path = study(tmp_path, f'kind = "pole frequency"\nmax = 0.0001\n{nowhere}\n')
    assert run(["run", str(path), "--no-store"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f'[[requirements]] "b": {told}: is empty' in line


def test_a_path_that_leads_nowhere_costs_no_other_verdict(tmp_path: Path) -> None:
    result = wb.run_study(study(tmp_path, 'kind = "value"\npath = "nothing"\nmin = 1\n'), store=None)
    assert [c.finding.verdict for c in result.checked if c.requirement.name == "a"] == ["passed", "passed"]
    assert {c.finding.reason for c in result.checked if c.requirement.name == "b"} == {
        next(c.finding.reason for c in result.checked if c.requirement.name == "b")
    }
    assert all("there is no 'nothing'" in c.finding.reason for c in result.checked if c.requirement.name == "b")
    assert not result.passed


def _study(**requirement: Any) -> dict[str, Any]:  # noqa: ANN401
    asked = {"name": "r", "analysis": "a", **requirement}
    return {"models": {"m": "x.fmu"}, "analyses": {"a": {"command": "lin", "model": "m"}}, "requirements": [asked]}


@pytest.mark.parametrize(
    ("good", "wrong"),
    [
        ({"kind": "damping", "min": 0.1}, {"kind": "damping"}),
        ({"kind": "value", "path": "x", "equal": 1, "tolerance": 0.1}, {"kind": "value", "path": "x", "equal": 1}),
        ({"kind": "value", "path": "x", "equal": "word"}, {"kind": "value", "path": "x"}),
        ({"kind": "damping", "min": 1, "configurations": ["a"]}, {"kind": "damping", "min": 1, "configurations": []}),
        ({"kind": "damping", "min": 1, "grid": {"m.k": [1]}}, {"kind": "damping", "min": 1, "grid": {"m.k": []}}),
        (
            {"kind": "agreement", "path": "x", "with": "b", "relative": 1},
            {"kind": "agreement", "path": "x", "with": "b"},
        ),
    ],
)
def test_the_schema_refuses_what_the_program_refuses(good: dict[str, Any], wrong: dict[str, Any]) -> None:
    validator = jsonschema.Draft202012Validator(schema("study"))
    assert validator.is_valid(_study(**good))
    assert not validator.is_valid(_study(**wrong))


@pytest.mark.parametrize("limit", ["timeout", "memory-limit"])
@pytest.mark.parametrize(("value", "valid"), [(5, True), (0.5, True), (0, False), (-1, False)])
def test_limits_of_time_and_memory_are_positive(limit: str, value: float, valid: bool) -> None:
    data = _study(kind="damping", min=0.1)
    data["analyses"]["a"] |= {"command": "simulate", limit: value}
    assert jsonschema.Draft202012Validator(schema("study")).is_valid(data) == valid


def test_the_schema_of_a_system_refuses_a_misspelt_key_of_a_connection() -> None:
    validator = jsonschema.Draft202012Validator(schema("system"))

    def system(connections: dict[str, Any]) -> dict[str, Any]:
        return {"components": {"a": {"model": "a.fmu"}, "b": {"gain": 2}}, "connections": connections}

    assert validator.is_valid(system({"a.u": {"from": "b.y", "unit": "deg"}}))
    assert validator.is_valid(system({"a": {"u": "b.y"}}))
    assert not validator.is_valid(system({"a.u": {"from": "b.y", "unti": "deg"}}))


def test_a_process_lost_after_the_last_check_breaks_it() -> None:
    job = CheckJob(interface="cs", names=("runs", "memory"))
    lost: Any = SimpleNamespace(job=job, reason="time limit: no result for 10 s", error=InputError("x"))
    (line,) = _lost(lost, [], deque())
    assert (line.name, line.verdict, line.finished) == ("memory", "broken", False)
    assert line.evidence == "after its last check: time limit: no result for 10 s"
