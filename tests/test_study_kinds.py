"""Kinds of requirements against closed forms, on results written here."""

from __future__ import annotations

import cmath
import math
import re
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from numpy.typing import NDArray

from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.point.lin.result import LinResult
from workbench.study.page import _step
from workbench.study.picture import plot_step
from workbench.study.requirements import KINDS, read_requirement
from workbench.study.requirements.base import Compliance, NotMeasured
from workbench.study.requirements.curves import unwrap
from workbench.study.requirements.step import SettlingTime
from workbench.study.requirements.value import found_at


def find(kind: str, *results: dict[str, Any], **options: Any) -> Compliance:  # noqa: ANN401
    requirement = read_requirement({"name": "r", "analysis": "a", "kind": kind, **options}, "here")
    requirement.check("here", [result["command"] for result in results] or [""])
    return requirement.find(results)


def nfr(responses: dict[float, Sequence[complex]], frequency: Sequence[float], **more: Any) -> dict[str, Any]:  # noqa: ANN401
    """What `workbench nfr` writes, of given responses by amplitude."""
    rows = list(responses.values())
    plain = {
        "command": "nfr",
        "input": {"name": "u", "unit": "mm"},
        "output": {"name": "y", "unit": "deg"},
        "frequency_hz": list(frequency),
        "amplitude": list(responses),
        "gain_db": [[20.0 * math.log10(abs(h)) for h in row] for row in rows],
        "phase_deg": [[math.degrees(cmath.phase(h)) for h in row] for row in rows],
        "offset": [[0.1 * k for k in range(len(row))] for row in rows],
        "averaged": [[False] * len(row) for row in rows],
        "failed": [],
    }
    return {**plain, **more}


def lag(frequency: float, corner: float = 1.0, order: int = 1) -> complex:
    """A lag with its corner in Hz."""
    return 1.0 / (1.0 + 1j * frequency / corner) ** order


DENSE = [0.01 * 10 ** (k / 200) for k in range(801)]
LAG = nfr({1.0: [lag(f) for f in DENSE]}, DENSE)
THREE = nfr({1.0: [lag(f, order=3) for f in DENSE]}, DENSE)


def test_gain_and_phase_at_a_frequency() -> None:
    found = find("gain", LAG, frequency=1.0, min=-3.1, max=-3.0)
    assert found.value == pytest.approx(-10.0 * math.log10(2.0), abs=1e-9)
    assert (found.passed, found.unit) == (True, "dB")
    assert found.margin == pytest.approx(10.0 * math.log10(2.0) - 3.0, abs=1e-9)
    assert find("phase", LAG, frequency=1.0, min=-44.9).margin == pytest.approx(-0.1, abs=1e-9)


def test_phase_has_no_jumps_beyond_half_a_turn() -> None:
    assert find("phase", THREE, frequency=10.0, max=0).value == pytest.approx(
        -3 * math.degrees(math.atan(10.0)), abs=1e-6
    )
    assert unwrap([170.0, -170.0, -10.0, 100.0, -60.0]) == [170.0, 190.0, 350.0, 460.0, 300.0]


def test_between_points_gain_in_db_is_straight_over_log_frequency() -> None:
    coarse = nfr({1.0: [1.0, 0.01]}, [1.0, 100.0])
    assert find("gain", coarse, frequency=10.0, max=0).value == pytest.approx(-20.0)


def test_the_worst_amplitude_counts_unless_one_is_chosen() -> None:
    result = nfr({1.0: [1.0, 1.0], 4.0: [1.0, 0.1]}, [1.0, 10.0])
    found = find("gain", result, frequency=10.0, min=-3)
    assert found.value == pytest.approx(-20.0)
    assert found.where == "10 Hz, amplitude 4 mm"
    assert find("gain", result, frequency=10.0, min=-3, amplitude=1).passed
    with pytest.raises(InputError, match=r"amplitude 2 was not measured; measured: 1, 4"):
        find("gain", result, frequency=10.0, min=-3, amplitude=2)


def test_outside_of_the_measured_band_nothing_is_claimed() -> None:
    with pytest.raises(NotMeasured, match=r"200 Hz is outside of the measured 0\.01 to 100 Hz"):
        find("gain", LAG, frequency=200.0, max=0)


def test_offset_in_the_unit_of_the_output() -> None:
    result = nfr({1.0: [1.0, 1.0]}, [1.0, 10.0])
    found = find("offset", result, frequency=10.0, equal=0, tolerance=0.2)
    assert found.value == pytest.approx(0.1)
    assert found.unit == "deg"
    assert found.passed
    in_rad = find("offset", result, frequency=10.0, equal=0, tolerance=0.2, unit="rad")
    assert in_rad.value == pytest.approx(math.radians(0.1))
    with pytest.raises(InputError, match="unit 'kg' does not fit: the value is in deg"):
        find("offset", result, frequency=10.0, max=1, unit="kg")


