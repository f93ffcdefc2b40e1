"""Small functions against closed forms: places that mutants showed to be looked at by no other test."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.test_validate_overlay import measured
from workbench.core.records.forms import _WIDTHS
from workbench.core.records.record import brief
from workbench.core.values.arrays import Floats
from workbench.core.values.conversion import known_unit
from workbench.core.values.linear import LinearPart
from workbench.core.values.matrices import exponentials
from workbench.data.experiment.checks import regular
from workbench.errors import InputError
from workbench.health.check.jumps import jumps
from workbench.health.check.nominals import _judge
from workbench.health.check.run import validation
from workbench.health.check.start_time import _judge as judge_start
from workbench.health.check.step import _Convergence, _order_words
from workbench.health.check.subject import Trajectory
from workbench.identification.fit.run import _sampled
from workbench.identification.subspace.order import _weight
from workbench.jobs.options import Workers, _scheduler
from workbench.limit_cycles.feedback.gains import crossings
from workbench.limit_cycles.feedback.locus import shown_gains
from workbench.limit_cycles.limit_cycle.bias import _meeting
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.describing.sector import sector_of
from workbench.model.loading import Loading
from workbench.point.lin.task import width_for
from workbench.point.trim.null_space import least_norm
from workbench.point.trim.search import _left
from workbench.response.compare_linear.interfaces import _shift
from workbench.response.nfr.beats import Beat, mean_over_beats
from workbench.response.nfr.error import slowness
from workbench.response.nfr.prior_knowledge import LinearStart
from workbench.response.nfr.settling import Settling
from workbench.response.nfr.transient import remove_transient
from workbench.response.periodic.monodromy import _rows
from workbench.session.fmu import _plus
from workbench.session.me import MeSession
from workbench.signals.kinds import Constant, Signal, Sine, Step
from workbench.system.block_table.base import _short
from workbench.system.blocks import block_description
from workbench.system.description import SumComponent
from workbench.system.load import open_files

INF = math.inf


@pytest.mark.parametrize("zero", [-300.0, -2.0, -1e-3, 0.0, 1e-3, 2.0, 300.0])
@pytest.mark.parametrize("near", [-1.0, 0.0, 1.0])
def test_a_centre_is_found_on_either_side(zero: float, near: float) -> None:
    assert _meeting(lambda x: x - zero, near, 1.0) == pytest.approx(zero, rel=1e-9, abs=1e-9)


def test_of_two_centres_the_nearer_one_is_found() -> None:
    assert _meeting(lambda x: (x + 1.0) * (x - 3.0), 0.0, 1.0) == pytest.approx(-1.0, rel=1e-9)
    assert _meeting(lambda x: (x + 3.0) * (x - 1.0), 0.0, 1.0) == pytest.approx(1.0, rel=1e-9)


def test_a_measured_block_answers_a_motion_with_its_fundamental() -> None:
    frequency = np.array([0.5, 1.0, 2.0])
    block = MeasuredBlock(measured(frequency, {1.0: 2.0 / (1.0 + 1j * frequency), 4.0: 1.0 / (1.0 + 1j * frequency)}))
    v = np.array([0.3, 4.0j, 0.2, 0.0])
    found = block.answer(v, 1.0, 3)
    assert found.shape == (4,)
    assert found == pytest.approx(np.array([0.0, 4.0j / (1.0 + 1.0j), 0.0, 0.0]), rel=1e-12)


@pytest.mark.parametrize(
    ("stable", "shown"),
    [
        ([(1.0, 3.0)], (-0.45, 3.45)),  # 0 … 3 and 15 % beyond
        ([(-INF, 2.0)], (-4.3, 2.3)),  # what is stable without an end: twice the width more
        ([(-1.0, INF)], (-1.15, 2.15)),
        ([(-INF, -1.0), (1.0, INF)], (-5.3, 5.3)),
    ],
)
def test_gains_worth_a_picture(stable: list[tuple[float, float]], shown: tuple[float, float]) -> None:
    assert shown_gains(stable, [], (-INF, INF)) == pytest.approx(shown, rel=1e-12)


INCH, POUND, GRAVITY = 0.0254, 0.45359237, 9.80665


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("%", 1.0 / 100.0), ("1", 1.0), ("-", 1.0), ("Hz", 1.0), ("Pa", 1.0), ("N", 1.0), ("J", 1.0), ("W", 1.0),
        ("C", 1.0), ("bar", 1e5), ("Wh", 3600.0), ("kn", 1852.0 / 3600.0), ("kph", 1000.0 / 3600.0),
        ("mph", 5280.0 * 12.0 * INCH / 3600.0), ("lbf", POUND * GRAVITY), ("psi", POUND * GRAVITY / INCH**2),
        ("atm", 101325.0), ("mm", 1e-3), ("cm", 1e-2), ("dm", 1e-1), ("km", 1e3), ("MPa", 1e6), ("us", 1e-6),
    ],
)  # fmt: skip
def test_units_are_their_definitions(name: str, factor: float) -> None:
    unit = known_unit(name)
    assert unit is not None
    assert unit.factor == pytest.approx(factor, rel=1e-14)


def test_values_of_a_block_in_words() -> None:
    assert [_short(v) for v in ((1.0, 2.5), (1.0,) * 5, True, 0.25, 3, "mid")] == [
        "[1, 2.5]", "5 values", "true", "0.25", "3", "mid",
    ]  # fmt: skip


@pytest.mark.parametrize("size", [0.1, 0.25, 1.0, 7.0])
def test_exponentials_are_to_the_last_digits(size: float) -> None:
    """Diagonal and nilpotent: exp is known entry by entry. 1e-15 is a few roundings."""
    found = exponentials(np.array([[[size, 0.0], [0.0, -size]], [[0.0, size], [0.0, 0.0]]]))
    assert found[0].diagonal() == pytest.approx([math.exp(size), math.exp(-size)], rel=2e-15 * max(1.0, 8.0 * size))
    assert np.array_equal(found[1], [[1.0, size], [0.0, 1.0]])


@pytest.mark.parametrize("size", [0.1, 1.0, 3.0])
def test_the_exponential_of_equal_entries_is_known(size: float) -> None:
    """Of x in all n² places: the unit matrix plus (e^(n x) − 1)/n in all; its powers are full matrices."""
    found = exponentials(np.full((1, 3, 3), size))
    assert np.abs(found[0] - np.eye(3) - math.expm1(3.0 * size) / 3.0).max() < 1e-14 * math.exp(3.0 * size)


@pytest.mark.parametrize(("texts", "width"), [(["0.1"], 0.1), (["0.1,0.2"], (0.1, 0.2)), (["x=0.1"], {"x": 0.1})])
def test_widths_are_one_or_several_or_by_name(texts: list[str], width: object) -> None:
    assert _WIDTHS.read(_WIDTHS.layout.split(texts)) == width


@pytest.mark.parametrize("width", [0.0, -1.0, math.inf])
def test_a_width_is_positive_and_finite(width: float) -> None:
    with pytest.raises(InputError, match="must be positive and finite"):
        width_for({"x": width}, ["x"], what="width")
    assert width_for(2.0, ["x", "y"], what="width").tolist() == [2.0, 2.0]


@pytest.mark.parametrize("place", [5, "", 1.0])
def test_what_is_no_address_is_no_scheduler(place: object) -> None:
    with pytest.raises(ValueError, match="is not the address of a scheduler"):
        _scheduler(place)
    assert _scheduler("tcp://host:8786") == "tcp://host:8786"


def test_missing_rows_are_counted_and_put_where_they_were() -> None:
    every = np.linspace(7.0, 21.5, 30, dtype=np.float64)
    there = np.delete(np.arange(30), [3, 4, 11])
    values = np.array(np.sin(every[there]), dtype=np.float64)
    time, columns, missing = regular(np.array(every[there], dtype=np.float64), values[:, None])
    assert missing == 3
    assert time == pytest.approx(every, rel=1e-15)
    assert np.flatnonzero(np.isnan(columns[:, 0])).tolist() == [3, 4, 11]
    assert columns[there, 0].tolist() == values.tolist()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_what_a_change_of_a_lag_puts_into_the_output(order: int) -> None:
    """y = c·exp(a·t) over a period: the mean and the component at the forcing's frequency are integrals of exp."""
    a, c, period, k = -0.8, 1.5, 2.5, 2000
    t = period * np.arange(k) / k
    flows = np.full((k, 1, 1), math.exp(a * period / k)), np.exp(a * t)[:, None, None]
    found = _rows(np.full((k, 1, 1), a), np.full((k, 1), c), flows, period, order)[:, 0]
    turned = a - 2j * math.pi * order / period
    first = 2j * c / period * (np.exp(turned * period) - 1.0) / turned
    mean = c * math.expm1(a * period) / (a * period)
    assert found == pytest.approx([mean, first.real, first.imag], rel=1e-6)


