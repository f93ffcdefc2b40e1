"""Black boxes: pulses, Markov parameters, realisation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.lin_fmus import built
from tests.lying_fmus import build_lying
from tests.mimic_fmus import build_mimic
from workbench.core.values.matrices import unheld
from workbench.errors import InputError, SimulationError
from workbench.model.load import load
from workbench.point.lin.intersample import lines
from workbench.point.lin.realisation import Realisation, realise
from workbench.point.lin.request import lin
from workbench.point.lin.result import Doubt, LinResult
from workbench.point.lin.validation_run import MoveTrial, smallest, trial_levels
from workbench.system.connect import connect


def markov(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, count: int) -> np.ndarray:
    found, state = [D], B
    for _ in range(count - 1):
        found.append(C @ state)
        state = A @ state
    return np.array(found)


def test_a_realisation_is_what_it_was_made_of() -> None:
    random = np.random.default_rng(5)
    A = np.diag([0.95, 0.9, -0.5]) + np.array([[0, 0.1, 0], [-0.1, 0, 0], [0, 0, 0]])
    B, C, D = random.normal(size=(3, 2)), random.normal(size=(2, 3)) * [[1e6], [1e-6]], random.normal(size=(2, 2))
    found = realise(markov(A, B, C, D, 80), noise=1e-13)
    assert len(found.A) == 3
    assert sorted(np.linalg.eigvals(found.A), key=lambda z: (z.real, z.imag)) == pytest.approx(
        sorted(np.linalg.eigvals(A), key=lambda z: (z.real, z.imag)), abs=1e-8
    )
    h = markov(A, B, C, D, 80)

    def missed(part: Realisation) -> float:
        apart = np.abs(markov(part.A, part.B, part.C, part.D, 80) - h).max(axis=0)
        return float((apart / np.abs(h).max(axis=0)).max())

    assert missed(found) < 1e-9
    assert missed(realise(h, noise=1e-13, order=1)) > 1e-3
    with pytest.raises(InputError, match="order must be"):
        realise(markov(A, B, C, D, 9), noise=1e-13, order=9)


def test_a_hold_is_undone() -> None:
    A, B = np.array([[-1.0, 4.0], [-4.0, -1.0]]), np.array([[1.0], [2.0]])
    from scipy.linalg import expm

    block = np.zeros((3, 3))
    block[:2, :2], block[:2, 2:] = A, B
    full = expm(block * 0.1)
    back = unheld(full[:2, :2], full[:2, 2:], 0.1)
    assert np.allclose(back[0], A)
    assert np.allclose(back[1], B)
    with pytest.raises(InputError, match=r"pole at z = -0\.5"):
        unheld(np.array([[-0.5]]), np.array([[1.0]]), 0.1)


@needs_gemseo
@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
def test_explicit_euler_is_found_in_a_co_simulation(step: float) -> None:
    with load(gemseo_fmu("MassSpringSubSystem1"), "cs", step=step) as model:
        result = lin(model, inputs=["x2"]).result
    assert (result.method, result.dt) == ("response", step)
    expected = [1.0 - 1j * 2**0.5 * step, 1.0 + 1j * 2**0.5 * step]
    assert sorted(result.poles, key=lambda p: p.imag) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_lag_in_closed_form(interface: str) -> None:
    with load("fmu:FirstOrderLag", interface, tolerance=1e-9) as model:
        result = lin(model, method="response", period=0.1).result
        continuous = lin(model, method="response", period=0.1, continuous=True).result
    assert result.A.shape == (1, 1)
    assert result.A[0, 0] == pytest.approx(np.exp(-0.1), abs=1e-6)
    assert (result.C @ result.B)[0, 0] == pytest.approx(1.0 - np.exp(-0.1), abs=1e-6)
    assert continuous.dt == 0.0
    assert continuous.A[0, 0] == pytest.approx(-1.0, abs=1e-5)


def test_the_rudder_as_a_black_box_shows_its_poles() -> None:
    with load("fmu:Rudder", "me") as model:
        exact = lin(model, inputs=["delC"]).result
        found = lin(model, inputs=["delC"], method="response", period=0.002).result
    slow = exact.poles[np.abs(exact.poles) < 500.0]
    for pole in slow[np.abs(slow) > 10.0]:
        assert np.min(np.abs(found.continuous_poles - pole)) < 1e-3 * abs(pole)
    at = np.array([1.0, 10.0, 40.0])
    ratio = found.fundamental(at)[:, 0, 0] / exact.response(at)[:, 0, 0]
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 0.3


# -- the model must predict what it was not made from -----------------------------------------------

STIFFNESS, DAMPING = 40.0, 0.8  # of the lying FMUs: y = x, d²x/dt² = u − K x − D dx/dt


@pytest.fixture(scope="module")
def lies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lies")


@pytest.mark.parametrize("time", [0.0, 0.28, 0.5])
def test_inputs_that_act_late_give_no_linear_model(lies: Path, time: float) -> None:
    """The pulse is lost at 0 s and drawn out from 10 to 37 ms at 0.28 s; either way it was "reproduced"."""
    with (
        load(build_lying(lies, "late-inputs"), "cs") as model,
        pytest.raises(SimulationError, match="y responds to u differently at other times"),
    ):
        lin(model, inputs=["u"], outputs=["y"], time=time)


def test_inputs_that_act_a_little_late_are_a_doubt(lies: Path) -> None:
    with load(build_lying(lies, "late-inputs"), "cs") as model:
        result = lin(model, inputs=["u"], outputs=["y"], period=0.1).result
    (doubt,) = result.doubts
    assert "inputs act late" in doubt.reason
    assert (doubt.row, doubt.column) == ("y", "u")


def test_the_same_fmu_without_the_lie_is_predicted_and_right(lies: Path) -> None:
    with load(build_lying(lies, "honest"), "cs") as model:
        result = lin(model, inputs=["u"], outputs=["y"], time=0.28).result
    s = 2j * np.pi * np.array([0.1, 1.0, 3.0])
    truth = 1.0 / (s**2 + DAMPING * s + STIFFNESS)
    line = (s.imag * 0.01) ** 2 / 12.0  # a straight line between samples, 10 ms apart
    off = np.abs(result.fundamental(s.imag / (2.0 * np.pi))[:, 0, 0] / truth - 1.0)
    assert np.all(off < 1.01 * line)
    assert not result.doubts
    (said,) = [n for n in result.notes if "not used for the fit" in n]
    assert float(said.split()[-2]) < 1e-6  # percent


def test_a_model_that_grows_is_found_by_its_beginning(lies: Path) -> None:
    """Explicit Euler on K = 10⁴ with 10 ms: z = 1 + h s, |z| = 1.41; over 400 periods it grows by 10⁵⁹."""
    with load(build_lying(lies, "diverging"), "cs") as model:
        result = lin(model, inputs=["u"], outputs=["y"]).result
    s = np.roots([1.0, DAMPING, 1e4])
    assert sorted(result.poles, key=lambda p: p.imag) == pytest.approx(sorted(1.0 + 0.01 * s, key=lambda p: p.imag))


def _trial(answer: np.ndarray, pulse: np.ndarray, levels: np.ndarray) -> MoveTrial:
    return MoveTrial("u", 0, ("y",), levels, answer[:, None], pulse[:, None], np.zeros(1), np.zeros(1))


def test_prediction_errors_are_those_of_the_convolution() -> None:
    count = 60
    pulse = np.asarray(0.5 * 0.9 ** np.arange(count), dtype=np.float64)
    found = realise(pulse[:, None, None], noise=1e-13)
    levels = trial_levels(count)
    answer = np.convolve(levels, pulse)[:count]
    right = _trial(answer, pulse, levels)
    assert not right.why_refused("use nfr")
    right.refuse(found)
    assert right.error(found) < 1e-9
    assert not right.doubts(found)
    off = _trial(1.25 * answer, pulse, levels)  # the pulse gave four fifths of what the rest gives
    assert off.error(found) == pytest.approx(0.2)
    (doubt,) = off.doubts(found)
    assert "missed by 20 %" in doubt.reason
    assert "missed by 100 %" in _trial(answer, 0.0 * pulse, levels).why_refused("use nfr")
    missed = 100.0 * np.abs(answer - 0.5 * levels).max() / np.abs(answer).max()  # with D alone
    with pytest.raises(SimulationError, match=f"by {missed:.3g} %; give order"):
        right.refuse(found.truncated(0))


def test_an_order_that_is_too_low_is_a_doubt_and_not_found_by_itself() -> None:
    """Two modes: what one of them predicts is off, although pulses superpose; asked for, it is given with a doubt."""
    count, k = 120, np.arange(120)
    pulse = 0.9**k - 0.98 * (-0.9) ** k
    found = realise(np.asarray(pulse[:, None, None], dtype=np.float64), noise=1e-13, order=1)
    levels = trial_levels(count)
    trial = _trial(np.convolve(levels, pulse)[:count], pulse, levels)
    (doubt,) = trial.doubts(found)
    assert "order 1 misses other pulses" in doubt.reason


def test_states_that_only_the_errors_of_a_solver_need_are_left_out() -> None:
    """A mode of two states; what the solver adds to every run fades with the motion, and differs from run to run."""
    random, count, k = np.random.default_rng(8), 300, np.arange(300)
    true = np.where(k > 0, 0.97 ** (k - 1.0) * np.cos(0.2 * (k - 1.0)), 0.0)
    pulse = np.asarray(true + 1e-5 * 0.9**k * random.choice([-1.0, 0.0, 1.0], count), dtype=np.float64)
    levels = trial_levels(count)
    answer = np.convolve(levels, true)[:count] + 1e-5 * random.choice([-1.0, 0.0, 1.0], count)
    largest = realise(pulse[:, None, None], noise=0.0)
    assert len(largest.A) > 10
    found = smallest(largest, [_trial(answer, pulse, levels)], given=False)
    assert len(found.A) == 2
    assert np.abs(np.linalg.eigvals(found.A)) == pytest.approx(0.97, abs=1e-4)
    assert smallest(largest, [_trial(answer, pulse, levels)], given=True) is largest


def test_a_state_that_the_trial_needs_is_kept() -> None:
    """A slow mode of one hundredth of the fast one's size: without it a step is missed by half."""
    count, k = 400, np.arange(400)
    pulse = np.asarray(np.where(k > 0, 0.5 ** (k - 1.0) + 0.01 * 0.995 ** (k - 1.0), 0.0), dtype=np.float64)
    levels = trial_levels(count)
    largest = realise(pulse[:, None, None], noise=1e-13)
    found = smallest(largest, [_trial(np.convolve(levels, pulse)[:count], pulse, levels)], given=False)
    assert sorted(np.linalg.eigvals(found.A).real) == pytest.approx([0.5, 0.995], abs=1e-6)


