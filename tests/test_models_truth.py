"""What the READMEs of the bundled models state, measured on the Modelica sources with rumoca's own simulator."""

from __future__ import annotations

import cmath
import math
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from scripts.reproduce.targets import read_targets
from tests import rudder_reference as reference

rumoca = pytest.importorskip("rumoca", reason="not installed: pip install 'fmi-workbench[build]'")

Vector = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

SOURCES = Path(__file__).resolve().parents[1] / "modelica_src"
GRID_POINT = 1.2**15  # the sixteenth frequency of the band 1 … 30 Hz, 15.407 Hz

WRAPPER = """
model Wrapper
  {model} m;
  Real inPhase(start = 0, fixed = true);
  Real quadrature(start = 0, fixed = true);
  Real area(start = 0, fixed = true);
equation
{bindings}
  der(inPhase) = m.{output} * sin({omega!r} * time);
  der(quadrature) = m.{output} * cos({omega!r} * time);
  der(area) = m.{output};
end Wrapper;
"""


class Result(Protocol):
    """What rumoca's simulator returns."""

    time: Vector

    def __getitem__(self, name: str) -> Vector: ...


def sine(amplitude: float, frequency: float) -> str:
    return f"{amplitude!r} * sin({2 * math.pi * frequency!r} * time)"


def oracle(
    model: str, *, inputs: dict[str, str], output: str, times: float, step: float, frequency: float = 1.0
) -> Result:
    """Run a model from its start to `times` [s], each input given as an expression of time."""
    bindings = "\n".join(f"  m.{name} = {expression};" for name, expression in inputs.items())
    wrapper = WRAPPER.format(model=model, bindings=bindings, output=output, omega=2 * math.pi * frequency)
    source = (SOURCES / model / f"{model}.mo").read_text(encoding="utf-8") + wrapper
    compiled = rumoca.Session().loads(source, model="Wrapper", filename="Wrapper.mo")
    config = rumoca.SimConfig(solver="rk-like", rtol=1e-8, atol=1e-10)
    result: Result = compiled.simulate(t=times, dt=step, config=config)
    return result


def column(result: Result, name: str) -> Vector:
    return np.asarray(result[name], dtype=float)


def complex_of(real: npt.ArrayLike, imaginary: npt.ArrayLike) -> Complex:
    return np.asarray(real, dtype=complex) + 1j * np.asarray(imaginary, dtype=complex)


def per_period(result: Result, *, frequency: float, amplitude: float, periods: int) -> tuple[Complex, Vector]:
    """P + jQ and mean of the output over each period."""
    time = np.asarray(result.time, dtype=float)
    ends = np.arange(periods + 1) / frequency
    gained = [np.diff(np.interp(ends, time, column(result, name))) for name in ("inPhase", "quadrature", "area")]
    return 2 * frequency / amplitude * complex_of(gained[0], gained[1]), frequency * gained[2]


def margins(values: Complex, *, errcrit: float) -> Vector:
    """How far successive periods are apart, in units of what counts as settled."""
    turned = np.abs(np.angle(values[1:] / values[:-1])) / errcrit
    grown = np.abs(np.diff(np.abs(values))) / (errcrit / 10)
    return np.maximum(turned, grown)


def decibel(value: complex) -> float:
    return 20 * math.log10(abs(value))


def degrees(value: complex) -> float:
    """Phase between −330° and +30°."""
    angle = math.degrees(cmath.phase(value))
    return angle if angle <= 30 else angle - 360


# ── FirstOrderLag ────────────────────────────────────────────────────────────────────────────────────────────────

TAU = 1.0


def lag_after(period: int, frequency: float, tau: float = TAU) -> complex:
    """Exact P + jQ of one period of the lag forced from rest; what is left of the start decays with exp(−t/tau)."""
    omega = 2 * math.pi * frequency
    settled = 1 / (1 + 1j * omega * tau)
    left = -settled.imag * math.exp(-(period - 1) / (frequency * tau)) * -math.expm1(-1 / (frequency * tau))
    return settled + 2 * frequency * left * complex(omega, 1 / tau) / (tau**-2 + omega**2)


def test_lag_follows_its_analytic_solution() -> None:
    omega = 2 * math.pi * 3
    result = oracle("FirstOrderLag", inputs={"u": sine(1, 3)}, output="y", times=2, step=1 / 300, frequency=3)
    time = np.asarray(result.time, dtype=float)
    h = 1 / (1 + 1j * omega * TAU)
    expected = np.imag(h * np.exp(1j * omega * time)) - h.imag * np.exp(-time / TAU)
    np.testing.assert_allclose(column(result, "m.y"), expected, atol=1e-7)
    measured, _ = per_period(result, frequency=3, amplitude=1, periods=5)
    np.testing.assert_allclose(measured, [lag_after(n, 3) for n in range(1, 6)], atol=1e-7)


