"""The envelope of a study: distributions, points, the interpolated map, the search, whole studies on small FMUs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import workbench as wb
from workbench.cli.app import run as run_command
from workbench.core.values.arrays import Floats
from workbench.study.envelope.page import envelope_page
from workbench.study.envelope.sampling import shares
from workbench.study.envelope.search import search
from workbench.study.envelope.surface import Surface
from workbench.study.names import units_of
from workbench.study.read import read_study
from workbench.study.spread import read_spread

# -- distributions and points -------------------------------------------------------------------

LAWS = [
    ({"range": [2.0, 5.0]}, stats.uniform(2.0, 3.0)),
    ({"normal": [1.0, 0.2]}, stats.norm(1.0, 0.2)),
    ({"log-normal": [3.0, 0.5]}, stats.lognorm(0.5, scale=3.0)),
    ({"triangular": [0.0, 1.0, 4.0]}, stats.triang(0.25, 0.0, 4.0)),
    ({"normal": [0.0, 1.0], "between": [-1.0, 2.0]}, stats.truncnorm(-1.0, 2.0)),
]


@pytest.mark.parametrize(("given", "law"), LAWS)
def test_shares_become_quantiles(given: dict[str, Any], law: Any) -> None:  # noqa: ANN401
    spread = read_spread("m.k", given, "[x]")
    for share in (0.01, 0.3, 0.5, 0.99):
        assert law.cdf(spread.at(share)) == pytest.approx(share, abs=1e-9)
    assert spread.across(0.0) == spread.low
    assert spread.across(1.0) == spread.high
    assert spread.place(spread.across(0.3)) == pytest.approx(0.3)
    assert len(spread.grid) == 5


def test_discrete_values_come_as_often_as_their_weights() -> None:
    spread = read_spread("m.k", {"discrete": [True, False], "weights": [3.0, 1.0]}, "[x]")
    found = [spread.at(float(u)) for u in np.linspace(0.0005, 0.9995, 1000)]
    assert found.count(True) == 750
    assert spread.middle is True
    assert [spread.across(p) for p in (0.0, 0.6, 1.0)] == [True, False, False]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "has no distribution; give one of range, normal"),
        ({"range": [0.0, 1.0], "normal": [0.0, 1.0]}, "range and normal: only one"),
        ({"range": [1.0, 0.0]}, "the numbers must rise"),
        ({"normal": [1.0, 0.0]}, "standard deviation"),
        ({"log-normal": [0.0, 1.0]}, "median"),
        ({"triangular": [0.0, 1.0]}, "takes 3 numbers, not 2"),
        ({"discrete": [1.0, 1.0]}, "each once"),
        ({"discrete": [1.0, 2.0], "weights": [1.0]}, "one for each value"),
        ({"range": [0.0, 1.0], "weights": [1.0]}, "belong to discrete"),
        ({"normal": [0.0, 1.0], "between": [60.0, 70.0]}, "nothing of the distribution"),
        ({"range": [0.0, 1.0], "between": [0.0, 2.0]}, "wider than the range"),
        ({"uniform": [0.0, 1.0]}, "uniform"),
    ],
)
def test_what_is_no_distribution_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(wb.InputError, match=words):
        read_spread("m.k", given, "[x]")


def test_plans_fill_the_cube() -> None:
    latin = shares("latin", 50, 3, 1)
    assert all(sorted(np.floor(50 * column)) == list(range(50)) for column in latin.T)
    sobol = shares("sobol", 64, 2, 1)
    boxes = {tuple(np.floor(8 * row)) for row in sobol}
    assert len(boxes) == 64  # each of 8 × 8 boxes once
    assert np.array_equal(shares("random", 5, 2, 7), shares("random", 5, 2, 7))
    assert not np.array_equal(shares("sobol", 5, 2, 7), shares("sobol", 5, 2, 8))


# -- the map ------------------------------------------------------------------------------------


def test_a_plane_is_interpolated_without_error() -> None:
    places = shares("random", 40, 2, 3)
    surface = Surface(places, 2.0 * places[:, 0] - 3.0 * places[:, 1])
    inside = 0.3 + 0.4 * shares("random", 200, 2, 4)
    value, error = surface(inside)
    assert value == pytest.approx(2.0 * inside[:, 0] - 3.0 * inside[:, 1])
    assert error.max() < 1e-12
    assert np.isnan(surface(np.array([[5.0, 5.0]]))[0]).all()


def smooth(places: Floats, k: int) -> Floats:
    x, y = places.T
    a, b, c = np.random.default_rng(k).uniform(-4.0, 4.0, 3)
    return np.asarray(np.sin(a * x + c) * np.cos(b * y) + 0.3 * (x - y) * c, dtype=np.float64)


@pytest.mark.parametrize("plan", ["grid", "latin", "sobol"])
def test_the_error_of_the_map_covers_the_truth(plan: str) -> None:
    """Of 19 places in 20 at least, over many smooth functions; so the limit's band has the limit."""
    side = np.linspace(0.0, 1.0, 7)
    grid = np.column_stack([a.ravel() for a in np.meshgrid(side, side)])
    covered, signs = [], []
    for k in range(25):
        places = grid if plan == "grid" else shares(plan, 64, 2, k)
        value, error = Surface(places, smooth(places, k))(shares("random", 300, 2, 99 + k))
        truth = smooth(shares("random", 300, 2, 99 + k), k)
        known = np.isfinite(value)
        covered.append(np.mean(np.abs(value - truth)[known] <= error[known]))
        outside = known & (np.abs(value) > error)
        signs.append(np.mean((value > 0.0)[outside] == (truth > 0.0)[outside]) if outside.any() else 1.0)
    assert np.mean(covered) >= 0.95
    assert np.mean(signs) >= 0.99


