"""`wb.identify`, the command and its report: closed forms, the bundled FMUs, wrong input."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import workbench as wb
from scripts.reproduce.targets import read_targets
from workbench.cli.app import run
from workbench.show.page import Page, PageTable, Section, write_page

TARGETS = read_targets()
PERIOD = 0.022  # of the elevator law [s]


def lag(samples: int = 600, *, offset: float = 0.0, noise: float = 0.0) -> wb.Experiment:
    """x(k + 1) = 0.8 x(k) + 0.5 (u(k) − 3), y = x + offset: a lag about an operating point."""
    random = np.random.default_rng(1)
    u = 3.0 + random.choice([-1.0, 1.0], samples)
    x = np.zeros(samples)
    for k in range(samples - 1):
        x[k + 1] = 0.8 * x[k] + 0.5 * (u[k] - 3.0)
    y = x + offset + noise * random.standard_normal(samples)
    return wb.make_experiment(0.1, u, y, input_names=["u"], output_names=["y"], input_units=["V"], output_units=["deg"])


def test_a_lag_is_found_with_its_operating_point_and_units() -> None:
    result = wb.identify(lag(offset=7.0).part(0, 300), validation=lag(offset=7.0).part(300))
    model = result.model
    assert result.order == 1
    assert model.poles == pytest.approx([0.8], abs=1e-9)
    # The gain: 0.5/(1 − 0.8); the point lies on the line through the true one with this slope.
    gain = (model.C @ np.linalg.solve(np.eye(1) - model.A, model.B) + model.D).item()
    assert gain == pytest.approx(2.5, rel=1e-9)
    assert result.fit_percent > 99.0
    assert (model.input_units, model.output_units) == (("V",), ("deg",))
    assert model.name == lag().name


def test_the_settling_part_is_cut_and_a_drift_taken_out() -> None:
    data = lag(offset=1.0)
    drifting = data.with_data(y=data.y + 0.01 * data.time[:, None])
    result = wb.identify(drifting, order=1, detrend="linear", settle=5.0)
    assert result.data.n_samples == data.n_samples - 50
    assert result.model.poles == pytest.approx([0.8], abs=1e-3)


def test_without_other_data_it_says_so() -> None:
    result = wb.identify(lag(noise=0.05), order=1)
    assert result.validation is result.own
    assert any("look too good" in note for note in result.notes)
    assert result.to_dict()["validated_on"] == "the data of the fit"


def test_the_delay_of_the_advice_is_taken() -> None:
    data = lag(noise=0.01)
    late = data.with_data(y=np.vstack([np.zeros((4, 1)), data.y[:-4]]))
    result = wb.identify(late, order=1, delay="auto")
    assert result.model.delay == (4,)
    assert result.model.undelayed().poles == pytest.approx([0.8], abs=0.02)


def test_a_single_sine_is_refused_for_more_than_two_orders() -> None:
    t = 0.01 * np.arange(2000)
    sine = wb.make_experiment(0.01, np.sin(2.0 * np.pi * t), 0.5 * np.sin(2.0 * np.pi * t - 0.7))
    with pytest.raises(wb.InputError, match="sine"):
        wb.identify(sine, order=3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "n4sd"}, "did you mean n4sid"),
        ({"detrend": "mena"}, "did you mean mean"),
        ({"inputs": ["U"]}, "no column 'U'"),
        ({"settle": -1.0}, "settle"),
        ({"order": 500}, "too high"),
    ],
)
def test_wrong_input_is_one_line(change: dict[str, object], message: str) -> None:
    with pytest.raises(wb.InputError, match=message) as caught:
        wb.identify(lag(), **change)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_the_rudder_as_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Chapter 7.2: amplitude 2, 0.01 s, sixth order; lin, model and NFR on one picture."""
    data, other = tmp_path / "rudder.csv", tmp_path / "rudder_validation.csv"
    lin, nfr, out = (tmp_path / name for name in ("lin.json", "nfr.json", "id.json"))
    pictures = [tmp_path / name for name in ("bode.svg", "fit.svg", "id.html")]
    prbs = ["--prbs", "amplitude=2", "--step", "0.01", "--csv", str(data)]
    assert run(["excite", "fmu:Rudder", "--input", "delC", "--output", "del", *prbs, "--in-process"]) == 0
    assert run(["lin", "fmu:Rudder", "--inputs", "delC", "--json", str(lin)]) == 0
    grid = ["--freq", "0.5,1,2,4,7,10,15,20,25,30", "--amplitude", "2", "--in-process"]
    assert run(["nfr", "fmu:Rudder", "--input", "delC", "--output", "del", *grid, "--json", str(nfr)]) == 0
    capsys.readouterr()
    command = ["identify", str(data), "--input", "delC", "--output", "del", "--order", "6", "--validate", str(other)]
    files = ["--bode", str(pictures[0]), "--plot", str(pictures[1]), "--report", str(pictures[2]), "--json", str(out)]
    assert run([*command, "--lin", str(lin), "--nfr", str(nfr), *files]) == 0
    assert "order 6" in capsys.readouterr().out
    assert all(p.stat().st_size > 10_000 for p in pictures)
    found = json.loads(out.read_text(encoding="utf-8"))
    promised = {"A", "B", "C", "D", "dt", "order", "singular_values", "fit_percent", "error_percent", "residual_tests"}
    assert promised <= set(found)
    assert (found["order"], found["dt"], len(found["A"])) == (6, 0.01, 6)
    assert TARGETS["rudder-fit"].accepts(found["fit_percent"])
    gaps = {d["curve"]: d for d in found["overlay"]["differences"]}
    assert set(gaps) == {"identified", "linearised"}
    assert TARGETS["rudder-identified-gain-30"].accepts(max(map(abs, gaps["identified"]["gain_db"])))
    assert TARGETS["rudder-identified-phase-30"].accepts(max(map(abs, gaps["identified"]["phase_deg"])))


