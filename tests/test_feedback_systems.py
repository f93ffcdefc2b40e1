"""Feedback on systems of FMUs and functions: published figures, a van der Pol oscillator, third-party plants."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import control
import numpy as np
import pytest

from scripts.reproduce.targets import read_targets
from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.limit_cycles.feedback.actuator import wrapped
from workbench.limit_cycles.feedback.block import cut_at, find_block
from workbench.limit_cycles.feedback.closed_system import find_place
from workbench.limit_cycles.feedback.gains import crossings, intervals, stable_gains
from workbench.limit_cycles.feedback.request import feedback
from workbench.limit_cycles.feedback.result import FeedbackResult
from workbench.model.described_model import DescribedModel
from workbench.signals.kinds import Table
from workbench.system.connect import connect
from workbench.system.load import load

SYSTEMS = Path(__file__).resolve().parents[1] / "systems"
POSITION, RATE, INNER = "aircraft.outer_aileron_position", "aircraft.outer_aileron_rate", "aircraft.inner_aileron"

AT_START = OperatingPoint(x={}, u={})


def within(name: str, measured: object) -> bool:
    return read_targets()[name].expects(np.asarray(measured, dtype=np.float64))


@pytest.fixture(scope="module")
def aircraft() -> Iterator[DescribedModel]:
    with load(SYSTEMS / "failed_aileron.toml") as model:
        yield model


@pytest.fixture(scope="module")
def position(aircraft: DescribedModel) -> FeedbackResult:
    return feedback(
        aircraft, source=POSITION, target=INNER, settle=True, settle_gains=(-1.28, -0.78), count=6, order=3,
        threshold=3e-5, longest=80.0,
    )  # fmt: skip


# -- the failed aileron ------------------------------------------------------------------------


def test_stable_gains_of_the_position_feedback(position: FeedbackResult) -> None:
    (interval,) = position.stable_gains
    assert within("position-gains", interval)
    bounds = sorted(c.real for c in position.crossings if c.gain in interval)
    assert within("position-crossings", bounds)
    assert position.unstable_open == 2
    assert position.fixed == ()


def test_no_gain_stabilises_the_rate_feedback(aircraft: DescribedModel) -> None:
    result = feedback(aircraft, source=RATE, target=INNER, count=1)
    negative = [c for c in result.crossings if c.real < 0.0]
    assert within("rate-crossings", len(negative))
    assert within("rate-gains-negative", sum(low < 0.0 for low, _ in result.stable_gains))
    assert within("rate-gains-positive", sum(high > 0.0 for _, high in result.stable_gains))
    assert "no gain stabilises" in result.words
    with pytest.raises(InputError, match="no gain stabilises"):
        feedback(aircraft, source=RATE, target=INNER, settle=True, count=1)


def test_no_cycle_is_left_in_the_stable_interval(position: FeedbackResult) -> None:
    assert position.block == "damper"
    assert [c.cycles for c in position.cycles] == [()] * 6
    assert all(c.unstable_small == c.unstable_large == 0 for c in position.cycles)


def test_outside_the_interval_a_cycle_stays(aircraft: DescribedModel) -> None:
    place = find_place(aircraft, POSITION, INNER)
    with ExitStack() as keep:
        two = cut_at(place, AT_START, "damper", time=0.0, keep=keep)
        without = two.left(0.0, band=(0.1, 6.0), amplitudes=(1e-4, 1e4))
        beyond = two.left(-1.35, band=(0.1, 10.0), amplitudes=(1e-4, 1e4))
    (steady,) = [c for c in without.cycles if c.stable]
    assert steady.frequency_hz == pytest.approx(2.64, abs=0.01)  # the limit cycle of chapter 8.3
    assert steady.amplitude == pytest.approx(0.217, rel=0.025)
    assert any(c.stable for c in beyond.cycles)


def test_settling_study_of_the_aircraft(position: FeedbackResult) -> None:
    study = position.settling
    assert study is not None
    assert study.variable == "damper.rate"
    assert study.motion.frequency == pytest.approx(2.639, rel=5e-3)
    assert len(study.gains) == len(study.settling_seconds) == 6
    assert all(t is not None for t in study.settling_seconds)
    assert not study.optimum_at_end
    assert study.optimum is not None
    assert study.gains[0] < study.optimum < -1.0


def test_fastest_oscillation_by_a_scan_of_the_eigenvalues(position: FeedbackResult) -> None:
    (best,) = position.fastest
    assert best is not None

    def slowest(gain: float) -> float:
        poles = position.plant.poles_at(gain)
        return float(poles.real[np.abs(poles.imag) > np.abs(poles.real)].max())

    gains = np.linspace(-1.31, -0.32, 300)
    rates = [slowest(g) for g in gains.tolist()]
    assert best.growth <= min(rates) + 1e-9
    assert abs(best.gain - gains[int(np.argmin(rates))]) < 0.01


def test_unit_gain_closed_on_the_limit_cycle_removes_it_within_the_limits(aircraft: DescribedModel) -> None:
    result = feedback(
        aircraft,
        source=POSITION,
        target=INNER,
        gain=-1.0,
        stop=80.0,
        limit=math.radians(25.0),
        rate_limit=math.radians(40.0),
        outputs=["aircraft.inner_aileron_position", "aircraft.inner_aileron_rate"],
        count=2,
    )
    run = result.run
    assert run is not None
    assert within("feedback-left", run.left(60.0))
    after = run.time >= run.closes_at
    assert within("feedback-deflection", np.degrees(np.abs(run.signals["aircraft.inner_aileron_position"]).max()))
    assert within("feedback-rate", np.degrees(np.abs(run.signals["aircraft.inner_aileron_rate"]).max()))
    assert np.abs(run.handed[~after]).max() < 1e-9
    # The sudden engagement asks for more than 40 deg/s: the actuator gives so much and no more.
    assert run.to_dict()["peak_rate"] == pytest.approx(math.radians(40.0), rel=1e-3)


def test_lag_of_an_actuator_narrows_the_interval(aircraft: DescribedModel, position: FeedbackResult) -> None:
    """The bundled actuator follows with 5 ms, which turns the phase at 4 Hz by 7°."""
    (wide,) = position.stable_gains
    place = find_place(aircraft, POSITION, INNER)
    plant = place.linear(AT_START, time=0.0, actuator=wrapped("fmu:LimitedActuator")).part().balanced()
    (narrow,) = stable_gains(intervals(plant, [c.gain for c in crossings(plant)]), (-math.inf, math.inf))
    assert wide[0] < narrow[0] < narrow[1] < wide[1]


# -- van der Pol -------------------------------------------------------------------------------

MU = 0.1


def van_der_pol(sign: float = 1.0) -> DescribedModel:
    """y'' − μ(1 − y²)y' + y = 0, its cubic in a block; with u = g·y added, μ(1 + g − y²)."""
    return connect(
        {"block": lambda u: sign * u**3 / 3.0, "plant": control.ss(control.tf([MU, 0.0], [1.0, -MU, 1.0]))},
        [("plant.y", "block.u"), ("block.y", "plant.u", {"gain": -1.0})],
        outputs={"y": "plant.y"},
    )


