"""Which page belongs to which result, and how a result becomes a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench import __version__
from workbench.core.named import named
from workbench.core.operating_point import point_of_json
from workbench.core.record import plain
from workbench.errors import InputError, one_line
from workbench.origin import Origin, origin_of
from workbench.report.facts import finished
from workbench.report.page import SUFFIXES, Page, write_page
from workbench.report.svg import svg_of
from workbench.report.terminal import text_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PAGES", "PICTURES", "line_of", "notebook_of", "page_of", "picture_of", "write_report"]

_NAMED = 12  # inputs and states of an operating point

# Class of the result → function that makes its page. Both by name, so that a page loads what it shows and no more.
PAGES: dict[str, str] = {
    "workbench.analysis.advice.result.Advice": "workbench.report.data:advice_page",
    "workbench.analysis.check.result.HealthCard": "workbench.report.check:check_page",
    "workbench.analysis.delays.result.DelayReport": "workbench.report.delays:delays_page",
    "workbench.analysis.delays.result.NoDelays": "workbench.report.delays:no_delays_page",
    "workbench.analysis.describing.describe.DescribingFunction": "workbench.report.limit_cycle:describing_page",
    "workbench.analysis.excite.result.ExciteResult": "workbench.report.excite:excite_page",
    "workbench.analysis.feed_forward.result.FeedForwardResult": "workbench.report.feed_forward:feed_forward_page",
    "workbench.analysis.feedback.result.FeedbackResult": "workbench.report.feedback:feedback_page",
    "workbench.analysis.feedback.run.FeedbackRun": "workbench.report.feedback:run_page",
    "workbench.analysis.feedback.settling.SettlingStudy": "workbench.report.feedback:settling_page",
    "workbench.analysis.identify.result.IdentifyResult": "workbench.report.identify:identify_page",
    "workbench.analysis.info.result.FmuInfo": "workbench.report.info:info_page",
    "workbench.analysis.info.result.SystemInfo": "workbench.report.info:system_page",
    "workbench.analysis.limit_cycle.branch.Branch": "workbench.report.limit_cycle:branch_page",
    "workbench.analysis.limit_cycle.free_run.FreeRun": "workbench.report.limit_cycle:free_run_page",
    "workbench.analysis.limit_cycle.result.LimitCycleResult": "workbench.report.limit_cycle:limit_cycle_page",
    "workbench.analysis.lin.compare.LinComparison": "workbench.report.lin:comparison_page",
    "workbench.analysis.lin.result.LinResult": "workbench.report.lin:lin_page",
    "workbench.analysis.lin.state_space.LinearModel": "workbench.report.state_space:linear_model_page",
    "workbench.analysis.lin.step_check.StepCheck": "workbench.report.lin:step_check_page",
    "workbench.analysis.lin.sweep.LinGrid": "workbench.report.lin:grid_page",
    "workbench.analysis.loop.result.LoopResult": "workbench.report.loop:loop_page",
    "workbench.analysis.modes.result.ModesResult": "workbench.report.modes:modes_page",
    "workbench.analysis.motions.result.MotionComparison": "workbench.report.motions:motions_page",
    "workbench.analysis.nfr.result.NfrResult": "workbench.report.nfr:nfr_page",
    "workbench.analysis.nyquist.result.NyquistResult": "workbench.report.limit_cycle:nyquist_page",
    "workbench.analysis.reduction.balanced.BalancedReduction": "workbench.report.feed_forward:reduction_page",
    "workbench.analysis.simulate.result.SimulationResult": "workbench.report.simulate:simulate_page",
    "workbench.analysis.spectra.coherence.Coherence": "workbench.report.data:coherence_page",
    "workbench.analysis.spectra.density.SpectralDensity": "workbench.report.data:density_page",
    "workbench.analysis.subspace.result.SubspaceEstimate": "workbench.report.identify:estimate_page",
    "workbench.analysis.trim.result.TrimResult": "workbench.report.trim:trim_page",
    "workbench.analysis.validate.bootstrap.PoleBootstrap": "workbench.report.identify:bootstrap_page",
    "workbench.analysis.validate.overlay.Overlay": "workbench.report.identify:overlay_page",
    "workbench.analysis.validate.result.Validation": "workbench.report.identify:validation_page",
    "workbench.build.export.ExportResult": "workbench.report.build:export_page",
    "workbench.build.fmu.BuildResult": "workbench.report.build:build_page",
    "workbench.build.fmu.BuiltModels": "workbench.report.build:built_page",
    "workbench.reproduce.result.ReproduceResult": "workbench.reproduce.page:reproduce_page",
    "workbench.reproduce.result.TargetList": "workbench.reproduce.page:targets_page",
    "workbench.system.container.ContainerResult": "workbench.report.build:container_page",
}

# Class of the result → function that draws its picture, given the result and the path of a file or None.
PICTURES: dict[str, str] = {
    "workbench.analysis.advice.result.Advice": "workbench.plotting.advice:plot_advice",
    "workbench.analysis.check.result.HealthCard": "workbench.plotting.check:plot_check",
    "workbench.analysis.describing.describe.DescribingFunction": "workbench.plotting.describing:plot_describing",
    "workbench.analysis.excite.result.ExciteResult": "workbench.plotting.excite:plot_excite",
    "workbench.analysis.feedback.result.FeedbackResult": "workbench.plotting.feedback:plot_feedback",
    "workbench.analysis.feedback.run.FeedbackRun": "workbench.plotting.feedback_run:plot_feedback_run",
    "workbench.analysis.feedback.settling.SettlingStudy": "workbench.plotting.feedback_settling:plot_settling",
    "workbench.analysis.limit_cycle.branch.Branch": "workbench.plotting.limit_cycle:plot_branch",
    "workbench.analysis.limit_cycle.free_run.FreeRun": "workbench.plotting.free_run:plot_free_run",
    "workbench.analysis.limit_cycle.result.LimitCycleResult": "workbench.plotting.limit_cycle:plot_limit_cycle",
    "workbench.analysis.lin.compare.LinComparison": "workbench.plotting.lin_compare:plot_comparison",
    "workbench.analysis.lin.result.LinResult": "workbench.plotting.lin:plot_lin",
    "workbench.analysis.lin.step_check.StepCheck": "workbench.plotting.lin_compare:plot_step_check",
    "workbench.analysis.loop.result.LoopResult": "workbench.plotting.loop:plot_loop",
    "workbench.analysis.modes.result.ModesResult": "workbench.plotting.modes:plot_modes",
    "workbench.analysis.motions.result.MotionComparison": "workbench.plotting.motions:plot_motions",
    "workbench.analysis.nyquist.result.NyquistResult": "workbench.plotting.nyquist:plot_nyquist",
    "workbench.analysis.simulate.result.SimulationResult": "workbench.plotting.time_history:time_history",
    "workbench.analysis.spectra.coherence.Coherence": "workbench.plotting.spectra:plot_coherence",
    "workbench.analysis.spectra.density.SpectralDensity": "workbench.plotting.spectra:plot_density",
    "workbench.analysis.trim.result.TrimResult": "workbench.plotting.residual_bars:plot_residuals",
    "workbench.analysis.validate.bootstrap.PoleBootstrap": "workbench.plotting.identify:plot_bootstrap",
    "workbench.analysis.validate.overlay.Overlay": "workbench.plotting.overlay:plot_overlay",
}


def picture_of(result: object, path: str | Path | None) -> Figure:
    """Draw the picture of a result.

    Args:
        result: of a class in `PICTURES`.
        path: also write the picture here; png, svg or pdf by suffix.

    Raises:
        InputError: it has no picture, unknown suffix, file cannot be written.
    """
    draw: Callable[[object, str | Path | None], Figure] = _function(PICTURES, result, "picture")
    return draw(result, path)


def page_of(result: object, **drawn: object) -> Page:
    """Return what a result says of itself, without how it was made.

    Args:
        result: of a class in `PAGES`.
        drawn: what the function of its page can be told.

    Raises:
        InputError: it has no page.
    """
    make: Callable[..., Page] = _function(PAGES, result, "page")
    return make(result, **drawn)


def _function(table: Mapping[str, str], result: object, what: str) -> Any:  # noqa: ANN401 - what the table says
    kind = type(result)
    name = table.get(f"{kind.__module__}.{kind.__qualname__}")
    if name is None:
        known = ", ".join(sorted(key.rpartition(".")[2] for key in table))
        raise InputError(f"{kind.__name__} has no {what}; results that have one: {known}")
    return named(name)


def line_of(result: object) -> str:
    """Return what a result is in one line; one that is put together by hand may be too incomplete for a page.

    Args:
        result: any.
    """
    name = type(result).__name__
    try:
        page = page_of(result)
    except Exception:  # noqa: BLE001 - whatever is missing: a debugger shows such objects, too
        return f"<{name}>"
    return one_line(f"<{name}: {page.title}. {page.lead}>")


def notebook_of(result: object) -> str:
    """Return the page of a result for a notebook: what a terminal shows, and the first picture.

    Args:
        result: of a class in `PAGES`.
    """
    page = page_of(result)
    figures = [figure for section in page.sections for figure in section.figures][:1]
    pictures = [svg_of(draw(), "workbench", words) for draw, words in figures]
    return "".join([f"<pre>{escape(text_of(page, None))}</pre>", *pictures])


def write_report(result: object, path: str | Path, origin: Origin | None = None) -> None:
    """Write the page of a result.

    Args:
        result: of a class in `PAGES`, or a page that was made already.
        path: of the page, .html.
        origin: how the result was made; None: what it remembers.

    Raises:
        InputError: it has no page, another suffix, or the file cannot be written.
    """
    if Path(path).suffix.lower() not in SUFFIXES:  # said before the pictures are drawn
        raise InputError(f"{path}: a report is a page; name it {SUFFIXES[0]}")
    known = origin or origin_of(result) or Origin()
    page = result if isinstance(result, Page) else page_of(result)
    data = _data(result, page, known)
    page = finished(replace(page, facts={**page.facts, **_point(data)}), known)
    write_page(replace(page, data=data), path)


def _point(data: Mapping[str, Any]) -> dict[str, str]:
    """Return where the result was measured, in one line."""
    try:
        point = point_of_json(data)
    except InputError:  # a search that ran away leaves no finite numbers
        return {}
    return {} if point is None else {"operating point": point.words(_NAMED)}


def _data(result: object, page: Page, origin: Origin) -> Mapping[str, Any]:
    """Return what is embedded: what the command line writes to JSON, or the same made of the result itself."""
    if origin.data is not None:
        return origin.data
    own = page.data or getattr(result, "to_dict", dict)()
    model = origin.models[0] if origin.models else None
    who = {} if model is None else {"model": model.name, "interface": model.interface, "solver": model.solver}
    full: Mapping[str, Any] = plain(
        {"command": origin.command, "version": __version__, "seconds": origin.seconds, **who, **own}
    )
    return full
