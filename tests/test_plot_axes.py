"""Axes of Bode pictures: ticks that say something, labels with what 0 dB is, legends for every line style."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from matplotlib.figure import Figure

import workbench as wb
from tests.fakes import lag
from tests.test_records import example
from workbench.errors import InputError
from workbench.response.branches.result import Fold, ResponseBranch
from workbench.response.nfr.picture import plot_nfr
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.show.bode import Degrees, gain_label, log_axis
from workbench.show.figure import rows
from workbench.show.result import Result, picture_of


def labels(figure: Figure) -> list[str]:
    figure.canvas.draw()
    axis = figure.axes[-1].xaxis
    low, high = axis.get_view_interval()
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    return [t.label1.get_text() for t in ticks if low <= t.get_loc() <= high and t.label1.get_text()]


@pytest.mark.parametrize(
    ("low", "high"), [(0.15, 0.26), (0.1, 0.4), (1.0, 1.1), (9.0, 11.0), (0.1, 5.0), (1.0, 100.0), (20.0, 60.0)]
)
def test_a_frequency_axis_has_several_different_plain_numbers(low: float, high: float) -> None:
    figure, axes = rows(2, title="")
    log_axis(axes[-1], low, high)
    found = labels(figure)
    assert 3 <= len(found) <= 12
    assert len(set(found)) == len(found)
    assert all(0.9 * low < float(text) < 1.1 * high for text in found)


@pytest.mark.parametrize("span", [0.01, 0.5, 3.0, 25.0, 60.0, 180.0, 570.0, 5000.0])
@pytest.mark.parametrize("end", [-390.0, -12.0, 3.3])
def test_phase_ticks_are_parts_of_a_right_angle_and_few(span: float, end: float) -> None:
    ticks = np.array(Degrees().tick_values(end, end + span))
    assert 2 <= len(ticks) <= 10
    step = float(np.diff(ticks)[0])
    assert span < 90.0 or step % 45.0 == 0.0
    np.testing.assert_allclose(np.diff(ticks), step)


@pytest.mark.parametrize(
    "kind", [wb.BlaResult, wb.BranchesResult, wb.DescribingFunction, wb.FitResult, wb.NfrResult, wb.ModelSpread]
)
def test_every_picture_of_a_phase_has_its_ticks(kind: type[Result]) -> None:
    axes = [ax for ax in picture_of(example(kind), None).axes if ax.get_ylabel().startswith("phase")]
    assert axes
    assert all(isinstance(ax.yaxis.get_major_locator(), Degrees) for ax in axes)


def test_a_gain_in_decibels_says_of_what() -> None:
    assert gain_label("deg", "deg") == gain_label(None, "1") == gain_label(None, None) == "gain [dB]"
    assert gain_label("N", None) == "gain [dB re 1/N]"
    assert gain_label("N", "m") == "gain [dB re 1 m/N]"
    assert gain_label("1", "m") == "gain [dB re 1 m]"


def measured() -> NfrResult:
    return nfr(lag(0.1), "u", "y", [1.0, 2.0, 3.0], [1.0])


def test_the_legend_explains_branches_and_folds() -> None:
    places = np.array([1.0, 2.0, 1.5])
    branch = ResponseBranch(
        amplitude=1.0, frequency_hz=places, varied=places, gain=places, phase_deg=-places, offset=0.0 * places,
        stable=np.array([True, True, False]), multipliers=((0.5 + 0j,),) * 3,
    )  # fmt: skip
    fold = Fold(frequency_hz=2.0, amplitude=1.0, varied=2.0, gain=2.0, phase_deg=-2.0, kind="fold")
    legend = plot_nfr(replace(measured(), branches=(branch,), folds=(fold,))).axes[0].get_legend()
    assert legend is not None
    assert [t.get_text() for t in legend.get_texts()][-3:] == ["stable", "unstable", "fold"]


def test_an_error_that_leaves_everything_open_does_not_fill_the_phase() -> None:
    result = replace(measured(), error=np.array([[0.01, 2.0, 0.01]]))
    low, high = plot_nfr(result).axes[1].get_ylim()
    assert high - low < 150.0


def test_curves_on_each_other_are_all_seen() -> None:
    twice = nfr(lag(0.1), "u", "y", [1.0, 2.0, 3.0], [1.0, 2.0])
    widths = [line.get_linewidth() for line in plot_nfr(twice).axes[0].lines if line.get_linestyle() == "-"]
    assert widths[0] > widths[1] + 1.0


@pytest.mark.parametrize(
    "kind", [wb.Advice, wb.BranchesResult, wb.LoopResult, wb.NfrResult, wb.TrimResult, wb.Validation]
)
def test_a_picture_is_drawn_on_the_axes_of_the_caller(kind: type[Result]) -> None:
    """All its lines, once for each time that it is drawn there, and nothing else in the caller's figure."""
    result = example(kind)
    own = result.plot()
    figure = Figure()
    given = figure.subplots(len(own.axes), 1, squeeze=False)
    assert result.plot(axes=given) is figure
    once = [len(ax.lines) for ax in figure.axes]
    assert once == [len(ax.lines) for ax in own.axes]
    result.plot(axes=given)
    assert [len(ax.lines) for ax in figure.axes] == [2 * n for n in once]
    assert len(result.plot().axes[0].lines) == once[0]  # a figure of its own again


@pytest.mark.parametrize("share", ["none", "col"])
def test_on_axes_of_the_caller_frequencies_are_logarithmic_and_curves_have_names(
    share: Literal["none", "col"],
) -> None:
    axes = Figure().subplots(2, 1, sharex=share)
    nfr(lag(0.1), "u", "y", [0.1, 1.0], [1.0, 2.0]).plot(axes=axes)
    assert [ax.get_xscale() for ax in axes] == ["log", "log"]
    assert axes[0].get_xlim() == axes[1].get_xlim()
    assert axes[0].get_legend_handles_labels()[1] == ["1 deg", "2 deg"]


def test_other_axes_than_the_panels_are_refused() -> None:
    result = example(wb.NfrResult)
    axes = Figure().subplots(3, 1)
    with pytest.raises(InputError, match="2 are needed, one for each panel; given: 3"):
        result.plot(axes=axes)
    with pytest.raises(InputError, match="axes of matplotlib"):
        result.plot(axes=3)