def test_points_on_a_line_are_no_map() -> None:
    with pytest.raises(ValueError, match="one line"):
        Surface(np.column_stack([np.arange(5.0), np.arange(5.0)]), np.arange(5.0))


# -- the search ---------------------------------------------------------------------------------


def valleys(places: Floats) -> Floats:
    """Many valleys; the deepest, of −1, at (0.62, 0.31)."""
    off = places - np.array([0.62, 0.31])
    return np.asarray(3.0 * np.sum(off**2, axis=1) - np.prod(np.cos(18.0 * off), axis=1), dtype=np.float64)


@pytest.mark.parametrize("seed", range(5))
def test_the_search_finds_what_the_grid_does_not(seed: int) -> None:
    side = np.linspace(0.0, 1.0, 4)
    grid = np.column_stack([a.ravel() for a in np.meshgrid(side, side)])
    calls: list[int] = []

    def margins(places: Floats) -> Floats:
        calls.append(len(places))
        return valleys(places)

    found = search(margins, 2, known=(grid, valleys(grid)), evaluations=300, seed=seed)
    assert found.margin <= valleys(grid).min()
    assert found.margin == pytest.approx(valleys(found.place[None])[0])
    assert found.evaluations == sum(calls) <= 300
    assert found.margin < -0.75  # one of the deepest valleys; the grid's worst point is -0.6


def test_the_search_keeps_the_worst_known_point_and_passes_over_failures() -> None:
    corner = np.array([[0.0, 0.0]])
    found = search(lambda p: np.full(len(p), np.nan), 2, known=(corner, np.array([-5.0])), evaluations=40, seed=1)
    assert (found.margin, found.place.tolist()) == (-5.0, [0.0, 0.0])
    assert found.failed == found.evaluations > 0


# -- whole studies ------------------------------------------------------------------------------

# The pole of 1/(tau s + 1) is −1/tau: stable "by 0.6" as long as tau < 1/0.6.
LAG = """
name = "lag"
models.lag = "fmu:FirstOrderLag"
analyses.linear = {command = "lin", model = "lag"}
[[requirements]]
name = "quick"
analysis = "linear"
kind = "stability"
max = -0.6
"""
ENVELOPE = LAG + '\n[envelope]\n[envelope.parameters]\n"lag.tau" = {range = [0.5, 2.0], steps = 4}\n'


