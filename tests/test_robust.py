"""What holds for all parameters in their ranges: bounds of µ against known answers, margins against closed forms."""

from __future__ import annotations

import itertools
import json
import math
import shlex
import shutil
from pathlib import Path

import control
import numpy as np
import pytest

import workbench as wb
from scripts.promises import disks, mu, robust
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.errors import InputError
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.mu.peak import peak
from workbench.loops.robust import uncertain
from workbench.loops.robust.fraction import fraction
from workbench.loops.robust.page import robust_page

# 1/(s³ + 0.6 s² + s) in a loop with a gain k: stable below 0.6 (Routh), where the poles are ±j.
ROUTH = """
[components]
plant = {block = "transfer_function", numerator = [1.0], denominator = [1.0, 0.6, 1.0, 0.0]}
k = {gain = 0.4}
error = {sum = "+-"}
[connections]
"error.u2" = "plant.y"
"k.u" = "error.y"
"plant.u" = "k.y"
[inputs]
r = "error.u1"
[outputs]
y = "plant.y"
"""

SATELLITE = """
[components.plant]
A = [[0.0, 10.0], [-10.0, 0.0]]
B = [[1.0, 0.0], [0.0, 1.0]]
C = [[1.0, 10.0], [-10.0, 1.0]]
D = [[0.0, 0.0], [0.0, 0.0]]
inputs = ["u1", "u2"]
outputs = ["y1", "y2"]
[connections]
"plant.u1" = {from = "plant.y1", gain = -1.0}
"plant.u2" = {from = "plant.y2", gain = -1.0}
[outputs]
y1 = "plant.y1"
"""


@pytest.fixture(scope="module")
def routh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("robust") / "routh.toml"
    path.write_text(ROUTH, encoding="utf-8")
    return path


def test_bounds_of_mu_hold_the_truth_of_matrices_whose_mu_is_known() -> None:
    assert mu.run(cases=5, seed=3) == 0


def test_no_peak_hides_between_frequencies() -> None:
    """Two resonances of a damping of 1e-5, 0.1 % apart: the peak is 1/(2 ζ √(1 - ζ²)), and no grid meets it."""
    zeta = 1e-5
    modes = [np.array([[0.0, w], [-w, -2.0 * zeta * w]]) for w in (3.0, 3.003)]
    a = np.block([[modes[0], np.zeros((2, 2))], [np.zeros((2, 2)), modes[1]]])
    b, c = np.zeros((4, 2)), np.zeros((2, 4))
    b[1, 0], b[3, 1], c[0, 0], c[1, 2] = 3.0, 1.5 * 3.003, 1.0, 1.0
    system = Linear(a, b, c, np.zeros((2, 2)))
    truth = 1.5 / (2.0 * zeta * math.sqrt(1.0 - zeta**2))
    for blocks in ([MuBlock(size=2)], [MuBlock(size=1), MuBlock(size=1)]):
        found = peak(system, blocks)
        assert truth <= found.level <= 1.02 * truth
        assert found.frequency_hz == pytest.approx(3.003 / (2.0 * math.pi), rel=1e-4)


