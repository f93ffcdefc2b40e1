"""Sampled loops in units in which everything is small: the slope at the point, of a period map by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.arrays import Complex, Floats

DT, A, B, D = 0.1, 0.5, 0.5, 0.2  # the controller


def loop(kind: str, parameters: Mapping[str, Any], gain: float) -> wb.DescribedModel:
    def linear(name: str, a: float, b: float, d: float, dt: float) -> wb.LinearComponent:
        return wb.LinearComponent(
            name=name, A=np.array([[a]]), B=np.array([[b]]), C=np.array([[1.0]]), D=np.array([[d]]), dt=dt,
            input_names=("u",), output_names=("y",), state_names=("x",), x0=np.zeros(1),
        )  # fmt: skip

    parts = {
        "e": wb.SumComponent(name="e", signs=(1.0, -1.0)),
        "n": wb.BlockComponent(name="n", kind=kind, parameters=parameters),
        "c": linear("c", A, B, D, DT),
        "k": wb.GainComponent(name="k", gain=gain),
        "p": linear("p", -1.0, 1.0, 0.0, 0.0),
    }
    wires = [("e.y", "n.u"), ("n.y", "c.u"), ("c.y", "k.u"), ("k.y", "p.u"), ("p.y", "e.u2")]
    return wb.connect(parts, wires, inputs={"r": "e.u1"}, outputs={"y": "p.y"})


def truth(slope: float, gain: float) -> Floats:
    """States p and c just before a sample → one period later."""
    e = math.exp(-DT)
    held = (1.0 - e) * gain
    return np.array([[e - held * D * slope, held], [-B * slope, A]])


def poles(matrix: Floats) -> Complex:
    return np.asarray(np.sort_complex(np.linalg.eigvals(matrix)))


@pytest.mark.parametrize("scale", [1e-10, 1e-9, 1e-7, 1e-6, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize(
    ("kind", "slope"), [("saturation", 1.0), ("dead_band", 0.0), ("lookup", 3.0)], ids=["limit", "dead band", "table"]
)
def test_slopes_at_the_point_in_any_unit(kind: str, slope: float, scale: float) -> None:
    table = {"x": [-scale, scale, 2.0 * scale], "y": [-3.0 * scale, 3.0 * scale, 3.0 * scale]}
    limits = {"lower": -scale, "upper": scale}
    with loop(kind, table if kind == "lookup" else limits, 1.0) as model:
        result = wb.lin(model).result
    assert result.state_names == ("p.x", "c.x")
    assert np.abs(result.A - truth(slope, 1.0)).max() < 1e-4
    assert not [d for d in result.doubts if "width" in d.reason]


@pytest.mark.parametrize("scale", [1e-9, 1e-8, 1e-6, 1.0])
def test_the_loop_is_unstable_in_any_unit(scale: float) -> None:
    expected = poles(truth(1.0, 40.0))
    assert np.abs(expected).max() > 1.0
    with loop("saturation", {"lower": -scale, "upper": scale}, 40.0) as model:
        found = wb.loop(model, "p.y")
        over = wb.modes(model, vary="k.gain", values=[1.0, 20.0, 40.0])
    assert found.linear is not None
    assert found.linear.stability.verdict == "unstable"
    last = np.sort_complex([m.pole[-1] for m in over.sets[0].modes])
    assert last.real.max() == pytest.approx(math.log(np.abs(expected[0])) / DT, rel=1e-3)


def test_what_an_fmu_may_hide_is_a_doubt() -> None:
    """A function is not looked into: its small range could be a sum with a large number as well."""
    parts = {
        "n": wb.FunctionComponent(name="n", function=lambda u: np.clip(u, -1e-9, 1e-9)),
        "c": wb.LinearComponent(
            name="c", A=np.array([[A]]), B=np.array([[B]]), C=np.array([[1.0]]), D=np.array([[0.0]]), dt=DT,
            input_names=("u",), output_names=("y",), state_names=("x",), x0=np.zeros(1),
        ),
    }  # fmt: skip
    with wb.connect(parts, [("n.y", "c.u")], inputs={"r": "n.u"}, outputs={"y": "c.y"}) as model:
        result = wb.lin(model, in_process=True).result
    (doubt,) = [d for d in result.doubts if d.column == "r" and "depends on the width" in d.reason]
    assert doubt.row == "c.x"
    assert doubt.other == pytest.approx(B, rel=1e-3)
