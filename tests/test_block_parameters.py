"""Parameters of blocks and gains of a system, set and varied by their full names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.core.records.option import options_of
from workbench.errors import InputError
from workbench.model.varied import set_to
from workbench.point.lin.linearise import run as run_lin
from workbench.point.lin.request import Lin
from workbench.point.lin.task import make_task
from workbench.system.block_table.registry import BLOCKS

SYSTEM = """
[components]
error = {sum = "+-"}
gain = 2.0
limiter = {block = "saturation", lower = -1.0, upper = 1.0}
plant = {block = "lead_lag", gain = 1.0, lead = 0.0, lag = 0.5}
[connections]
"error.u2" = "plant.y"
"gain.u" = "error.y"
"limiter.u" = "gain.y"
"plant.u" = "limiter.y"
[inputs]
r = "error.u1"
[outputs]
y = "plant.y"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "loop.toml"
    path.write_text(SYSTEM, encoding="utf-8")
    return path


def pole(file: Path, values: dict[str, Any]) -> float:
    with wb.load(file, start_values=values) as system:
        return float(wb.lin(system).result.A[0, 0])


def test_a_set_parameter_is_that_of_the_file(file: Path) -> None:
    """The pole of the loop is −(1 + K)/lag."""
    assert pole(file, {}) == pytest.approx(-6.0)
    assert pole(file, {"gain.gain": 4.0}) == pytest.approx(-10.0)
    assert pole(file, {"gain.gain": 4.0, "plant.lag": "0.25"}) == pytest.approx(-20.0)


def test_the_command_line_sets_it(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "l.json"
    assert run(["lin", str(file), "--set", "plant.lag=0.25", "--json", str(out), "--in-process"]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["A"] == [[pytest.approx(-12.0)]]


@pytest.mark.parametrize("kind", ["pi", "pid"])
def test_the_gain_of_a_controller_is_set_and_not_its_state(tmp_path: Path, kind: str) -> None:
    """With e = r − y and dy/dt = u of the plant, a PI loop has s² + P s + I: the product of its poles is I."""
    file = tmp_path / "loop.toml"
    text = SYSTEM.replace("gain = 2.0", f'gain = {{block = "{kind}", proportional = 2.0, integral = 1.0}}')
    file.write_text(text.replace('"lead_lag", gain = 1.0, lead = 0.0, lag = 0.5', '"integrator"'), encoding="utf-8")
    given = {"gain.integral": 3.0, **({"gain.derivative": 0.0} if kind == "pid" else {})}
    with wb.load(file, start_values=given) as system:
        assert "gain.integral" in {v.name for v in system.parameters}
        slow = sorted(wb.lin(system).result.poles, key=abs)[:2]
        assert np.prod(slow).real == pytest.approx(3.0)
        with system.open_session() as session:
            assert session.values(["gain.integrated"]) == {"gain.integrated": 0.0}


def test_no_number_of_a_block_has_the_name_of_its_input_output_or_state() -> None:
    for kind, block in BLOCKS.items():
        made = block(**block.sample)
        numbers = {d.name for d in options_of(block) if isinstance(getattr(made, d.name), float)}
        assert not numbers & {*made.inputs, "y", *made.states, *made.remembers}, kind


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"plant.lag": -1.0}, "component plant: lead_lag: lag: -1 is not a positive number"),
        ({"plant.lag": "soon"}, "lag"),
        ({"gain.gain": "high"}, "gain.gain: 'high' is not a number"),
        ({"limiter.uper": 1.0}, "component limiter: 'uper' is not a parameter; did you mean upper?"),
        ({"limiter.lower": 2.0}, "lower = 2 must be below upper = 1"),
    ],
)
def test_a_wrong_value_or_name_is_refused(file: Path, values: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught, wb.load(file, start_values=values):
        pass
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_modes_over_a_parameter_of_a_block(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.json"
    line = ["modes", str(file), "--vary", "plant.lag=0.25,0.5,1", "--json", str(out), "--in-process"]
    assert run(line) in (0, 1)
    (found,) = json.loads(out.read_text(encoding="utf-8"))["sets"]
    assert found["real"] == [pytest.approx([-12.0, -6.0, -3.0])]


def test_a_model_varied_in_this_process_is_the_one_that_is_loaded_so(file: Path) -> None:
    with wb.load(file) as system:
        twin = set_to(system, {"plant.lag": 0.25, "gain.gain": 4.0})
        assert wb.lin(twin).result.A[0, 0] == pytest.approx(-20.0)
        assert wb.lin(system).result.A[0, 0] == pytest.approx(-6.0)


def test_an_envelope_over_a_parameter_of_a_block(file: Path) -> None:
    study = file.parent / "study.toml"
    study.write_text(
        """
models.loop = "loop.toml"
analyses.linear = {command = "lin", model = "loop"}
envelope.parameters."loop.plant.lag" = {range = [0.25, 1.0], steps = 2}
envelope.parameters."loop.gain.gain" = {range = [1.0, 4.0], steps = 2}
requirements = [{name = "pole", analysis = "linear", kind = "value", path = "A[0][0]", max = 0.0}]
""",
        encoding="utf-8",
    )
    found = wb.envelope(study, keep=False)
    for p in found.points:
        gain, lag = float(p.values["loop.gain.gain"]), float(p.values["loop.plant.lag"])
        assert p.margin == pytest.approx((1.0 + gain) / lag)
    assert found.worst is not None
    again = file.parent / "worst.toml"
    again.write_text(found.worst.systems["loop"], encoding="utf-8")
    assert pole(again, {}) == pytest.approx(-2.0)


def test_modes_leave_out_what_explains_zeros_and_find_the_same_matrix(file: Path) -> None:
    """With a limit in the loop every zero entry would be looked at far away."""
    with wb.load(file) as system:
        task = make_task(system, Lin())
        told, short = (run_lin(replace(task, explained=explained), "exact") for explained in (True, False))
    assert (told.A == short.A).all()
    assert sum(short.calls.values()) < sum(told.calls.values())