def test_a_mask_is_worst_where_its_distance_is() -> None:
    # The mask falls by 20 dB a decade from 0 dB at 1 Hz; the lag lies 10·log10(1 + f²) − 20·log10(f) below it.
    found = find("mask", LAG, upper=[[1.0, 0.0], [10.0, -20.0]])
    distance = 10.0 * math.log10(1.0 + 100.0) - 20.0
    assert found.margin == pytest.approx(distance, abs=1e-9)
    assert found.where == "10 Hz"
    assert found.limit["max"] == pytest.approx(-20.0)
    assert found.passed


def test_a_mask_counts_at_its_own_corners_too() -> None:
    flat = nfr({1.0: [1.0, 1.0]}, [1.0, 100.0])
    found = find("mask", flat, upper=[[1.0, 6.0], [10.0, -1.0], [100.0, 6.0]])
    assert found.margin == pytest.approx(-1.0)
    assert found.where == "10 Hz"
    assert find("mask", flat, lower=[[1.0, -6.0], [10.0, -0.5], [100.0, -6.0]]).margin == pytest.approx(0.5)


def test_a_step_in_a_mask_takes_the_stricter_side() -> None:
    flat = nfr({1.0: [1.0, 1.0]}, [1.0, 100.0])
    found = find("mask", flat, upper=[[1.0, 3.0], [10.0, 3.0], [10.0, 1.0], [100.0, 1.0]])
    assert found.margin == pytest.approx(1.0)
    assert found.limit["max"] == 1.0
    # Just below the step the looser side holds.
    near = nfr({1.0: [1.0, 10 ** (2.0 / 20.0), 1.0, 1.0]}, [1.0, 9.999, 10.0, 100.0])
    assert find("mask", near, upper=[[1.0, 3.0], [10.0, 3.0], [10.0, 0.5], [100.0, 0.5]]).passed


def test_a_failed_point_inside_the_mask_fails_it_with_its_reason() -> None:
    failed = [{"frequency_hz": 10.0, "amplitude": 1.0, "reason": "the pump ran dry"}]
    broken = nfr({1.0: [1.0, 1.0, 1.0]}, [1.0, 10.0, 100.0], failed=failed)
    with pytest.raises(NotMeasured, match=r"the point at 10 Hz failed: the pump ran dry"):
        find("mask", broken, upper=[[1.0, 3.0], [100.0, 3.0]])
    assert find("mask", broken, upper=[[20.0, 3.0], [100.0, 3.0]]).passed


def test_averaged_points_are_marked() -> None:
    result = nfr({1.0: [1.0, 1.0]}, [1.0, 10.0], averaged=[[False, True]])
    assert find("gain", result, frequency=10.0, max=1).where == "10 Hz (averaged)"


def test_a_value_between_points_says_between_which_and_meets_no_limit_between_them() -> None:
    coarse = nfr({1.0: [1.0, 0.1]}, [1.0, 100.0])
    found = find("gain", coarse, frequency=10.0, min=-20.0)
    assert found.value == pytest.approx(-10.0)
    assert found.where == "10 Hz, between 1 and 100 Hz"
    assert find("gain", coarse, frequency=10.0, max=0.0).passed
    for limit in ({"min": -19.0}, {"max": -1.0}):
        with pytest.raises(
            NotMeasured, match=r"known to ± 10 only, between points, .*: let nfr measure that frequency"
        ):
            find("gain", coarse, frequency=10.0, **limit)
    assert find("gain", coarse, frequency=100.0, min=-20.5).where == "100 Hz"


def test_bandwidth_by_gain_and_by_phase() -> None:
    level = 10.0 ** (3.0 / 10.0)
    # Straight lines between points h apart are off by h²/8 of curvature over slope, which is 1 at the corner.
    off = (math.log(10.0) / 200.0) ** 2 / 8.0
    start = 1.0 + DENSE[0] ** 2  # the drop counts from the lowest frequency
    exact = math.sqrt(level * start - 1.0)
    assert find("bandwidth", LAG, min=0.9).value == pytest.approx(exact, rel=1.1 * off)
    assert find("bandwidth", LAG, reference=0.0, min=0.9).value == pytest.approx(math.sqrt(level - 1.0), rel=1.1 * off)
    by_phase = find("bandwidth", THREE, criterion="phase", max=1.0)
    assert by_phase.value == pytest.approx(math.tan(math.radians(30.0)), rel=1.1 * off)


