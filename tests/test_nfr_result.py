"""The result: arrays, phase, files, python-control, pictures; checks of what is asked for."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import control
import numpy as np
import pytest
from numpy.typing import NDArray

import workbench as wb
from tests.fakes import FakeModel, Rows, SampledSession, lag, linear
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import follow_phase
from workbench.errors import InputError, SimulationError
from workbench.response.nfr.frequency_grid import frequency_grid, geometric_band
from workbench.response.nfr.page import nfr_page
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.show.figure import save
from workbench.signals.kinds import Sine


def phasors(degrees: list[float]) -> NDArray[np.complex128]:
    return np.exp(1j * np.radians(degrees))


def test_the_phase_is_followed_down_over_several_turns() -> None:
    truth = np.arange(-10.0, -1100.0, -70.0)
    np.testing.assert_allclose(follow_phase(phasors(truth.tolist())), truth)


def test_a_rise_below_a_hundred_degrees_is_a_rise() -> None:
    np.testing.assert_allclose(follow_phase(phasors([90.0, 170.0, 189.0, 100.0])), [90.0, 170.0, 189.0, 100.0])


def test_the_first_phase_counts_from_zero() -> None:
    np.testing.assert_allclose(follow_phase(phasors([101.0])), [-259.0])
    np.testing.assert_allclose(follow_phase(phasors([99.0])), [99.0])


def test_missing_points_are_passed_over() -> None:
    response = phasors([-100.0, 0.0, -170.0, -190.0])
    response[1] = np.nan
    np.testing.assert_allclose(follow_phase(response), [-100.0, np.nan, -170.0, -190.0])


def result_with_everything() -> NfrResult:
    class Partly(SampledSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            if sine.frequency > 15.41 and sine.amplitude > 1.0:
                raise SimulationError("y is not finite", time=0.1)
            return super().rows(time, sine)

    model = FakeModel(lambda: Partly([(1 / 208, 0.05), (1 / 131, 0.01)]), output_unit="deg")
    return nfr(model, "u", "y", [15.39, 15.407, 15.42], [1.0, 2.0], errcrit=0.08)


def test_dict_is_json_and_has_the_promised_keys() -> None:
    result = result_with_everything()
    found = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    promised = {"model", "interface", "solver", "frequency_hz", "amplitude", "gain", "gain_db", "phase_deg"}
    promised |= {"offset", "averaged", "periods", "failed", "warnings"}
    assert promised <= set(found)
    assert np.shape(found["gain"]) == np.shape(found["averaged"]) == (2, 3)
    assert found["gain"][1][2] is None
    (failed,) = found["failed"]
    why = {"reason": "y is not finite (at t = 0.1 s)", "kind": "failed"}
    assert failed == {"frequency_hz": 15.42, "amplitude": 2.0, **why}
    assert found["averaged"][0] == [True, True, True]  # the fake does not show that it samples


def test_csv_has_a_line_per_point(tmp_path: Path) -> None:
    result = result_with_everything()
    result.to_csv(tmp_path / "r.csv")
    stream = io.StringIO()
    result.to_csv(stream)
    assert (tmp_path / "r.csv").read_text(encoding="utf-8") == stream.getvalue()
    rows = list(csv.DictReader(io.StringIO(stream.getvalue())))
    assert len(rows) == 6
    assert float(rows[0]["gain"]) == result.gain[0, 0]
    assert rows[5]["gain"] == ""
    assert rows[5]["failed"]


def test_csv_into_a_missing_folder_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        result_with_everything().to_csv(tmp_path / "none" / "r.csv")


def test_frequency_response_data_carries_names_and_radians() -> None:
    result = nfr(lag(0.1), "u", "y", [1.0, 2.0], [1.0, 3.0])
    frd = result.to_frd(3.0)
    np.testing.assert_allclose(frd.omega, 2.0 * np.pi * np.array([1.0, 2.0]))
    np.testing.assert_allclose(np.squeeze(frd.frdata), 1.0 / (1.0 + 0.1j * frd.omega), rtol=1e-3)
    assert frd.input_labels == ["u"]
    with pytest.raises(InputError, match="known: 1, 3"):
        result.to_frd(2.0)
    with pytest.raises(InputError, match="say which"):
        result.to_frd()


def test_a_frequency_response_without_points_is_refused() -> None:
    result = nfr(linear([[80.0]], [1.0], [1.0]), "u", "y", [0.2], 1.0)
    with pytest.raises(InputError, match="failed"):
        result.to_frd()


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_picture_is_drawn(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bode.{suffix}"
    figure = result_with_everything().plot(path, offset=True)
    assert path.stat().st_size > 5_000
    assert [ax.get_ylabel() for ax in figure.axes] == ["gain [dB]", "phase [deg]", "offset of y [deg]"]
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [t.get_text() for t in legend.get_texts()] == ["1 deg", "2 deg", "averaged", "failed"]
    markers = {line.get_marker() for line in figure.axes[0].lines if line.get_xdata().size}  # type: ignore[union-attr]
    assert {"o", "^", "x"} <= markers


def test_the_same_result_gives_the_same_svg(tmp_path: Path) -> None:
    result = nfr(lag(0.1), "u", "y", [1.0, 2.0], 1.0)
    for name in ("a.svg", "b.svg"):
        result.plot(tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_picture_without_any_point_is_drawn_too(tmp_path: Path) -> None:
    result = nfr(linear([[80.0]], [1.0], [1.0]), "u", "y", [0.2], 1.0)
    result.plot(tmp_path / "none.png")
    assert (tmp_path / "none.png").exists()


def test_many_amplitudes_have_the_legend_beside(tmp_path: Path) -> None:
    figure = nfr(lag(0.1), "u", "y", [1.0, 2.0], np.arange(1.0, 9.0).tolist()).plot(tmp_path / "many.png")
    assert len(figure.legends) == 1


def test_an_unknown_suffix_is_refused(tmp_path: Path) -> None:
    figure = nfr(lag(0.1), "u", "y", [1.0], 1.0).plot()
    with pytest.raises(InputError, match=r"\.png"):
        save(figure, tmp_path / "x.bmp")


def test_a_band_is_geometric_and_ends_at_its_end() -> None:
    np.testing.assert_allclose(geometric_band(1.0, 2.0, 1.2), [1.0, 1.2, 1.44, 1.728, 2.0])
    np.testing.assert_allclose(geometric_band(1.0, 8.0, 2.0), [1.0, 2.0, 4.0, 8.0])
    np.testing.assert_allclose(geometric_band(8.0, 3.0, 2.0, falling=True), [8.0, 4.0, 3.0])
    assert geometric_band(2.0, 2.0, 1.2) == (2.0,)


def test_a_list_rises_unless_it_may_fall() -> None:
    assert frequency_grid([3.0, 1.0, 2.0], None, 1.2, falling=False) == (1.0, 2.0, 3.0)
    assert frequency_grid([3.0, 2.0, 1.0], None, 1.2, falling=True) == (3.0, 2.0, 1.0)
    assert frequency_grid([3.0, 1.0, 2.0], None, 1.2, falling=True) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"frequencies": [1.0, 0.0]}, "frequencies: 0 is not a positive number"),
        ({"frequencies": [-1.0]}, "frequencies: -1 is not"),
        ({"frequencies": [float("nan")]}, "frequencies: nan is not"),
        ({"frequencies": [float("inf")]}, "frequencies: inf is not"),
        ({"frequencies": []}, "frequencies: none given"),
        ({"frequencies": [1.0, 1.0]}, "given twice"),
        ({"frequencies": None}, "neither is given"),
        ({"band": (1.0, 2.0)}, "both are given"),
        ({"frequencies": None, "band": (2.0, 1.0)}, "falls from 2 to 1 Hz"),
        ({"frequencies": None, "band": (0.0, 1.0)}, "band: 0"),
        ({"frequencies": None, "band": (1.0, 2.0), "ratio": 1.0}, "ratio: 1 "),
        ({"frequencies": None, "band": (1.0, 2.0), "ratio": 1.0 + 1e-9}, "use a larger one"),
        ({"amplitudes": 0.0}, "amplitudes: 0 is not"),
        ({"amplitudes": [1.0, -2.0]}, "amplitudes: -2 is not"),
        ({"amplitudes": None}, "amplitudes: none given"),
        ({"errcrit": 0.0}, "errcrit: 0"),
        ({"max_periods": 1}, "at least 2"),
        ({"step": 0.0}, "step: 0"),
        ({"input": "v"}, "has no input 'v'"),
        ({"input": "unusd"}, "did you mean unused"),
        ({"input": "y"}, "'y' of Fake is an output; its inputs are: u, unused"),
        ({"output": "u"}, "'u' of Fake is an input; its outputs and states are: y"),
        ({"output": "k"}, "'k' of Fake is a parameter"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_runs(changed: dict[str, object], message: str) -> None:
    model = lag(1.0)
    asked: dict[str, object] = {"input": "u", "output": "y", "frequencies": [1.0], "amplitudes": 1.0}
    with pytest.raises(InputError, match=message):
        nfr(model, **(asked | changed))  # type: ignore[arg-type]
    assert model.sessions == 0


def test_a_state_may_be_measured_as_an_output() -> None:
    assert np.isfinite(nfr(lag(1.0), "u", "x", [1.0], 1.0).gain[0, 0])


def test_above_the_sampling_rate_the_page_says_what_is_not_known_and_why() -> None:
    """A law that samples every 0.022 s: what a beat leaves has no error, and what follows no input is told so."""
    with wb.load("fmu:ElevatorLaw", "me") as model:
        result = wb.nfr(model, "side_stick", "elevator", [45.4, 60.0], [0.5])
    assert result.status == (("averaged", "failed"),)
    assert np.isnan(result.error[0, 0])
    page = nfr_page(result)
    assert any(v.word == "averaged" and "error unknown" in v.text for v in page.summary)
    (table,) = next(section for section in page.sections if section.title == "Values").parts[0].tables
    assert [row[4] for row in table.rows] == ["unknown", "–"]
    (heading, first, _) = (list(row) for row in result.rows())
    assert first[heading.index("why")].startswith("error unknown")
    (failed,) = result.failed
    assert "samples every 0.022 s" in failed.reason
    assert "light" not in failed.reason


def test_the_offset_of_an_integrating_output_is_any() -> None:
    """1/(s² + s) moves periodically about any mean; 1/(s + 1) about one."""
    for poles, word in ([1.0, 1.0, 0.0], "any"), ([1.0, 1.0], "<"):
        plant = control.ss(control.tf([1.0], poles))
        with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
            page = nfr_page(nfr(model, "u", "y", [0.5], [1.0]))
        (table,) = next(section for section in page.sections if section.title == "Values").parts[0].tables
        (row,) = table.rows
        assert row[table.headings.index("offset")].startswith(word)
