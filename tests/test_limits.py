"""Limits that a model declares for its inputs: what leaves them is told, and runs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import workbench as wb
from workbench.model.described_model import DescribedModel

SAID = "delC: {} deg is outside of what the model declares, -180 to 180 deg"


@pytest.fixture(scope="module")
def rudder() -> Iterator[DescribedModel]:
    with wb.load("fmu:Rudder") as model:
        yield model


@pytest.mark.parametrize(
    ("inputs", "told"),
    [
        ({"delC": 500.0}, [SAID.format("500")]),
        ({"delC": "4rad"}, [SAID.format("229.183")]),
        ({"delC": wb.Sine(frequency=1.0, amplitude=100.0, offset=-90.0)}, [SAID.format("-190")]),
        ({"delC": wb.Table([0.0, 1.0], [0.0, 181.0])}, [SAID.format("181")]),
        ({"pS": -1e6}, ["pS: -1e+06 Pa is outside of what the model declares, at least 0 Pa"]),
        ({"delC": wb.Sine(frequency=1.0, amplitude=90.0, offset=-90.0)}, []),
    ],
)
def test_a_forced_input_that_leaves_its_limits_is_noted(
    rudder: DescribedModel, inputs: dict[str, object], told: list[str]
) -> None:
    notes = wb.simulate(rudder, stop=0.001, inputs=inputs).notes  # type: ignore[arg-type]
    assert [note for note in notes if "declares" in note] == told


def test_amplitudes_count_about_the_operating_point(rudder: DescribedModel) -> None:
    def notes(amplitude: float, **options: object) -> list[str]:
        found = wb.nfr(rudder, "delC", "del", [5.0], [amplitude], max_periods=2, **options)  # type: ignore[arg-type]
        return [note for note in found.warnings if "declares" in note]

    assert notes(500.0) == [SAID.format("-500")]
    assert notes(1.0) == []


def test_values_of_points_and_parameters_count_too(rudder: DescribedModel) -> None:
    found = wb.lin(rudder, inputs=["delC"], outputs=["del"], u0={"delC": 200.0}).result
    assert SAID.format("200") in found.notes
    assert any("u0" not in n and n.startswith("pS: -1 Pa") for n in wb.trim(rudder, u0={"pS": -1.0}).notes)
    with wb.load("fmu:Rudder", start_values={"delMax": 100.0}) as wide:
        notes = wb.simulate(wide, stop=0.001, inputs={"delC": 5.0}).notes
    assert [n for n in notes if "declares" in n] == [
        "delMax: 100 deg is outside of what the model declares, 1 to 90 deg"
    ]