def law(amplitude: float, *, offset: float = 0.0, **settings: float) -> wb.ExciteResult:
    """The elevator law under a PRBS held at 30 Hz, as published but for the bits."""
    signal = wb.PrbsDesign(amplitude=amplitude, offset=offset, rate=30.0, order=15, seed=1)
    with wb.load("fmu:ElevatorLaw", "me", start_values={"side_stick": offset, **settings}) as model:
        return wb.excite(model, ["side_stick"], ["elevator"], signal=signal, dt=PERIOD, samples=3000, settle=1.0)


def test_the_elevator_law_as_published() -> None:
    """Chapter 6.3: one singular value stands out, a third of the output is missed, the residuals are not white."""
    data = law(1.0)
    result = wb.identify(data.identification, order=1, validation=data.validation)
    first, second = result.estimate.singular_values[:2]
    assert TARGETS["law-singular-values"].accepts(first / second)
    # Published is one number, for bits that are not printed; other sequences give others around it.
    low, high = TARGETS["law-error-range"].limits
    assert low.min() < result.own.error_percent["elevator"] < high.max()
    tests = result.own.simulation
    assert tests.autocorrelation is not None
    assert tests.cross is not None
    assert not tests.autocorrelation.white
    assert TARGETS["law-residuals"].accepts(tests.autocorrelation.outside[0])
    assert TARGETS["law-cross-correlation"].accepts(tests.cross.outside[1])
    plain = wb.coherence(data.identification, segments=20, window="boxcar", overlap=0.0)
    assert TARGETS["law-coherence"].accepts(np.nanmax(plain.ordinary[1:]))
    assert TARGETS["law-coherence-median"].accepts(np.nanmedian(plain.ordinary[1:]))


def test_the_elevator_law_is_linear_where_the_limiter_rests() -> None:
    data = law(0.04, offset=0.3)
    result = wb.identify(data.identification, validation=data.validation)
    assert TARGETS["law-small-order"].accepts(
        result.order
    )  # a gain, as the source report suspects of its cancelling pole and zero
    assert result.model.D.item() == pytest.approx(0.96 * 6.9, rel=1e-9)
    assert TARGETS["law-small-fit"].accepts(result.fit_percent)


def test_a_failed_elevator_shows_its_limit() -> None:
    advice = wb.advise(law(1.0, elevator_failed=1.0).identification)
    limit = advice.finding("saturation")
    assert limit.verdict != "good"
    assert "15 deg" in limit.evidence


@pytest.mark.parametrize(("failed", "verdict"), [(0.0, "good"), (1.0, "poor")])
def test_a_slow_input_tells_a_limit_from_a_settled_response(failed: float, verdict: str) -> None:
    # Under two levels both configurations rest at their extremes; where the input moves on, only a limit does.
    signal = wb.MultisineDesign(amplitude=1.0, band=(0.05, 0.2), seed=1)
    with wb.load("fmu:ElevatorLaw", "me", start_values={"elevator_failed": failed}) as model:
        data = wb.excite(model, ["side_stick"], ["elevator"], signal=signal, dt=PERIOD, samples=3000, settle=2.0)
    assert wb.advise(data.identification).finding("saturation").verdict == verdict


def test_a_page_stands_alone(tmp_path: Path) -> None:
    figure = lag_figure()
    table = PageTable(("what", "verdict"), [("<b>", "good")], verdict=1)
    page = Page(
        "A & B", "lead", {"command": "workbench x"}, [Section("S", tables=[table], figures=[(lambda: figure, "f")])]
    )
    path = tmp_path / "page.html"
    write_page(page, path)
    text = path.read_text(encoding="utf-8")
    assert "A &amp; B" in text
    assert "&lt;b&gt;" in text
    assert "<svg" in text
    assert not re.search(r'(src|href)="https?:', text.replace("xlink:href", ""))
    identifiers = re.findall(r'\bid="([^"]+)"', text)
    assert len(identifiers) == len(set(identifiers))
    with pytest.raises(wb.InputError, match=r"\.html"):
        write_page(page, tmp_path / "page.txt")


def lag_figure() -> Figure:
    return wb.sdf(lag()).plot()