@pytest.mark.parametrize("count", [8, 20, 50, 400])
def test_a_trial_is_not_the_pulse(count: int) -> None:
    """Pulses of several lengths and heights at other times and a step, never wider than the pulse itself by half."""
    levels = trial_levels(count)
    assert levels[0] == 0.0
    assert levels.shape == (count,)
    assert np.abs(levels).max() <= 1.5
    assert len(set(levels.tolist())) >= 4
    assert levels[-1] != 0.0


def test_an_output_of_noise_does_not_hide_the_order_of_the_others() -> None:
    random = np.random.default_rng(3)
    h = markov(np.array([[0.9, 0.2], [-0.2, 0.9]]), np.array([[1.0], [0.5]]), np.array([[1.0, 0.0]]), np.eye(1), 80)
    both = np.concatenate([h, 1e-9 * random.normal(size=h.shape)], axis=1)
    noise = np.array([[1e-12], [4e-9]])
    found = realise(both, noise=noise)
    assert len(found.A) == 2
    assert np.linalg.eigvals(found.A) == pytest.approx(np.array([0.9 + 0.2j, 0.9 - 0.2j]), abs=1e-9)


@needs_gemseo
def test_a_small_answer_to_a_moving_model_is_found_above_the_noise() -> None:
    """Mass_Damper falls from 0.5 m; 0.002 N are lost in the integration of that. y = −f/(s² + 10 s + 10⁴)."""
    with load(gemseo_fmu("Mass_Damper"), "me") as model:
        result = lin(model, method="response").result
    assert len(result.A) == 2
    assert result.continuous_poles == pytest.approx(np.roots([1.0, 10.0, 1e4]), rel=1e-4)
    s = 2j * np.pi * np.array([1.0, 5.0, 15.9, 30.0])
    gain = np.abs(result.fundamental(s.imag / (2.0 * np.pi))[:, 0, 0] * (s**2 + 10.0 * s + 1e4))
    assert np.abs(20.0 * np.log10(gain)).max() < 1e-3  # straight lines within a sixteenth of the period: (ωh/16)²/12
    assert any("moved by" in note for note in result.notes)
    assert not result.doubts


