"""The elevator law does what chapter 6 of the source report says of it, on the bundled FMUs."""

from __future__ import annotations

import math

import numpy as np
import pytest

import workbench as wb
from scripts.reproduce.targets import read_targets
from workbench.jobs.options import Workers

PERIOD = 0.022
TARGETS = read_targets()
HERE = Workers(in_process=True)
# A demand of 7 degrees on both sides for a full stick: the sine whose fate at three frequencies is published.
SEVEN = {
    "positiveByFlap[1]": 7.0,
    "negativeByFlap[1]": 7.0,
    "positiveGain": 7.0,
    "negativeGain": 7.0,
    "stickOut[2]": -0.5,
    "stickOut[4]": 0.5,
    "offsetByFlap[1]": 0.0,
    "deflection": 0.0,
}


def steady(fmu: str = "fmu:ElevatorLaw", *, interface: str = "me", **inputs: float) -> float:
    """Elevator [deg] after a minute of constant inputs."""
    signals = {name: wb.Constant(value) for name, value in inputs.items()}
    with wb.load(fmu, interface) as law:
        result = wb.simulate(law, stop=60.0, inputs=signals, outputs=["elevator"], verify_step=False)
    return float(result.signals["elevator"][-1])


def test_four_discrete_states_sampled_at_46_hz() -> None:
    with wb.load("fmu:ElevatorLaw") as law, law.open_session() as session:
        states = ["positiveGain", "negativeGain", "normalFor", "deflection"]
        declared = {v.name: v for v in law.description.variables}
        assert [declared[n].variability for n in states] == ["discrete"] * 4
        record = session.advance(0.5, signals={"side_stick": wb.Constant(1.0)}, record=["elevator"])
        jumps = record.time[1:][np.diff(record.values["elevator"]) != 0.0]
        assert jumps == pytest.approx(PERIOD * np.round(jumps / PERIOD), abs=1e-9)


def test_rate_limiter_passes_distorts_and_makes_a_triangle_of_seven_degrees() -> None:
    """At 2 Hz the limiter never catches up: a triangle of 30 deg/s, peak 30/(4 f), whose fundamental is 8/π² of it.

    At 0.5 Hz the slope of 7·2π·0.5 = 22 deg/s stays below the limit; the third harmonic of a triangle is 1/9.
    """
    with wb.load("fmu:ElevatorLaw", start_values=SEVEN) as law:
        result = wb.nfr(law, "side_stick", "elevator", [0.5, 1.0, 2.0], [1.0], workers=HERE, drift_check=False)
    fundamental = TARGETS["limiter-fundamental"]
    assert isinstance(fundamental.value, list)
    assert fundamental.value[2] == pytest.approx(8.0 / math.pi**2 * 30.0 / 8.0, rel=1e-6)
    assert fundamental.accepts(result.gain[0])
    third = [c.harmonics[1] for c in result.certificates[0] if c is not None]
    assert TARGETS["limiter-harmonic"].accepts([np.nan if h is None else h for h in third])


def test_positive_deflection_is_15_to_20_percent_larger_in_every_flap_setting() -> None:
    factors = []
    for flap in range(5):
        neutral = steady(flap=float(flap))
        # Half a stick, which the shape makes 0.48: a full one meets the limit of 15 deg with flaps out.
        forward, aft = (abs(steady(flap=float(flap), side_stick=s) - neutral) / 0.48 for s in (0.5, -0.5))
        assert TARGETS["law-positive"].accepts(forward / aft), flap
        factors += [aft, forward]
    assert TARGETS["law-gains"].accepts([min(factors), max(factors)])
    assert factors[::2] == sorted(factors[::2])
    assert factors[1::2] == sorted(factors[1::2])


def test_one_failed_elevator_doubles_the_other_and_ground_has_its_own_gains() -> None:
    both = steady(side_stick=1.0) - steady()
    one = steady(side_stick=1.0, elevator_failed=1.0) - steady(elevator_failed=1.0)
    assert one == pytest.approx(min(2.0 * both, 15.0 - steady()), rel=1e-9)  # the limit of 15 deg comes first
    aft = steady(side_stick=-1.0, on_ground=1.0) - steady(on_ground=1.0)
    assert TARGETS["law-ground"].accepts(-aft)


def test_limits_are_never_reached_in_normal_flight_with_flaps_in() -> None:
    assert TARGETS["law-never-limited"].accepts([steady(side_stick=-1.0), steady(side_stick=1.0)])
    # beyond the stick's stop nothing is added
    assert steady(side_stick=2.0) == steady(side_stick=1.0)


def test_every_version_and_interface_agrees() -> None:
    values = {
        steady(fmu, interface=interface, side_stick=0.37, flap=2.0)
        for fmu in ("fmu:ElevatorLaw", "fmu:ElevatorLaw@3")
        for interface in ("me", "cs")
    }
    assert max(values) - min(values) < 1e-12