def test_van_der_pol_settles_as_the_averaged_equation_says() -> None:
    """dA²/dt = μA²(c − A²/4) with c = 1 + g and A = 2 at the beginning.

    Its solution is A²/4 = c/(1 + (c − 1)e^(−μct)).
    """
    with van_der_pol() as system:
        assert find_block(system) == ("block", "")
        result = feedback(
            system, source="plant.y", target="plant.u", settle=True, settle_gains=(-4.0, -1.5), count=6,
            threshold=0.05,
        )  # fmt: skip
    assert np.array(result.stable_gains) == pytest.approx(np.array([[-math.inf, -1.0]]))
    assert [c.frequency_hz for c in result.crossings] == pytest.approx([1.0 / (2.0 * math.pi)])
    study = result.settling
    assert study is not None
    assert study.motion.magnitude == pytest.approx(4.0 / math.pi, rel=2e-3)
    for run in study.runs:
        c = -(1.0 + run.gain)
        expected = math.log((c / 0.05**2 + 1.0) / (c + 1.0)) / (MU * c)
        # The magnitude is a mean over the cycle before.
        assert run.settling_seconds == pytest.approx(expected + math.pi, abs=0.35 * 2.0 * math.pi)


def test_limits_of_deflection_are_respected_and_told() -> None:
    """At the beginning the gain asks for 6, and gets 1."""
    with van_der_pol() as system:
        result = feedback(
            system, source="plant.y", target="plant.u", settle=True, settle_gains=(-3.0, -2.0), count=1, limit=1.0,
            longest=60.0,
        )  # fmt: skip
    assert result.settling is not None
    (run,) = result.settling.runs
    assert run.limit_reached
    assert run.deflection_limited is not None
    assert run.deflection_limited > 5.0
    assert run.peak_deflection == pytest.approx(1.0, rel=1e-6)
    assert run.rate_limited is None
    assert any("deflection reached its limit" in n for n in result.notes)


