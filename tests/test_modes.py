"""Modes over a parameter: closed forms of crossing, veering, coalescence and loss of stability."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.mimic_fmus import build_mimic
from tests.reference_fmus import build_reference
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.core.values.modal import Poles, poles_of
from workbench.errors import InputError
from workbench.model.described_model import DescribedModel
from workbench.point.modes.match import Match, ModeCluster, closeness, coincide, match, turning
from workbench.point.modes.mode import Critical, Mode
from workbench.point.modes.page import modes_page
from workbench.point.modes.ranges import unstable_ranges
from workbench.point.modes.request import modes
from workbench.point.modes.run import critical_values, find_root, sign_of
from workbench.point.modes.source import ModelSource
from workbench.point.modes.track import ModeTracks, track
from workbench.system.connect import connect
from workbench.system.description import GainComponent
from workbench.system.load import load


def second_order(k: object, c: object = 0.0, m: object = 1.0) -> Poles:
    """M q'' + C q' + K q = 0; scalars are multiples of the unit matrix."""
    stiffness = np.array(k, dtype=float)
    one = np.eye(len(stiffness))
    mass, damping = (x * one if np.ndim(x) == 0 else np.array(x) for x in (np.array(m), np.array(c)))
    upper = np.hstack([np.zeros_like(one), one])
    return poles_of(np.vstack([upper, np.linalg.solve(mass, np.hstack([-stiffness, -damping]))]))


def frequencies(found: ModeTracks) -> Floats:
    """Undamped frequencies [rad/s], shape (values, branches)."""
    return np.asarray(np.abs(found.table()[0]), dtype=np.float64)


class Family(ModelSource):
    """Poles as a function of the parameter, without a model."""

    def __init__(self, poles: Callable[[float], Poles]) -> None:
        self._family = poles

    def __call__(self, value: float) -> Poles:
        return self._family(value)


Ranges = tuple[tuple[float, float], ...]


def stability(family: Callable[[float], Poles], values: list[float]) -> tuple[list[Critical], Ranges]:
    """Critical values mode by mode, and where any mode is unstable."""
    found = track(family, values)
    poles, uncertain = found.table()
    lines = [Mode(number=b + 1, pole=poles[:, b], uncertain=uncertain[:, b], states=()) for b in range(found.count)]
    critical = [c for line in lines for c in critical_values(Family(family), found, line, 1e-8)]
    rising = sorted(critical, key=lambda c: c.value)
    return critical, unstable_ranges(found.values, lines, rising, tolerance=1e-8)


def criticals(family: Callable[[float], Poles], values: list[float]) -> list[Critical]:
    return stability(family, values)[0]


# -- crossings and veering -------------------------------------------------------------------


@pytest.mark.parametrize("values", [np.linspace(0.0, 1.0, 5), np.linspace(0.03, 1.0, 6), [0.0, 1.0]])
def test_uncoupled_modes_cross(values: Floats) -> None:
    """Two oscillators, one of them with stiffness 0.5 + p: each keeps its own closed form, also at p = 0.5 itself."""
    found = track(lambda p: second_order([[1.0, 0.0], [0.0, 0.5 + p]], 0.02), list(values))
    moving, still = frequencies(found).T
    assert moving == pytest.approx(np.sqrt(0.5 + found.values), rel=1e-9)
    assert still == pytest.approx(np.ones(len(found.values)), rel=1e-9)
    assert not found.meetings


@pytest.mark.parametrize("coupling", [0.1, 0.01, 3e-4])
def test_coupled_modes_veer(coupling: float) -> None:
    """ω² = (1.5 + p)/2 ± √((0.5 − p)²/4 + κ²), however narrow the gap: the lower one stays the lower one."""
    found = track(
        lambda p: second_order([[1.0, -coupling], [-coupling, 0.5 + p]], 0.02), np.linspace(0.0, 1.0, 6).tolist()
    )
    p = found.values
    root = np.sqrt((0.5 - p) ** 2 / 4.0 + coupling**2)
    lower, upper = frequencies(found).T
    assert lower**2 == pytest.approx((1.5 + p) / 2.0 - root, rel=1e-8)
    assert upper**2 == pytest.approx((1.5 + p) / 2.0 + root, rel=1e-8)
    assert not found.meetings