@pytest.fixture
def study(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_grid_its_worst_case_and_its_continuation(study: Callable[[str], Path], tmp_path: Path) -> None:
    path = study(ENVELOPE)
    found = wb.envelope(path, workers=wb.Workers(jobs=1), search=12)
    taus = [float(p.values["lag.tau"]) for p in found.points]
    assert taus == [0.5, 1.0, 1.5, 2.0]
    assert [p.margin for p in found.points] == pytest.approx([1.0 / t - 0.6 for t in taus], abs=1e-9)
    assert [p.passed for p in found.points] == [True, True, True, False]
    assert found.probabilities == ()
    assert found.worst is not None
    assert found.worst.margin == pytest.approx(-0.1, abs=1e-9)
    assert 1 <= found.worst.evaluations <= 12
    again = wb.envelope(path, workers=wb.Workers(jobs=1), search=12)
    assert again.measured == 0
    assert again.worst == found.worst
    assert wb.EnvelopeResult.from_dict(json.loads(json.dumps(found.to_dict()))).to_dict() == found.to_dict()
    written = tmp_path / "worst.toml"
    written.write_text(found.worst.systems["lag"], encoding="utf-8")
    with wb.load(written) as model:
        assert wb.lin(model).poles().real == pytest.approx([found.worst.value], abs=0.0)
    assert "--set=tau=2" in found.worst.commands[0]


def test_a_worst_case_that_only_the_search_met_is_not_passed(
    study: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = ENVELOPE.replace("[envelope]\n", '[envelope]\nplan = "random"\npoints = 1\nseed = 3\n', 1)
    path, out = study(text), tmp_path / "e.json"
    words = ["run", str(path), "--no-keep", "--jobs", "1", "--json", str(out)]
    assert run_command([*words, "--search", "0"]) == 0
    assert run_command([*words, "--search", "12"]) == 1
    told = json.loads(out.read_text(encoding="utf-8"))
    assert (told["met"], told["violated"], told["passed"]) == (1, 0, False)
    assert told["worst"]["value"] == pytest.approx(-0.5, abs=1e-3)  # at tau = 2
    said = capsys.readouterr().out
    assert "but not at one that the search found" in said
    assert "failed: not met at the worst case, margin -0.1" in said


def test_a_probability_and_how_many_more_points(study: Callable[[str], Path]) -> None:
    text = ENVELOPE + "[envelope.failures]\nfresh = 0.75\nworn = 0.25\n"
    text = text.replace("[envelope]\n", '[envelope]\nplan = "random"\npoints = 12\nwidth = 0.1\n', 1)
    configurations = "configurations.fresh.lag = {}\nconfigurations.worn.lag = {set = {tau = 2.0}}\n"
    found = wb.envelope(study(configurations + text), keep=False, workers=wb.Workers(jobs=1))
    fresh, worn, all_of_them = found.probabilities
    passed = [float(p.values["lag.tau"]) < 1.0 / 0.6 for p in found.of("fresh")]
    assert (fresh.samples, fresh.met) == (12, sum(passed))
    assert fresh.low < fresh.met / 12 < fresh.high
    assert fresh.more is not None
    assert fresh.more > 100
    assert {p.values["lag.tau"] for p in found.of("worn")} == {2.0}  # what a failure sets is not varied
    assert (worn.met, worn.low) == (0, 0.0)
    assert all_of_them.estimate == pytest.approx(0.75 * fresh.met / 12)
    assert found.measured == 13  # the failed lag is the same at all points
    assert "Wilson's interval holds" in found.interval


def test_a_failed_point_keeps_its_reason_and_widens_the_interval(study: Callable[[str], Path]) -> None:
    text = ENVELOPE.replace("{range = [0.5, 2.0], steps = 4}", "{discrete = [0.0, 1.0]}")
    found = wb.envelope(study(text), keep=False, workers=wb.Workers(jobs=1), plan="random", points=8)
    assert found.failed
    assert found.violated == ()
    assert all(p.values["lag.tau"] == 0.0 and p.reason for p in found.failed)
    (p,) = found.probabilities
    assert (p.unknown, p.high, p.more) == (len(found.failed), 1.0, None)
    assert p.low < p.met / p.samples < 1.0
    assert "nothing was measured" in envelope_page(found).lead


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAG, r"has no \[envelope\]"),
        (LAG + "[envelope]\nparameters = {}", r"\[envelope.parameters\]: is empty"),
        (LAG + '[envelope]\nparameters = {"lagg.tau" = [0.5, 1.0]}', "model 'lagg' is unknown; did you mean lag"),
        (LAG + '[envelope]\nparameters = {"lag.tou" = [0.5, 1.0]}', r'\[envelope.parameters\] "lag.tou"'),
        (LAG + '[envelope]\nplan = "cube"\nparameters = {"lag.tau" = [0.5, 1.0]}', "plan"),
        (ENVELOPE + "[grid]\nlag.tau = [1.0]", r"\[grid\] and \[envelope\]: only one"),
        (ENVELOPE + "[envelope.failures]\nworn = 1.0", "configuration 'worn' is unknown"),
        (ENVELOPE.replace("[envelope]\n", '[envelope]\nborders = ["linear"]\n', 1), "runs lin; borders come from"),
        (ENVELOPE.replace("[envelope]\n", '[envelope]\nrequirement = "slow"\n', 1), "requirement 'slow' is unknown"),
        (ENVELOPE.replace('kind = "stability"', 'kind = "value"\npath = "polls"'), "there is no 'polls'"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(study: Callable[[str], Path], text: str, words: str) -> None:
    with pytest.raises(wb.InputError, match=words) as told:
        wb.envelope(study(text), keep=False, workers=wb.Workers(jobs=1))
    assert "\n" not in str(told.value)


def test_run_says_who_runs_an_envelope(study: Callable[[str], Path]) -> None:
    with pytest.raises(wb.InputError, match=r"wb\.envelope"):
        wb.run_study(study(ENVELOPE))


# Two lags with the poles −1/a and −1/b, and an unstable loop around both: s² + s(1/a + 1/b) + (1 − gain)/(a·b).
LOOP = """
[components]
a = "fmu:FirstOrderLag"
b = "fmu:FirstOrderLag"
sum = {sum = "++"}
loop = {model = "fmu:Saturation", set = {"C[1]" = 0.0, "C[2]" = 0.0, D = 0.5, lower = -9.0, upper = 9.0}}
[connections]
"b.u" = "a.y"
"loop.u" = "b.y"
"sum.u1" = "loop.y"
"a.u" = "sum.y"
[inputs]
u = "sum.u2"
[outputs]
y = "b.y"
"""
BORDERS = """
models.loop = "loop.toml"
analyses.linear = {command = "lin", model = "loop"}
analyses.critical = {command = "modes", model = "loop", vary = "loop.D=0.5:2", points = 4}
requirements = [{name = "stable", analysis = "linear", kind = "stability", max = 0.0}]
[envelope]
borders = ["critical"]
lines = 2
parameters = {"loop.loop.D" = {range = [0.5, 2.0], steps = 3}, "loop.a.tau" = {range = [0.5, 1.0], steps = 3}}
"""


def test_borders_pictures_and_pages(study: Callable[[str], Path], tmp_path: Path) -> None:
    (tmp_path / "loop.toml").write_text(LOOP, encoding="utf-8")
    path = study(BORDERS)
    names = ("--json", "--csv", "--plot", "--report", "--worst")
    files = [str(tmp_path / f"made{suffix}") for suffix in (".json", ".csv", ".png", ".html", ".toml")]
    words = [word for pair in zip(names, files, strict=True) for word in pair]
    assert run_command(["run", str(path), "--no-keep", "--jobs", "1", *words]) == 1  # not met everywhere
    assert all(Path(f).stat().st_size > 100 for f in files)
    found = wb.EnvelopeResult.read(files[0])
    assert len(found.points) == 9
    assert [(b.kind, b.line) for b in found.borders] == [("real pole", 0.5), ("real pole", 1.0)]
    assert [b.at for b in found.borders] == pytest.approx([1.0, 1.0], abs=1e-4)
    for p in found.points:  # s² + s(1 + 1/a) + (1 − D)/a
        a, gain = float(p.values["loop.a.tau"]), float(p.values["loop.loop.D"])
        poles = np.roots([1.0, 1.0 + 1.0 / a, (1.0 - gain) / a])
        # The saturation has a state of its own, which nothing reads, with the poles −0.255 ± …j.
        assert p.value == pytest.approx(max(poles.real.max(), -0.255), abs=1e-7)
    with wb.load(files[4]) as model:
        assert found.worst is not None
        assert max(wb.lin(model).poles().real) == found.worst.value


def test_parameters_have_their_units(tmp_path: Path) -> None:
    """On the axes and in the table; what cannot be opened, and a number without a unit, has none."""
    file = tmp_path / "lags.toml"
    file.write_text(
        'models.lag = "fmu:FirstOrderLag"\nanalyses.linear = {command = "lin", model = "lag"}\n'
        'requirements = [{name = "stable", analysis = "linear", kind = "stability", max = 0.0}]\n'
        '[envelope]\nparameters = {"lag.tau" = {range = [0.5, 2.0], steps = 2}}\n',
        encoding="utf-8",
    )
    found = wb.envelope(file, keep=False)
    assert [(p.name, p.unit) for p in found.parameters] == [("lag.tau", "s")]
    assert found.plot().axes[0].get_xlabel() == "lag.tau [s]"
    study = read_study(file)
    assert units_of(study, ["lag.tau", "gone.x"]) == {"lag.tau": "s"}
