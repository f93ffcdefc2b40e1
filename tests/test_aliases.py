"""Second names of variables (FMI 3.0): the variable is found by each, and listed once, by its own."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.fmi3_fmus import build_aliased
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.model.described_model import DescribedModel

HERE = Workers(in_process=True)


@pytest.fixture
def fmu(tmp_path: Path) -> str:
    return str(build_aliased(tmp_path))


@pytest.fixture(params=["me", "cs"])
def model(request: pytest.FixtureRequest, fmu: str) -> Iterator[DescribedModel]:
    with wb.load(fmu, request.param) as opened:
        yield opened


def test_a_variable_is_listed_once(model: DescribedModel) -> None:
    listed = model.inputs, model.outputs, model.parameters, model.states
    assert [[v.name for v in found] for found in listed] == [["u"], ["y"], ["tau"], ["x"]]


def test_it_is_found_by_each_of_its_names(model: DescribedModel) -> None:
    """After 2 s the lag of 0.5 s has answered a step of 3 by 3 (1 - exp(-4)), to the error of a held input's start."""
    other = model.with_values({"second.tau": 0.5})
    found = wb.simulate(other, stop=2.0, inputs={"second.u": 3.0}, outputs=["second.y"], in_process=True)
    assert set(found.signals) == {"y", "u"}
    assert found.signals["y"][-1] == pytest.approx(3.0 * (1.0 - np.exp(-4.0)), rel=1e-4)
    assert [n for n in found.notes if "another name" in n] == [
        "second.u is another name of u", "second.y is another name of y"
    ]  # fmt: skip


def test_analyses_take_each_name(model: DescribedModel) -> None:
    response = wb.nfr(model, "second.u", "second.y", [0.5 / np.pi], [1.0], workers=HERE)
    assert response.gain[0, 0] == pytest.approx(np.sqrt(0.5), rel=2e-3)
    linear = wb.lin(model, inputs=["second.u"], outputs=["second.y"], in_process=True, period=0.05)
    said = linear.to_dict()
    assert (said["input_names"], said["output_names"]) == (["u"], ["y"])
    rest = wb.trim(model, fix={"second.u": 2.0}, in_process=True)
    assert rest.operating_point.u == {"u": 2.0}


def test_two_names_with_a_value_each_are_refused(model: DescribedModel) -> None:
    with pytest.raises(InputError, match=r"second\.u is another name of u: give one of them"):
        wb.simulate(model, stop=1.0, inputs={"u": 1.0, "second.u": 2.0}, in_process=True)
    with pytest.raises(InputError, match="tau is set twice: by itself, and by another name"):
        model.with_values({"tau": 1.0, "second.tau": 2.0})


def test_the_command_line_takes_each_name(fmu: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", fmu, "--stop", "1", "--set", "second.tau=2", "--bias", "second.u=1", "--output", "second.x"]
    assert run([*words, "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["signals"]["x"][-1] == pytest.approx(1.0 - np.exp(-0.5), rel=1e-4)