def test_a_gap_narrower_than_the_smallest_step_is_said() -> None:
    """κ = 1e-6, the smallest step is 0.2/2¹⁴ = 1.2e-5: no step shows the veering itself."""
    found = track(lambda p: second_order([[1.0, -1e-6], [-1e-6, 0.5 + p]], 0.02), np.linspace(0.0, 1.0, 6).tolist())
    (meeting,) = found.meetings
    assert meeting.kind == "unclear"
    assert meeting.modes == (1, 2)
    assert meeting.value == pytest.approx(0.5, abs=3e-5)


def test_modes_that_cross_in_frequency_with_unlike_damping() -> None:
    found = track(
        lambda p: second_order(np.diag([1.0, 0.5 + p]), np.diag([0.02, 0.3])), np.linspace(0.0, 1.0, 7).tolist()
    )
    real = found.table()[0].real
    assert real[:, 0] == pytest.approx(-0.15, rel=1e-9)
    assert real[:, 1] == pytest.approx(-0.01, rel=1e-9)


def test_twenty_modes_in_random_coordinates_keep_their_lines() -> None:
    """Frequencies 1 + 0.3 k at p = 0 in one order and at p = 1 in another, uncoupled, seen through a random matrix."""
    random = np.random.default_rng(3)
    start, end = 1.0 + 0.3 * np.arange(20), 1.0 + 0.3 * random.permutation(20)
    mixing = random.standard_normal((40, 40))
    inverse = np.linalg.inv(mixing)

    def family(p: float) -> Poles:
        omega = start + p * (end - start)
        a = np.zeros((40, 40))
        a[:20, 20:], a[20:, :20], a[20:, 20:] = np.eye(20), -np.diag(omega**2), -0.02 * np.diag(omega)
        return poles_of(mixing @ a @ inverse)

    found = track(family, np.linspace(0.0, 1.0, 9).tolist())
    assert frequencies(found)[-1] == pytest.approx(end, rel=1e-8)
    assert not found.meetings


def test_three_modes_that_cross_in_one_point_are_equal_there_however_rounding_mixes_their_vectors() -> None:
    """A mode that keeps 0.69 of itself and gives 0.15 to each of two others shares their point with both."""
    angle = np.exp(2j * np.pi / 3)
    mixed = np.array([[1, 1, 1], [1, angle, angle**2], [1, angle**2, angle]]) / np.sqrt(3.0)
    turn = mixed @ np.diag(np.exp(1j * np.array([0.0, 1.26, 1.26]))) @ mixed.conj().T
    kept = np.abs(turn) ** 2
    assert kept[0, 0] < 0.75
    assert kept[0, 1:].max() < 0.25
    unit = np.eye(3, dtype=np.complex128)
    apart = Poles(np.array([1j, 1.1j, 1.2j]), unit, unit, np.full(3, 1e-12))
    together = Poles(np.array([1.1j, 1.1j, 1.1j]), turn, turn, np.full(3, 1e-12))
    groups = match(apart, together).groups
    assert [(set(g.before), set(g.after), g.kind) for g in groups] == [({0, 1, 2}, {0, 1, 2}, "equal")]


def test_closeness_does_not_depend_on_the_units_of_the_states() -> None:
    a, b = np.random.default_rng(5).standard_normal((2, 6, 6))
    scale = np.diag(10.0 ** np.array([-6.0, -3.0, 0.0, 2.0, 5.0, 9.0]))
    plain = closeness(poles_of(a), poles_of(a + 0.05 * b))
    scaled = (scale @ x @ np.linalg.inv(scale) for x in (a, a + 0.05 * b))
    assert closeness(*(poles_of(x) for x in scaled)) == pytest.approx(plain, rel=1e-6, abs=1e-9)


# -- meetings --------------------------------------------------------------------------------


def test_a_pair_becomes_two_real_poles_and_a_pair_again() -> None:
    """x'' + c x' + x = 0 with c = 1 … 3 … 1: the pair keeps its number, the second real pole has one of its own."""
    found = track(lambda p: second_order([[1.0]], 3.1 - abs(p)), np.linspace(-2.0, 2.0, 12).tolist())
    poles, _ = found.table()
    assert found.count == 2
    assert [m.kind for m in found.meetings] == ["real axis", "real axis"]
    assert all(abs(abs(m.value) - 1.1) < m.width for m in found.meetings)
    over = 3.1 - np.abs(found.values) > 2.0
    assert np.isnan(poles[~over, 1]).all()
    assert np.real(poles[over, 0] * poles[over, 1]) == pytest.approx(1.0)