@pytest.mark.parametrize(
    ("tau", "errcrit", "gain", "phase"),
    [(1.0, 0.1, 0.0031, 4.5), (1.0, 0.001, 0.00005, 0.53), (0.1, 0.1, 0.0004, 1.53), (0.1, 0.001, 0.00001, 0.03)],
)
def test_published_settling_test_leaves_the_lag_this_far_from_theory(
    tau: float, errcrit: float, gain: float, phase: float
) -> None:
    errors = []
    for frequency in np.geomspace(0.1, 10, 200):
        values = np.array([lag_after(n, frequency, tau) for n in range(1, 21)])
        settled = int(np.argmax(margins(values, errcrit=errcrit) <= 1)) + 1
        errors.append(values[settled] * (1 + 2j * math.pi * frequency * tau))
    assert max(abs(abs(e) - 1) for e in errors) < gain
    assert 0.9 * phase < max(abs(math.degrees(cmath.phase(e))) for e in errors) < phase


# ── TwoRateQuantizer ─────────────────────────────────────────────────────────────────────────────────────────────


def held(frequency: float, amplitude: float, *, rate: float, resolution: float, periods: int) -> tuple[Complex, Vector]:
    """Exact P + jQ and mean of every period of one sampled quantiser."""
    samples = np.arange(math.floor(periods / frequency * rate + 1e-9) + 1) / rate
    values = resolution * np.floor(amplitude * np.sin(2 * math.pi * frequency * samples) / resolution + 0.5)
    edges = np.union1d(samples[samples < periods / frequency], np.arange(periods + 1) / frequency)
    value = values[np.floor(edges[:-1] * rate + 1e-9).astype(int)]
    angle = 2 * math.pi * frequency * edges
    period = np.floor((edges[:-1] + edges[1:]) / 2 * frequency).astype(int)
    weights = (-np.diff(np.cos(angle)), np.diff(np.sin(angle)), np.diff(edges))
    sums = [np.bincount(period, value * weight, periods) for weight in weights]
    mean: Vector = np.asarray(frequency * sums[2], dtype=np.float64)
    return complex_of(sums[0], sums[1]) / (math.pi * amplitude), mean


def quantised(frequency: float, amplitude: float = 1.0, periods: int = 20) -> tuple[Complex, Vector]:
    fast = held(frequency, amplitude, rate=208, resolution=0.05, periods=periods)
    slow = held(frequency, amplitude, rate=131, resolution=0.01, periods=periods)
    return fast[0] + slow[0], fast[1] + slow[1]


def settled_period(frequency: float, amplitude: float = 1.0) -> int:
    """Period at which errcrit 0.08 calls the exact values settled; 0 when none of 20 does."""
    good = margins(quantised(frequency, amplitude)[0], errcrit=0.08) <= 1
    return int(np.argmax(good)) + 2 if good.any() else 0


@pytest.mark.parametrize("frequency", [15.407, 15.39, 8.9161])
def test_quantizer_equals_its_exact_integrals(frequency: float) -> None:
    inputs, period = {"u": sine(1, frequency)}, 1 / frequency
    step = 0.005 * period
    result = oracle("TwoRateQuantizer", inputs=inputs, output="y", times=20 * period, step=step, frequency=frequency)
    measured, mean = per_period(result, frequency=frequency, amplitude=1, periods=20)
    expected, expected_mean = quantised(frequency)
    np.testing.assert_allclose(measured, expected, atol=1e-5)
    np.testing.assert_allclose(mean, expected_mean, atol=1e-5)


@pytest.mark.parametrize("frequency", [15.407, GRID_POINT, GRID_POINT - 1e-6, GRID_POINT + 1e-6])
@pytest.mark.parametrize("amplitude", [0.5, 1.0, 2.0, 5.0, 10.0])
def test_quantizer_never_settles_at_the_published_frequency(frequency: float, amplitude: float) -> None:
    values, _ = quantised(frequency, amplitude)
    assert margins(values, errcrit=0.08).min() > 1.8


@pytest.mark.parametrize(("frequency", "period"), [(15.39, 3), (15.42, 9)])
def test_quantizer_settles_beside_it_and_the_average_fits_in(frequency: float, period: int) -> None:
    assert settled_period(frequency) == period
    neighbour = quantised(frequency)[0][period - 1]
    ratio = quantised(GRID_POINT)[0][10:].mean() / neighbour
    assert abs(decibel(ratio)) < 0.1
    assert abs(math.degrees(cmath.phase(ratio))) < 1


def test_only_one_point_of_the_published_band_is_averaged() -> None:
    band = [1.2**k for k in range(19)] + [30.0]
    assert [round(f, 3) for f in band if settled_period(f) == 0] == [15.407]


def test_offsets_are_small_irregular_and_exactly_what_sampling_makes() -> None:
    band = [1.2**k for k in range(15)]
    offsets = [quantised(f)[1][settled_period(f) - 1] for f in band]
    assert 0.001 < np.max(np.abs(offsets)) < 0.02
    assert min(offsets) < 0 < max(offsets)


