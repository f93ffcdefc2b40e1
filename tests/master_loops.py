"""Two lags in a loop as co-simulation components, their exact motion, and how far a master is from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import control
import numpy as np

from tests.system_models import difference
from workbench.core.values.arrays import Floats
from workbench.session.base import Recorded
from workbench.signals.kinds import Signal, Sine
from workbench.system.connect import connect
from workbench.system.description import FmuComponent
from workbench.system.master.model import MasterModel

__all__ = ["REFERENCE", "error_of", "fmu", "grid", "lags", "lags_truth", "left_limits", "mastered"]

REFERENCE: Mapping[str, Signal] = {"r": Sine(frequency=0.3)}


def fmu(name: str, file: str, interface: str = "cs", **start: float) -> FmuComponent:
    return FmuComponent(name=name, file=file, interface=interface, set=start)


def mastered(model: object) -> MasterModel:
    assert isinstance(model, MasterModel)
    return model


def lags(
    first: str = "cs",
    second: str = "cs",
    *,
    gain: float = 4.0,
    version: str = "",
    step: float | None = None,
    order: str = "auto",
    hold_inputs: bool = False,
    tolerance: float = 1e-8,
    extrapolation: int = 1,
    step_tolerance: float | None = None,
    x0: tuple[float, float] = (0.0, 0.0),
) -> MasterModel:
    """r → (+) → lag a → lag b → y, with −gain·y fed back; the lags start from `x0`."""
    return mastered(
        connect(
            {
                "a": fmu("a", f"fmu:FirstOrderLag{version}", first, x=x0[0]),
                "b": fmu("b", f"fmu:FirstOrderLag{version}", second, x=x0[1]),
                "e": difference("e", 1.0, -gain),
            },
            [("e.y", "a.u"), ("a.y", "b.u"), ("b.y", "e.u2")],
            inputs={"r": "e.u1"},
            outputs={"y": "b.y", "a": "a.y"},
            step=step,
            order=order,
            hold_inputs=hold_inputs,
            tolerance=tolerance,
            extrapolation=extrapolation,
            step_tolerance=step_tolerance,
        )
    )


def lags_truth(t: Floats, gain: float = 4.0, x0: tuple[float, float] = (0.0, 0.0)) -> dict[str, Floats]:
    """Of `lags` under `REFERENCE`."""
    a, b, c = np.array([[-1.0, -gain], [1.0, -1.0]]), np.array([[1.0], [0.0]]), np.eye(2)
    fine = np.linspace(0.0, t[-1], 20001)
    _, x = control.forced_response(control.ss(a, b, c, np.zeros((2, 1))), fine, np.sin(0.6 * np.pi * fine), x0)
    return {"a": np.interp(t, fine, x[0]), "y": np.interp(t, fine, x[1])}


def grid(count: int, interval: float, offset: float = 0.0) -> Floats:
    found: Floats = np.arange(1, count + 1, dtype=np.float64) * interval + offset
    return found


def left_limits(record: Recorded, points: Floats, names: Sequence[str]) -> dict[str, Floats]:
    at = np.searchsorted(record.time, points)
    return {n: record.values[n][at] for n in names}


def error_of(model: MasterModel, gain: float = 4.0, x0: tuple[float, float] = (0.0, 0.0)) -> float:
    points = grid(25, 0.2)
    with model, model.open_session(signals=REFERENCE) as session:
        record = session.advance(5.0, signals=REFERENCE, record=["a", "y"], points=points)
    found, truth = left_limits(record, points, ["a", "y"]), lags_truth(points, gain, x0)
    return max(float(np.abs(found[n] - truth[n]).max()) for n in truth)