def test_rigid_modes_stay_apart_from_the_elastic_ones() -> None:
    """Two free masses on a spring: a double zero at all values, never unstable, and √(2 k)."""
    found = track(lambda p: second_order([[p, -p], [-p, p]]), np.linspace(0.5, 3.0, 6).tolist())
    poles, uncertain = found.table()
    assert found.count == 3
    assert not found.meetings
    rigid, rigid_rate, elastic = np.abs(poles).T
    assert max(rigid.max(), rigid_rate.max()) < 1e-6
    assert elastic == pytest.approx(np.sqrt(2.0 * found.values))
    assert all(sign_of(p, u) == 0 for p, u in zip(poles.ravel().tolist(), uncertain.ravel().tolist(), strict=True))


def typical_section(q: float) -> Poles:
    """Pines' section: inertia [[1, S], [S, I]], lift q θ at a distance e before the elastic axis, undamped."""
    return second_order([[1.0, q], [0.0, 1.0 - 0.4 * q]], 0.0, [[1.0, 0.2], [0.2, 0.25]])


def pines_flutter() -> float:
    """The q at which ω² of the section becomes a double root, in closed form.

    det(K − ω² M) = A ω⁴ − B(q) ω² + C(q), with B = b0 + b1 q, C = c0 + c1 q: B² = 4 A C [Pines 1958].
    """
    a = 0.25 - 0.04
    b0, b1 = 1.25, -(0.4 + 0.2)
    c0, c1 = 1.0, -0.4
    return float(
        min(r.real for r in np.roots([b1**2, 2.0 * b0 * b1 - 4.0 * a * c1, b0**2 - 4.0 * a * c0]) if r.real > 0.0)
    )


def test_flutter_of_an_undamped_section_by_coalescence() -> None:
    exact = pines_flutter()
    assert 0.3 < exact < 1.0
    found = track(typical_section, np.linspace(0.0, 1.0, 8).tolist())
    (meeting,) = found.meetings
    assert meeting.kind == "unclear"
    assert abs(meeting.value - exact) <= meeting.width
    poles, uncertain = found.table()
    before = found.values < exact
    assert all(sign_of(p, u) == 0 for p, u in zip(poles[before].ravel(), uncertain[before].ravel(), strict=True))
    assert (poles[~before].real.max(axis=1) > 0.0).all()

    def worst(q: float) -> tuple[complex, float]:
        p = typical_section(q)
        k = int(np.argmax(p.value.real))
        return complex(p.value[k]), float(p.uncertain[k])

    assert find_root(worst, 0.0, 1.0, tolerance=1e-9)[0] == pytest.approx(exact, abs=1e-8)


# -- public function -------------------------------------------------------------------------


def lags() -> DescribedModel:
    """Three lags of FMUs around a gain 16·D: poles −1 + ∛(16 D) e^{jπ(2k+1)/3}, unstable from D = 0.5 at √3 rad/s."""
    return connect(
        {"block": "fmu:Saturation", "a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag", "c": "fmu:FirstOrderLag@3"},
        [("c.y", "block.u", {"gain": -16.0}), ("block.y", "a.u"), ("a.y", "b.u"), ("b.y", "c.u")],
        outputs={"y": "c.y"},
        start_values={"block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0},
    )


def test_a_mode_that_becomes_unstable_at_a_known_value() -> None:
    with lags() as system:
        result = modes(system, vary="block.D", band=(0.1, 1.0), points=4)
    (only,) = result.sets
    (critical,) = only.critical
    assert critical.value == pytest.approx(0.5, abs=result.tolerance)
    assert result.tolerance == pytest.approx(0.9e-6)
    assert critical.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-5)
    assert (critical.becomes, critical.kind) == ("unstable", "flutter")
    assert only.first_unstable == critical
    root = (16.0 * only.value) ** (1.0 / 3.0)
    mode = only.mode(critical.mode)
    assert mode.frequency_hz == pytest.approx(root * math.sin(math.pi / 3.0) / (2.0 * math.pi), rel=1e-7)
    assert mode.pole.real == pytest.approx(root / 2.0 - 1.0, abs=1e-7)
    assert mode.damping == pytest.approx(-mode.pole.real / np.abs(mode.pole))
    assert {s.split(".")[0] for s in mode.states} == {"a", "b", "c"}
    # Damping in one unit everywhere, and what the legend names is in the picture.
    (table,) = modes_page(result).sections[1].parts[0].tables
    assert table.headings[3:6] == ("damping first [%]", "last [%]", "smallest [%]")
    row = table.rows[critical.mode - 1]
    assert [float(x) for x in row[3:5]] == pytest.approx((100.0 * mode.damping[[0, -1]]).tolist(), rel=1e-3)
    low, high = result.plot().axes[1].get_ylim()
    named = [only.mode(n).natural_frequency_hz for n in only.relevant(6)]
    assert all(low <= f <= high for line in named for f in line)


