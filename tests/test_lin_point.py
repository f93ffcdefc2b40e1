"""What `lin` says of its point: inputs without effect there, and a point that moves."""

from __future__ import annotations

import pytest

from tests.lin_fmus import built
from workbench.fmi.instance import Instance
from workbench.model.load import FmuModel, load
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


def test_a_model_without_time_events_is_opened_once_for_all_that_is_asked_at_its_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[Instance] = []
    plain = FmuModel.new_instance

    def counted(model: FmuModel) -> Instance:
        made.append(plain(model))
        return made[-1]

    monkeypatch.setattr(FmuModel, "new_instance", counted)
    with load("fmu:FirstOrderLag", "me") as model, model.open_point() as point:
        model.why_replay()  # a probe opens instances of its own, once
        count = len(made)
        assert len(point.ticks(1, float("inf"))) == 0
        assert point.jacobian().shape == (2, 2)
        point.at(point.x0 + 1.0, point.u0)
    assert len(made) == count
