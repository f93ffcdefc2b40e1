"""Each block against its closed form: characteristics, instants of events, steps, the describing function."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import workbench as wb
from tests.block_models import SAMPLES, alone, block, event_times, response
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.kernel.native_blocks import NUMBERS
from workbench.system.block_table.registry import BLOCKS, block_of, block_table

SINE = wb.Sine(amplitude=2.0, frequency=1.0)
Parameters = Mapping[str, Any]


def sine(time: Floats) -> Floats:
    return np.asarray(2.0 * np.sin(2.0 * np.pi * time))


# -- the table -------------------------------------------------------------------------------------


def test_every_kind_has_a_sample_and_a_number_or_matrices() -> None:
    assert set(SAMPLES) == set(BLOCKS)
    for kind, parameters in SAMPLES.items():
        found = block_of(kind, parameters)
        assert found.equations
        assert (found.number in NUMBERS) != (found.matrices() is not None)
        assert block_of(**_again(block_table(found))) == found


def _again(table: Mapping[str, Any]) -> dict[str, Any]:
    return {"kind": table["block"], "parameters": {k: v for k, v in table.items() if k != "block"}}


@pytest.mark.parametrize(
    ("kind", "parameters", "words"),
    [
        ("saturatoin", {}, "block 'saturatoin' is unknown; did you mean saturation?"),
        ("saturation", {"uper": 1.0}, "saturation: parameter 'uper' is unknown; did you mean upper?"),
        ("saturation", {"lower": 2.0}, "saturation: lower = 2 must be below upper = 1"),
        ("lookup", {"x": [0.0, 1.0]}, "lookup: parameter 'y' is missing"),
        ("lookup", {"x": [0.0, 0.0], "y": [0.0, 1.0]}, "lookup: x needs two or more finite values that rise"),
        ("lookup", {"x": [0.0, 1.0], "y": [0.0, 1.0], "extrapolation": "lin"}, "did you mean linear?"),
        ("lookup_2d", {"x1": [0, 1], "x2": [0, 1], "z": [[0, 1]]}, "2 rows of 2 are needed"),
        ("rate_limiter", {"rising": -1.0}, "rising: -1 is not a positive number"),
        ("rate_limiter", {"falling": 1.0}, "falling = 1 must be negative"),
        ("delay", {"delay": math.nan}, "delay is not a number"),
        ("transfer_function", {"numerator": [1, 0], "denominator": [1]}, "the numerator's degree exceeds"),
        ("pi", {"integral": 0.0, "upper": 1.0}, "tracking must be given"),
        ("relay", {"off_below": 1.0}, "off_below = 1 must not be above on_above = 0"),
        ("relay", {"lower": 1.0}, "lower and upper are both 1: a relay has two outputs"),
    ],
)
def test_wrong_parameters_are_refused_in_one_line(kind: str, parameters: Parameters, words: str) -> None:
    with pytest.raises(InputError) as caught:
        block(kind, parameters)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# -- characteristics -------------------------------------------------------------------------------

STATIC = [
    ("saturation", {"lower": -0.3, "upper": 1.2}),
    ("saturation", {"upper": math.inf}),
    ("dead_band", {"lower": -0.3, "upper": 1.2, "slope": 2.0}),
    ("lookup", {"x": [-1, 0, 0.5, 1], "y": [-2, 0, 0.1, 3]}),
    ("lookup", {"x": [-1, 0, 0.5, 1], "y": [-2, 0, 0.1, 3], "extrapolation": "linear"}),
    ("lookup", {"x": [-2.5, 0, 2.5], "y": [-2, 0, 0.1], "extrapolation": "error"}),
]


@pytest.mark.parametrize(("kind", "parameters"), STATIC)
def test_a_static_block_follows_its_characteristic(kind: str, parameters: Parameters) -> None:
    time, y = response(kind, parameters, {"u": SINE})
    assert np.abs(y - block(kind, parameters).block.static(sine(time))).max() < 1e-10


@pytest.mark.parametrize(
    ("kind", "parameters", "levels"),
    [
        ("saturation", {"lower": -0.3, "upper": 1.2}, [-0.3, 1.2]),
        ("dead_band", {"lower": -0.3, "upper": 1.2}, [-0.3, 1.2]),
        ("quantiser", {"step": 1.5}, [-0.75, 0.75]),
        ("lookup", {"x": [-1, 0.5, 1], "y": [-2, 0.1, 3]}, [-1.0, 0.5, 1.0]),
    ],
)
def test_events_are_where_the_input_passes_a_level(kind: str, parameters: Parameters, levels: list[float]) -> None:
    time, _ = response(kind, parameters, {"u": SINE}, stop=1.0)
    angle = [math.asin(level / 2.0) / (2.0 * math.pi) for level in levels]
    exact = np.sort([t % 1.0 for a in angle for t in (a, 0.5 - a)])
    assert event_times(time) == pytest.approx(exact, abs=1e-9)


def test_a_relay_switches_at_its_thresholds_and_nowhere_else() -> None:
    time, y = response("relay", {"off_below": -0.5, "on_above": 0.5, "upper": 3.0}, {"u": SINE}, stop=1.0)
    a = math.asin(0.25) / (2.0 * math.pi)
    assert event_times(time) == pytest.approx([a, 0.5 + a], abs=1e-9)
    assert (y == np.where((time > a) & (time < 0.5 + a), 3.0, -1.0))[np.abs(time % 0.5 - a) > 1e-6].all()


def test_tables_in_two_dimensions_are_bilinear() -> None:
    x1, x2, z = [-1.0, 0.0, 2.0], [0.0, 1.0], [[0.0, 1.0], [2.0, 5.0], [-1.0, 4.0]]
    other = wb.Sine(amplitude=0.8, frequency=0.7, offset=0.5)
    time, y = response("lookup_2d", {"x1": x1, "x2": x2, "z": z}, {"u1": SINE, "u2": other})
    a = np.clip(sine(time), -1.0, 2.0)
    b = np.clip(0.5 + 0.8 * np.sin(2.0 * np.pi * 0.7 * time), 0.0, 1.0)
    ends = [np.interp(a, x1, [row[j] for row in z]) for j in (0, 1)]
    assert np.abs(y - (ends[0] + b * (ends[1] - ends[0]))).max() < 1e-9


def test_a_table_that_ends_says_where() -> None:
    table = {"x": [-1.0, 1.0], "y": [0.0, 1.0], "extrapolation": "error"}
    with pytest.raises(SimulationError, match=r"b: u = 1\S* is at the end of the table, -1 … 1"):
        response("lookup", table, {"u": SINE})
    with pytest.raises(SimulationError, match=r"b: u = 3 is beyond the table, -1 … 1"):
        response("lookup", table, {"u": wb.Constant(3.0)})


def test_of_a_table_with_two_inputs_the_one_that_leaves_is_named() -> None:
    table = {"x1": [-1.0, 0.0, 2.0], "x2": [0.0, 1.0], "z": [[0.0, 1.0], [2.0, 5.0], [-1.0, 4.0]]}
    with pytest.raises(SimulationError, match=r"b: u2 = 3 is beyond the table, 0 … 1"):
        response("lookup_2d", {**table, "extrapolation": "error"}, {"u1": wb.Constant(1.0), "u2": wb.Constant(3.0)})


def test_a_transfer_function_without_a_numerator_is_refused() -> None:
    with pytest.raises(wb.InputError, match="numerator holds no coefficient"):
        response("transfer_function", {"numerator": [], "denominator": [1.0, 1.0]}, {"u": SINE})


def test_blocks_of_several_inputs() -> None:
    other = wb.Sine(amplitude=1.0, frequency=0.5)
    signals = {"u1": SINE, "u2": other}
    for kind, expected in (("minimum", np.minimum), ("maximum", np.maximum), ("product", np.multiply)):
        time, y = response(kind, {}, signals)
        assert np.abs(y - expected(sine(time), np.sin(np.pi * time))).max() < 1e-9, kind
    time, y = response("switch", {"threshold": 0.5}, {"u1": SINE, "u2": other, "u3": wb.Constant(7.0)}, stop=1.0)
    assert event_times(time) == pytest.approx([1.0 / 6.0, 5.0 / 6.0], abs=1e-9)
    inside = (time > 0.1667) & (time < 0.8333)
    assert np.abs(y - np.where(inside, sine(time), 7.0))[np.abs(np.abs(time - 0.5) - 1 / 3) > 1e-3].max() < 1e-12


# -- limits with states ----------------------------------------------------------------------------


def test_a_rate_limiter_goes_at_its_rate_and_then_settles() -> None:
    lag = 0.01
    time, y = response("rate_limiter", {"lag": lag}, {"u": wb.Step(time=0.0, value=1.0)}, tolerance=1e-9)
    near = 1.0 - lag  # where the lag takes over
    exact = np.where(time < near, time, 1.0 - lag * np.exp(-(time - near) / lag))
    assert np.abs(y - exact).max() < 1e-8
    assert event_times(time) == pytest.approx([near], abs=1e-9)


def test_a_rate_limiter_falls_at_another_rate() -> None:
    signals = {"u": wb.Table((0.0, 0.0, 1.0, 1.0), (1.0, 1.0, 1.0, -1.0))}
    time, y = response("rate_limiter", {"rising": 4.0, "falling": -0.5, "lag": 1e-3}, signals)
    assert y[np.searchsorted(time, 0.1)] == pytest.approx(0.4, abs=1e-6)
    assert y[-1] == pytest.approx(0.5, abs=1e-6)


def test_an_integrator_stops_at_its_limits_and_leaves_at_once() -> None:
    time, y = response("integrator", {"upper": 0.1, "lower": -0.05}, {"u": wb.Sine(amplitude=1.0, frequency=1.0)}, 1.0)
    there = math.acos(1.0 - 0.2 * np.pi) / (2.0 * np.pi)
    below = 1.0 - math.acos(-1.0 + 0.3 * np.pi) / (2.0 * np.pi)
    assert event_times(time) == pytest.approx([there, 0.5, below], abs=1e-6)
    assert event_times(time)[1] == pytest.approx(0.5, abs=1e-9)
    assert [y.max(), y.min()] == pytest.approx([0.1, -0.05], abs=1e-12)
    free = (1.0 - np.cos(2.0 * np.pi * time)) / (2.0 * np.pi)
    exact = np.where(time < there, free, np.where(time < 0.5, 0.1, np.maximum(0.1 + free - 1.0 / np.pi, -0.05)))
    assert np.abs(y - exact).max() < 1e-6


def test_backlash_tends_to_the_ideal_play_with_its_lag() -> None:
    lags = (1e-2, 1e-3, 1e-4)
    errors = []
    for lag in lags:
        time, y = response("backlash", {"half_width": 0.5, "lag": lag}, {"u": SINE})
        ideal, position = [], 0.0
        for value in sine(np.linspace(0.0, 2.0, 200_001)).tolist():
            position = min(max(position, value - 0.5), value + 0.5)
            ideal.append(position)
        errors.append(np.abs(y - np.interp(time, np.linspace(0.0, 2.0, 200_001), ideal)).max())
        assert errors[-1] < 4.0 * np.pi * lag * 1.01  # the highest rate times the lag
    assert errors[2] < 0.02 * errors[0]


@pytest.mark.parametrize("kind", ["pi", "pid"])
def test_a_limited_controller_agrees_with_a_fine_solution(kind: str) -> None:
    """The closed loop with 1/(s + 1)², a step of the reference: the output of the controller is limited at first."""
    given = {"proportional": 4.0, "integral": 3.0, "lower": -1.0, "upper": 1.5, "tracking": 0.4}
    more = {"derivative": 1.0, "filter": 0.05} if kind == "pid" else {}
    plant = wb.BlockComponent(
        name="p", kind="transfer_function", parameters={"numerator": [1], "denominator": [1, 2, 1]}
    )
    control = wb.BlockComponent(name="c", kind=kind, parameters={**given, **more})
    system = wb.connect(
        {"c": control, "p": plant, "e": wb.SumComponent(name="e", signs=(1, -1))},
        [("e.y", "c.u"), ("c.y", "p.u"), ("p.y", "e.u2")],
        inputs={"r": "e.u1"}, outputs={"y": "p.y", "v": "c.y"}, tolerance=1e-10,
    )  # fmt: skip
    times = np.linspace(0.0, 6.0, 61)[1:]
    with system, system.open_session() as session:
        record = session.advance(6.0, signals={"r": wb.Constant(1.0)}, record=["y", "v"], points=times)

    def slope(_t: float, s: Floats) -> list[float]:
        y, rate, x, w = s
        e = 1.0 - y
        free = 4.0 * e + x + (1.0 * (e - w) / 0.05 if more else 0.0)
        v = min(max(free, -1.0), 1.5)
        return [rate, v - 2.0 * rate - y, 3.0 * e + (v - free) / 0.4, (e - w) / 0.05]

    fine = solve_ivp(slope, (0.0, 6.0), np.zeros(4), rtol=1e-10, atol=1e-12, max_step=1e-3, t_eval=times)
    y = record.values["y"][np.searchsorted(record.time, times, side="right") - 1]
    assert np.abs(y - fine.y[0]).max() < 1e-7
    assert record.values["v"].max() == 1.5


def test_a_mass_sticks_until_the_force_is_large_enough_and_stops_again() -> None:
    """m dv/dt = F − R: with F = 3 t it breaks away at t = 1 (3 N), then slides at R = 2 N."""
    friction = wb.BlockComponent(name="r", kind="friction", parameters={"coulomb": 2.0, "breakaway": 3.0})
    system = wb.connect(
        {"r": friction, "sum": wb.SumComponent(name="sum", signs=(1, -1)),
         "m": wb.BlockComponent(name="m", kind="integrator")},
        [("r.y", "sum.u2"), ("sum.y", "m.u"), ("m.y", "r.u1")],
        inputs={"F": ["sum.u1", "r.u2"]}, outputs={"v": "m.y"},
    )  # fmt: skip
    push = wb.Table((0.0, 1.5, 1.5, 4.0), (0.0, 4.5, 0.0, 0.0))
    with system, system.open_session() as session:
        record = session.advance(4.0, signals={"F": push}, record=["v"], points=np.linspace(0.0, 4.0, 401)[1:])
    time, v = record.time, record.values["v"]
    slides = np.where(time < 1.0, 0.0, 1.5 * (np.minimum(time, 1.5) ** 2 - 1.0) - 2.0 * (np.minimum(time, 1.5) - 1.0))
    exact = np.maximum(slides - np.where(time > 1.5, 2.0 * (time - 1.5), 0.0), 0.0)
    assert np.abs(v - exact).max() < 1e-6
    stops = 1.5 + 0.5 * slides[-1]
    assert event_times(time) == pytest.approx([1.0, 1.5, stops], abs=1e-6)
    assert event_times(time)[0] == pytest.approx(1.0, abs=1e-9)
    assert np.abs(v[time > stops]).max() < 1e-12


# -- delays and samplers ---------------------------------------------------------------------------


def test_a_delay_gives_back_a_sine() -> None:
    time, y = response("delay", {"delay": 0.3}, {"u": SINE})
    exact = np.where(time < 0.3, 0.0, sine(time - 0.3))
    assert np.abs(y - exact).max() < 5e-6


def test_a_jump_passes_through_a_delay_at_its_instant() -> None:
    time, y = response("delay", {"delay": 0.3}, {"u": wb.Step(time=0.25, value=1.0)})
    assert event_times(time)[-1] == pytest.approx(0.55, abs=1e-12)
    assert set(y[time < 0.55 - 1e-9]) == {0.0}
    assert set(y[time > 0.55 + 1e-9]) == {1.0}
    _, y = response("delay", {"delay": 0.3, "past": 2.0}, {"u": wb.Constant(1.0)}, stop=0.5)
    assert set(y) == {1.0, 2.0}


def test_a_variable_delay_lets_a_jump_out_where_its_time_has_come() -> None:
    late = wb.Sine(amplitude=0.1, frequency=0.7, offset=0.3)
    signals = {"u1": wb.Step(time=0.25, value=1.0), "u2": late}
    time, _ = response("variable_delay", {}, signals)

    def ahead(t: float) -> float:
        return t - 0.3 - 0.1 * math.sin(1.4 * math.pi * t) - 0.25

    assert event_times(time)[-1] == pytest.approx(brentq(ahead, 0.0, 1.0, xtol=1e-14), abs=1e-9)
    time, y = response("variable_delay", {}, {"u1": SINE, "u2": late})
    shift = time - 0.3 - 0.1 * np.sin(1.4 * np.pi * time)
    assert np.abs(y - np.where(shift < 0.0, 0.0, sine(shift))).max() < 5e-6


def test_samplers_hold() -> None:
    time, y = response("zero_order_hold", {"period": 0.1}, {"u": SINE}, stop=1.0)
    between = np.abs(time / 0.1 - np.round(time / 0.1)) > 1e-6
    assert np.abs(y - sine(np.floor(time / 0.1) * 0.1))[between].max() < 1e-9
    given = {"numerator": [0.5], "denominator": [1.0, -0.5], "period": 0.1}
    time, y = response("discrete_transfer_function", given, {}, stop=1.05, bias={"u": 1.0})
    assert y[-1] == pytest.approx(1.0 - 0.5**10, abs=1e-12)


def test_linear_blocks_have_their_transfer_functions() -> None:
    s = 2j * np.pi * 3.0
    w = 2.0 * np.pi * 2.0
    cases: list[tuple[str, Parameters, complex]] = [
        ("transfer_function", {"numerator": [1, 2], "denominator": [1, 3, 4]}, (s + 2) / (s**2 + 3 * s + 4)),
        ("lead_lag", {"gain": 2.0, "lead": 0.5, "lag": 0.1}, 2 * (0.5 * s + 1) / (0.1 * s + 1)),
        ("notch", {"frequency": 2.0, "width": 0.2, "depth": 0.1},
         (s**2 + 0.04 * w * s + w**2) / (s**2 + 0.4 * w * s + w**2)),
        ("biquad", {"gain": 3.0, "zero_frequency": 2.0, "zero_damping": -0.1, "pole_frequency": 4.0,
                          "pole_damping": 0.6},
         3.0 * (s**2 / w**2 - 0.2 * s / w + 1.0) / (s**2 / (4.0 * w**2) + 0.6 * s / w + 1.0)),
    ]  # fmt: skip
    for kind, parameters, exact in cases:
        with alone(kind, parameters) as model:
            linear = wb.lin(model)
        states = np.linalg.solve(s * np.eye(len(linear.A)) - linear.A, linear.B)
        found = (linear.D + linear.C @ states)[0, 0]
        assert abs(found - exact) < 1e-12 * abs(exact), kind


# -- describing functions --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "parameters", "amplitudes"),
    [
        ("saturation", {}, [0.5, 1.5, 5.0]),
        ("dead_band", {}, [1.5, 5.0]),
        ("quantiser", {"step": 0.5}, [0.3, 2.2]),
        ("relay", {}, [0.3, 2.2]),
        ("relay", {"off_below": -0.2, "on_above": 0.2}, [0.3, 2.2]),
        ("friction", {"coulomb": 2.0, "viscous": 0.1}, [0.3, 2.2]),
        ("backlash", {"lag": 1e-4}, [0.3, 2.2]),
        ("rate_limiter", {"lag": 1e-4}, [0.1, 0.2, 0.25, 1.0]),
    ],
)
def test_the_measured_describing_function_is_the_formula(
    kind: str, parameters: Parameters, amplitudes: list[float]
) -> None:
    component = block(kind, parameters)
    known = component.block.described()
    assert known is not None
    formula = wb.standard_block(known.name, known.parameters)
    with alone(kind, parameters) as model:
        found = wb.nfr(model, component.block.inputs[0], "y", [1.0], amplitudes)
    measured = (found.gain * np.exp(1j * np.radians(found.phase_deg)))[:, 0]
    exact = np.array([formula.gain(a, 1.0) for a in amplitudes])
    lag = 2.0 * np.pi * parameters.get("lag", 0.0)  # by which backlash and rate limiter trail their ideal
    assert np.isfinite(found.error).all()
    assert (np.abs(measured - exact) <= (found.error[:, 0] + 1.02 * lag) * np.abs(exact)).all()
    assert (np.abs(measured - exact) <= (1e-4 + 1.02 * lag) * np.abs(exact)).all()