@pytest.mark.parametrize(
    ("band", "points", "told"),
    [((0.0, 7.9), 21, [8.0]), ((-0.95, 6.0), 28, [-1.0]), ((0.0, 6.0), 13, []), ((-2.0, 7.9), 34, [8.0])],
)
def test_a_mode_that_is_unstable_just_beyond_the_range_is_to_be_watched(
    band: tuple[float, float], points: int, told: list[float]
) -> None:
    """A gain k around three lags is stable between −1 and 8: a range that ends just inside does not look safe."""
    plant = control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))
    with connect({"k": 1.0, "plant": plant}, [("plant.y", "k.u"), ("k.y", "plant.u", {"gain": -1.0})]) as system:
        result = modes(system, vary="k.gain", band=band, points=points)
    (only,) = result.sets
    assert [v for _, v in only.reached_beyond] == pytest.approx(told, abs=0.02)
    summary = modes_page(result).summary
    unstable = ["unstable"] if band[0] < -1.0 else []
    assert [v.word for v in summary] == [*unstable, *(["watch"] if told else ["stable"])]
    for number, value in only.reached_beyond:
        words = f"mode {number} reaches zero just beyond the range, at about {value:.5g}: widen it"
        assert words in summary[-1].text


def test_the_gain_of_a_system_is_varied_like_a_parameter() -> None:
    """A gain k around three lags: unstable above 8 at √3 rad/s, and below −1 by divergence."""
    plant = control.ss(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))
    with connect({"k": 1.0, "plant": plant}, [("plant.y", "k.u"), ("k.y", "plant.u", {"gain": -1.0})]) as system:
        result = modes(system, vary="k.gain", band=(-2.0, 12.0), points=5)
        written = result.to_dict()
        earlier = {**written, "sets": [{k: v for k, v in s.items() if k != "unstable_ranges"} for s in written["sets"]]}
        assert type(result).from_dict(earlier).to_dict() == written
    low, high = result.sets[0].critical
    assert [c.value for c in (low, high)] == pytest.approx([-1.0, 8.0], abs=2e-5)
    assert (low.kind, low.becomes, high.kind, high.becomes) == ("divergence", "stable", "flutter", "unstable")
    assert high.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-5)
    page = modes_page(result)
    assert np.ravel(result.sets[0].unstable_ranges) == pytest.approx([-2.0, -1.0, 8.0, 12.0], abs=2e-5)
    assert np.ravel(result.sets[0].stable_ranges) == pytest.approx([-1.0, 8.0], abs=2e-5)
    assert page.lead.startswith("With the model as it is: unstable at k.gain = -2 … ")
    assert [v.word for v in page.summary] == ["unstable"]  # of the whole, whatever single modes become


@pytest.mark.parametrize("points", [2, 3, 12])
@pytest.mark.parametrize(
    ("below", "above", "expected"),
    [
        (0.7, 0.4, [0.0, 1.0]),  # one becomes stable where the other is unstable already
        (0.5, 0.5, [0.0, 1.0]),  # no gap within the tolerance
        (0.6, 0.63, [0.0, 0.6, 0.63, 1.0]),
        (-1.0, 0.4, [0.4, 1.0]),
        (0.7, 2.0, [0.0, 0.7]),
        (-1.0, 2.0, []),
    ],
)
def test_the_whole_is_unstable_where_any_mode_is(
    below: float, above: float, expected: list[float], points: int
) -> None:
    """One oscillator is unstable below a value, another one above another value, also between two values asked for."""

    def family(v: float) -> Poles:
        return second_order(np.diag([1.0, 30.0]), np.diag([v - below, above - v]))

    ranges = stability(family, np.linspace(0.0, 1.0, points).tolist())[1]
    assert np.ravel(ranges) == pytest.approx(expected, abs=1e-8)