def _mass(frequency: np.ndarray) -> np.ndarray:
    """The closed form of Mass_Damper: 1/(s² + 10 s + 10⁴), as its force acts on the spring's other end."""
    s = 2j * np.pi * frequency
    return np.asarray(1.0 / (s**2 + 10.0 * s + 1e4))


@needs_gemseo
def test_a_period_too_long_says_how_far_its_samples_hold() -> None:
    """15.9 Hz sampled at 20 Hz: the poles are folded to 4.1 Hz, and 1 Hz was 6 % off without a word."""
    with load(gemseo_fmu("Mass_Damper"), "me") as model:
        result = lin(model, method="response", period=0.05).result
    f = np.array([0.1, 1.0, 5.0, 9.0])
    # The outputs were watched within the period: what a sine shows is right beyond half the sampling rate.
    assert result.fundamental(f)[:, 0, 0] == pytest.approx(_mass(f), rel=3e-3)
    limit = result.holds_to_hz
    assert limit is not None
    joined = replace(result, intersample=lines(_realised(result), result.dt, sampled=False))
    at = np.array([0.5, 0.99, 1.1]) * limit
    off = np.abs(joined.fundamental(at)[:, 0, 0] / _mass(at) - 1.0)
    assert np.all(off[:2] <= 0.05)
    assert off[2] > 0.05
    (doubt,) = result.doubts
    assert "moves between the samples" in doubt.reason
    assert f"{limit:.3g} Hz" in doubt.reason
    assert LinResult.from_dict(result.to_dict()).holds_to_hz == limit
    assert any(note.startswith("the point is not at rest: y changes by") for note in result.notes)