def test_a_pole_at_zero_has_no_shift() -> None:
    """What is left of ln(1 + ε)/h is rounding; the shift of the other pole is told to its last digits."""
    h = 1e-6
    seen = np.array([1e-4, -2.0], dtype=np.complex128)
    discrete = np.array([1.0, np.exp(-2.0 * h)], dtype=np.complex128)
    assert _shift(discrete, seen, h) == pytest.approx(0.0, abs=1e-9)
    assert _shift(discrete, np.array([1e-4, -1.6], dtype=np.complex128), h) == pytest.approx(0.25, rel=1e-9)


def test_weighted_errors_are_white() -> None:
    mixed = np.random.default_rng(3).standard_normal((400, 2)) @ np.array([[1.0, 0.3], [0.0, 5.0]])
    weight = _weight(mixed)
    assert weight is not None
    white = mixed @ weight.T
    assert white.T @ white / len(white) == pytest.approx(np.eye(2), abs=1e-12)


def test_a_bias_is_added_to_numbers_only() -> None:
    assert _plus("text", 1.0) == "text"
    assert _plus(2, 0.5) == 2.5
    assert _plus(True, 0.0) is True


def test_a_bilinear_model_has_the_response_of_the_continuous_one() -> None:
    dt, numbers = 0.2, np.random.default_rng(5)
    A, B, C, D = (numbers.standard_normal(shape) for shape in ((3, 3), (3, 2), (2, 3), (2, 2)))
    A, B, C, D = (np.array(m, dtype=np.float64) for m in (A, B, C, D))
    Ad, Bd, Cd, Dd = _sampled((A, B, C, D), dt)
    for z in np.exp(1j * np.array([0.1, 1.0, 2.5])):
        s = 2.0 / dt * (z - 1.0) / (z + 1.0)
        continuous = C @ np.linalg.solve(s * np.eye(3) - A, B) + D
        assert Cd @ np.linalg.solve(z * np.eye(3) - Ad, Bd) + Dd == pytest.approx(continuous, rel=1e-10)