def test_a_delay_makes_windows_of_instability_that_its_approximation_does_not_have(tmp_path: Path) -> None:
    """1 + 30 e^(−sT)/(s² + 0.3 s + 900) has a pole ±jω where |L| = 1 and ω T is the phase that is left, and turns."""
    system = tmp_path / "delayed.toml"
    system.write_text(
        'components.p = {block = "transfer_function", numerator = [30.0], denominator = [1.0, 0.3, 900.0]}\n'
        'components.d = {block = "delay", delay = 1.0}\ncomponents.e = {sum = "+-"}\n'
        'connections = {"e.u2" = "p.y", "d.u" = "e.y", "p.u" = "d.y"}\ninputs.r = "e.u1"\noutputs.y = "p.y"\n'
    )
    # (900 − ω²)² + (0.3 ω)² = 30²
    omega = np.sqrt(np.roots([1.0, 0.09 - 1800.0, 810000.0 - 900.0]))
    phase = np.pi + np.angle(30.0 / (900.0 - omega**2 + 0.3j * omega))
    truth = np.sort(((phase[:, None] + 2.0 * np.pi * np.arange(9, 11)) / omega[:, None]).ravel())
    within = truth[(truth > 1.9) & (truth < 2.2)]
    with load(system) as model:
        found = modes(model, vary="d.delay", values=np.linspace(1.9, 2.2, 7), tolerance=1e-9, in_process=True)
    assert len(within) == 2
    assert [c.value for c in found.sets[0].critical] == pytest.approx(within.tolist(), rel=1e-8)
    assert [c.becomes for c in found.sets[0].critical] == ["stable", "unstable"]