def test_a_bandwidth_says_between_which_points_it_is_interpolated() -> None:
    coarse = nfr({1.0: [1.0, 0.9, 0.3]}, [1.0, 2.0, 4.0])
    found = find("bandwidth", coarse, min=2.0)
    assert found.where == "between 2 and 4 Hz"
    assert 2.0 < float(found.value or 0.0) < 4.0
    for limit in (
        {"min": 2.1},
        {"max": 3.9},
        {"min": 1.0, "max": 3.0},
    ):  # on any way from point to point it is beyond 2
        with pytest.raises(NotMeasured, match=r"is known to ± 1\.7|0\.33 only, between points"):
            find("bandwidth", coarse, **limit)
    assert find("bandwidth", coarse, max=4.0).passed
    at_a_point = nfr({1.0: [1.0, 10.0 ** (-3.0 / 20.0), 0.3]}, [1.0, 2.0, 4.0])
    assert find("bandwidth", at_a_point, min=1.5, drop=3.0).where in {"", "between 2 and 4 Hz"}
    # What `nfr --bandwidth` measured between them counts, where it is the same quantity.
    measured = {"amplitude": 1.0, "drop_db": 3.0, "bandwidth_hz": 2.7, "bandwidth_error_hz": 1e-3, "lag_hz": None}
    known = {**coarse, "features": [measured]}
    found = find("bandwidth", known, min=2.0)
    assert (found.value, found.where) == (2.7, "measured to ± 0.001 Hz")
    with pytest.raises(NotMeasured, match=r"known to ± 0\.001 only, as nfr measured it, and the limit is ≥ 2\.6995 Hz"):
        find("bandwidth", known, min=2.6995)
    for other in ({"drop": 6.0}, {"reference": 0.5}):
        assert find("bandwidth", known, min=2.0, **other).where == "between 2 and 4 Hz"
    assert find("bandwidth", {**coarse, "features": [{**measured, "bandwidth_hz": 5.0}]}, min=2.0).value != 5.0
    # A point that failed inside of the bracket leaves the crossing open.
    failed = [{"frequency_hz": 3.0, "amplitude": 1.0, "reason": "the pump ran dry"}]
    broken = nfr({1.0: [1.0, 0.9, 0.1, 0.3]}, [1.0, 2.0, 3.0, 4.0], failed=failed)
    with pytest.raises(NotMeasured, match="the pump ran dry"):
        find("bandwidth", broken, min=1.0)


def test_a_bandwidth_beyond_the_measurement_proves_a_smallest_one_only() -> None:
    flat = nfr({1.0: [1.0, 1.0]}, [1.0, 10.0])
    found = find("bandwidth", flat, min=5)
    assert (found.value, found.passed, found.where) == (10.0, True, "not reached up to 10 Hz")
    for limit in ({"min": 20}, {"max": 20}, {"equal": 10, "tolerance": 1}):
        with pytest.raises(NotMeasured, match="not reached up to 10 Hz"):
            find("bandwidth", flat, **limit)


# -- linear models -----------------------------------------------------------------------------


Array = Sequence[Sequence[float]] | NDArray[np.float64]


def model(command: str, A: Array, B: Array, C: Array, D: Array, dt: float = 0.0) -> dict[str, Any]:
    """Return what the command writes of a model with one input and one output."""
    matrices = [np.asarray(m, dtype=float) for m in (A, B, C, D)]
    if command == "lin":
        found: LinResult | IdentifiedModel = LinResult(
            *matrices, model="m", interface="me", method="exact", why="", dt=dt, input_names=("u",),
            output_names=("y",), state_names=tuple(f"x{k}" for k in range(len(A))),
            operating_point=OperatingPoint(x={}, u={}),
        )  # fmt: skip
    else:
        n, one = len(A), np.zeros(1)
        found = IdentifiedModel(
            *matrices, K=np.zeros((n, 1)), x0=np.zeros(n), u0=one, y0=one, covariance=np.zeros((1, 1)), dt=dt,
            input_names=("u",), output_names=("y",), input_units=(None,), output_units=(None,),
        )  # fmt: skip
    return {"command": command, **found.to_dict()}


def oscillator(damping: float, hz: float) -> tuple[list[list[float]], list[list[float]]]:
    w = 2.0 * math.pi * hz
    return [[0.0, 1.0], [-w * w, -2.0 * damping * w]], [[0.0], [w * w]]