def test_only_a_nominal_value_that_is_declared_bounds_the_scale_of_a_state() -> None:
    """FMI's default is 1, too: where the file does not say it, a state that lives at 1e-4 would drown in it."""
    states = [SimpleNamespace(nominal=n) for n in (1.0, None, None, 0.0)]
    instance = SimpleNamespace(
        description=SimpleNamespace(states=states), nx=4, get_nominals=lambda: np.array([1.0, 1.0, -50.0, 0.0])
    )
    smallest, largest = MeSession.scales(SimpleNamespace(instance=instance))  # type: ignore[arg-type]
    assert largest == pytest.approx(np.array([1.0, INF, 50.0, INF]))
    assert smallest == pytest.approx(np.array([1e-3, 1e-6, 0.05, 1e-6]))


@pytest.mark.parametrize(("largest", "others"), [([2e3, 3.0, 1.0], ""), ([2e3, 3.0, 1e9], " (and 1 more)")])
def test_states_far_from_their_nominal_values_are_counted(largest: list[float], others: str) -> None:
    subject: Any = SimpleNamespace(model=SimpleNamespace(recipe=SimpleNamespace(tolerance=1e-6)))
    size, nominal = np.array(largest), np.array([1e-3, 2.0, 2.0])
    answer = _judge(subject, ["a", "b", "c"], nominal, size, size)
    assert answer.verdict == "watch"
    worst = "c reaches 1e+09, its nominal value is 2" if others else "a reaches 2e+03, its nominal value is 0.001"
    assert answer.evidence == worst + others


def _with_jumps(late: float) -> Any:  # noqa: ANN401 - stands for a CheckedFmu
    """A lag of 1 s after a dead time, in steps, that also moves by itself: y = sin 3t + Σ (1 − exp(−(t − at)))."""
    step = 0.1

    def run(signals: dict[str, Signal], *, points: Floats) -> Trajectory:
        y = np.sin(3.0 * points)
        for signal in signals.values():
            if isinstance(signal, Step):
                since = np.maximum(points - signal.time - late * step, 0.0)
                y += (signal.value - signal.initial) * np.where(since > 1e-9, -np.expm1(-since), 0.0)
        return Trajectory(points, y[:, None])

    return SimpleNamespace(
        inputs={"u": (0.0, 1.0)}, start=0.0, steps=100, step=step, names=("y",), run=run,
        constants=lambda share: {"u": Constant(share)},
        sines=lambda share: {"u": Sine(amplitude=share, frequency=1.0)},
        model=SimpleNamespace(description=SimpleNamespace(variables=[])),
    )  # fmt: skip