def test_divergence_is_a_real_pole() -> None:
    """With the sign turned the same loop has a real pole at −1 + ∛(16 D): divergence at D = 1/16."""
    with connect(
        {"block": "fmu:Saturation", "a": "fmu:FirstOrderLag"},
        [("a.y", "block.u", {"gain": 16.0}), ("block.y", "a.u")],
        start_values={"block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0},
    ) as system:
        result = modes(system, vary="block.D", values=[0.2, 0.05, 0.02][::-1])
    (critical,) = result.sets[0].critical
    assert critical.kind == "divergence"
    assert critical.value == pytest.approx(1.0 / 16.0, abs=2e-7)


@pytest.mark.parametrize(("damping", "points"), [(0.3, 2), (0.3, 11), (0.0, 2), (0.0, 11)])
def test_divergence_in_the_step_in_which_the_pair_splits(damping: float, points: int) -> None:
    """s² + d s + 0.55 − k: two real poles from k = 0.55 − d²/4 on, one of them unstable from 0.55 on."""
    plant = control.ss(control.tf([1.0], [1.0, damping, 0.55]))
    with connect({"k": 1.0, "plant": plant}, [("plant.y", "k.u"), ("k.y", "plant.u")]) as system:
        result = modes(system, vary="k.gain", band=(0.0, 1.0), points=points)
    (critical,) = result.sets[0].critical
    assert (critical.kind, critical.becomes) == ("divergence", "unstable")
    assert critical.value == pytest.approx(0.55, abs=2e-6)


def test_two_divergences_in_one_step() -> None:
    """Neither takes the other's value, and an undamped one is found beside a damped one."""

    def family(p: float) -> Poles:
        parts = [[[0.0, 1.0], [p - 0.55, -0.3]], [[0.0, 2.0], [p - 0.56, -0.3]]]
        return poles_of(block_diag(*parts))

    assert [c.value for c in criticals(family, [0.0, 0.5, 1.0])] == pytest.approx([0.55, 0.56], abs=1e-6)


@pytest.mark.parametrize(("sign", "becomes"), [(1.0, "unstable"), (-1.0, "stable")])
def test_a_second_real_pole_leaves_stability_in_the_step_in_which_it_meets_the_first(sign: float, becomes: str) -> None:
    """q'' − 0.01 q' + v q = 0 has one unstable real pole below v = 0, two above; a pair from v = 2.5e-5 on."""

    def family(v: float) -> Poles:
        return second_order([[sign * v]], -0.01)

    (found,) = criticals(family, [-1.0, -0.3, 0.4, 1.0])
    assert found.value == pytest.approx(0.0, abs=1e-7)
    assert (found.becomes, found.frequency_hz) == (becomes, 0.0)


def test_every_change_of_the_number_of_unstable_poles_is_a_critical_value() -> None:
    """Random families with stiffness and damping that depend on v, against a count of the poles on a fine grid."""
    random = np.random.default_rng(16)
    for _ in range(6):
        size = int(random.integers(2, 5))
        w = np.sort(10.0 ** random.uniform(0.0, 1.3, size))
        coupling = 0.5 * w.mean() ** 2 * random.normal(size=(size, size))
        still, moving = (np.diag(random.uniform(0.004, top, size) * w) for top in (0.1, 0.05))

        def family(v: float, w: Floats = w, k: Floats = coupling, c: Floats = still, d: Floats = moving) -> Poles:
            return second_order(np.diag(w**2) + v * v * k, c + v * d)

        fine = np.linspace(0.0, 2.0, 1001)
        v = fine[:, None, None]
        zero, one = np.zeros((len(fine), size, size)), np.broadcast_to(np.eye(size), (len(fine), size, size))
        companions = np.block([[zero, one], [-np.diag(w**2) - v * v * coupling, -still - v * moving]])
        counts = np.sum(np.linalg.eigvals(companions).real > 0.0, axis=1)
        truth = fine[np.flatnonzero(np.diff(counts))]
        critical, ranges = stability(family, np.linspace(0.0, 2.0, 41).tolist())
        found = np.sort([c.value for c in critical])
        assert len(found) == len(truth)
        assert np.all(np.abs(found - truth - 0.001) < 0.0011)
        inside = np.any([(low < fine) & (fine < high) for low, high in ranges] or [fine < 0.0], axis=0)
        clear = np.all(np.abs(fine - found[:, None]) > 1e-6, axis=0) & (fine > 0.0) & (fine < 2.0)
        assert np.array_equal(inside[clear], (counts > 0)[clear])


@pytest.mark.parametrize(("sign", "flat"), [(1.0, 0.0), (1.0, 0.2), (-1.0, 0.0), (-1.0, 0.2)])
def test_a_mode_that_only_touches_zero_has_no_critical_value(sign: float, flat: float) -> None:
    def family(p: float) -> Poles:
        growth = sign * max(0.0, abs(p - 0.5) - flat) ** 2
        return poles_of(np.array([[growth, 1.0], [-1.0, growth]]))

    assert not criticals(family, np.linspace(0.0, 1.0, 11).tolist())


def test_configurations_beside_each_other_and_parameters_of_all() -> None:
    with lags() as system:
        twice = {"a.tau": 2.0, "b.tau": 2.0, "c.tau": 2.0}
        result = modes(system, vary="block.D", band=(0.1, 2.0), points=4, set=twice, against=[{"a.tau": 20.0}])
    first, second = result.sets
    assert first.label == "a.tau = 2"
    assert second.label == "a.tau = 20"
    # All three lags alike: the time scale changes, the critical gain does not.
    assert first.critical[0].value == pytest.approx(0.5, abs=1e-6)
    assert first.critical[0].frequency_hz == pytest.approx(math.sqrt(3.0) / (4.0 * math.pi), rel=1e-5)
    # Routh: K = (τ1 + τ2 + τ3)(1/τ1 + 1/τ2 + 1/τ3) − 1.
    assert 16.0 * second.critical[0].value == pytest.approx(24.0 * (1.0 / 20.0 + 1.0) - 1.0, rel=1e-5)


def test_the_equilibrium_may_move_with_the_parameter() -> None:
    """A lag that starts where its feedback is saturated: pole −1/τ there, −17/τ at the equilibrium."""
    with connect(
        {"block": "fmu:Saturation", "a": "fmu:FirstOrderLag"},
        [("a.y", "block.u", {"gain": -16.0}), ("block.y", "a.u")],
        start_values={"block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0, "a.x": 0.5},
    ) as system:
        still, moved = (modes(system, vary="a.tau", values=[1.0, 2.0], trimmed=t).sets[0] for t in (False, True))
    assert still.mode(1).pole.real == pytest.approx([-1.0, -0.5])
    assert moved.mode(1).pole.real == pytest.approx([-17.0, -8.5], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vary": "block.E", "band": (0.0, 1.0)}, "did you mean block.D"),
        ({"vary": "block.D", "band": (1.0, 0.0)}, "rising"),
        ({"vary": "block.D"}, "either values or a band"),
        ({"vary": "block.D", "band": (0.0, 1.0), "points": 1}, "take at least 2"),
        ({"vary": "block.D", "band": (0.0, 1.0), "tolerance": 0.0}, "tolerance"),
        ({"vary": "block.D", "band": (0.0, 1.0), "against": [{"a.tua": 1.0}]}, "a.tau"),
    ],
)
def test_mistakes_are_one_line(options: dict[str, Any], message: str) -> None:
    with lags() as system, pytest.raises(InputError, match=message):
        modes(system, **options)


def test_models_of_different_order_cannot_be_followed() -> None:
    def family(p: float) -> Poles:
        return poles_of(-np.eye(2 if p < 0.5 else 3))

    with pytest.raises(InputError, match="2 states at 0 and 3 at 1"):
        track(family, [0.0, 1.0])


def test_a_sampled_model_shows_its_poles_in_continuous_time() -> None:
    a = control.c2d(control.ss(control.tf([4.0], [1.0, 0.4, 4.0])), 0.01).A
    assert poles_of(a, dt=0.01).value == pytest.approx(np.array([-0.2 + 1j * math.sqrt(3.96)]), rel=1e-9)


@needs_gemseo
def test_a_third_party_fmu_over_its_mass() -> None:
    """Mass, damper 10 N.s/m and spring 1e4 N/m: ω² = k/m, ζ = c/(2 √(k m))."""
    with load(gemseo_fmu("Mass_Damper")) as body:
        (only,) = modes(body, vary="mass.m", values=[0.5, 1.0, 2.0]).sets
    (mode,) = only.modes
    assert np.abs(mode.pole) == pytest.approx(np.sqrt(1e4 / only.value), rel=1e-5)
    assert mode.damping == pytest.approx(5.0 / np.sqrt(1e4 * only.value), rel=1e-5)


# -- the aircraft ----------------------------------------------------------------------------


def test_modes_are_those_at_the_time_at_which_sessions_begin() -> None:
    with load("fmu:Aircraft", start=2.0) as aircraft:
        result = modes(aircraft, vary="airspeed", values=[200.0, 201.0])
    assert result.operating_point is not None
    assert result.operating_point.time == 2.0


def test_the_critical_speeds_of_the_aircraft_do_not_depend_on_the_grid() -> None:
    """Two grids, one so coarse that all matching is refinement; and the poles counted by themselves on both sides."""
    with load("fmu:Aircraft") as aircraft:
        coarse, fine = (
            modes(aircraft, vary="airspeed", band=(248.0, 254.0), points=n, set={"outer_aileron_failed": True}).sets[0]
            for n in (2, 4)
        )
    assert [c.value for c in coarse.critical] == pytest.approx([c.value for c in fine.critical], abs=1e-4)
    assert [c.mode for c in coarse.critical] == [c.mode for c in fine.critical]
    assert [m.frequency_hz[-1] for m in coarse.modes] == pytest.approx([m.frequency_hz[-1] for m in fine.modes])
    for c in fine.critical:
        assert abs(c.real) < 1e-5
    balance = sum(1 if c.becomes == "unstable" else -1 for c in fine.critical)
    assert fine.unstable_count[-1] == fine.unstable_count[0] + balance


def test_the_published_interval_of_position_gains() -> None:
    """Chapter 8.5 of the source report: outer aileron's position to the inner one, stable for −1.3125 … −0.3185."""
    with connect(
        {"aircraft": "fmu:Aircraft", "k": GainComponent(name="k", units={"u": "rad", "y": "rad"})},
        [("aircraft.outer_aileron_position", "k.u"), ("k.y", "aircraft.inner_aileron")],
        start_values={"aircraft.outer_aileron_failed": True},
    ) as system:
        low, high = modes(system, vary="k.gain", band=(-1.5, -0.2), points=2, tolerance=1e-4).sets[0].critical
    assert (low.becomes, high.becomes) == ("stable", "unstable")
    assert low.value == pytest.approx(-1.3125, rel=5e-3)
    assert high.value == pytest.approx(-0.3185, rel=5e-3)


def test_another_interface_is_named_only_where_the_fmu_has_it(tmp_path: Path) -> None:
    for file, words in (
        (build_mimic(tmp_path, "simulink"), "the FMU offers no other interface"),
        (build_mimic(tmp_path, "orderly"), "use interface me"),
    ):
        with (
            load(file, "cs") as model,
            pytest.raises(InputError, match=f"no states by which modes are followed; {words}"),
        ):
            modes(model, vary="d", values=[3.0, 4.0, 5.0])


# -- command ---------------------------------------------------------------------------------


def test_command_writes_table_json_csv_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {o: str(tmp_path / f"modes.{s}") for o, s in (("--json", "json"), ("--csv", "csv"), ("--plot", "png"))}
    arguments = ["modes", "fmu:FirstOrderLag", "--vary", "tau=0.5:4", "--points", "3", "--against", "tau=1"]
    assert run([*arguments, *(x for pair in files.items() for x in pair)]) == 0
    data = json.loads((tmp_path / "modes.json").read_text(encoding="utf-8"))
    assert data["parameter"] == "tau"
    assert data["sets"][0]["real"][0] == pytest.approx([-2.0, -1.0 / 2.25, -0.25])
    assert (tmp_path / "modes.csv").read_text(encoding="utf-8").count("\n") == 7
    assert (tmp_path / "modes.png").stat().st_size > 1000
    assert "no mode is unstable at tau = 0.5 … 4 s; least damped: mode 1, 100 % at" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary", "tua=1:2"], "did you mean tau"),
        (["--vary", "tau=2:1"], "LO < HI"),
        (["--vary", "tau"], "NAME=VALUE"),
        (["--vary", "tau=1:2", "--against", "tau"], "NAME=VALUE"),
        (["--vary", "tau=1:2", "--plot", "x.gif"], "must end in"),
    ],
)
def test_command_refuses_in_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["modes", "fmu:FirstOrderLag", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_modes_away_from_an_equilibrium_say_so() -> None:
    """The linear model about a motion has poles, but they do not tell whether the model is stable."""
    with load("fmu:Rudder", bias={"delC": 1.0}) as rudder:
        found = modes(rudder, vary="delC", values=[0.0, 1.0])
    assert any("not at rest" in note and "`trimmed`" in note for note in found.notes)
    with load("fmu:Rudder") as rudder:
        assert not any("not at rest" in note for note in modes(rudder, vary="delC", values=[0.0, 1e-12]).notes)


def test_a_sampled_model_without_modes_has_none(capsys: pytest.CaptureFixture[str]) -> None:
    """Its linear model, over a period, has no states that matter and is asked for no outputs."""
    assert run(["modes", "fmu:TwoRateQuantizer", "--vary", "fine=0.0099:0.0101", "--points", "3"]) == 0
    assert "All 0 modes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("values", "uncertain", "expected"),
    [
        ([-1.0, -1.0], [0.0, 0.0], True),
        ([-1.0, -1.2], [0.01, 0.01], False),
        ([-1.0, -1.2], [0.2, 1e-9], True),  # one of the two is known badly: it may be the other
        ([-1.0, -1.1, -1.2], [0.01] * 3, False),  # the middle one is their mean, the outer two are not
        ([-1.0], [1.0], False),
    ],
)
def test_poles_coincide_within_what_rounding_may_have_done(
    values: list[float], uncertain: list[float], expected: bool
) -> None:
    count = len(values)
    eye = np.eye(count, dtype=complex)
    poles = Poles(np.array(values, dtype=complex), eye, eye, np.array(uncertain))
    assert coincide(poles, tuple(range(count))) is expected