def _realised(result: LinResult) -> Realisation:
    return Realisation(result.A, result.B, result.C, result.D)


def test_outputs_of_a_lag_are_all_but_straight_between_the_samples() -> None:
    with load("fmu:FirstOrderLag", "me") as model:
        result = lin(model, method="response", period=0.01).result
    assert result.holds_to_hz == pytest.approx(50.0)  # half the sampling rate
    assert not result.doubts
    assert not any("moving" in note for note in result.notes)
    s = 2j * np.pi * np.array([0.1, 10.0, 40.0])
    assert result.fundamental(s.imag / (2.0 * np.pi))[:, 0, 0] == pytest.approx(1.0 / (1.0 + s), rel=1e-3)


def test_parabolas_between_the_samples_hold_to_an_eighth_of_the_rate() -> None:
    """d²x/dt² = u − x: far above 0.16 Hz the samples joined by lines show (πfh)/tan(πfh) of it: 0.95 at f h = 0.123."""
    text = "model Swing input Real u(start = 0); output Real y; Real x(start = 0, fixed = true); "
    text += "Real v(start = 0, fixed = true); equation der(x) = v; der(v) = u - x - 0.2 * v; y = x; end Swing;"
    with load(built(text, "Swing"), "me") as model:
        result = lin(model, method="response", period=0.01).result
    assert result.holds_to_hz == pytest.approx(12.3, rel=0.03)
    assert not result.doubts
    s = 2j * np.pi * np.array([0.1, 10.0, 40.0])
    truth = 1.0 / (s**2 + 0.2 * s + 1.0)
    assert result.fundamental(s.imag / (2.0 * np.pi))[:, 0, 0] == pytest.approx(truth, rel=1e-2)


def test_an_output_with_a_state_and_a_feedthrough_between_the_samples() -> None:
    """y = x + 3 u, dx/dt = u − x: the last left limit of a period still has that period's input."""
    text = "model Both input Real u(start = 0); output Real y; Real x(start = 0, fixed = true); "
    text += "equation der(x) = u - x; y = x + 3 * u; end Both;"
    with load(built(text, "Both"), "me") as model:
        result = lin(model, method="response", period=0.1).result
    s = 2j * np.pi * np.array([0.1, 1.0, 4.0])
    assert result.fundamental(s.imag / (2.0 * np.pi))[:, 0, 0] == pytest.approx(3.0 + 1.0 / (1.0 + s), rel=1e-4)