def test_what_moves_by_itself_takes_a_jump_alike_at_all_instants() -> None:
    answer = jumps(_with_jumps(late=0.0))
    assert answer.verdict == "good"
    assert answer.numbers["gap"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("late", "verdict"), [(3.0, "good"), (4.0, "not applicable"), (4.5, "not applicable")])
def test_what_answers_a_jump_later_than_four_steps_is_not_judged(late: float, verdict: str) -> None:
    answer = jumps(_with_jumps(late))
    assert answer.verdict == verdict
    assert (answer.evidence == "nothing responds within 4 steps") == (late >= 4.0)


@pytest.mark.parametrize(("count", "others"), [(1, ""), (2, " (and 1 more)"), (5, " (and 4 more)")])
def test_rules_that_are_bent_are_counted_behind_the_first(count: int, others: str) -> None:
    description: Any = SimpleNamespace(
        problems=[f"rule {k}" for k in range(count)], notes=(), lost=(), variables=("y",)
    )
    answer = validation(description)
    assert (answer.verdict, answer.evidence) == ("watch", f"rule 0{others}")


@pytest.mark.parametrize("moved", [0, 1, 2])
def test_the_variable_that_the_start_time_moves_most_is_named(moved: int) -> None:
    subject: Any = SimpleNamespace(
        names=("a", "b", "c"),
        model=SimpleNamespace(
            recipe=SimpleNamespace(tolerance=1e-6),
            description=SimpleNamespace(experiment=SimpleNamespace(tolerance=None)),
        ),
    )
    time = np.linspace(0.0, 1.0, 21, dtype=np.float64)
    first = np.column_stack([time, 2.0 * time, 3.0 * time])
    later = first + 0.01 * first.max(axis=0)
    later[:, moved] += 0.5 * (moved + 1.0)
    answer = judge_start(subject, Trajectory(time, first), Trajectory(time, later), 32.0, 0.0)
    assert answer.verdict == "watch"
    assert answer.evidence.startswith(f"begun 32 s later {'abc'[moved]} is ")
    # The range of both runs together is 1.51 of that of one, in all three.
    assert answer.numbers["relative"] == pytest.approx(0.51 / 1.51)


@pytest.mark.parametrize(
    ("order", "error", "words"),
    [
        (1.0, 5e-6, "the step has almost no effect"),
        (0.1, 5e-5, "the step has almost no effect"),
        (math.nan, 5e-5, "the step has almost no effect"),
        (1.0, 5e-5, "first order (1.00)"),
        (2.02, 5e-3, "second order (2.02)"),
        (5.0, 5e-3, "higher order (5.00)"),
        (0.1, 5e-3, "no convergence (order 0.1)"),
        (math.nan, 5e-3, "no convergence"),
    ],
)
def test_the_order_of_convergence_in_words(order: float, error: float, words: str) -> None:
    assert _order_words(_Convergence([], [], [], order, error)) == words


@pytest.mark.parametrize(("small", "left"), [(0.7e-7, 1), (1.4e-7, 0)])
def test_a_singular_value_below_1e_7_of_the_largest_is_zero(small: float, left: int) -> None:
    assert least_norm(np.diag([3.0, 3.0 * small]))[1].shape == (2, left)
    assert least_norm(np.diag([1.0, 2.0 * small]), size=2.0)[1].shape == (2, left)


@pytest.mark.parametrize(("turns", "slowest"), [(3.3, 0.1), (3.01, 0.01), (7.9, 0.1)])
def test_the_slowest_harmonic_of_a_beat_is_the_one_that_nearly_stands_still(turns: float, slowest: float) -> None:
    """Of 0.3, 0.6, 0.9 and 1.2 turns in a period of the forcing the third lacks 0.1 to a whole one."""
    assert Beat(1.0 / turns, 1.0).slowness == pytest.approx(1.0 / abs(1.0 - np.exp(2j * np.pi * slowest)))
    assert Beat(1.0 / 2.5, 1.0).slowness == 1.0


def test_an_integrator_that_the_feedback_does_not_move_hides_no_crossing_at_rest() -> None:
    """Beside it stands 1/(s − 1), whose pole the gain g moves to 1 + g: through 0 at g = −1."""
    B = np.array([[0.0], [1.0]])
    found = crossings(LinearPart(np.diag([0.0, 1.0]), B, B.T, np.zeros((1, 1))))
    (through,) = (c for c in found if c.gain != 0.0)
    assert through.gain == pytest.approx(-1.0, rel=1e-8)
    assert (through.frequency_hz, through.unstable_below, through.unstable_above) == (0.0, 0, 1)


