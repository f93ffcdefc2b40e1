"""Blocks alone, and loops around them, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import workbench as wb
from workbench.core.values.arrays import Floats

# Parameters with which every kind can be made, chosen so that a loop around it moves.
SAMPLES: Mapping[str, Mapping[str, Any]] = {
    "saturation": {"lower": -0.5, "upper": 0.5},
    "dead_band": {"lower": -0.2, "upper": 0.2},
    "rate_limiter": {"rising": 2.0, "lag": 0.01},
    "backlash": {"half_width": 0.1, "lag": 0.01},
    "relay": {"off_below": -0.1, "on_above": 0.1},
    "quantiser": {"step": 0.25},
    "integrator": {"lower": -0.5, "upper": 0.5},
    "pi": {"lower": -1.0, "upper": 1.0},
    "pid": {"lower": -1.0, "upper": 1.0},
    "transfer_function": {"numerator": [1.0], "denominator": [0.1, 1.0]},
    "lead_lag": {},
    "notch": {"frequency": 3.0},
    "biquad": {"zero_frequency": 3.0, "pole_frequency": 5.0},
    "product": {},
    "minimum": {},
    "maximum": {},
    "switch": {},
    "friction": {"coulomb": 0.1, "viscous": 0.1},
    "lookup": {"x": [-1.0, 0.0, 1.0], "y": [-0.5, 0.0, 1.0]},
    "lookup_2d": {"x1": [-1.0, 0.0, 1.0], "x2": [0.0, 1.0], "z": [[-0.5, -1.0], [0.0, 0.0], [1.0, 2.0]]},
    "delay": {"delay": 0.2},
    "variable_delay": {"smallest": 0.05, "largest": 0.5},
    "crossover_pilot": {"gain": 0.5, "lead": 0.4, "lag": 0.2, "delay": 0.15},
    "neal_smith_pilot": {"gain": 0.5, "lead": 0.1, "lag": 0.5, "delay": 0.2},
    "zero_order_hold": {"period": 0.05},
    "discrete_transfer_function": {"numerator": [0.5], "denominator": [1.0, -0.5], "period": 0.05},
}


def block(kind: str, parameters: Mapping[str, Any] | None = None) -> wb.BlockComponent:
    """Return a block named `b`."""
    return wb.BlockComponent(name="b", kind=kind, parameters=SAMPLES[kind] if parameters is None else parameters)


def alone(kind: str, parameters: Mapping[str, Any] | None = None, **options: Any) -> wb.DescribedModel:  # noqa: ANN401
    """Return a block as a model with its own inputs and the output `y`."""
    component = block(kind, parameters)
    inputs = {name: f"b.{name}" for name in component.block.inputs}
    return wb.connect({"b": component}, inputs=inputs, outputs={"y": "b.y"}, **options)


def response(
    kind: str,
    parameters: Mapping[str, Any],
    signals: Mapping[str, wb.Signal],
    stop: float = 2.0,
    **options: Any,  # noqa: ANN401
) -> tuple[Floats, Floats]:
    """Return times and outputs of a block, events with both sides, at 400 times and at events."""
    points = np.linspace(0.0, stop, 401)[1:]
    with alone(kind, parameters, **options) as model, model.open_session() as session:
        record = session.advance(stop, signals=dict(signals), record=["y"], points=points)
    return np.asarray(record.time), np.asarray(record.values["y"])


def event_times(time: Floats) -> Floats:
    """Return the times that a record has twice."""
    return np.unique(time[:-1][np.diff(time) == 0.0])
