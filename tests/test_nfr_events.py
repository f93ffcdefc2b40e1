"""Fundamentals of outputs with events somewhere in the model, against closed forms."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import numpy as np
import pytest

import workbench as wb
from tests.lin_fmus import built
from workbench.core.values.arrays import Floats
from workbench.response.nfr.error import Evidence, quadrature
from workbench.response.periodic.fourier import measure_period
from workbench.session import Recorded

SOURCE = """
model Events
  input Real u(start = 0);
  output Real square;
  output Real cubic;
  output Real pulse;
  output Real clipped;
  output Real folded;
  output Real relay;
  Real x(start = 0, fixed = true);
equation
  der(x) = (if u > 0.5 then 1 else 0) - x;
  square = u * u + 1e-4 * u;
  cubic = 4 * u ^ 3 - 3 * u + 1e-4 * u;
  pulse = if u > 0.5 then 1 else 0;
  clipped = if u > 0.5 then 0.5 else if u < -0.3 then -0.3 else u;
  folded = if u > 0 then 1.1 * u else -u;
  relay = if u > 0 then 1 else -1;
end Events;
"""

ROWS = 200
AMPLITUDES = [0.7, 1.93]


def cubic(amplitude: float) -> float:
    """4u³ − 3u + 1e-4·u: sin³ has the fundamental 3/4."""
    return 3.0 * amplitude**2 - 3.0 + 1e-4


def pulse(amplitude: float) -> float:
    """1 above 1/2."""
    return 2.0 / math.pi * math.sqrt(1.0 - (0.5 / amplitude) ** 2) / amplitude


def clipped(amplitude: float) -> float:
    """u between −0.3 and 0.5: half the describing function of a saturation for each side."""
    angles = [math.asin(level / amplitude) for level in (0.3, 0.5)]
    return sum(a + math.sin(a) * math.cos(a) for a in angles) / math.pi


# Output: (its response, what it may be off, relative).
TRUTH: dict[str, tuple[Callable[[float], float], float]] = {
    "square": (lambda _: 1e-4, 1e-8),
    "cubic": (cubic, 1e-8),
    "pulse": (pulse, 2e-6),
    "clipped": (clipped, 8e-5),
    "folded": (lambda _: 0.05, 1e-5),  # half the difference of the slopes; its kinks are at zero, where sin is
    "relay": (lambda a: 4.0 / (math.pi * a), 2e-6),
}


@pytest.mark.parametrize(
    ("output", "driver"),
    [*((name, "compiled") for name in TRUTH), ("cubic", "python"), ("pulse", "python")],
    indirect=["driver"],
)
def test_the_response_is_the_closed_form_and_within_the_error(output: str, driver: str) -> None:
    truth, off = TRUTH[output]
    with wb.load(built(SOURCE, "Events"), "me") as model:
        result = wb.nfr(
            model, "u", output, frequencies=[1.3], amplitudes=AMPLITUDES, workers=wb.Workers(in_process=True)
        )
    for i, amplitude in enumerate(AMPLITUDES):
        wanted = truth(amplitude)
        error = abs(complex(result.response[i, 0]) - wanted) / abs(wanted)
        assert error < off
        assert error <= result.error[i, 0] + 1e-12


def record_of(y: Callable[[Floats], Floats], events: list[float], points: Floats) -> Recorded:
    """Rows at the points and, two with one time, at events; u has its right limits in the second row."""
    time = np.sort(np.concatenate([[0.0], np.setdiff1d(points, events), np.repeat(events, 2)]))
    side = np.where(np.concatenate([[True], np.diff(time) == 0.0]), 1e-13, -1e-13)
    return Recorded(time=time, values={"y": y(time + side)}, inputs={"u": np.sin(2.0 * np.pi * time)})


@pytest.mark.parametrize("rows", [50, 100, 200])
def test_orders_of_the_error(rows: int) -> None:
    points = np.arange(1, rows + 1) / rows
    h = 2.0 * math.pi / rows
    events = [0.0837, 0.3321, 0.6173]

    def error(y: Callable[[Floats], Floats], wanted: complex) -> float:
        record = record_of(y, events, points)
        harmonics = measure_period(record, input="u", output="y", begin=0.0, frequency=1.0, points=points).harmonics
        return abs(complex(harmonics[1], harmonics[2]) - wanted)

    def between(t: Floats) -> Floats:
        return np.asarray((t > events[0]) & (t < events[1]), dtype=np.float64)

    # ∫ e^(−jωt) over the interval; in-phase + j·quadrature is 2j times that.
    turned = [cmath.exp(-2j * math.pi * e) for e in events[:2]]
    jump = 2j * (turned[1] - turned[0]) / (-2j * math.pi)
    assert error(lambda t: np.cos(6.0 * math.pi * t), 0.0) < 1e-14
    assert error(between, jump) < 2.0 * 0.0081 * 2.0 / math.pi * h**3
    # A tent has the second derivative of pulses: steps of the slope by 1, −2, 1 at the events.
    slopes = np.array([1.0, -(events[2] - events[0]) / (events[2] - events[1]), 0.0])
    slopes[2] = -slopes[0] - slopes[1]
    tent = sum(k * cmath.exp(-2j * math.pi * e) for k, e in zip(slopes, events, strict=True)) / (2j * math.pi) ** 2

    def kinks(t: Floats) -> Floats:
        return np.asarray(sum(k * np.maximum(t - e, 0.0) for k, e in zip(slopes, events, strict=True)))

    bound = float(np.sum(np.abs(slopes))) / (2.0 * math.pi) * h**2 / 12.0 / math.pi
    assert error(kinks, 2j * tent) <= bound
    record = record_of(kinks, events, points)
    harmonics = measure_period(record, input="u", output="y", begin=0.0, frequency=1.0, points=points).harmonics
    stated = quadrature(harmonics, Evidence(rows=rows)) * abs(complex(harmonics[1], harmonics[2]))
    assert error(kinks, 2j * tent) <= stated


def test_an_event_at_a_point_is_one_between_them() -> None:
    points = np.arange(1, ROWS + 1) / ROWS
    found = []
    for event in (points[39], points[39] + 1e-12, points[39] - 1e-12):

        def dropping(t: Floats, event: float = event) -> Floats:
            return np.where(t > event, 1.0, 0.0) * (1.0 - t)

        record = record_of(dropping, [event], points)
        period = measure_period(record, input="u", output="y", begin=0.0, frequency=1.0, points=points)
        found.append(period.harmonics)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-11)