# ── Rudder ───────────────────────────────────────────────────────────────────────────────────────────────────────


def rudder(
    command: str,
    *,
    stop: float,
    frequency: float = 1.0,
    step: float = 0.005,
    inputs: reference.Inputs = reference.NORMAL,
) -> Result:
    values = {"delC": command, "pS": repr(inputs.supply), "mH": repr(inputs.moment), "bypass": repr(inputs.bypass)}
    return oracle("Rudder", inputs=values, output="del", times=stop, step=step, frequency=frequency)


def states(result: Result) -> Vector:
    return np.array([column(result, f"m.{name}") for name in reference.STATES])


def measured_rudder(frequency: float, amplitude: float, periods: int = 12) -> complex:
    result = rudder(sine(amplitude, frequency), stop=periods / frequency, frequency=frequency, step=0.005 / frequency)
    values, _ = per_period(result, frequency=frequency, amplitude=amplitude, periods=periods)
    return complex(values[-1])


@pytest.mark.parametrize(
    ("command", "inputs"),
    [
        (10.0, reference.NORMAL),
        (30.0, reference.Inputs(supply=1.5e7)),
        (5.0, reference.Inputs(moment=800.0, bypass=0.5)),
        (0.0, reference.Inputs(moment=-500.0, bypass=1.0)),
    ],
)
def test_rudder_source_equals_its_second_writing(command: float, inputs: reference.Inputs) -> None:
    result = rudder(repr(command), stop=0.5, inputs=inputs)
    time = np.asarray(result.time, dtype=float)
    again = solve_ivp(
        lambda _, x: reference.derivatives(x, command, inputs),
        (0, 0.5), reference.AT_REST, method="BDF", t_eval=time, rtol=1e-8, atol=1e-9 * reference.NOMINAL,
    )  # fmt: skip
    scale = np.max(np.abs(again.y), axis=1, keepdims=True)
    np.testing.assert_allclose(states(result) / scale, again.y / scale, atol=1e-5)


def test_rudder_unforced_is_normal_operation_at_rest() -> None:
    final = states(rudder("0.0", stop=1.0))
    np.testing.assert_array_equal(final, np.repeat(reference.AT_REST[:, None], final.shape[1], axis=1))


def test_rudder_at_ten_hertz_has_the_published_gain_and_phase() -> None:
    value = measured_rudder(10, 1)
    assert read_targets()["rudder-10hz-gain"].accepts(decibel(value))
    assert degrees(value) == pytest.approx(-162.8, abs=0.3)


def test_rudder_has_unity_gain_at_low_frequency() -> None:
    assert abs(measured_rudder(0.1, 1, periods=3)) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("frequency", [3.0, 10.0, 20.0])
def test_rudder_gain_falls_with_amplitude(frequency: float) -> None:
    gains = [decibel(measured_rudder(frequency, amplitude)) for amplitude in (0.5, 1, 2, 5, 10)]
    assert np.all(np.diff(gains) < -0.05)
    assert gains[2] - gains[3] > 1.5
    assert gains[3] - gains[4] > 3


def test_rudder_turns_no_faster_than_the_valve_lets_it() -> None:
    rate = math.degrees(np.max(states(rudder("20.0", stop=1.0))[7]))
    no_load = math.degrees(0.61 * 0.02 * 3.6e-4 * math.sqrt((2.06e7 - 5e5) / 1000) / 4e-3 / 0.15)
    assert no_load == pytest.approx(59.5, abs=0.1)
    assert 0.95 * no_load < rate < no_load


def test_rudder_trim_obeys_statics() -> None:
    x = reference.trim(2.0)
    final = states(rudder("2.0", stop=5.0))[:, -1]
    np.testing.assert_allclose(final / reference.NOMINAL, x / reference.NOMINAL, atol=2e-4)
    force = 4e-3 * (x[0] - x[1])
    assert 0.15 * force == pytest.approx(3000 * x[6], rel=1e-6)
    assert x[4] == pytest.approx(force / 8e7 + 0.15 * x[6], rel=1e-9)
    assert math.degrees(x[6]) == pytest.approx(1.9906, abs=1e-4)


def test_rudder_is_stiff_stable_and_well_damped() -> None:
    a, _ = reference.linearise(reference.trim(2.0), 2.0)
    poles = np.linalg.eigvals(a)
    assert poles.real.max() < 0
    assert np.abs(poles).max() > 1e4
    assert np.min(-poles.real / np.abs(poles)) > 0.13


@pytest.mark.parametrize("frequency", [2.0, 6.0, 20.0])
def test_rudder_at_two_degrees_is_near_its_linear_model(frequency: float) -> None:
    a, b = reference.linearise(reference.trim(2.0), 2.0)
    ratio = reference.response(a, b, frequency) / measured_rudder(frequency, 2, periods=15)
    assert abs(decibel(ratio)) < 0.9
    assert abs(math.degrees(cmath.phase(ratio))) < 3