def test_a_co_simulation_that_follows_at_once_has_no_delay() -> None:
    """y = u: neither a state nor half a period, which was taken for a sampler's hold as nothing is left of a pulse."""
    with load(
        built("model Same input Real u(start = 0); output Real y; equation y = u; end Same;", "Same"), "cs"
    ) as model:
        result = lin(model, period=0.1).result
    assert result.A.shape == (0, 0)
    assert result.fundamental(np.array([0.1, 1.0, 4.0]))[:, 0, 0] == pytest.approx(1.0, abs=1e-9)


def test_an_input_without_a_linear_model_is_left_out_with_the_reason(lies: Path) -> None:
    late, honest = load(build_lying(lies, "late-inputs"), "cs"), load(build_lying(lies, "honest"), "cs")
    inputs, outputs = {"a": "late.u", "b": "good.u"}, {"ya": "late.y", "yb": "good.y"}
    with connect({"late": late, "good": honest}, inputs=inputs, outputs=outputs, step=0.01) as both:
        result = lin(both, period=0.01).result
        alone = lin(both, period=0.01, inputs=["b"]).result
        with pytest.raises(SimulationError, match="responds to a differently"):
            lin(both, period=0.01, inputs=["a"])
    assert result.input_names == ("b",)
    assert list(result.refused) == ["a"]
    assert any(note.startswith("a is left out: there is no linear model") for note in result.notes)
    f = np.array([0.1, 1.0, 3.0])
    assert result.response(f)[:, 1, 0] == pytest.approx(alone.response(f)[:, 1, 0], rel=1e-9)
    assert LinResult.from_dict(result.to_dict()).refused == result.refused


def test_what_moves_within_the_scatter_of_the_runs_is_not_called_without_effect(lies: Path) -> None:
    """y = x, f = v + u/2, and a force of ±5e-4 that no two runs have in common: u moves by half of 1e-4."""
    with load(build_lying(lies, "random"), "cs") as model:
        with pytest.raises(SimulationError, match=r"y, f move when u does, but by no more than the runs scatter"):
            lin(model, inputs=["u"], du=1e-4)
        partly = lin(model, inputs=["u"], du=7e-4).result
    told = {(d.row, d.column) for d in partly.doubts if d.reason.startswith("not known")}
    assert told == {("y", "u")}
    assert not partly.without_effect
    assert any("y by u did not" in note for note in partly.notes)
    assert all("not known" in z.reason for z in partly.zeros if z.kind == "output")


def test_what_a_doubt_is_about_is_not_read_from_its_words() -> None:
    """Whether 0 means no effect is unknown where the doubt is about that, in whatever words."""
    with load("fmu:FirstOrderLag") as model:
        found = lin(model).result
    still = replace(found, C=0.0 * found.C)
    (pair,) = still.without_effect
    for about, known in (("effect", ()), ("value", (pair,))):
        doubt = Doubt(pair[1], pair[0], 0.0, None, "not known: in other words", about)
        doubted = replace(still, doubts=(doubt,))
        assert doubted.without_effect == known
        assert LinResult.from_dict(doubted.to_dict()).doubts == (doubt,)


def test_an_output_that_nothing_moves_has_no_effect_and_no_doubt() -> None:
    """Its answer is 0 to the last bit, or what rounding makes of its size."""
    count = 60
    pulse = np.asarray(0.5 * 0.9 ** np.arange(count), dtype=np.float64)
    levels = trial_levels(count)
    answer = np.column_stack([np.convolve(levels, pulse)[:count], np.full(count, 3e-16)])
    both = np.column_stack([pulse, np.zeros(count)])
    noise, rounding = np.array([1e-9, 1e-12]), np.array([1e-15, 1e-15])
    still = MoveTrial("u", 0, ("y", "z"), levels, answer, both, noise, rounding)
    found = realise(both[:, :, None], noise=1e-13)
    assert not still.doubts(found)
    assert not still.untested
    moved = replace(still, rounding=np.array([1e-15, 1e-17]))
    assert moved.untested == ("z",)
    assert not moved.why_refused("use nfr")  # y is known
    (doubt,) = moved.doubts(found)
    assert doubt.about == "effect"
    assert (doubt.row, doubt.column) == ("z", "u")