def test_a_real_number_is_borne_where_a_complex_one_is_not() -> None:
    """s² + 2ζ s + 1 + δ: stable for every real δ > -1; a complex δ of the size 2ζ√(1 - ζ²) makes it unstable."""
    zeta = 0.05
    a = np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    system = Linear(a, np.array([[0.0], [-1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    real, any_number = peak(system, [MuBlock(size=1, real=True)]), peak(system, [MuBlock(size=1)])
    assert 1.0 <= real.level <= 1.02
    truth = 1.0 / (2.0 * zeta * math.sqrt(1.0 - zeta**2))
    assert truth <= any_number.level <= 1.02 * truth


def test_a_sampled_peak_is_that_on_the_unit_circle() -> None:
    one = np.ones((1, 1))
    found = peak(Linear(-0.8 * one, one, one, 0.0 * one, dt=0.1), [MuBlock(size=1)])
    assert 5.0 <= found.level <= 5.1  # 1/|z - p| at z = -1
    assert found.frequency_hz == pytest.approx(5.0)


def test_the_margin_of_a_gain_is_that_of_routh_and_its_worst_set_is_unstable(routh: Path, tmp_path: Path) -> None:
    out = tmp_path / "robust.json"
    words = ["robust", str(routh), "--uncertain", "k.gain=0.1:0.7", "--json", str(out), "--in-process"]
    assert run(words) == 1  # not stable for all
    told = wb.RobustResult.from_dict(json.loads(out.read_text(encoding="utf-8"))).stability
    truth = (0.6 - 0.4) / 0.3
    assert 0.97 * truth <= told.lower <= truth <= told.upper <= 1.01 * truth
    assert told.verdict == "unstable"
    assert told.worst.unstable
    assert told.worst.pole.real > 0.0
    assert told.worst.frequency_hz == pytest.approx(1.0 / (2.0 * math.pi), rel=1e-2)
    assert told.worst.parameters["k.gain"] == pytest.approx(0.6, rel=1e-2)


def test_a_worst_set_outside_the_ranges_is_told_as_such(routh: Path) -> None:
    """Unstable from a gain of 0.6 on: not in a range from 0.3 to 0.5, but twice that range holds it."""
    with wb.load(routh) as model:
        found = wb.robust(model, {"k.gain": (0.3, 0.5)}, hold=True, in_process=True)
    (row,) = robust_page(found).sections[0].tables[0].rows
    value, words = row[-1].split(", ")
    assert float(value) == pytest.approx(0.6, rel=0.02)
    assert words == "outside the range"


def test_a_range_over_which_the_loop_may_be_unstable_has_no_worst_gain(routh: Path) -> None:
    """The search for the worst gain meets unstable sets, whose gain is infinite, and differences beside them."""
    with wb.load(routh) as model:
        found = wb.robust(model, {"k.gain": (0.2, 0.8)}, inputs=["r"], outputs=["y"], hold=True, in_process=True)
    assert found.stability.lower == pytest.approx(0.1 / 0.3, rel=0.03)
    assert found.worst_gain is not None
    assert found.worst_gain.lower == math.inf


def test_unstable_sets_are_sought_where_bounds_would_take_hours(routh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncertain, "_COPIES", 0)
    with wb.load(routh) as model:
        found = wb.robust(model, uncertain={"k.gain": (0.1, 0.7)}, in_process=True)
    assert found.stability.lower == 0.0
    assert found.stability.upper == pytest.approx(2.0 / 3.0, rel=0.01)  # Routh: k = 0.6
    assert found.stability.verdict == "unstable"
    assert any("nothing is proved" in note and "k.gain 1" in note for note in found.notes)
    assert robust_page(found).facts["stability margin"] == "nothing is proved, unstable from 0.667 times on"


def test_a_block_that_is_too_large_by_itself_ends_the_search_for_a_level() -> None:
    """|4/(s + 1)| = 4 beside what may be 1: no size of the other block helps."""
    system = Linear(-np.eye(2), np.eye(2), np.diag([1.0, 4.0]), np.zeros((2, 2)))
    assert peak(system, [MuBlock(size=1), MuBlock(size=1, varies=False)]).level == math.inf


def test_the_worst_set_is_a_file_and_a_command_that_have_its_poles(
    routh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(routh.parent)  # the command names the file alone
    out, shown = tmp_path / "worst.toml", tmp_path / "lin.json"
    with wb.load(routh) as system:
        found = wb.robust(system, {"k.gain": (0.1, 0.7)}, hold=True, out=out, in_process=True)
    worst = found.stability.worst
    with wb.load(out) as written:
        assert np.sort_complex(wb.lin(written, inputs=["r"]).poles()) == pytest.approx(np.sort_complex(worst.poles))
    words = shlex.split(found.command_line)
    assert words[:2] == ["workbench", "lin"]
    assert run([*words[1:], "--json", str(shown), "--in-process"]) == 0
    a = np.array(json.loads(shown.read_text(encoding="utf-8"))["A"])
    assert np.sort_complex(np.linalg.eigvals(a)) == pytest.approx(np.sort_complex(worst.poles))


def test_the_command_of_a_trimmed_worst_set_trims_there_first(
    routh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(routh, tmp_path)
    with wb.load(routh) as system:
        found = wb.robust(system, {"k.gain": (0.1, 0.7)}, in_process=True)
    for line in found.command_line.split(" && "):
        assert run([*shlex.split(line)[1:], "--in-process"]) == 0


def test_the_worst_disk_margin_is_that_of_the_loop_at_the_worst_gain(routh: Path) -> None:
    with wb.load(routh) as system:
        found = wb.robust(system, uncertain={"k.gain": (0.2, 0.4)}, open=["plant.y"], in_process=True)
        margins = wb.loop(system, "plant.y").margins  # its own gain is 0.4
    with wb.load(routh, start_values={"k.gain": 0.3}) as system:
        middle = wb.loop(system, "plant.y").margins
    assert margins.disk is not None
    assert middle.disk is not None
    (disk,) = found.disk_margins
    assert disk.nominal == pytest.approx(middle.disk.alpha, rel=1e-5)
    assert found.stability.verdict == "stable"
    assert 0.97 * margins.disk.alpha <= disk.alpha <= margins.disk.alpha
    assert disk.found == pytest.approx(margins.disk.alpha, rel=1e-5)
    assert disk.frequency_hz == pytest.approx(margins.disk.frequency_hz, rel=1e-3)


def test_a_time_constant_acts_by_its_inverse_and_the_bounds_hold_that() -> None:
    """1/(τ s + 1) is stable for every τ > 0, and its largest gain is 1 for all of them."""
    with wb.load("fmu:FirstOrderLag") as lag:
        found = wb.robust(lag, uncertain={"tau": (0.5, 1.5)}, inputs=["u"], outputs=["y"], in_process=True)
    assert found.stability.verdict == "stable"
    assert math.isinf(found.stability.upper)
    assert found.worst_gain is not None
    assert found.worst_gain.lower <= 1.0 + 1e-9
    assert 1.0 <= found.worst_gain.upper <= 1.2
    assert found.stability.worst.pole.real == pytest.approx(-1.0 / 1.5)


def test_no_bound_is_optimistic_over_loops_whose_parameters_act_in_curves() -> None:
    assert robust.run(cases=1, samples=400, seed=2) == 0


def test_disk_margins_of_several_loops_are_those_of_python_control_with_what_lies_between_its_points() -> None:
    assert disks.run(cases=1, seed=7) == 0


def test_products_squares_and_inverses_of_parameters_leave_next_to_no_rest() -> None:
    """k/τ, 1/τ and b² within 1e-4, at points on which nothing was fitted either."""

    def entries(d: Floats) -> Floats:
        k, b, tau = 2.0 + d[0], 1.0 + 0.5 * d[1], 1.0 + 0.6 * d[2]
        return np.array([[k / tau, 1.0 / tau], [b * b, 1.0]])

    middle = entries(np.zeros(3))
    alone = [[entries(x * e) - middle for x in (1.0, -0.5, -1.0, 0.5)] for e in np.eye(3)]
    corners = [np.array(s) for s in itertools.product((-1.0, 1.0), repeat=3)]
    found = fraction(alone, corners, [entries(c) - middle for c in corners], 1e-12)
    assert found.ranks == (1, 2, 1)
    for d in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3)):
        assert np.abs(found.at(d) - (entries(d) - middle)).max() <= 1e-4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--uncertain k.gian=0.1:0.7", "did you mean"),
        ("--uncertain k.gain=0.7:0.1", "LO < HI"),
        ("--uncertain k.gain=0.1:0.7 --input r", "--output: the worst-case gain needs inputs and outputs"),
        ("--uncertain k.gain=0.5:0.9", "is not stable in the middle of the ranges"),
        ("--uncertain k.gain=0.1:0.7 --out worst.fmu", "neither .toml nor .ssp"),
        ("--uncertain k.gain=0.1:0.7 --open plant.z", "no connection leaves 'plant.z'"),
    ],
)
def test_what_cannot_be_asked_is_told_in_a_line(
    words: str, said: str, routh: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["robust", str(routh), *words.split(), "--in-process"]) == 2
    line = capsys.readouterr().err
    assert said in line
    assert "Traceback" not in line


def test_a_connection_is_opened_once(routh: Path) -> None:
    with wb.load(routh) as system, pytest.raises(InputError, match="have a connection in common"):
        wb.robust(system, uncertain={"k.gain": (0.2, 0.4)}, open=["plant.y", "error.u2"], in_process=True)


def test_disk_margins_of_several_loops_are_those_of_python_control(tmp_path: Path) -> None:
    """The spinning satellite of Zhou, Doyle & Glover, section 9.6: large margins one at a time, small ones of both."""
    path = tmp_path / "satellite.toml"
    path.write_text(SATELLITE, encoding="utf-8")
    with wb.load(path) as system:
        found = wb.loop(system, ["plant.y1", "plant.y2"])
        everything = wb.loop(system, "all")
    told = {d.where.partition(" ")[0]: d for d in found.disk_margins}
    assert list(told) == ["plant.y1", "plant.y2", "all"]
    one, both = told["plant.y1"], told["all"]
    # One at a time L = 1/s: the largest |S - T| is 1, at all frequencies.
    assert one.alpha == pytest.approx(2.0, rel=1e-4)
    a = np.array([[0.0, 10.0], [-10.0, 0.0]])
    plant = control.ss(a, np.eye(2), [[1.0, 10.0], [-10.0, 1.0]], 0.0)
    at = 2.0 * math.pi * both.frequency_hz
    alpha = control.disk_margins(plant, np.unique([*np.linspace(0.5, 1.5, 41) * max(at, 0.1), at]), skew=0.0)[0]
    assert both.alpha == pytest.approx(alpha, rel=1e-3)
    assert both.alpha < 0.3
    assert both.gain_db == pytest.approx(20.0 * math.log10((2.0 + alpha) / (2.0 - alpha)), rel=1e-2)
    assert everything.disk_margins[-1].alpha == pytest.approx(both.alpha, rel=1e-3)
    assert found.others[0].place.source == "plant.y2"


def test_a_worst_set_that_no_system_file_could_hold_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    seen: list[object] = []
    (tmp_path / "file").write_text("", encoding="utf-8")
    with wb.load("system:rudder_loop") as loop:
        for uncertain, out, words in (
            ({"plant.p1": (1e7, 1.1e7)}, tmp_path / "w.toml", "plant.p1 is not a parameter"),
            ({"plant.viscous": (1e3, 2e3)}, tmp_path / "file" / "w.toml", "out: "),
        ):
            with pytest.raises(wb.InputError, match=words):
                wb.robust(loop, uncertain=uncertain, out=out, progress=lambda *told: seen.append(told))
    assert not seen