def test_linear_models_have_responses_damping_and_frequency() -> None:
    A, B = oscillator(0.2, 3.0)
    result = model("lin", A, B, [[1.0, 0.0]], [[0.0]])
    assert find("gain", result, frequency=3.0, max=9).value == pytest.approx(20.0 * math.log10(1.0 / 0.4))
    assert find("phase", result, frequency=3.0, max=0).value == pytest.approx(-90.0)
    assert find("damping", result, min=0.1).value == pytest.approx(0.2)
    assert find("pole frequency", result, equal=3.0, tolerance=1e-6).value == pytest.approx(3.0)
    assert find("stability", result, max=0.0).value == pytest.approx(-0.2 * 6.0 * math.pi)
    with pytest.raises(NotMeasured, match="no pole there"):
        find("damping", result, min=0.1, band=[5.0, 10.0])


def of_fraction(numerator: Sequence[float], denominator: Sequence[float]) -> dict[str, Any]:
    """What `lin` writes of a transfer function."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model("lin", *scipy.signal.tf2ss(numerator, denominator))


def test_a_mask_meets_a_resonance_and_a_notch_between_all_points() -> None:
    w = 2.0 * math.pi * 3.333
    for zeta in (1e-2, 1e-4, 1e-7):
        peak = -20.0 * math.log10(2.0 * zeta * math.sqrt(1.0 - zeta**2))
        resonant = of_fraction([w * w], [1.0, 2.0 * zeta * w, w * w])
        found = find("mask", resonant, upper=[[0.1, 20.0], [100.0, 20.0]])
        assert found.value == pytest.approx(peak, abs=1e-3)
        assert not found.passed
        notch = of_fraction([1.0, 2.0 * zeta * w, w * w], [1.0, 2.0 * w, w * w])
        dip = find("mask", notch, lower=[[0.1, -20.0], [100.0, -20.0]])
        assert dip.value == pytest.approx(20.0 * math.log10(zeta), abs=1e-3)
        assert not dip.passed


def test_a_mask_that_slopes_meets_a_linear_model_where_it_is_nearest() -> None:
    result = of_fraction([1.0], [1.0, 0.4, 1.0])
    f = np.geomspace(0.05, 1.0, 400_001)
    gain = -20.0 * np.log10(np.abs(1.0 - (2.0 * np.pi * f) ** 2 + 0.8j * np.pi * f))
    mask = np.interp(np.log(f), np.log([0.05, 1.0]), [12.0, -20.0])
    found = find("mask", result, upper=[[0.05, 12.0], [1.0, -20.0]])
    assert found.margin == pytest.approx((mask - gain).min(), abs=1e-8)


def test_the_phase_of_a_linear_model_begins_in_its_own_turn() -> None:
    w = 2.0 * math.pi
    twice = of_fraction([1.0], [0.1, 1.0, 0.0, 0.0])
    truth = -180.0 - math.degrees(math.atan(0.1 * w))
    found = find("phase", twice, frequency=1.0, min=-200.0)
    assert found.value == pytest.approx(truth)
    assert not found.passed
    assert not find("mask", twice, quantity="phase", lower=[[0.5, -200.0], [1.0, -200.0]]).passed
    three = of_fraction([1.0], [1.0, 0.0, 0.0, 0.0])
    assert find("phase", three, frequency=1.0, max=0.0).value == pytest.approx(-270.0)
    lead = of_fraction([1.0, 0.0, 0.0], [1.0, 2.0, 1.0])
    turned = 2.0 * math.degrees(math.atan(w))
    assert find("phase", lead, frequency=1.0, max=180.0).value == pytest.approx(180.0 - turned)
    right = of_fraction([-1.0, 1.0], [1.0, 1.0])  # a zero at the right turns as a pole at the left
    assert find("phase", right, frequency=1.0, max=0.0).value == pytest.approx(-turned)
    undamped = of_fraction([1.0], [1.0, 0.0, 1.0])
    assert find("phase", undamped, frequency=1.0, max=0.0).value == pytest.approx(-180.0)
    # Poles of damping 1e-9 turn by half a turn each, however narrow.
    narrow = np.polymul([1.0, 2e-9, 1.0], [1.0, 6e-9, 9.0]).tolist()
    assert find("phase", of_fraction([1.0], narrow), frequency=1.0, max=0.0).value == pytest.approx(-360.0, abs=1e-4)


def test_a_measured_phase_says_where_its_turn_is_not_known() -> None:
    f = [0.5, 1.0, 2.0]
    twice = nfr({1.0: [-1.0 / (w * w * (1.0 + 0.1j * w)) for w in (2.0 * math.pi * x for x in f)]}, f)
    assert "the turn of the phase is not known" in find("phase", twice, frequency=1.0, min=-200.0).where
    assert "turn" not in find("phase", LAG, frequency=1.0, min=-50.0).where


def test_an_integrator_is_a_pole_that_is_zero_within_its_rounding() -> None:
    stiff = of_fraction([1.0], [5e-6, 1.0 - 5e-10, -1e-4])  # poles at 1e-4 and −2e5 1/s
    assert find("stability", stiff, max=0.0).value == pytest.approx(1e-4, rel=1e-5)
    assert find("damping", stiff, min=0.0).value == -1.0
    T = np.random.default_rng(3).standard_normal((3, 3))
    twice = T @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) @ np.linalg.inv(T)
    double = model("lin", twice, T[:, :1], T[:1], [[0.0]])  # rounding leaves poles of 1e-8
    assert find("stability", double, max=0.0).value == pytest.approx(-1.0)


def test_an_unstable_pole_has_negative_damping() -> None:
    A, B = oscillator(-0.1, 3.0)
    result = model("lin", A, B, [[1.0, 0.0]], [[0.0]])
    found = find("damping", result, min=0.0)
    assert found.value == pytest.approx(-0.1)
    assert not found.passed


def test_an_identified_model_is_compared_with_sines_without_its_hold() -> None:
    A, B = oscillator(0.3, 5.0)
    dt = 0.01
    whole = scipy.linalg.expm(dt * np.block([[np.array(A), np.array(B)], [np.zeros((1, 3))]]))
    sampled = model("identify", whole[:2, :2], whole[:2, 2:], [[1.0, 0.0]], [[0.0]], dt)
    frequencies = [1.0, 3.0, 5.0, 8.0, 20.0]
    truth = [1.0 / (1.0 - (f / 5.0) ** 2 + 0.6j * f / 5.0) for f in frequencies]
    measured = nfr({2.0: truth}, frequencies)
    options: dict[str, Any] = {"with": "b", "db": 1e-9, "deg": 1e-9}
    assert find("response agreement", measured, sampled, **options).passed
    assert find("response agreement", sampled, measured, **options).passed
    # Held, as its samples show it, it lags by half a sample: 36 deg at 20 Hz.
    held = find("response agreement", measured, sampled, **{**options, "db": 1.0}, plant="held")
    assert held.value == pytest.approx(36.0, abs=1.0)
    assert find("damping", sampled, min=0.0).value == pytest.approx(0.3)


# -- loops, time histories ---------------------------------------------------------------------


def margins(**more: object) -> dict[str, Any]:
    plain = {
        "closed_loop": "stable", "words": "stable", "gain_margin_db": 10.0, "phase_crossover_hz": 3.0,
        "phase_margin_deg": 50.0, "gain_crossover_hz": 1.0, "delay_margin_s": 0.14, "disk_margin": {"alpha": 0.8},
        "peak_sensitivity": 1.5, "peak_sensitivity_hz": 2.0,
    }  # fmt: skip
    return {**plain, **more}


def loop(linear: dict[str, Any], **measured: dict[str, Any]) -> dict[str, Any]:
    curves = [
        {"amplitude": float(name[1:]), "how": "break", "margins": m, "points": []} for name, m in measured.items()
    ]
    return {"command": "loop", "unit": "mm", "linear": {"margins": linear}, "measured": curves}


def test_margins_of_the_worst_loop() -> None:
    result = loop(margins(), a1=margins(gain_margin_db=7.0), a4=margins(gain_margin_db=5.0))
    found = find("gain margin", result, min=6)
    assert (found.value, found.margin, found.where) == (5.0, -1.0, "3 Hz, amplitude 4 mm")
    assert find("gain margin", result, min=6, source="linear").value == 10.0
    assert find("gain margin", result, min=6, amplitude=1).value == 7.0
    assert find("phase margin", result, min=45).unit == "deg"
    ahead = loop(margins(phase_margin_deg=-50.0))  # stable: its phase may rise by 50, and fall by more
    assert (find("phase margin", ahead, min=45).value, find("phase margin", ahead, min=45).passed) == (50.0, True)
    assert not find("phase margin", loop(margins(phase_margin_deg=-40.0)), min=45).passed
    assert find("disk margin", result, min=0.7).passed
    assert find("peak sensitivity", result, max=1.4).margin == pytest.approx(-0.1)
    assert find("delay margin", result, min=100, unit="ms").value == pytest.approx(140.0)


def test_an_unstable_loop_has_no_margins() -> None:
    with pytest.raises(NotMeasured, match="linear: two poles are unstable"):
        find("gain margin", loop(margins(closed_loop="unstable", words="two poles are unstable")), min=6)


def test_a_margin_without_a_crossing_is_infinite_only_for_the_linear_loop() -> None:
    found = find("gain margin", loop(margins(gain_margin_db=None)), min=6)
    assert (found.value, found.passed) == (math.inf, True)
    with pytest.raises(NotMeasured, match="amplitude 1 mm: not seen in the measured band"):
        find("gain margin", loop(margins(), a1=margins(gain_margin_db=None)), min=6)


ZETA, OMEGA = 0.3, 10.0


def step_response(stop: float = 5.0, begin: float = 0.5, height: float = 2.0) -> dict[str, Any]:
    time = [0.001 * k for k in range(int(stop / 0.001) + 1)]
    wd = OMEGA * math.sqrt(1.0 - ZETA**2)
    values = []
    for t in time:
        s = max(t - begin, 0.0)
        decay = math.exp(-ZETA * OMEGA * s)
        values.append(1.0 + height * (1.0 - decay * (math.cos(wd * s) + ZETA * OMEGA / wd * math.sin(wd * s))))
    return {"command": "simulate", "time": time, "signals": {"y": values}, "units": {"y": "deg"}}


def test_a_step_of_second_order() -> None:
    result = step_response()
    found = find("overshoot", result, after=0.5, max=40)
    assert found.value == pytest.approx(100.0 * math.exp(-math.pi * ZETA / math.sqrt(1.0 - ZETA**2)), rel=1e-4)
    signal, time = np.array(result["signals"]["y"]), np.array(result["time"])
    outside = time[np.abs(signal - 3.0) > 0.05 * 2.0][-1]
    settled = find("settling time", result, after=0.5, band=0.05, max=2)
    assert outside - 0.5 <= settled.value <= outside - 0.5 + 0.0011
    assert find("peak", result, max=10).value == pytest.approx(signal.max())
    assert find("final value", result, equal=3, tolerance=0.01).unit == "deg"


def test_one_of_several_outputs_is_named() -> None:
    time = np.linspace(0.0, 10.0, 1001)
    record = {"command": "simulate", "time": time.tolist(), "units": {}, "asked": {"inputs": "u=1"}}
    y, u = (1.0 - np.exp(-2.0 * time)).tolist(), [1.0] * len(time)
    z = (1.0 - np.exp(-2.0 * time) * np.cos(6.0 * time)).tolist()
    assert find("overshoot", {**record, "signals": {"y": y, "u": u}}, max=5).passed
    with pytest.raises(InputError, match='the record has 2 outputs, y and z; name one, as in output = "y"'):
        find("overshoot", {**record, "signals": {"y": y, "z": z, "u": u}}, max=5)
    assert not find("overshoot", {**record, "signals": {"y": y, "z": z, "u": u}}, max=5, output="z").passed


def test_what_coarse_rows_leave_out_is_the_error_of_the_number() -> None:
    time = np.arange(0.0, 6.3, 0.3)
    result = {"command": "simulate", "time": time.tolist(), "units": {}, "signals": {"y": np.sin(time).tolist()}}
    found = find("peak", result, max=2.0)
    rows = float(np.abs(np.sin(time)).max())
    assert found.value == rows
    said = re.search(r"± (\S+) between the rows", found.where)
    assert said is not None
    assert float(said[1]) == pytest.approx(1.0 - rows, rel=0.1)
    with pytest.raises(NotMeasured, match="lies between the rows"):
        find("peak", result, max=0.9995)
    assert not find("peak", result, max=0.9).passed


def test_rise_of_a_first_order_lag() -> None:
    time = [0.001 * k for k in range(10_001)]
    result = {"command": "simulate", "time": time, "signals": {"y": [1.0 - math.exp(-t) for t in time]}, "units": {}}
    assert find("rise time", result, max=3).value == pytest.approx(math.log(9.0), rel=1e-3)


def test_a_step_that_is_not_at_rest_is_not_judged() -> None:
    with pytest.raises(NotMeasured, match="not at rest at the end"):
        find("settling time", step_response(stop=0.9), after=0.5, max=2)
    found = find("settling time", step_response(stop=0.9), after=0.5, max=2, final=3.0, band=0.9)
    assert found.passed


def test_the_step_begins_between_samples() -> None:
    result = {"command": "simulate", "time": [0.0, 0.4, 1.0, 2.0, 3.0], "units": {}}
    result["signals"] = {"y": [0.0, 0.0, 1.0, 1.0, 1.0]}
    # From 0.4 s the record rises straight to 1 at 1 s; 2 % are left at 0.988 s.
    found = find("settling time", result, after=0.5, max=4)
    assert found.value == pytest.approx(0.488)
    with pytest.raises(NotMeasured, match="lies between the rows"):  # five rows leave open where the signal settles
        find("settling time", result, after=0.5, max=2)


# -- limit cycles, identification, agreement, paths ----------------------------------------------


CYCLES: dict[str, Any] = {
    "command": "limit-cycle",
    "block_input": "damper.rate",
    "limit_cycles": [
        {"method": "describing function", "amplitude": 0.22, "frequency_hz": 2.64, "stable": True},
        {"method": "simulation", "amplitude": 0.21, "frequency_hz": 2.63, "stable": True, "amplitudes": {"tip": 0.13}},
        {"method": "simulation", "amplitude": 0.5, "frequency_hz": 3.3, "stable": False, "amplitudes": {"tip": 0.4}},
    ],
    "simulated": {"frequency_hz": 2.63, "amplitude": {"tip": 0.13}, "units": {"tip": "m", "damper.rate": "rad/s"}},
}


def test_limit_cycles() -> None:
    found = find("limit cycle amplitude", CYCLES, max=0.3)
    assert (found.value, found.unit, found.where) == (0.21, "rad/s", "2.63 Hz, simulation")
    assert find("limit cycle amplitude", CYCLES, max=0.3, unstable=True).value == 0.5
    assert find("limit cycle amplitude", CYCLES, signal="tip", max=150, unit="mm").value == pytest.approx(130.0)
    # The largest counts, of a signal as of the block's input.
    assert find("limit cycle amplitude", CYCLES, signal="tip", max=0.3, unstable=True).value == 0.4
    with pytest.raises(InputError, match="a signal is measured in a simulation, not by shooting"):
        find("limit cycle amplitude", CYCLES, signal="tip", method="shooting", max=1)
    assert find("limit cycle frequency", CYCLES, equal=2.64, relative=0.005).passed
    with pytest.raises(InputError, match="signal 'tap' was not measured; did you mean tip"):
        find("limit cycle amplitude", CYCLES, signal="tap", max=1)
    with pytest.raises(NotMeasured, match="but not by shooting"):
        find("limit cycle amplitude", CYCLES, method="shooting", max=1)


def test_no_limit_cycle_has_no_amplitude() -> None:
    none = {**CYCLES, "limit_cycles": [], "simulated": None}
    assert find("limit cycle amplitude", none, max=0.0).passed
    with pytest.raises(NotMeasured, match="no limit cycle"):
        find("limit cycle frequency", none, max=1)


def test_stable_gains() -> None:
    result = {"command": "feedback", "stable_gains": [[-1.3125, -0.3185], [2.0, None]]}
    found = find("stable gains", result, contains=[-1.0])
    assert found.value == pytest.approx(0.3125)
    assert found.passed
    assert not find("stable gains", result, contains=[-1.0, -0.2]).passed
    assert find("stable gains", result, contains=[5.0], reserve=1.0).margin == pytest.approx(2.0)


def test_fit_of_the_worst_output() -> None:
    result = {"command": "identify", "order": 2, "validation": {"fit_percent": {"a": 98.0, "b": 90.0}}}
    found = find("fit", result, min=95)
    assert (found.value, found.where) == (90.0, "b, order 2")
    with pytest.raises(NotMeasured, match="not validated"):
        find("fit", {**result, "validation": None}, min=95)


def test_agreement_of_numbers() -> None:
    a, b = {"command": "lin", "A": [[1.0, 2.0]]}, {"command": "lin", "A": [[1.0, 2.1]]}
    found = find("agreement", a, b, path="A", tolerance=0.2, **{"with": "b"})
    assert found.value == pytest.approx(0.1)
    assert found.where == "[0][1]: 2 and 2.1"
    assert not find("agreement", a, b, path="A", relative=0.01, **{"with": "b"}).passed
    same = find(
        "agreement", CYCLES, CYCLES, relative=0.05, path="limit_cycles[method=describing function].amplitude",
        with_path="limit_cycles[method=simulation][0].amplitude",
    )  # fmt: skip
    assert same.margin == pytest.approx(0.05 * 0.21 - 0.01)


def test_responses_agree_whole_turns_apart() -> None:
    mine = nfr({1.0: [1.0, 1j]}, [1.0, 2.0])
    other = {**mine, "phase_deg": [[360.0, 449.0]]}
    found = find("response agreement", mine, other, deg=2, **{"with": "b"})
    assert found.value == pytest.approx(1.0)
    assert found.where == "2 Hz"


def test_paths() -> None:
    data = {"a": {"b.c": [1, {"d": [3, 4]}]}, "list": [{"k": "x", "v": 1}, {"k": "y", "v": 2}]}
    assert found_at(data, 'a."b.c"[1].d[-1]') == [("", 4)]
    assert found_at(data, "list[k=y].v") == [("", 2)]
    assert found_at(data, "list[*].v") == [("[0]", 1), ("[1]", 2)]
    for path, message in {
        "a.x": "there is no 'x'", "list[5]": r"no \[5\] in a list of 2", "a[0]": "no list before",
        "a..b": "cannot be read",
    }.items():  # fmt: skip
        with pytest.raises(InputError, match=message):
            found_at(data, path)


def test_a_key_that_no_item_has_is_a_mistake() -> None:
    found = {"command": "lin", "notes": ["one"], "zeros": [{"kind": "input"}, {"kind": "state", "name": "x"}]}
    assert find("value", found, path="zeros[name=y]", count=True, max=0).passed
    with pytest.raises(InputError, match="no item has 'nam'; did you mean name"):
        find("value", found, path="zeros[nam=y]", count=True, max=0)
    for notes in (["one"], []):
        with pytest.raises(InputError, match=r"items of the list are not tables.*methd"):
            find("value", {"command": "lin", "notes": notes}, path="notes[methd=xyz]", count=True, max=0)
    with pytest.raises(InputError, match="no item has 'colum'; did you mean column"):
        find("value", {"command": "lin", "doubtful": []}, path="doubtful[colum=x]", count=True, max=0)
    assert find("value", {"command": "lin", "doubtful": []}, path="doubtful[column=x]", count=True, max=0).passed


def test_any_value() -> None:
    result = {"command": "info", "runnable": True, "inputs": [{"unit": "deg"}], "x": [[0.5, -2.0]], "none": None}
    assert find("value", result, path="runnable", equal=True).passed
    assert not find("value", result, path="inputs[0].unit", equal="rad").passed
    assert find("value", result, path="x", absolute=True, max=1).value == 2.0
    assert find("value", result, path="inputs", count=True, min=1).value == 1.0
    with pytest.raises(NotMeasured, match="no value at none"):
        find("value", result, path="none", max=1)


def test_every_kind_is_documented_and_says_what_it_reads() -> None:
    for name, kind in KINDS.items():
        assert kind.__doc__, name
        fields = {f for c in kind.__mro__ if hasattr(c, "model_fields") for f in vars(c).get("__annotations__", {})}
        text = " ".join(c.__doc__ or "" for c in kind.__mro__)
        missing = [
            f
            for f in fields
            if f not in text and f not in ("model_config", "commands", "units", "quantity", "between_rows")
        ]
        assert not missing or missing == ["number"] or set(missing) <= {"number", "place"}, (name, missing)


def test_the_picture_of_a_step_tells_final_value_and_limit_apart_and_marks_where_the_limit_is_broken() -> None:
    style: dict[str, Any] = {"title": "t", "name": "y", "unit": "deg", "final": 1.0}
    time, values = [0.0, 1.0, 2.0, 3.0], [0.0, 1.3, 0.9, 1.0]
    over = plot_step(time, values, highest=1.2, violated=(1.0, 1.3), **style)
    ax = over.axes[0]
    lines = {str(line.get_label()): line for line in ax.lines}
    assert set(lines) == {"y", "final value", "limit", "limit violated"}
    final, limit = lines["final value"], lines["limit"]
    assert (final.get_linestyle(), final.get_color()) != (limit.get_linestyle(), limit.get_color())
    assert np.ravel(lines["limit violated"].get_xydata()).tolist() == [1.0, 1.3]
    settling = plot_step(time, values, band=("± 2 % of the step", 0.02), times={"settled": 2.9, "limit": 3.5}, **style)
    (legend,) = settling.legends
    assert [text.get_text() for text in legend.get_texts()].count("± 2 % of the step") == 1
    assert len(legend.get_texts()) == 5


@pytest.mark.parametrize(("unit", "limit"), [(None, 0.5), ("ms", 500.0)])
def test_the_limit_of_a_settling_time_is_drawn_where_it_is_whatever_its_unit(unit: str | None, limit: float) -> None:
    time = np.linspace(0.0, 10.0, 2001)
    record = {
        "command": "simulate", "time": time.tolist(), "signals": {"y": (1.0 - np.exp(-time)).tolist()},
        "units": {"y": None},
    }  # fmt: skip
    asked = {"name": "r", "analysis": "a", "kind": "settling time", "max": limit, **({"unit": unit} if unit else {})}
    requirement = read_requirement(asked, "here")
    assert isinstance(requirement, SettlingTime)
    ax = _step(requirement, record, "title", requirement.find([record])).axes[0]
    lines = {str(line.get_label()): line for line in ax.lines}
    assert np.asarray(lines["limit"].get_xdata(), dtype=np.float64)[0] == pytest.approx(0.5)
    assert np.asarray(lines["settled"].get_xdata(), dtype=np.float64)[0] == pytest.approx(math.log(50.0), rel=1e-3)
    x, y = np.ravel(lines["limit violated"].get_xydata())
    assert (x, y) == pytest.approx((math.log(50.0), 0.98), rel=1e-2)