def test_an_fmu_whose_own_tolerance_is_too_coarse_is_told_another(lies: Path) -> None:
    """Poles of x'' + D x' + K x over 10 ms; the FMU's runs scatter by the tolerance that it is told, 1e-3 by itself."""
    with load(build_lying(lies, "coarse"), "cs") as model:
        result = lin(model, inputs=["u"], outputs=["y"], du=1e-4).result
    s = np.roots([1.0, DAMPING, STIFFNESS])
    assert sorted(result.poles, key=lambda p: p.imag) == pytest.approx(
        sorted(np.exp(0.01 * s), key=lambda p: p.imag), rel=1e-6
    )
    assert any(note.startswith("tolerance: 1e-10 in place of the FMU's own") for note in result.notes)
    with (
        load(build_lying(lies, "coarse"), "cs", tolerance=1e-3) as model,
        pytest.raises(SimulationError, match="no more than the runs scatter"),
    ):
        lin(model, inputs=["u"], outputs=["y"], du=1e-4)


def test_the_order_is_that_of_the_input_that_needs_the_most_states() -> None:
    """Each input moves an output of its own by one mode; the larger one alone predicts the first input."""
    pulses = markov(np.diag([0.9, -0.6]), np.diag([1.0, 0.1]), np.eye(2), np.zeros((2, 2)), 80)
    largest, levels = realise(pulses, noise=1e-13), trial_levels(80)
    answers = [np.column_stack([np.convolve(levels, h)[:80] for h in pulses[:, :, j].T]) for j in range(2)]
    trials = [
        MoveTrial(f"u{j}", j, ("y0", "y1"), levels, answer, pulses[:, :, j], np.zeros(2), np.zeros(2))
        for j, answer in enumerate(answers)
    ]
    found = smallest(largest, trials, given=False)
    assert sorted(np.linalg.eigvals(found.A).real) == pytest.approx([-0.6, 0.9], abs=1e-9)


@pytest.mark.parametrize(("share", "told"), [(0.015, True), (0.007, False)])
def test_directions_that_differ_by_more_than_a_hundredth_are_a_doubt(share: float, told: bool) -> None:
    """y = u + 0.1 u²: by ±h the mean of both answers is 0.1 h² beside answers of h."""
    text = "model Bent input Real u(start = 0); output Real y; equation y = u + 0.1 * u * u; end Bent;"
    width = 2.0 * share / 0.1
    with load(built(text, "Bent"), "me") as model:
        result = lin(model, method="response", period=0.1, du=width).result
    told_of = [doubt.reason for doubt in result.doubts if "rising and falling" in doubt.reason]
    assert bool(told_of) is told
    if told:  # the slopes are 1 ± share
        assert told_of[0].endswith(f"differ by {2.0 * share:.3g}")


def test_a_co_simulation_of_two_steps_in_a_period_is_watched_in_the_middle() -> None:
    """The error of a straight line goes with its length squared: half as long, a quarter."""
    with load("fmu:FirstOrderLag", "cs", step=0.5) as model:
        result = lin(model, method="response", period=1.0).result
    assert result.holds_to_hz is not None
    joined = replace(result, intersample=lines(_realised(result), result.dt, sampled=False))
    f = np.array([0.1, 0.3, 0.45])
    true = 1.0 / (1.0 + 2j * np.pi * f)
    off, off_joined = (np.abs(found.fundamental(f)[:, 0, 0] / true - 1.0) for found in (result, joined))
    assert off / off_joined == pytest.approx(0.25, rel=0.15)


def test_without_step_and_experiment_the_period_is_a_millisecond_and_told(tmp_path: Path) -> None:
    with load(build_mimic(tmp_path, "no-experiment"), interface="cs") as model:
        found = lin(model).result
    assert found.dt == 1e-3
    assert any("names neither a step nor a default experiment" in note for note in found.notes)
    natural = np.abs(np.log(np.linalg.eigvals(found.A).astype(complex))) / found.dt
    assert natural == pytest.approx(10.0, rel=1e-3)
