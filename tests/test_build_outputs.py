"""Outputs that are evaluated on their own between events: the same bits as when everything is evaluated."""

from __future__ import annotations

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.fmi.bundled import bundled_names
from workbench.session.fmu import FmuSession


@pytest.mark.parametrize("version", ["", "@3"])
@pytest.mark.parametrize("name", bundled_names())
def test_outputs_alone_and_after_everything_else_are_equal(name: str, version: str) -> None:
    random = np.random.default_rng(7)
    with wb.load(f"fmu:{name}{version}", "me") as model:
        first, second = model.open_session(), model.open_session()
        for time in (1e-4, 2e-4, 3e-4):
            move = 1.0 + 0.1 * random.standard_normal(first.instance.nx)
            u = random.standard_normal(len(model.inputs))
            alone = _outputs(_moved(first, time, move, u), model)
            everything = _moved(second, time, move, u)
            everything.instance.get_derivatives()
            assert _outputs(everything, model) == alone
            first.instance.get_derivatives()
            assert first.instance.dx.tobytes() == second.instance.dx.tobytes()
            assert _numbers(first, model) == _numbers(second, model)


def _moved(session: FmuSession, time: float, move: Floats, u: Floats) -> FmuSession:
    """Put a session at `time`, its states multiplied by `move`, its continuous inputs at about `u`."""
    instance = session.instance
    instance.set_time(time)
    instance.get_states()
    instance.x[:] = instance.x * move + 1e-3 * move
    instance.set_states()
    for variable, value in zip(session.inputs.values(), u, strict=True):
        if variable.is_continuous_input:
            instance.access([variable]).write([float(variable.start or 0.0) + value])
    return session


def _outputs(session: FmuSession, model: wb.DescribedModel) -> dict[str, float]:
    return session.values([v.name for v in model.outputs])


def _numbers(session: FmuSession, model: wb.DescribedModel) -> dict[str, float]:
    return session.values([v.name for v in model.description.variables if v.is_number])


def test_a_saved_state_remembers_what_is_due() -> None:
    with wb.load("fmu:Rudder", "me") as model, model.open_session() as session:
        instance = session.instance
        _moved(session, 1e-3, np.full(8, 1.5), np.zeros(4))
        after_outputs = _outputs(session, model)
        state = instance.get_state()
        instance.get_derivatives()
        expected = instance.dx.copy()
        _moved(session, 2e-3, np.full(8, 0.5), np.ones(4))
        instance.get_derivatives()
        instance.set_state(state)
        assert _outputs(session, model) == after_outputs
        instance.get_derivatives()
        assert instance.dx.tobytes() == expected.tobytes()
        instance.free_state(state)
