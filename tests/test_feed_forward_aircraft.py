"""Feed-forward of the aircraft's damper: design, system file and command, on the bundled FMUs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.core.values.linear import LinearPart
from workbench.limit_cycles.feedback.closed_system import find_place
from workbench.loops.opened_system import find_ports
from workbench.point.reduction.cancel import cancel
from workbench.point.reduction.factored import factored
from workbench.system.files.read import read_system

SYSTEMS = Path(__file__).parents[1] / "systems"
FEEDBACK = ("aircraft.outer_aileron_position", -1.0)
TARGET = "aircraft.inner_aileron"
PULSE = wb.Table((0.0, 0.1, 0.1, 300.0), (0.8, 0.8, 0.0, 0.0))
COMMAND = [
    "feed-forward", str(SYSTEMS / "failed_aileron.toml"), "--block", "damper", "--to", TARGET, "--feedback",
    "aircraft.outer_aileron_position:-1",
]  # fmt: skip


@pytest.fixture(scope="module")
def aircraft() -> Iterator[wb.DescribedModel]:
    with wb.load(str(SYSTEMS / "failed_aileron.toml")) as model:
        yield model


@pytest.fixture(scope="module")
def found(aircraft: wb.DescribedModel) -> wb.FeedForwardResult:
    return wb.feed_forward(
        aircraft, block="damper", target=TARGET, feedback=FEEDBACK, orders=(36, 29), cancel=3e-3, low_pass=5.0
    )


# -- design ---------------------------------------------------------------------------------------


def test_the_orders_of_the_steps(found: wb.FeedForwardResult) -> None:
    orders = [(step.name, step.order) for step in found.steps]
    assert orders == [
        ("reduced", 65), ("joined", 65), ("cancelled", 42), ("mirrored", 42), ("sign", 42), ("low-pass", 43),
    ]  # fmt: skip
    assert (found.design.G.order, found.design.H.order) == (36, 29)
    assert (found.design.G.full_order, found.design.H.full_order) == (71, 71)
    assert (len(found.open_unstable), len(found.closed_unstable)) == (2, 0)
    assert np.abs(found.open_unstable) / (2.0 * np.pi) == pytest.approx([3.435, 3.435], abs=0.005)


def test_the_reduced_filter_holds_in_its_band(found: wb.FeedForwardResult) -> None:
    steps = {step.name: step for step in found.steps}
    joined, cancelled, mirrored = steps["joined"], steps["cancelled"], steps["mirrored"]
    assert joined.response == pytest.approx(steps["reduced"].response, rel=1e-6)  # as a state-space quotient
    assert joined.gain_error_db < 1.2
    assert joined.residual < 1e-3
    assert cancelled.residual < 1e-2
    assert mirrored.gain_error_db == pytest.approx(cancelled.gain_error_db, abs=1e-9)
    # Above the slow poles the phase holds within 2 degrees, until it is mirrored.
    ratio = (joined.response / found.exact)[(found.frequency_hz > 0.5) & (found.frequency_hz < 5.0)]
    assert np.max(np.abs(np.angle(ratio, deg=True))) < 2.0


def test_the_errors_of_the_reduction_keep_their_bounds(found: wb.FeedForwardResult) -> None:
    for exact, reduced in ((found.g, found.design.G), (found.h, found.design.H)):
        error = np.abs(exact - reduced.part.response(found.frequency_hz))
        assert np.max(error) <= reduced.bound
        assert np.all(np.diff(reduced.hankel) <= 0.0)


def test_poles_right_of_the_axis_are_zeros_of_the_plant(found: wb.FeedForwardResult) -> None:
    # Independent of any reduction: zeros of G of the whole aircraft, by the eigenvalues of its system matrix.
    mirrored = found.design.mirrored
    inside = mirrored[np.abs(mirrored) < 2.0 * np.pi * 5.0]
    assert len(inside) == 4
    with wb.load(str(SYSTEMS / "failed_aileron.toml")) as model:
        linear = wb.lin(model, inputs=["inner_aileron"], outputs=["outer_aileron_rate"]).result
    zeros = factored(LinearPart(linear.A, linear.B[:, 0], linear.C[0])).zeros
    right = zeros[zeros.real > 1e-6]
    assert len(right) == 7
    for pole in inside:
        assert np.min(np.abs(right - pole)) < 1e-3 * abs(pole)
    assert np.sum(found.design.mirrored.imag == 0.0) == 1  # one real pole: the phase at rest turns, the sign changes


def test_the_quotient_does_not_depend_on_the_feedback(aircraft: wb.DescribedModel, found: wb.FeedForwardResult) -> None:
    from workbench.limit_cycles.feed_forward.plant import linear_plant

    open_ = linear_plant(find_place(aircraft, FEEDBACK[0], TARGET), find_ports(aircraft, "damper"), 0.0)
    f = np.geomspace(0.1, 10.0, 50)
    exact = open_.H.response(f) / open_.G.response(f)
    # Fed back is the integral of what the filter keeps at zero.
    at_f = np.exp(np.interp(np.log(f), np.log(found.frequency_hz), np.log(np.abs(found.exact))))
    assert np.abs(exact) == pytest.approx(at_f, rel=0.02)


def test_without_tolerance_for_pairs_only_few_cancel(found: wb.FeedForwardResult, aircraft: wb.DescribedModel) -> None:
    narrow = wb.feed_forward(aircraft, block="damper", target=TARGET, feedback=FEEDBACK, orders=(36, 29), cancel=1e-5)
    steps = {step.name: step for step in narrow.steps}
    assert steps["cancelled"].order == 62
    joined = factored(narrow.design.H.part).over(factored(narrow.design.G.part))
    for order, tolerance in ((42, 2.8e-3), (40, 3.8e-3)):
        assert cancel(joined, tolerance=0.95 * tolerance)[0].order > order
        assert cancel(joined, tolerance=1.05 * tolerance)[0].order <= order


def test_the_filter_brings_limit_cycles_of_its_own(found: wb.FeedForwardResult) -> None:
    # The scalar feedback alone leaves none. With the filter a larger one stands beside the rest, and an unstable one
    # between them. Independently: the system file, linearised whole with its actuator after 140 s.
    assert found.limit_cycles is not None
    assert found.limit_cycles.without == ()
    ours = {c.stable: c for c in found.limit_cycles.with_filter if c.frequency_hz > 1.0}
    with wb.load(str(SYSTEMS / "failed_aileron_feedforward.toml")) as model:
        theirs = wb.limit_cycle(model, block="damper", time=150.0, band=(1.0, 10.0), methods=("describing function",))
    assert len(theirs.crossings) == len(ours) == 2
    for c in theirs.crossings:
        assert ours[c.stable].frequency_hz == pytest.approx(c.frequency_hz, abs=0.01)
        assert ours[c.stable].amplitude == pytest.approx(c.amplitude, rel=0.15)  # the actuator lags by 5 ms
    assert ours[False].amplitude < 0.217 < ours[True].amplitude  # type: ignore[operator]
    assert any("a limit cycle is predicted at" in note and "without it there is none" in note for note in found.notes)


# -- system file ----------------------------------------------------------------------------------


def test_the_bundled_filter_is_what_the_command_writes(tmp_path: Path) -> None:
    out = tmp_path / "filter.json"
    assert run([*COMMAND, "--orders", "36,29", "--cancel", "3e-3", "--out", str(out)]) == 0
    f = np.geomspace(0.05, 20.0, 200)
    responses = []
    for path in (out, SYSTEMS / "aileron_feedforward.json"):
        data = json.loads(path.read_text(encoding="utf-8"))
        A, B, C = (np.array(data[key]) for key in "ABC")
        responses.append(LinearPart(A, B[:, 0], C[0], data["D"][0][0]).response(f))
        assert np.max(np.linalg.eigvals(A).real) < 0.0
        assert data["units"] == {"u": "N.m", "y": "rad"}
    assert responses[0] == pytest.approx(responses[1], rel=1e-6)


def test_the_system_file_settles_within_the_limits() -> None:
    outputs = [
        "outer_aileron_rate", "inner_aileron_position", "inner_aileron_rate", "filter", "actuator.deflection",
    ]  # fmt: skip
    with wb.load(str(SYSTEMS / "failed_aileron_feedforward.toml")) as model:
        result = wb.simulate(model, stop=202.0, inputs={"pulse": PULSE}, outputs=outputs, interval=0.01)
    t, y = result.time, result.signals
    cycle = np.max(np.abs(y["outer_aileron_rate"][(t > 130.0) & (t < 140.0)]))
    assert cycle == pytest.approx(0.217, rel=0.025)
    assert np.all(y["filter"][t < 140.0] == 0.0)
    assert np.max(np.abs(y["filter"])) > 0.01
    assert np.max(np.abs(y["outer_aileron_rate"][t > 200.0])) < 0.01 * cycle
    assert np.max(np.abs(y["actuator.deflection"])) < np.radians(25.0)
    rate = np.abs(np.diff(y["actuator.deflection"])) / np.maximum(np.diff(t), 1e-9)
    assert np.max(rate[np.diff(t) > 1e-3]) <= np.radians(40.0) * (1.0 + 1e-6)


def test_filter_scalar_feedback_and_a_crude_gain(aircraft: wb.DescribedModel) -> None:
    result = wb.feed_forward(
        aircraft, block="damper", target=TARGET, feedback=FEEDBACK, orders=(36, 29), cancel=3e-3,
        inputs={"pulse": PULSE}, closes_at=110.0, stop=136.0, actuator="fmu:LimitedActuator", crude=True,
    )  # fmt: skip
    scalar, filtered, free, limited = result.trials
    assert [t.limited for t in result.trials] == [True, True, False, True]
    assert scalar.failure == filtered.failure == limited.failure == ""
    # To 10 % the scalar feedback takes 6.8 to 7.9 s, with the filter it takes 10.1 to 11.6 s, as the phase of the cycle
    # is when they are connected; to 1 % both depend on the slowest mode only, and which is first on that phase.
    fast, slow = scalar.settling_seconds[0.1], filtered.settling_seconds[0.1]
    assert fast is not None
    assert slow is not None
    assert fast < 9.0 < slow < 13.0
    assert filtered.settling_seconds[0.01] is not None
    assert filtered.largest_target > 2.0 * scalar.largest_target  # what the filter costs: 2.8 to 3.6 times
    # One gain in place of the filter: to infinity after 0.27 s (at 140 s: 0.16 s); within the limits a larger cycle.
    assert free.divergence is not None
    assert (free.divergence.kind, free.divergence.variable) == ("finite escape", "damper.rate")
    assert 110.05 < free.divergence.escape_time < 110.4  # type: ignore[operator]
    assert free.divergence.exponent == pytest.approx(1.0, rel=0.1)  # a quadratic brake that pushes: v ~ 1/(t* − t)
    assert limited.rest is not None
    assert limited.rest > 1.5


# -- linear models from JSON ------------------------------------------------------------------------


LOOP = '[components]\nfilter = {linear = "filter.json"}\n[inputs]\nu = "filter.u"\n[outputs]\ny = "filter.y"\n'


def written(folder: Path, data: object) -> Path:
    (folder / "filter.json").write_text(data if isinstance(data, str) else json.dumps(data), encoding="utf-8")
    path = folder / "loop.toml"
    path.write_text(LOOP, encoding="utf-8")
    return path


def test_a_system_takes_matrices_from_json(tmp_path: Path) -> None:
    data = {"A": [[-2.0]], "B": [[1.0]], "C": [[3.0]], "D": [[0.5]], "dt": 0.0, "units": {"u": "N.m"}, "order": 1}
    with wb.load(str(written(tmp_path, data))) as model:
        y = wb.simulate(model, stop=3.0, inputs={"u": wb.Constant(2.0)}).signals["y"]
        assert model.inputs[0].unit == "N.m"
    assert y[0] == pytest.approx(1.0)
    assert y[-1] == pytest.approx(1.0 + 3.0 * (1.0 - np.exp(-6.0)), rel=1e-5)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("{", "is not JSON"),
        ({"A": [[1.0]]}, "keys A, B, C and D are needed"),
        ([1, 2], "keys A, B, C and D are needed"),
        ({"A": [[1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]], "u0": [2.0]}, "u0 is not 0"),
        ({"A": [[1.0]], "B": [[1.0, 2.0]], "C": [[1.0]], "D": [[0.0]]}, "key 'B' has shape"),
        ({"A": [["a"]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]]}, "must be a number"),
    ],
)
def test_json_that_holds_no_filter(tmp_path: Path, data: object, words: str) -> None:
    with pytest.raises(wb.InputError, match=words) as caught:
        read_system(written(tmp_path, data))
    assert "[components] filter" in str(caught.value)


def test_a_json_that_is_not_there(tmp_path: Path) -> None:
    path = written(tmp_path, {})
    (tmp_path / "filter.json").rename(tmp_path / "filters.json")
    with pytest.raises(wb.InputError, match=r"did you mean filters\.json"):
        read_system(path)


# -- command --------------------------------------------------------------------------------------


def test_json_csv_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, table, picture = (tmp_path / name for name in ("o.json", "o.csv", "o.png"))
    options = [
        "--orders",
        "36,29",
        "--json",
        str(out),
        "--csv",
        str(table),
        "--plot",
        str(picture),
        "--figure",
        "error",
    ]
    assert run([*COMMAND, *options]) == 0
    data = json.loads(out.read_text(encoding="utf-8"))
    assert [s["order"] for s in data["steps"]] == [65, 65, 62, 62, 62, 63]
    assert data["reduced"]["G"]["order"] == 36
    assert data["reduced"]["H"]["band_error"]["relative"] < 0.3
    assert len(data["filter"]["A"]) == 63
    assert table.read_text(encoding="utf-8").startswith("frequency_hz,G gain")
    assert picture.stat().st_size > 10_000
    said = capsys.readouterr()
    assert "cancelled" in said.out
    assert "note: poles were mirrored at" in said.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--orders", "36"], "--orders: 36 is not two whole numbers G,H"),
        (["--orders", "36,a"], "'a' is not a number"),
        (["--orders", "99,29"], "order must lie between"),
        (["--out", "filter.mat"], "must end in one of .json, .fmu"),
        (["--out", "nowhere/filter.json"], "does not exist"),
        (["--figure", "phase"], "--figure 'phase' is unknown; known: "),
        (["--crude"], "--crude and --figure simulated need a simulation"),
        (["--band", "5:1"], "--band: '5:1' is not a band; write the lower frequency first"),
        (["--low-pass", "0"], "--low-pass: 0 is not a positive number [Hz]"),
        (["--input", "puls=1", "--stop", "1"], "--input: failed_aileron has no input 'puls'"),
        (["--sign", "minus"], "minus"),
    ],
)
def test_bad_input_is_one_line(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*COMMAND, *options]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert words in said.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--block", "dampr", "--to", TARGET], "did you mean damper"),
        (["--block", "damper", "--to", "aircraft.inner_ailron"], "did you mean aircraft.inner_aileron"),
        (["--block", "damper", "--to", TARGET, "--feedback", "aircraft.outer_aileron_position"], "NAME:GAIN"),
    ],
)
def test_names_that_are_wrong(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["feed-forward", str(SYSTEMS / "failed_aileron.toml"), *arguments]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert words in said.err


def test_simulate_tells_of_an_escape(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # The damper with its sign turned pushes: the command says what grew and when, and writes what came before.
    text = (SYSTEMS / "failed_aileron.toml").read_text(encoding="utf-8").replace('sum = "-+"', 'sum = "++"')
    path, out = tmp_path / "pushed.toml", tmp_path / "pushed.csv"
    path.write_text(text, encoding="utf-8")
    started = ["--set", "aircraft.outer_aileron_failed=true", "--input", "pulse=step:time=0.1,value=40"]
    assert run(["simulate", str(path), "--stop", "60", *started, "--csv", str(out)]) == 2
    said = capsys.readouterr().err
    assert "escapes to infinity in finite time, at t =" in said
    # Rows every 0.12 s would not show it: it is followed until the last doubling that can be told.
    heading, *rows, _ = out.read_text(encoding="utf-8").splitlines()
    time, *columns = np.array([row.split(",") for row in rows], dtype=float).T
    assert len(time) > 100
    assert (np.diff(time) >= 0.0).all()
    rate = np.abs(columns[heading.split(",").index("outer_aileron_rate [rad/s]") - 1])
    grown = rate[rate > rate.max() / 1e4]
    assert np.max(grown[1:] / grown[:-1]) < 1.5