def test_van_der_pol_keeps_a_cycle_below_the_stable_gain() -> None:
    with van_der_pol() as system, ExitStack() as keep:
        place = find_place(system, "plant.y", "plant.u")
        two = cut_at(place, AT_START, "block", time=0.0, keep=keep)
        for gain in (0.0, -0.5, -0.9):
            left = two.left(gain, band=(0.01, 10.0), amplitudes=(1e-3, 1e3))
            (cycle,) = left.cycles
            assert cycle.amplitude == pytest.approx(2.0 * math.sqrt(1.0 + gain), rel=1e-9)
            assert cycle.stable
            assert (left.unstable_small, left.unstable_large) == (2, 0)


def test_what_large_motions_do_is_told() -> None:
    """With the cubic's sign turned, motions above A = 2√−c grow although every pole is stable."""
    with van_der_pol(sign=-1.0) as system:
        result = feedback(system, source="plant.y", target="plant.u", gains=(-5.0, -2.0), count=3)
    for left in result.cycles:
        (cycle,) = left.cycles
        assert cycle.amplitude == pytest.approx(2.0 * math.sqrt(-1.0 - left.gain), rel=1e-9)
        assert not cycle.stable
        assert (left.unstable_small, left.unstable_large) == (0, 2)
        assert "not from all larger ones" in left.words


def test_a_motion_excited_by_a_signal_is_settled_too() -> None:
    plant = control.ss(control.tf([1.0, 0.0], [1.0, 0.2, 4.0]))
    with connect(
        {"plant": plant, "in": 1.0}, [("in.y", "plant.u")], inputs={"u": "in.u"}, outputs={"y": "plant.y"}
    ) as s:
        studies = [
            feedback(
                s, source="y", target="u", settle=True, settle_gains=(-0.8, -0.1), count=4, threshold=threshold,
                signals={"u": Table([0.0, 1.0, 1.0], [1.0, 1.0, 0.0])}, start_after=16.0,
            ).settling
            for threshold in (0.2, 0.02)
        ]  # fmt: skip
    early, late = ([] if study is None else study.settled for study in studies)
    assert len(early) == len(late) == 4
    for one, other in zip(early, late, strict=True):  # decay 0.1 − g/2
        apart = (other.settling_seconds or 0.0) - (one.settling_seconds or 0.0)
        assert apart == pytest.approx(math.log(10.0) / (0.1 - one.gain / 2.0), rel=0.1, abs=0.3)


# -- what a feedback is added to ---------------------------------------------------------------


@pytest.mark.parametrize("target", ["plant.u", "u"])
def test_feedback_is_added_to_what_acts_already(target: str) -> None:
    """(s + 1)³ with an inner feedback of −2 on the same input: −8 < g − 2 < 1."""
    lag = control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))
    parts: dict[str, object] = {"plant": lag, "inner": -2.0}
    if target == "plant.u":
        system = connect(parts, [("plant.y", "inner.u"), ("inner.y", "plant.u")], outputs={"y": "plant.y"})
        expected = (-6.0, 3.0)
    else:
        system = connect({"plant": lag}, inputs={"u": "plant.u"}, outputs={"y": "plant.y"})
        expected = (-8.0, 1.0)
    with system:
        (interval,) = feedback(system, source="y", target=target).stable_gains
    assert interval == pytest.approx(expected)


def test_limits_of_the_gain_cut_the_intervals() -> None:
    with connect(
        {"plant": control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))}, inputs=["plant.u"], outputs=["plant.y"]
    ) as system:
        result = feedback(system, source="plant.y", target="plant.u", gains=(-3.0, 30.0))
    assert np.array(result.stable_gains) == pytest.approx(np.array([[-3.0, 1.0]]))
    found = json.loads(json.dumps(result.to_dict()))
    assert found["stable_gains"] == [[-3.0, pytest.approx(1.0)]]
    assert found["searched"] == [-3.0, 30.0]


def test_an_open_end_is_null_in_json() -> None:
    with connect({"plant": control.ss(control.tf([1.0], [1.0, -1.0]))}, inputs=["plant.u"], outputs=["plant.y"]) as s:
        found = json.loads(json.dumps(feedback(s, source="plant.y", target="plant.u").to_dict(), allow_nan=False))
    assert found["stable_gains"] == [[None, pytest.approx(-1.0)]]


