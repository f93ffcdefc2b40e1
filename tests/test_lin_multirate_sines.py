"""What a sine shows of multirate models, in closed form: paths of one rate each, side by side, are sums."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.arrays import Complex, Floats

FILTER, LAG = 0.5, 0.2  # y(k+1) = a y(k) + (1 - a) u(k); 1/(LAG s + 1)


def part(name: str, a: float, b: float, dt: Fraction | None) -> wb.LinearComponent:
    return wb.LinearComponent(
        name=name, A=np.array([[a]]), B=np.array([[b]]), C=np.array([[1.0]]), D=np.array([[0.0]]),
        dt=float(dt) if dt else 0.0, input_names=("u",), output_names=("y",), state_names=("x",), x0=np.zeros(1),
    )  # fmt: skip


def lag(name: str) -> wb.LinearComponent:
    return part(name, -1.0 / LAG, 1.0 / LAG, None)


def sampled_path(f: Floats, dt: Fraction) -> Complex:
    """The filter, its hold and the lag behind it."""
    s = 2j * np.pi * f
    z = np.exp(s * float(dt))
    held = (1.0 - 1.0 / z) / (s * float(dt))
    return np.asarray((1.0 - FILTER) / (z - FILTER) * held / (LAG * s + 1.0))


@pytest.mark.parametrize("through", [False, True], ids=["at samples", "and between"])
@pytest.mark.parametrize(
    "rates",
    [
        (Fraction(1, 10), Fraction(3, 20)),
        (Fraction(1, 10), Fraction(3, 10)),
        (Fraction(1, 8), Fraction(1, 3)),
        (Fraction(3, 100), Fraction(7, 100)),
        (Fraction(1, 10), Fraction(1, 10)),
    ],
    ids=str,
)
def test_an_input_that_several_rates_read(rates: tuple[Fraction, Fraction], *, through: bool) -> None:
    parts = {"p": lag("p"), "q": lag("q"), "e": wb.SumComponent(name="e", signs=(1.0, 1.0))}
    parts |= {"f": part("f", FILTER, 1.0 - FILTER, rates[0]), "g": part("g", FILTER, 1.0 - FILTER, rates[1])}
    wires = [("f.y", "p.u"), ("g.y", "q.u"), ("p.y", "e.u1"), ("q.y", "e.u2")]
    inputs = ["f.u", "g.u"]
    outputs = {"y": "e.y"}
    if through:
        parts |= {"c": lag("c"), "d": wb.SumComponent(name="d", signs=(1.0, 1.0))}
        wires += [("e.y", "d.u1"), ("c.y", "d.u2")]
        inputs, outputs = [*inputs, "c.u"], {"y": "d.y"}
    f = 0.5 / float(max(rates)) * np.array([0.05, 0.3, 0.7, 0.95])
    with wb.connect(parts, wires, inputs={"u": inputs}, outputs=outputs) as model:
        found = wb.lin(model).result.fundamental(f)[:, 0, 0]
    truth = sampled_path(f, rates[0]) + sampled_path(f, rates[1])
    if through:
        truth = truth + 1.0 / (LAG * 2j * np.pi * f + 1.0)
    assert found == pytest.approx(truth, rel=1e-3)


def test_a_block_that_only_listens_changes_nothing() -> None:
    parts = {
        "f": part("f", FILTER, 1.0 - FILTER, Fraction(1, 10)),
        "p": lag("p"),
        "s": part("s", 0.0, 1.0, Fraction(3, 10)),
    }
    wires = [("f.y", "p.u"), ("p.y", "s.u")]
    f = np.array([0.2, 0.5, 1.0, 2.0, 4.0])
    with wb.connect(parts, wires, inputs={"u": "f.u"}, outputs={"y": "p.y", "z": "s.y"}) as model:
        result = wb.lin(model).result
    assert result.dt == pytest.approx(0.3)
    assert result.fundamental(f)[:, 0, 0] == pytest.approx(sampled_path(f, Fraction(1, 10)), rel=1e-3)
