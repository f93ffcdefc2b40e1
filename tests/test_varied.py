"""A model with other parameters is the model that is opened with them, and the one that it came from stays as it is."""

from __future__ import annotations

import control
import numpy as np
import pytest

import workbench as wb
from workbench.errors import InputError
from workbench.model.varied import set_to, with_parameters


def test_an_fmu_with_another_parameter_is_the_one_opened_with_it() -> None:
    with wb.load("fmu:FirstOrderLag") as model, wb.load("fmu:FirstOrderLag", start_values={"tau": 0.5}) as opened:
        varied = set_to(model, {"tau": 0.5})
        assert varied.recipe.identity() == opened.recipe.identity()
        assert wb.lin(varied).A.tolist() == wb.lin(opened).A.tolist()
        assert wb.lin(model).A.tolist() != wb.lin(varied).A.tolist()
        assert set_to(varied, {"tau": 2.0}).recipe.start_values == {"tau": 2.0}
        with varied.open_session(), varied.open_session():  # as many as wanted
            pass
    assert "tau" not in model.recipe.start_values


def test_a_system_with_another_parameter_is_the_one_opened_with_it() -> None:
    plant = control.ss([[-1.0]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]], inputs=["a", "b"], outputs=["y"])

    def system(**start: float) -> wb.DescribedModel:
        return wb.connect(
            {"lag": "fmu:FirstOrderLag", "plant": plant},
            [("lag.y", "plant.a"), ("plant.y", "lag.u", {"gain": -2.0})],
            inputs={"u": "plant.b"},
            start_values={f"lag.{name}": value for name, value in start.items()},
        )

    with system() as model, system(tau=0.25) as opened:
        varied = with_parameters(model, {"lag.tau": 0.25})
        found, truth, before = (np.sort(np.linalg.eigvals(wb.lin(m).A)) for m in (varied, opened, model))
    assert found.tolist() == truth.tolist()
    assert before.tolist() != truth.tolist()


def test_wrong_parameters_are_refused_as_when_the_model_is_opened() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        assert with_parameters(model, {}) is model
        with pytest.raises(InputError, match="did you mean tau"):
            set_to(model, {"tua": 1.0})
        with pytest.raises(InputError, match="is not a value that a Real can have"):
            set_to(model, {"tau": "slow"})
