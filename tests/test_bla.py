"""Best linear approximations against theory: Wiener and Hammerstein systems, noise, the grid of lines; the command."""

from __future__ import annotations

import json
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import control
import numpy as np
import pytest
from scipy import stats

import workbench as wb
from tests.random_systems import Modes, random_modes
from workbench.cli.app import run
from workbench.core.values.arrays import Complex, Floats
from workbench.data.bla.design import Lines, RandomPhase, lines_of
from workbench.data.bla.estimate import Approximation, approximate, steady
from workbench.data.bla.request import Bla
from workbench.data.bla.run import run as measure
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job

N = 1024
LAG = 0.6  # pole of the linear block (1 − LAG) / (z − LAG)


def filtered(u: Floats) -> Floats:
    """The periodic answer of the linear block."""
    z = np.exp(2j * np.pi * np.arange(N // 2 + 1) / N)
    return np.asarray(np.fft.irfft(np.fft.rfft(u) * (1.0 - LAG) / (z - LAG), N))


def block(lines: Lines) -> Complex:
    return np.asarray((1.0 - LAG) / (np.exp(2j * np.pi * lines.excited / N) - LAG), dtype=np.complex128)


def measured(
    system: object,
    kind: str = "random-odd",
    *,
    realisations: int = 7,
    noise: float = 0.0,
    last: int = 300,
    seed: int = 0,
) -> tuple[Approximation, Lines]:
    """Two periods of each realisation through a system, with white noise."""
    lines = lines_of(kind, 1, last, 3)
    random = np.random.default_rng(seed)
    u, y = [], []
    for k in range(realisations):
        design = RandomPhase(
            rms=1.0, length=N, excited=tuple(lines.excited), periods=2, transient=0, seed=100 * seed + k
        )
        one = design.period()
        answer = system(one)  # type: ignore[operator]
        u.append(np.tile(one, (2, 1)))
        y.append(np.tile(answer, (2, 1)) + noise * random.standard_normal((2, N)))
    return approximate(np.array(u), np.array(y), lines), lines


def leaves(found: Approximation) -> float:
    """What a linear model leaves of the output."""
    return float(np.sqrt(found.distortion_rms**2 + found.odd_rms**2 + found.even_rms**2) / found.output)


def hardening(transient: int, *, realisations: int) -> tuple[Floats, Floats, Lines]:
    """Two periods of x'' = ω² (u − x − 0.001 x³) − 2 ζ ω x' at 1 Hz, by Runge and Kutta's method, after others."""
    dt, length, w, zeta = 1.0 / 32.0, 320, 2.0 * np.pi, 0.003
    lines = lines_of("random-odd", 1, 80, 1)
    one = np.array([
        RandomPhase(
            rms=1.0, length=length, excited=tuple(lines.excited), periods=2, transient=0, seed=1000 + k
        ).period()
        for k in range(realisations)
    ])  # fmt: skip

    def slope(x: Floats, u: Floats) -> Floats:
        return np.array([x[1], w * w * (u - x[0] - 0.001 * x[0] ** 3) - 2.0 * zeta * w * x[1]])

    x, y, h = np.zeros((2, realisations)), np.empty((realisations, 2, length)), dt / 4.0
    for n in range((transient + 2) * length):
        period, k = divmod(n, length)
        if period >= transient:
            y[:, period - transient, k] = x[0]
        for _ in range(4):
            a = slope(x, one[:, k])
            b = slope(x + 0.5 * h * a, one[:, k])
            c = slope(x + 0.5 * h * b, one[:, k])
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(x + h * c, one[:, k]))
    return np.repeat(one[:, None], 2, axis=1), y, lines


def cubic(x: Floats, lines: Lines) -> Floats:
    """3 (σ² − |X|²): of x³ for a random-phase multisine; 3 σ² for normal signals (Bussgang)."""
    spectrum = np.abs(np.fft.rfft(x)[lines.excited]) / N
    return np.asarray(3.0 * (np.mean(x**2) - spectrum**2))


def test_a_linear_system_has_its_own_response_and_no_distortion() -> None:
    found, lines = measured(filtered)
    assert found.response == pytest.approx(block(lines), abs=1e-12)
    assert max(found.distortion_rms, found.odd_rms, found.even_rms, found.noise_rms) < 1e-8
    assert found.linear == pytest.approx(found.output, rel=1e-9)


@pytest.mark.parametrize("order", ["Wiener", "Hammerstein"])
def test_a_cubic_block_scales_the_linear_one_by_its_power(order: str) -> None:
    """Every realisation has the same amplitudes; the mean over 60 is within its own 95 % errors as often as that."""
    system = (lambda u: filtered(u) ** 3) if order == "Wiener" else (lambda u: filtered(u**3))
    found, lines = measured(system, realisations=60)
    one = RandomPhase(rms=1.0, length=N, excited=tuple(lines.excited), periods=2, transient=0, seed=0).period()
    true = cubic(filtered(one) if order == "Wiener" else one, lines) * block(lines)
    assert np.median(np.abs(found.response - true) / np.abs(true)) < 0.1
    inside = np.mean(np.abs(found.response - true) <= found.error)
    # About 110 lines: two standard deviations of the share are 0.04.
    assert 0.89 <= inside <= 1.0
    assert found.even_rms < 1e-9
    assert found.odd_rms > 0.05 * found.output


@pytest.mark.parametrize(("seed", "noise"), [(1, 0.0), (5, 0.0), (10, 0.0), (16, 0.0), (3, 0.01), (20, 0.01)])
def test_a_transient_is_no_distortion(seed: int, noise: float) -> None:
    """Linear plants with ζ down to 1e-3, one with an integrator, recorded from the second period on after rest.

    Left in, the transients of these plants look like a distortion of up to 40 % of the output.
    """
    plant = random_modes(np.random.default_rng(seed), integrates=seed % 3 == 2)
    dt, random = 1.0 / 64.0, np.random.default_rng(seed)
    data = [
        wb.make_experiment(dt, u, y + noise * y.std() * random.standard_normal(len(y)))
        for u, y in plant.records(dt, (0.1, 8.0), realisations=7, periods=2)
    ]
    found = wb.best_linear(data, period=10.0)
    away = np.abs(found.response[0] - plant.sampled(found.frequency_hz, dt))
    assert found.left[0] < (1e-3 if noise == 0.0 else 0.05)
    assert found.worth == (True,)
    # Of 30 lines 90 % or more; about 95 % over all plants, see scripts/evidence.py bla.
    assert np.mean(away <= found.error[0]) > 0.8
    assert found.removed_rms[0] > 0.003 * found.output_rms[0]


def test_a_transient_that_is_not_linear_hides_distortion() -> None:
    """A hardening spring with ζ = 0.003: settled, a linear model leaves 0.6 % of the output; before, none can say.

    What is estimated of its transient is that of a linear model, and what is wrong in it looks like 26 % distortion.
    """
    early, late = (approximate(*hardening(transient, realisations=4)) for transient in (1, 60))
    assert leaves(late) < 0.03
    assert leaves(early) > 0.1
    assert min(early.removed_rms, leaves(early) * early.output) > (leaves(early) - 0.1) * early.output
    assert early.wait > 20.0


def test_what_decays_no_mode_explains_is_told_from_noise() -> None:
    """Changes that fall by a third in a period, shaped by chance: all that is left is their sum, in 20 of 20 cases.

    The same changes without the decay are noise, in 20 of 20.
    """
    for seed in range(20):
        random = np.random.default_rng(seed)
        noise = random.standard_normal((3, 3, 200))
        fading = np.exp(-np.arange(600) / 400.0).reshape(3, 200)
        assert steady(noise).unsettled == 0.0
        found = steady(noise * fading).unsettled
        rest = np.exp(-0.5)
        assert found == pytest.approx(0.5 / (1.0 - rest), rel=0.5), seed


def test_circles_are_those_of_the_integration_where_there_is_no_noise() -> None:
    """A resonance with ζ = 0.002 and an integrator, in model exchange: without statistics the circles hold."""
    plant = Modes(((1.0, 0.002, 1.0), (3.0, 0.1, -0.5)), integrator=1.0)
    linear = plant.linear
    model = wb.connect(
        {"p": control.ss(linear.A, linear.B, linear.C, linear.D)}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"},
        tolerance=1e-8,
    )  # fmt: skip
    with model:
        found = wb.bla(model, "u", "y", rms=[1.0], band=(0.1, 8.0), realisations=3)
    away = np.abs(found.response[0] - plant.sampled(found.frequency_hz, found.dt))
    assert found.left[0] < 1e-3
    assert np.mean(away <= found.error[0]) > 0.85
    assert np.median(found.error[0] / np.abs(found.response[0])) < 1e-5  # a circle that is too wide says nothing
    assert any("what the integration makes" in note for note in found.notes)


def test_a_tighter_tolerance_that_fails_is_not_said_to_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise SimulationError("p: the step became too small at 1.5 s")

    lag = wb.connect({"p": control.ss(-1.0, 1.0, 1.0, 0.0)}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"})
    with lag as model:
        monkeypatch.setattr(type(model.recipe), "tighter", fails)
        asked = Bla(input="u", output="y", rms=(1.0,), band=(0.1, 1.0), realisations=2, transient=1)
        found = measure(model, asked, Job())
    assert not np.any(found.integration)
    said = [note for note in found.notes if "integration error is not included" in note]
    assert len(said) == 1
    assert said[0].endswith("a tighter tolerance fails (p: the step became too small at 1.5 s)")


def test_what_a_cubic_leaves_is_two_fifths_of_its_power() -> None:
    """Of x³ of a normal signal: all 15 σ⁶, linear 9 σ⁶, the rest distortion."""
    found, _ = measured(lambda u: u**3, "all", realisations=40, last=N // 2 - 1)
    assert found.output**2 == pytest.approx(15.0, rel=0.05)
    assert found.linear**2 == pytest.approx(9.0, rel=0.05)
    assert found.distortion_rms**2 == pytest.approx(6.0, rel=0.05)


def test_a_square_appears_at_even_lines_and_in_the_mean_only() -> None:
    """Of x²: mean σ², power about it 2 σ⁴ of normal signals, all at even sums of odd lines."""
    found, _ = measured(lambda u: u**2, last=200, realisations=20)
    assert np.max(np.abs(found.response)) < 1e-9
    assert found.offset == pytest.approx(1.0, rel=1e-6)
    assert found.odd_rms < 1e-9
    # Half of the power lies above the band, and what is within falls off linearly.
    assert 0.3 * found.output < found.even_rms < found.output


def test_noise_is_told_from_distortion() -> None:
    """White noise σ makes σ/(√(N P) |U|) of a response over P periods."""
    found, lines = measured(lambda u: filtered(u) + 0.0 * u, noise=0.1, realisations=40)
    size = np.sqrt(0.5 / len(lines.excited))  # of U
    assert np.sqrt(np.mean(found.noise**2)) == pytest.approx(0.1 / np.sqrt(2.0 * N) / size, rel=0.05)
    assert found.noise_rms == pytest.approx(0.1, rel=0.05)
    assert np.median(found.distortion) < 0.5 * np.median(found.noise)
    held = [
        np.mean(np.abs(result.response - block(lines)) <= result.error)
        for result, lines in (measured(filtered, noise=0.1, realisations=4, seed=s) for s in range(10))
    ]
    assert 0.92 <= np.mean(held) <= 0.98  # of 1100


@pytest.mark.parametrize(("kind", "excited"), [("all", 20), ("odd", 10), ("random-odd", 8)])
def test_grids(kind: str, excited: int) -> None:
    lines = lines_of(kind, 1, 20, 0)
    assert len(lines.excited) == excited
    assert sorted([*lines.excited, *lines.odd, *lines.even]) == list(range(1, 21))
    if kind != "all":
        assert np.all(lines.excited % 2 == 1)
    with pytest.raises(InputError, match="at least three"):
        lines_of(kind, 1, 2, 0)


def test_the_multisine_has_the_power_asked_for_and_other_phases_for_each_seed() -> None:
    one, other = (
        RandomPhase(rms=2.5, length=N, excited=(1, 3, 9), periods=2, transient=1, seed=s).period() for s in (0, 1)
    )
    assert np.sqrt(np.mean(one**2)) == pytest.approx(2.5)
    assert np.flatnonzero(np.abs(np.fft.rfft(one)) > 1e-6 * N).tolist() == [1, 3, 9]
    assert np.abs(one - other).max() > 0.1


def recorded(
    *seeds: int, periods: int = 3, noise: float = 0.0, on_input: float = 0.0, kind: str = "random-odd"
) -> wb.Experiment:
    """Realisations one after the other through the linear block and a weak cubic one behind it."""
    lines = lines_of(kind, 1, 300, 3)
    ones = [
        RandomPhase(rms=1.0, length=N, excited=tuple(lines.excited), periods=2, transient=0, seed=s).period()
        for s in seeds
    ]
    u = np.concatenate([np.tile(one, periods) for one in ones])
    y = np.concatenate([np.tile(filtered(one) + 0.1 * filtered(one) ** 3, periods) for one in ones])
    random = np.random.default_rng(seeds[0])
    given = u + on_input * random.standard_normal(len(u))
    return wb.make_experiment(
        0.01, given, y + noise * random.standard_normal(len(u)), input_names=["force"], output_names=["way"]
    )


def test_records_give_the_same_as_what_they_were_made_of() -> None:
    lines = lines_of("random-odd", 1, 300, 3)
    records = [recorded(seed) for seed in range(5)]
    found = wb.best_linear(records, period=N * 0.01, transient=1)
    assert found.frequency_hz == pytest.approx(lines.excited / (N * 0.01))
    assert (found.periods, found.realisations, found.lines) == (2, 5, "random-odd")
    assert found.worth == (True,)
    assert np.isnan(found.offset).all()  # the output at rest is not known
    together = wb.best_linear([recorded(*range(5))], period=N * 0.01, transient=1)
    assert together.realisations == 5
    assert together.response == pytest.approx(found.response, abs=1e-12)
    with pytest.raises(InputError, match="not a whole number of samples"):
        wb.best_linear(records, period=0.015)
    with pytest.raises(InputError, match="does not repeat with a period of 7 s"):
        wb.best_linear(records, period=7.0)
    with pytest.raises(InputError, match=r"1 whole period of 10\.24 s after the transient"):
        wb.best_linear(records, period=N * 0.01, transient=2)
    with pytest.raises(InputError, match="excite different lines"):
        wb.best_linear([*records, recorded(9, kind="odd")], period=N * 0.01)


def test_records_that_begin_within_a_period_lose_the_ones_with_two_phases() -> None:
    late = recorded(1, 2, 3, periods=4).part(100)
    found = wb.best_linear([late], period=N * 0.01)
    assert (found.realisations, found.periods) == (3, 3)
    assert found.distortion_rms == pytest.approx(
        wb.best_linear([recorded(1, 2, 3)], period=10.24).distortion_rms, rel=0.05
    )
    assert any("at other phases are left out" in note for note in found.notes)


def test_one_realisation_tells_distortion_by_the_lines_left_out() -> None:
    """The fast method: as large an error as that of many realisations, and it holds the truth as often as it says."""
    one = RandomPhase(
        rms=1.0, length=N, excited=tuple(lines_of("random-odd", 1, 300, 3).excited), periods=2, transient=0, seed=0
    ).period()
    lines = lines_of("random-odd", 1, 300, 3)
    true = block(lines) * (1.0 + 0.1 * cubic(filtered(one), lines))
    every = [wb.best_linear([recorded(s, noise=0.02, on_input=0.01)], period=N * 0.01) for s in range(30)]
    held = [np.mean(np.abs(found.response[0] - true) <= found.error[0]) for found in every]
    assert 0.92 <= np.mean(held) <= 0.98  # of 3300 in 30 realisations
    many = wb.best_linear([recorded(*range(30), noise=0.02)], period=N * 0.01)
    alone = np.sqrt(np.mean([found.distortion_rms[0] ** 2 for found in every]))
    assert alone == pytest.approx(many.distortion_rms[0], rel=0.1)
    with pytest.raises(InputError, match="only where odd lines are left out"):
        wb.best_linear([recorded(1, kind="odd")], period=N * 0.01)


def test_noise_of_a_measured_input_is_in_the_error() -> None:
    """What the input's noise adds to Y − G U: √(σ_y² + |G|² σ_u²) of the linear block."""
    lines = lines_of("random-odd", 1, 300, 3)
    random = np.random.default_rng(0)
    u, y = [], []
    for s in range(20):
        design = RandomPhase(rms=1.0, length=N, excited=tuple(lines.excited), periods=2, transient=0, seed=s)
        one = design.period()
        u.append(np.tile(one, (4, 1)) + 0.1 * random.standard_normal((4, N)))
        y.append(np.tile(filtered(one), (4, 1)))
    found = approximate(np.array(u), np.array(y), lines)
    size = np.sqrt(0.5 / len(lines.excited))
    said = found.noise / np.abs(block(lines))
    assert np.sqrt(np.mean(said**2)) == pytest.approx(0.1 / np.sqrt(4.0 * N) / size, rel=0.05)


@pytest.mark.parametrize(
    ("left", "hidden", "removed", "worth"),
    [
        (0.09, 0.0, 0.0, True), (0.11, 0.0, 0.0, False), (0.19, 0.0, 0.0, False), (0.19, 0.08, 0.0, False),
        (0.19, 0.1, 0.0, None), (0.0, 0.2, 0.0, None), (0.09, 0.0, 0.6, True), (0.19, 0.0, 0.1, None),
        (0.19, 0.0, 0.08, False), (0.01, 0.0, 2.0, True),
    ],
)  # fmt: skip
def test_a_linear_model_is_worth_having_where_it_leaves_less_than_a_tenth(
    left: float, hidden: float, removed: float, worth: bool | None
) -> None:
    """Distortion at excited, odd and even lines adds up by its power, 2² + 3² + 6² = 7²; a transient may hide it."""
    size, curve = 5.0, np.zeros((1, 3))
    excited, odd, even = (np.array([size * left * part / 7.0]) for part in (2.0, 3.0, 6.0))
    found = wb.BlaResult(
        model="m", input="u", output="y", input_unit=None, output_unit=None, rms=np.ones(1), frequency_hz=np.ones(3),
        response=curve.astype(np.complex128), error=curve, integration=curve, noise=curve, distortion=curve,
        output_rms=np.array([size]), linear_rms=np.array([size]), noise_rms=np.zeros(1), distortion_rms=excited,
        removed_rms=np.array([size * removed]), unsettled_rms=np.array([size * hidden]), odd_rms=odd, even_rms=even,
        offset=np.zeros(1), dt=0.1, samples=10, periods=2, realisations=2, transient=1, lines="odd",
    )  # fmt: skip
    assert found.left == pytest.approx(left)
    assert found.worth == (worth,)
    assert ("10 % of the output" if worth is not None else "cannot be said") in found.verdict


def test_zero_is_a_seed_of_several_realisations_too() -> None:
    """The lag 1/(1 + s), sampled with a held input."""
    asked = Bla(
        input="u", output="y", rms=1.0, band=(0.2, 1.0), dt=0.1, realisations=2, lines="odd", seed=0, transient=2
    )
    with wb.load("fmu:FirstOrderLag") as model:
        found = measure(model, asked, Job())
    z = np.exp(2j * np.pi * found.frequency_hz * found.dt)
    assert found.response[0] == pytest.approx((1.0 - np.exp(-found.dt)) / (z - np.exp(-found.dt)), rel=1e-3)


def test_the_command_takes_recorded_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(1, 2).to_csv(tmp_path / "one.csv")
    recorded(3).to_csv(tmp_path / "two.csv")
    ends = ["--input", "force", "--output", "way"]
    command = ["bla", str(tmp_path / "one.csv"), *ends, "--period", "10.24"]
    also = [
        "--also",
        str(tmp_path / "two.csv"),
        "--json",
        str(tmp_path / "bla.json"),
        "--plot",
        str(tmp_path / "b.png"),
    ]
    assert run([*command, *also]) == 0
    assert "3 realisations of 2 periods of 1024 samples" in capsys.readouterr().out
    found = wb.BlaResult.read(tmp_path / "bla.json")
    expected = wb.best_linear([recorded(1, 2), recorded(3)], period=10.24, transient=1)
    assert found.response == pytest.approx(expected.response, abs=1e-9)
    assert np.isnan(found.offset).all()
    for more, said in (
        ([*command, "--rms", "1"], "--rms is for models"),
        ([*command, "--solver", "gear"], "--solver is for models"),
        ([*command, "--measured-periods", "3"], "--measured-periods is for models"),
        (command[:-2], "--period is missing"),
        (["bla", "fmu:Rudder", "--input", "delC", "--output", "del", "--period", "2"], "--period is for recorded data"),
        (["bla", "fmu:Rudder", "--input", "delC", "--output", "del", "--rms", "2"], "--band is missing"),
        ([*command[:2], "--input", "forc", "--output", "way", "--period", "1"], "no column 'forc'"),
    ):
        assert run(more) == 2
        assert said in capsys.readouterr().err


def test_the_rudder_stops_being_linear_where_its_rate_limit_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bla.json"
    command = ["bla", "fmu:Rudder", "--input", "delC", "--output", "del", "--band", "0.2:5", "--realisations", "2"]
    assert run([*command, "--rms", "0.2,20", "--json", str(path), "--plot", str(tmp_path / "bla.png")]) == 0
    told = capsys.readouterr().out
    assert "a linear model is worth having at 0.2 deg rms" in told
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["worth"] == [True, False]
    assert len(found["gain_db"]) == 2
    again = wb.BlaResult.read(path)
    assert again.response.shape == (2, len(again.frequency_hz))
    assert (tmp_path / "bla.png").stat().st_size > 10_000
    assert run([*command, "--rms", "0"]) == 2
    assert "rms: 0 is not a positive number" in capsys.readouterr().err
    assert run([*command[:-4], "--band", "5:2", "--rms", "1"]) == 2
    assert "band must rise" in capsys.readouterr().err


@pytest.mark.skipif(
    sys.version_info < (3, 12) or not all(map(find_spec, ("best_linear_approximation", "multisine"))),
    reason="compares with the packages best-linear-approximation and multisine, which need Python 3.12 and newer and "
    "are no dependency: pip install best-linear-approximation multisine",
)
def test_the_package_best_linear_approximation_says_the_same() -> None:
    """Response, and variances of the mean by noise and in all; its distortion is that of the mean, ours of one."""
    theirs = import_module("best_linear_approximation.robust")
    multisine = import_module("multisine")
    realisations, periods = 6, 3
    played = multisine.random_phase_multisine(N, 100.0, n_realizations=realisations, f_min=1.0, f_max=30.0).u
    random = np.random.default_rng(0)
    ones = played[:, 0, :].T
    y = np.array([filtered(one) + 0.2 * filtered(one) ** 3 for one in ones])[:, None]
    y = y + 0.05 * random.standard_normal((realisations, periods, N))
    u = np.repeat(ones[:, None], periods, axis=1)
    for given, known in ((u, True), (u + 0.03 * random.standard_normal(u.shape), False)):
        bins = np.arange(11, 308)
        outputs = np.transpose(y, (2, 0, 1))[:, None]
        if known:
            found = theirs.known_input(played, outputs, 100.0, bins, show_warnings=False)
        else:
            inputs = np.transpose(given, (2, 0, 1))[:, None]
            found = theirs.noisy_input(inputs, outputs, 100.0, bins, show_warnings=False)
        own = approximate(given, y, Lines(bins, np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)))
        assert own.response == pytest.approx(found.G.value[:, 0, 0], rel=1e-9)
        assert own.noise**2 / realisations == pytest.approx(found.G.noise.var.ravel(), rel=1e-6)
        total = own.error**2 / stats.f.ppf(0.95, 2, 2 * (realisations - 1))
        assert total == pytest.approx(found.G.total.var.ravel(), rel=1e-6)
        if known:
            assert own.distortion**2 / realisations == pytest.approx(found.G.nonlinear.var.ravel(), rel=1e-6)
