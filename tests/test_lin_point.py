"""What `lin` says of its point: inputs without effect there, and a point that moves."""

from __future__ import annotations

import pytest

from tests.lin_fmus import built
from workbench.model.load import load
from workbench.point.lin.request import lin

PRODUCT = """model Product "an input acts through a state that is 0 at the start"
  input Real u(start = 0.0);
  input Real w(start = 0.0);
  input Real idle(start = 0.0);
  output Real y;
  Real x(start = 0.0, fixed = true);
equation
  der(x) = w - x + u * x;
  y = x;
end Product;
"""


@pytest.mark.parametrize("method", ["exact", "difference"])
def test_an_input_without_effect_here_is_not_called_unconnected(method: str) -> None:
    with load(built(PRODUCT, "Product"), "me") as model:
        there = lin(model, method=method).result
        away = lin(model, method=method, x0={"x": 0.5}, u0={"w": 0.5}).result
    reasons = {zero.name: zero.reason for zero in there.zeros if zero.kind == "input"}
    assert reasons["u"].startswith("no effect at this point, but an effect nearby")
    assert reasons["idle"] == "not connected: by what is declared, nothing depends on it"
    assert [zero.name for zero in away.zeros if zero.kind == "input"] == ["idle"]
    assert not any("moving" in note for note in (*there.notes, *away.notes))


@pytest.mark.parametrize("method", ["exact", "difference"])
def test_a_point_that_moves_is_told(method: str) -> None:
    with load(built(PRODUCT, "Product"), "me") as model:
        result = lin(model, method=method, u0={"w": 2.0}).result
    assert any(note.startswith("the point is not at rest: der(x) = 2;") for note in result.notes)