@pytest.mark.parametrize(
    ("real", "uncertain", "turns"),
    [
        ((-1.0, -2.0), 0.0, False),  # all decay
        ((1.0, 2.0), 0.0, False),  # all grow: nothing has changed here
        ((1.0, -2.0), 0.0, True),
        ((0.0, 1.0), 0.0, False),  # at 0 it has no side
        ((-0.5, 1.0), 0.5, False),  # nor as far from it as rounding may have moved it
    ],
)
def test_a_pair_that_splits_turns_where_its_poles_are_known_to_lie_on_both_sides(
    real: tuple[float, float], uncertain: float, turns: bool
) -> None:
    eye = np.eye(2, dtype=np.complex128)
    sign = -1.0 if max(real) < 0.0 else 1.0
    pair = Poles(np.array([sign + 2.0j]), eye[:, :1], eye[:, :1], np.zeros(1))
    split = Poles(np.array(real, dtype=np.complex128), eye, eye, np.full(2, uncertain))
    assert turning(pair, split, Match(((0, 0),), (ModeCluster((0,), (0, 1), "real axis"),))) == turns


def test_a_model_without_states_has_no_modes(tmp_path: Path) -> None:
    with load(build_reference(tmp_path, subject="feedthrough", fmi=2, interface="me"), interface="me") as model:
        parameter = next(v.name for v in model.description.variables if v.causality == "parameter" and v.is_number)
        found = modes(model, vary=parameter, band=(1.0, 2.0), points=3)
    assert found.sets[0].critical == ()