@pytest.mark.parametrize("jump", [0.9966, 0.5, 1e-3, 1.02e-10])
def test_the_sector_of_a_relay_with_a_dead_zone_ends_at_its_jump_wherever_that_is(jump: float) -> None:
    """Also between the last or the first two of the inputs that are looked at, 200 a decade."""
    block: Any = SimpleNamespace(static=lambda v: np.where(np.abs(v) >= jump, np.sign(v), 0.0))
    assert sector_of(block, 1.0).high == pytest.approx(1.0 / jump, rel=1e-6)


@pytest.mark.parametrize(
    ("factor", "count", "grows"), [(2.0, 4, True), (2.0, 6, True), (0.5, 6, False), (2.0, 3, False)]
)
def test_three_changes_that_double_are_growth(factor: float, count: int, grows: bool) -> None:
    periods = [SimpleNamespace(compared=np.array([1.0, factor**k])) for k in range(count)]
    point: Any = SimpleNamespace(periods=periods, most=100)
    assert Settling._grows(point) == grows


def test_what_is_left_of_a_trim_is_its_largest_scaled_residual() -> None:
    verdict = SimpleNamespace(scales=np.array([10.0, 2.0]))
    solution: Any = SimpleNamespace(residuals=np.array([2.0, -3.0]), verdict=verdict)
    assert _left(solution) == 1.5
    solution.residuals[0] = math.nan
    assert _left(solution) == math.inf


def test_a_few_values_are_written_out() -> None:
    assert brief(np.zeros(6)) == repr(np.zeros(6))
    assert brief(np.zeros((7, 1))) == "array of shape (7, 1)"
    assert brief([1] * 6) == "[1, 1, 1, 1, 1, 1]"
    assert brief([1] * 7) == "[7 values]"


def test_files_of_a_secured_scheduler_need_its_address() -> None:
    files = ("ca.pem", "own.pem", "own.key")
    with pytest.raises(InputError, match="tls: names the files for a scheduler"):
        Workers(tls=files)
    assert Workers(scheduler="tls://x:1", tls=files).tls == files


def test_a_sum_has_one_unit_at_all_its_ends() -> None:
    for unit in ("m", None):
        found = block_description(SumComponent(name="s", unit=unit)).variables
        assert {v.name: v.unit for v in found} == {"u1": unit, "u2": unit, "y": unit}


def test_a_file_that_is_named_once_has_no_number() -> None:
    for names in (["Saturation", "DeadBand"], ["Saturation", "Saturation"]):
        with open_files([f"fmu:{name}" for name in names], Loading()) as models:
            assert list(models) == (names if len(set(names)) == 2 else ["Saturation (1)", "Saturation (2)"])


@pytest.mark.parametrize("step", [None, 0.4])
def test_a_model_is_led_in_the_given_step_its_own_an_eighth_and_a_sixty_fourth(step: float | None) -> None:
    """As docs/methods/sessions.md says; an FMU that suggests no step has 1 ms for its own."""
    with wb.load("fmu:Saturation", interface="cs", step=step) as model:
        own = model.description.experiment.step or 1e-3
        found = model._lead_steps(model._setup)
    assert found == pytest.approx([*filter(None, [step]), own, own / 8.0, own / 64.0], rel=1e-12)


def test_of_a_sampled_output_without_a_fundamental_the_last_period_stands_and_its_error_is_unknown() -> None:
    periods = np.zeros((16, 7))
    periods[:, 0] = np.arange(16.0)
    mean, error = mean_over_beats(periods, Beat(1.0 / 3.3, 1.0))
    assert np.array_equal(mean, periods[-1])
    assert error == INF


@pytest.mark.parametrize("tau", [1e-3, 1e-2])
def test_a_lag_that_is_quick_within_a_period_is_not_slow(tau: float) -> None:
    """Of two periods nothing is seen but the twin, whose multiplier μ is e^(−1/τ): 1/|1 − μ| is 1."""
    part = LinearPart(np.array([[-1.0 / tau]]), np.array([1.0 / tau]), np.array([1.0]))
    twin = LinearStart(part, np.zeros(1), np.ones(1)).twin(1.0, 1.0)
    limit = remove_transient(np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]))
    assert slowness(limit, twin) == pytest.approx(1.0 / (1.0 - math.exp(-1.0 / tau)), rel=0.02)
