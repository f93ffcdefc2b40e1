"""What a notebook shows of models, results and their parts: a line, or a short page, never pages of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import workbench as wb
from tests.test_records import RECORDS, example
from workbench.core.records.record import RecordPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result


def parts_of(value: object, depth: int = 0) -> Iterator[RecordPart]:
    if isinstance(value, RecordPart):
        yield value
    if depth > 4:
        return
    if is_dataclass(value):
        for field in fields(value):
            yield from parts_of(getattr(value, field.name), depth + 1)
    elif isinstance(value, dict):
        for held in value.values():
            yield from parts_of(held, depth + 1)
    elif isinstance(value, list | tuple):
        for held in value[:3]:
            yield from parts_of(held, depth + 1)


@pytest.mark.parametrize("kind", RECORDS, ids=lambda c: c.__name__)
def test_every_result_and_part_is_a_line(kind: type[Result]) -> None:
    for part in parts_of(example(kind)):
        assert len(repr(part)) <= 260
        assert "\n" not in repr(part) or not isinstance(part, Result)


def test_a_long_part_tells_its_sizes() -> None:
    point = OperatingPoint(x={f"q[{k}]": float(k) for k in range(71)}, u={"u": 2.0})
    assert repr(point).startswith("OperatingPoint(x={71 entries}, u={'u': 2.0}, ")
    data = wb.Experiment(
        time=np.linspace(0.0, 49.9, 500),
        u=np.ones((500, 1)),
        y=np.ones((500, 1)),
        input_names=("u",),
        output_names=("y",),
        input_units=(None,),
        output_units=(None,),
        name="data",
    )
    assert "u=array of shape (500, 1)" in repr(data)


def test_a_model_is_a_line_and_its_variables_a_table() -> None:
    with wb.load("fmu:Rudder") as model:
        assert repr(model) == "<FmuModel Rudder (me, gear): 4 inputs, 1 output, 8 states, 31 parameters>"
        shown = model._repr_html_()
    assert "<td>delC</td><td>deg</td>" in shown
    assert "<summary>8 states</summary>" in shown


def test_names_in_a_model_cannot_become_markup() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        model.name = "<script>"
        assert "<script>" not in model._repr_html_()


def test_a_result_shows_what_was_found_and_folds_its_numbers() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        shown = wb.nfr(model, "u", "y", [0.1, 0.2], [1.0], in_process=True)._repr_html_()
    before, _, after = shown.partition("<details>")
    assert "Frequency response of FirstOrderLag" in before
    assert "<svg" in before
    assert "frequency [Hz]" in after