def test_a_hidden_pole_is_named_in_the_answer() -> None:
    hidden = control.ss(np.diag([-1.0, 0.5]), [[1.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    with connect({"plant": hidden}, inputs={"u": "plant.u"}, outputs={"y": "plant.y"}) as system:
        result = feedback(system, source="y", target="u")
    assert result.words == "no gain stabilises the system: the feedback does not move the real pole at 0.5 1/s"


def test_a_sampled_plant() -> None:
    lag = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    with connect({"plant": lag}, inputs={"u": "plant.u"}, outputs={"y": "plant.y"}) as system:
        result = feedback(system, source="y", target="u")
    assert result.plant.dt == pytest.approx(0.1)
    assert np.array(result.stable_gains) == pytest.approx(np.array([[-1.5, 0.5]]))
    assert any("sampled" in n for n in result.notes)


def test_one_output_to_several_inputs_with_weights() -> None:
    """x' = x + u1 + 2 u2, and u1 = g/2 x, u2 = g/4 x: the pole is 1 + g."""
    plant = control.ss([[1.0]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]], inputs=["u1", "u2"], outputs=["y"])
    parts = {"plant": plant, "shared": 1.0, "first": 0.5, "second": 0.25}
    wires = [("shared.y", "first.u"), ("shared.y", "second.u"), ("first.y", "plant.u1"), ("second.y", "plant.u2")]
    with connect(parts, wires, inputs={"u": "shared.u"}) as system:
        assert feedback(system, source="plant.y", target="shared.u").stable_gains == ((-math.inf, -1.0),)
    with connect({"plant": plant}, [], inputs={"both": ["plant.u1", "plant.u2"]}) as system:
        words = r"both drives several inputs \(plant.u1, plant.u2\); name one of them, or let a gain of 1 drive them"
        with pytest.raises(InputError, match=words):
            feedback(system, source="plant.y", target="both")


# -- FMUs of others ----------------------------------------------------------------------------


@needs_gemseo
def test_third_party_fmu() -> None:
    """Mass 1 kg with damper and no spring: the interval of position feedback is bounded by 0."""
    with load(gemseo_fmu("Mass_Damper")) as model:
        result = feedback(model, source="y", target="f")
    closed = [np.linalg.eigvals(result.plant.closed(g)).real.max() for g in (-1.0, 1.0)]
    stable = [any(low < g < high for low, high in result.stable_gains) for g in (-1.0, 1.0)]
    assert stable == [c < 0.0 for c in closed]
    assert any(stable)


def test_rudder_with_an_outer_loop_agrees_with_simulation() -> None:
    """Just inside the border the linear model decays, just outside it grows; so does the rudder itself."""
    with load("fmu:Rudder") as rudder:
        result = feedback(rudder, source="del", target="delC")
        ends = [g for pair in result.stable_gains for g in pair if math.isfinite(g)]
        assert result.stable_gains
        assert any(low < 0.0 < high for low, high in result.stable_gains)
    for end in ends:
        assert result.plant.growth(end) == pytest.approx(0.0, abs=1e-6)


# -- wrong input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        ("aircraft.outer_aileron_positon", INNER, "did you mean aircraft.outer_aileron_position"),
        (INNER, INNER, "is an input; its outputs are: "),
        (POSITION, POSITION, "is an output; its inputs are: "),
        (POSITION, "aircraft.iner_aileron", "did you mean aircraft.inner_aileron"),
        ("aircraft.airspeed", INNER, "is a parameter"),
    ],
)
def test_wrong_names_say_what_to_do(aircraft: DescribedModel, source: str, target: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        feedback(aircraft, source=source, target=target)


def test_a_block_that_holds_the_target_is_none(aircraft: DescribedModel) -> None:
    with pytest.raises(InputError, match="block aircraft contains the feedback's source"):
        feedback(aircraft, source=POSITION, target=INNER, block="aircraft")


def test_nothing_to_settle_from_is_told() -> None:
    with (
        connect(
            {"plant": control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))}, inputs=["plant.u"], outputs=["plant.y"]
        ) as system,
        pytest.raises(InputError, match="no nonlinear block is known"),
    ):
        feedback(system, source="plant.y", target="plant.u", settle=True)


def test_a_stable_system_with_a_block_has_no_cycle_to_settle_from() -> None:
    plant = control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))
    with (
        connect(
            {"plant": plant, "block": lambda u: np.clip(u, -1.0, 1.0)},
            [("plant.y", "block.u"), ("block.y", "plant.u", {"gain": -1.0})],
            outputs=["plant.y"],
        ) as system,
        pytest.raises(InputError, match="no stable limit cycle is predicted"),
    ):
        feedback(system, source="plant.y", target="plant.u", settle=True)
