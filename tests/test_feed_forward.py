"""Nonlinear feed-forward: closed forms of small systems, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import workbench as wb
from tests.random_systems import pole_error
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.limit_cycles.feed_forward.plant import linear_plant
from workbench.limit_cycles.feed_forward.remaining_cycles import Remaining, remaining, with_filter
from workbench.limit_cycles.feed_forward.trial import Trial, run_trial
from workbench.limit_cycles.feed_forward.weighting import weighted
from workbench.limit_cycles.feedback.closed_system import ControlLaw, find_place
from workbench.loops.opened_system import find_ports

Numbers = list[float]


def plant(g: Numbers, h: Numbers, poles: Numbers, *, x0: Numbers | None = None) -> wb.LinearComponent:
    """y = (g u + h w)/poles, polynomials with the highest power first; `poles` is monic."""
    n = len(poles) - 1
    A = np.zeros((n, n))
    A[:, 0] = -np.array(poles[1:])
    A[:-1, 1:] = np.eye(n - 1)
    B = np.array([g, h], dtype=float).T
    start = np.zeros(n) if x0 is None else np.array(x0)
    return wb.LinearComponent(
        name="plant", A=A, B=B, C=np.eye(1, n), D=np.zeros((1, 2)), dt=0.0, input_names=("u", "w"), output_names=("y",),
        state_names=tuple(f"x{k + 1}" for k in range(n)), x0=start, units={"u": "rad", "w": "N.m", "y": "rad/s"},
    )  # fmt: skip


def drag(v: np.ndarray) -> float:
    return float(v[0] * abs(v[0]))


def system(part: wb.LinearComponent, *, tolerance: float | None = None) -> wb.DescribedModel:
    """The plant with a quadratic block that brakes: w = −y·|y|."""
    block = wb.FunctionComponent(name="block", function=drag, units={"u": "rad/s", "y": "N.m"})
    brake = wb.Connection(source="block.y", destination="plant.w", gain=-1.0)
    wires = [wb.Connection(source="plant.y", destination="block.u"), brake]
    parts, outputs = {"plant": part, "block": block}, {"y": "plant.y"}
    return wb.connect(parts, wires, inputs={"u": "plant.u"}, outputs=outputs, tolerance=tolerance)


def design(model: wb.DescribedModel, **options: object) -> wb.FeedForwardResult:
    settings = {"block": "block", "target": "plant.u", "low_pass_order": 0, "band": (0.01, 10.0), **options}
    return wb.feed_forward(model, **settings)  # type: ignore[arg-type]


# (s + 2)(s + 8) and (s + 5)(s + 1)/2 over lightly damped modes at 4 and 1 rad/s.
POLES = list(np.polymul([1.0, 0.4, 16.0], [1.0, 0.3, 1.0]))
G = [0.0, *np.polymul([1.0, 2.0], [1.0, 8.0])]
H = [0.0, *(0.5 * np.polymul([1.0, 5.0], [1.0, 1.0]))]


def test_the_filter_is_the_quotient() -> None:
    with system(plant(G, H, POLES)) as model:
        found = design(model, orders=(4, 4))
    s = 2j * np.pi * found.frequency_hz
    exact = 0.5 * (s + 5.0) * (s + 1.0) / ((s + 2.0) * (s + 8.0))
    assert found.exact == pytest.approx(exact, rel=1e-6)
    assert [(step.name, step.order) for step in found.steps] == [
        ("reduced", 8), ("joined", 6), ("cancelled", 2), ("mirrored", 2), ("sign", 2),
    ]  # fmt: skip
    for step in found.steps:
        assert step.response == pytest.approx(exact, rel=1e-6)
        assert step.gain_error_db < 1e-5
        assert step.phase_error_deg < 1e-4
        assert step.residual < 1e-6
    assert np.sort(np.array(found.filter.poles()).real) == pytest.approx([-8.0, -2.0])
    assert np.sort(np.array(found.filter.zeros()).real) == pytest.approx([-5.0, -1.0])
    assert float(found.filter.D[0, 0]) == pytest.approx(0.5)
    assert (found.filter.input_labels, found.filter.output_labels) == (["block_y"], ["plant_u"])


def test_an_exact_filter_takes_the_block_out_of_the_motion() -> None:
    # With it the plant swings as if the block were not there: exp(−0.2 t) and exp(−0.15 t) modes, from x0.
    x0 = [1.0, 0.3, -0.2, 0.1]
    part = plant(G, H, POLES, x0=x0)
    with system(part, tolerance=1e-8) as model:
        found = design(model, orders=(4, 4), inputs={}, stop=20.0)
    (trial,) = found.trials
    w, V = np.linalg.eig(part.A)
    free = (V[0] * np.linalg.solve(V, np.array(x0, dtype=complex)) @ np.exp(np.outer(w, trial.time))).real
    assert trial.signals["block.u"] == pytest.approx(free, abs=1e-6)
    assert trial.units["block.u"] == "rad/s"
    # Without it the block brakes visibly.
    with system(part) as model:
        braked = wb.simulate(model, stop=20.0, points=trial.time[1:]).signals["y"]
    assert np.max(np.abs(braked - free)) > 0.1


def test_unstable_poles_are_mirrored_and_the_sign_changed() -> None:
    # G has a zero at +2: F = 0.5 (s + 5)(s + 1)/((s − 2)(s + 8)).
    g = [0.0, *np.polymul([1.0, -2.0], [1.0, 8.0])]
    with system(plant(g, H, POLES)) as model:
        found = design(model, orders=(4, 4))
        kept = design(model, orders=(4, 4), sign="keep")
    s = 2j * np.pi * found.frequency_hz
    mirrored = 0.5 * (s + 5.0) * (s + 1.0) / ((s + 2.0) * (s + 8.0))
    steps = {step.name: step for step in found.steps}
    assert steps["cancelled"].unstable_poles == pytest.approx([2.0])
    assert found.design.mirrored == pytest.approx([2.0])
    assert steps["mirrored"].response == pytest.approx(mirrored, rel=1e-6)
    assert steps["mirrored"].gain_error_db < 1e-5
    assert steps["sign"].response == pytest.approx(-mirrored, rel=1e-6)
    assert kept.steps[-1].response == pytest.approx(mirrored, rel=1e-6)
    # At frequency 0 the filter with the sign changed is exact; the all-pass takes it to −1 far above 2 rad/s.
    assert steps["sign"].response[0] == pytest.approx(found.exact[0], rel=0.1)
    assert steps["sign"].phase_error_deg == pytest.approx(
        180.0 - 2.0 * math.degrees(math.atan(2.0 / (20.0 * math.pi))), abs=0.1
    )
    assert any("mirrored at 0.318 Hz" in note for note in found.notes)


def test_a_block_that_is_not_at_zero_is_told() -> None:
    """w = v·|v| + 0.2: the plant rests where v·16 = −2.5 w, and the filter moves it from there to 0."""
    rest = -0.03109888428070242
    assert 16.0 * rest == pytest.approx(-2.5 * (rest * abs(rest) + 0.2), rel=1e-12)

    def pushing(v: np.ndarray) -> float:
        return float(v[0] * abs(v[0]) + 0.2)

    part = plant(G, H, POLES)
    x0 = np.linalg.solve(part.A, part.B[:, 1] * pushing(np.array([rest]))).tolist()
    block = wb.FunctionComponent(name="block", function=pushing, units={"u": "rad/s", "y": "N.m"})
    brake = wb.Connection(source="block.y", destination="plant.w", gain=-1.0)
    wires = [wb.Connection(source="plant.y", destination="block.u"), brake]
    parts = {"plant": plant(G, H, POLES, x0=x0), "block": block}
    with wb.connect(parts, wires, inputs={"u": "plant.u"}, outputs={"y": "plant.y"}) as model:
        found = design(model, orders=(4, 4), inputs={}, stop=40.0, closes_at=10.0)
    assert any("moves about -0.0311, not about 0" in note for note in found.notes)
    assert abs(found.trials[0].signals["block.u"][-1]) < 0.1 * abs(rest)
    with system(plant(G, H, POLES, x0=[1.0, 0.3, -0.2, 0.1])) as model:
        assert not any("not about 0" in note for note in design(model, inputs={}, stop=40.0, closes_at=10.0).notes)


def test_a_low_pass_lies_behind() -> None:
    with system(plant(G, H, POLES)) as model:
        found = design(model, orders=(4, 4), low_pass=3.0, low_pass_order=2)
    last, before = found.steps[-1], found.steps[-2]
    assert (last.name, last.order) == ("low-pass", before.order + 2)
    assert np.abs(last.response / before.response) == pytest.approx(
        1.0 / np.sqrt(1.0 + (found.frequency_hz / 3.0) ** 4), rel=1e-9
    )


def test_feedback_of_the_integral_leaves_the_quotient_as_it_is() -> None:
    # v is the rate of the position that is fed back: v = 0 makes the feedback nothing, so H/G cannot change.
    A = np.array([[0.0, 1.0, 0.0], [2.0, 0.1, 1.0], [0.0, 0.0, -3.0]])  # unstable; u drives through a lag
    B = np.array([[0.0, 0.0], [0.2, 1.0], [3.0, 0.0]])
    part = wb.LinearComponent(
        name="plant", A=A, B=B, C=np.eye(2, 3), D=np.zeros((2, 2)), dt=0.0, input_names=("u", "w"),
        output_names=("position", "y"), state_names=("a", "b", "c"), x0=np.zeros(3),
        units={"u": "rad", "w": "N.m", "y": "rad/s", "position": "rad"},
    )  # fmt: skip
    with system(part) as model:
        ports = find_ports(model, "block")
        place = find_place(model, "plant.position", "plant.u")
        plain, fed = (linear_plant(place, ports, gain) for gain in (0.0, -9.0))
    f = np.geomspace(0.01, 10.0, 50)
    s = 2j * np.pi * f
    by_hand = np.linalg.eigvals(A - 9.0 * np.outer(B[:, 0], [1.0, 0.0, 0.0]))
    assert pole_error(fed.poles, by_hand) < 1e-6
    assert pole_error(fed.open_poles, np.linalg.eigvals(A)) < 1e-6
    # By hand: y = s/(s² − 0.1 s − 2) · ((0.2 + 3/(s + 3)) u − w)
    assert plain.H.response(f) == pytest.approx(s / (s**2 - 0.1 * s - 2.0), rel=1e-9)
    assert plain.G.response(f) == pytest.approx((0.2 + 3.0 / (s + 3.0)) * s / (s**2 - 0.1 * s - 2.0), rel=1e-9)
    assert fed.H.response(f) / fed.G.response(f) == pytest.approx(plain.H.response(f) / plain.G.response(f), rel=1e-9)
    assert np.max(np.abs(fed.G.response(f) / plain.G.response(f) - 1.0)) > 0.5


def test_what_is_left_is_h_less_g_times_f() -> None:
    with system(plant(G, H, POLES)) as model:
        found = linear_plant(find_place(model, "plant.y", "plant.u"), find_ports(model, "block"), 0.0)
    f = np.geomspace(0.01, 10.0, 60)
    s = 2j * np.pi * f
    left = with_filter(found, LinearPart(np.array([[-2.0]]), np.array([1.0]), np.array([1.0]), 3.0))
    expected = found.H.response(f) - found.G.response(f) * (3.0 + 1.0 / (s + 2.0))
    assert left.response(f) == pytest.approx(expected, rel=1e-9)


def test_a_wrong_sign_makes_a_limit_cycle_of_known_size() -> None:
    # Three lags 1/(s + 1)³ and u = −9 v·|v|·(8/9): with F = −8 the brake of gain 1 acts with gain 1 + 8 = 9. The
    # describing function 8A/(3π)·9 meets the critical gain 8 at A = π/3, at √3 rad/s; it is unstable: beyond it grows.
    lag = list(np.polymul([1.0, 1.0], np.polymul([1.0, 1.0], [1.0, 1.0])))
    with system(plant([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], lag)) as model:
        found = linear_plant(find_place(model, "plant.y", "plant.u"), find_ports(model, "block"), 0.0)
        wrong = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), -8.0)
        left = remaining(model, "block", found, wrong, band=(0.01, 10.0), at=None, time=0.0)
    assert isinstance(left, Remaining)
    (cycle,), (alone,) = left.with_filter, left.without
    assert cycle.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-9)
    assert cycle.amplitude == pytest.approx(math.pi / 3.0, rel=1e-6)
    assert alone.amplitude == pytest.approx(3.0 * math.pi, rel=1e-6)
    assert (cycle.stable, cycle.unstable_below, cycle.unstable_above) == (False, 0, 2)
    (line,) = left.words("rad/s")
    assert line.startswith("with the filter motions at 0.276 Hz grow from 1.05 rad/s on")


def scalar(x0: float, *, size: float = 1.0) -> wb.DescribedModel:
    """dv/dt = −v + size·u − v·|v|: F = 1/size."""
    return system(plant([size], [1.0], [1.0, 1.0], x0=[x0]))


def tried(model: wb.DescribedModel, gain: float, *, stop: float) -> Trial:
    """A trial of a plain gain in place of the filter."""
    plain = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), gain)
    law = ControlLaw(gain=0.0, filter=plain, filtered="block.y")
    place = find_place(model, "plant.y", "plant.u")
    return run_trial(place, find_ports(model, "block"), law, name="plain gain", inputs={}, closes_at=0.0, stop=stop)


def test_a_filter_too_strong_escapes_in_finite_time_and_says_when() -> None:
    # The crude gain is 1 = exact here; a sign that is wrong doubles the brake, twice the gain turns it:
    # dv/dt = −v + v·|v| escapes from v > 1 at ln(v/(v − 1)).
    with scalar(1.5) as model:
        trial = tried(model, 2.0, stop=10.0)
        tame = tried(model, 1.0, stop=10.0)
    assert trial.divergence is not None
    assert trial.divergence.kind == "finite escape"
    assert trial.divergence.escape_time == pytest.approx(math.log(3.0), rel=1e-4)
    assert "finite time" in trial.failure
    assert trial.rest is None
    assert trial.settling_seconds[0.1] is None
    # The record ends just before: 1/v = 1 − e^t/3, which the solver's tolerance shifts in time
    assert trial.time[-1] == pytest.approx(math.log(3.0), rel=1e-3)
    assert 1.0 / trial.signals["block.u"] == pytest.approx(1.0 - np.exp(trial.time) / 3.0, abs=1e-4)
    assert tame.failure == ""
    assert tame.signals["block.u"] == pytest.approx(1.5 * np.exp(-tame.time), abs=1e-5)
    assert tame.settling_seconds[0.1] == pytest.approx(math.log(10.0), abs=1e-3)


def test_the_largest_target_is_that_of_the_motion_however_small() -> None:
    """The exact gain 1 leaves dv/dt = −v from 0.5; the target is v·|v|, which begins at 0.25 and falls with −2 v²."""
    with scalar(0.5) as model:
        trial = tried(model, 1.0, stop=1.0)
    assert trial.largest_target == pytest.approx(0.25, rel=1e-3)
    assert trial.largest_target_rate == pytest.approx(0.5, rel=1e-3)


def test_the_feedback_that_closes_late() -> None:
    # Until 2 s the block brakes, from then on it is compensated: dv/dt = −v.
    with scalar(1.5, size=4.0) as model:
        found = design(model, orders=(1, 1), inputs={}, stop=8.0, closes_at=2.0)
    (trial,) = found.trials
    assert float(found.filter.D[0, 0]) == pytest.approx(0.25)
    t, v = trial.time, trial.signals["block.u"]
    alone = 1.5 * np.exp(-t) / (1.0 + 1.5 * (1.0 - np.exp(-t)))
    before, after = t < 2.0, t > 2.0
    assert v[before] == pytest.approx(alone[before], abs=1e-5)
    at_two = 1.5 * math.exp(-2.0) / (1.0 + 1.5 * (1.0 - math.exp(-2.0)))
    assert v[after] == pytest.approx(at_two * np.exp(-(t[after] - 2.0)), abs=1e-5)
    assert trial.closes_at == 2.0


def test_results_are_written(tmp_path: Path) -> None:
    folder = tmp_path
    with scalar(1.5) as model:
        found = design(model, orders=(1, 1), inputs={}, stop=2.0, crude=True)
    assert [t.name for t in found.trials] == ["feed-forward", "plain gain, no limits"]
    assert found.trial("feed-forward").rest is not None
    with pytest.raises(KeyError):
        found.trial("feed forward")
    for name in ("overview", "reduced", "compensation", "mirrored", "simulated", "error", "poles"):
        found.plot(folder / f"{name}.png", figure=name)
        assert (folder / f"{name}.png").stat().st_size > 5_000
    with pytest.raises(wb.InputError, match="did you mean error"):
        found.plot(figure="eror")
    found.to_csv(folder / "bode.csv")
    lines = (folder / "bode.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("frequency_hz,G gain,G phase_deg,H gain")
    assert len(lines) == len(found.frequency_hz) + 1
    data = found.to_dict()
    assert [s["name"] for s in data["steps"]][:3] == ["reduced", "joined", "cancelled"]
    assert data["trials"][0]["settling_seconds"].keys() == {"0.5", "0.1", "0.05", "0.01"}
    assert data["filter"]["input_names"] == ["u"]
    assert data["filter"]["units"] == {"u": "N.m", "y": "rad"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"block": "blok"}, "did you mean block"),
        ({"target": "plant.v"}, "has no input 'plant.v'"),
        ({"feedback": ("plant.z", -1.0)}, "has no output 'plant.z'"),
        ({"feedback": ("plant.y", math.inf)}, "finite number"),
        ({"orders": (9, 1)}, "between 1 and 4"),
        ({"hankel": 2.0}, "between 0 and 1"),
        ({"cancel": -1.0}, "between 0 and 1"),
        ({"low_pass": -5.0, "low_pass_order": 1}, "low_pass: -5 is not a positive number"),
        ({"sign": "chang"}, "did you mean change"),
        ({"method": "matchdc"}, "did you mean match-dc"),
        ({"band": (5.0, 1.0)}, "lower frequency first"),
        ({"inputs": {"q": wb.Constant(1.0)}, "stop": 1.0}, "has no input 'q'"),
        ({"inputs": {}}, "stop is missing"),
        ({"inputs": {}, "stop": 1.0, "closes_at": 2.0}, "closes_at must lie between"),
        ({"inputs": {}, "stop": 1.0, "outputs": ["plant.q"]}, "variable 'plant.q' is unknown"),
        ({"inputs": {}, "stop": 1.0, "actuator": "fmu:Aircraft"}, "5 real inputs .* must have one"),
        ({"actuator": "fmu:LimitdActuator"}, "did you mean LimitedActuator"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, object], words: str) -> None:
    with system(plant(G, H, POLES)) as model, pytest.raises(wb.InputError, match=words):
        design(model, **options)


def test_a_single_fmu_is_no_system() -> None:
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(wb.InputError, match="is not a system"):
        wb.feed_forward(model, block="a", target="a.u")


# -- two control inputs ----------------------------------------------------------------------------------


def response(numerator: Numbers, f: np.ndarray) -> Complex:
    s = 2j * np.pi * f
    return np.asarray(np.polyval(numerator, s) / np.polyval(POLES, s), dtype=np.complex128)


@pytest.mark.parametrize("method", ["absolute", "relative"])
@pytest.mark.parametrize("weights", [(0.9, 0.1), (0.6, -0.4), (1.0, 0.0)])
def test_a_combination_that_is_the_effect_itself_is_found(method: str, weights: tuple[float, float]) -> None:
    f = np.geomspace(0.01, 10.0, 200)
    first, second = response(G, f), response(H, f)
    # The scale belongs to the filter: its sign, too.
    found = weighted(first, second, -3.0 * (weights[0] * first + weights[1] * second), method=method)
    assert found.weights == pytest.approx(weights, abs=1e-9)
    assert found.left < 1e-9
    assert (found.left_alone < 1e-9) == (weights[1] == 0.0)


def test_which_error_is_least_decides() -> None:
    """Minimise |a − 1|² + |0.1 (a + b) − 0.2|² + |0.3 b|²: closed form by the normal equations."""
    h = np.array([1.0, 0.2, 1e-9], dtype=complex)
    first, second = np.array([1.0, 0.1, 0.0], dtype=complex), np.array([0.0, 0.1, 0.3], dtype=complex)
    normal = np.array([[1.01, 0.01], [0.01, 0.1]])
    a, b = np.linalg.solve(normal, [1.02, 0.02])
    assert weighted(first, second, h).weights == pytest.approx((a / (a + b), b / (a + b)), rel=1e-6)


def test_inputs_that_cannot_be_told_apart_are_refused() -> None:
    f = np.geomspace(0.01, 10.0, 50)
    with pytest.raises(wb.InputError, match="act alike"):
        weighted(response(G, f), response([2.0 * g for g in G], f), response(H, f))
    with pytest.raises(wb.InputError, match="weighting 'both' is unknown"):
        weighted(response(G, f), response(H, f), response(H, f), method="both")


def two_inputs() -> wb.DescribedModel:
    """As `system`, with a second control: w acts as 0.75 of the first and 0.25 of the second."""
    alone = plant(G, H, POLES, x0=[1.0, 0.0, 0.0, 0.0])
    second = (alone.B[:, 1] - 0.75 * alone.B[:, 0]) / 0.25
    part = replace(
        alone, B=np.column_stack([alone.B, second]), D=np.zeros((1, 3)), input_names=("u", "w", "v"),
        units={"u": "rad", "w": "N.m", "v": "rad", "y": "rad/s"},
    )  # fmt: skip
    block = wb.FunctionComponent(name="block", function=drag, units={"u": "rad/s", "y": "N.m"})
    brake = wb.Connection(source="block.y", destination="plant.w", gain=-1.0)
    wires = [wb.Connection(source="plant.y", destination="block.u"), brake]
    inputs = {"u": "plant.u", "v": "plant.v"}
    return wb.connect({"plant": part, "block": block}, wires, inputs=inputs, outputs={"y": "plant.y"})


def test_two_controls_take_the_block_out_of_the_motion() -> None:
    """Together they act as the block does, so that the filter is 1 and nothing of the block is left."""
    with two_inputs() as model:
        found = design(model, second="plant.v", orders=(4, 4), cancel=1e-3, inputs={}, stop=2.0)
    assert found.shared is not None
    assert found.shared.weights == pytest.approx((0.75, 0.25), rel=1e-6)
    assert abs(found.steps[-1].response - 1.0) == pytest.approx(0.0, abs=1e-6)
    # The block brakes the motion; with the controls it moves as the linear part alone does.
    time, moved = found.trials[-1].time, found.trials[-1].signals["block.u"]
    A = plant(G, H, POLES).A
    for k in (5000, 12000, 20000):
        assert moved[k] == pytest.approx(expm(A * time[k])[0, 0], abs=1e-4)
    assert any("plant.u with 0.75 and to plant.v with 0.25" in note for note in found.notes)
    assert wb.FeedForwardResult.from_dict(found.to_dict()).shared == found.shared


def test_the_second_control_must_be_another_one() -> None:
    with two_inputs() as model:
        with pytest.raises(wb.InputError, match=r"plant\.u is the target itself"):
            design(model, second="plant.u")
        with pytest.raises(wb.InputError, match=r"has no input 'plant\.q'"):
            design(model, second="plant.q")
