"""Which page belongs to which result, and how a result becomes a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench import __version__
from workbench.core.named import named
from workbench.core.record import drawn, plain
from workbench.errors import InputError, one_line, visible
from workbench.origin import Origin, origin_of
from workbench.report.facts import finished, point_facts
from workbench.report.page import SUFFIXES, Page, write_page
from workbench.report.stmd import write_stmd
from workbench.report.svg import svg_of
from workbench.report.terminal import text_of
from workbench.report.tones import worst_first

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SHOWN", "line_of", "notebook_of", "page_of", "picture_of", "write_report"]

_VERDICTS = 6  # of a result in a notebook; the others are folded
_LINE = 200  # characters of a result in one line

# Class of the result → (function of `workbench.report` that makes its page, function of `workbench.plotting` that draws
# it, "" where there is no picture); packages of their own are named in full. Both by name, so that a page loads what it
# shows and no more.
SHOWN: dict[str, tuple[str, str]] = {
    "analysis.advice.result.Advice": ("data:advice_page", "advice:plot_advice"),
    "analysis.bla.result.BlaResult": ("bla:bla_page", "bla:plot_bla"),
    "analysis.blocks.result.BlocksResult": ("blocks:blocks_page", ""),
    "analysis.branches.result.BranchesResult": ("branches:branches_page", "branches:plot_branches"),
    "analysis.check.result.HealthCard": ("check:check_page", "check:plot_check"),
    "analysis.delays.result.DelayReport": ("delays:delays_page", ""),
    "analysis.delays.result.NoDelays": ("delays:no_delays_page", ""),
    "analysis.describing.describe.DescribingFunction": ("limit_cycle:describing_page", "describing:plot_describing"),
    "analysis.excite.result.ExciteResult": ("excite:excite_page", "excite:plot_excite"),
    "analysis.feed_forward.result.FeedForwardResult": ("feed_forward:filter_page", "feed_forward:plot_feed_forward"),
    "analysis.feedback.result.FeedbackResult": ("feedback:feedback_page", "feedback:plot_feedback"),
    "analysis.feedback.run.FeedbackRun": ("feedback:run_page", "feedback_run:plot_feedback_run"),
    "analysis.feedback.settling.SettlingStudy": ("feedback:settling_page", "feedback_settling:plot_settling"),
    "analysis.fit.result.FitResult": ("fit:fit_page", "fit:plot_fit_response"),
    "analysis.identify.result.IdentifyResult": ("identify:identify_page", ""),
    "analysis.info.result.FmuInfo": ("info:info_page", ""),
    "analysis.info.result.SystemInfo": ("info:system_page", ""),
    "analysis.limit_cycle.branch.Branch": ("limit_cycle:branch_page", "limit_cycle:plot_branch"),
    "analysis.limit_cycle.free_run.FreeRun": ("limit_cycle:free_run_page", "free_run:plot_free_run"),
    "analysis.limit_cycle.result.LimitCycleResult": ("limit_cycle:limit_cycle_page", "limit_cycle:plot_limit_cycle"),
    "analysis.lin.compare.LinComparison": ("lin:comparison_page", "lin_compare:plot_comparison"),
    "analysis.lin.result.LinResult": ("lin:lin_page", "lin:plot_lin"),
    "analysis.lin.state_space.LinearModel": ("state_space:linear_model_page", ""),
    "analysis.lin.step_check.StepCheck": ("lin:step_check_page", "lin_compare:plot_step_check"),
    "analysis.lin.sweep.LinGrid": ("lin:grid_page", ""),
    "analysis.loop.result.LoopResult": ("loop:loop_page", "loop:plot_loop"),
    "analysis.modes.result.ModesResult": ("modes:modes_page", "modes:plot_modes"),
    "analysis.motions.result.MotionComparison": ("motions:motions_page", "motions:plot_motions"),
    "analysis.nfr.result.NfrResult": ("nfr:nfr_page", "bode:plot_nfr"),
    "analysis.nyquist.absolute.AbsoluteStability": ("limit_cycle:absolute_page", ""),
    "analysis.nyquist.result.NyquistResult": ("limit_cycle:nyquist_page", "nyquist:plot_nyquist"),
    "analysis.reduction.balanced.BalancedReduction": ("feed_forward:reduction_page", ""),
    "analysis.onset.result.OnsetResult": ("onset:onset_page", "onset:plot_onset"),
    "analysis.simulate.result.SimulationResult": ("simulate:simulate_page", "time_history:time_history"),
    "analysis.spectra.coherence.Coherence": ("data:coherence_page", "spectra:plot_coherence"),
    "analysis.spectra.density.SpectralDensity": ("data:density_page", "spectra:plot_density"),
    "analysis.structures.result.StructureResult": ("structures:structure_page", "structures:plot_structure"),
    "analysis.subspace.result.SubspaceEstimate": ("identify:estimate_page", "identify:plot_order"),
    "analysis.trim.result.TrimResult": ("trim:trim_page", "residual_bars:plot_residuals"),
    "analysis.validate.bootstrap.PoleBootstrap": ("identify:bootstrap_page", "identify:plot_bootstrap"),
    "analysis.validate.overlay.Overlay": ("identify:overlay_page", "overlay:plot_overlay"),
    "analysis.validate.spread.ModelSpread": ("identify:spread_page", "identify:plot_spread"),
    "analysis.validate.result.Validation": ("identify:validation_page", "validate:plot_fit"),
    "build.export.ExportResult": ("build:export_page", ""),
    "build.fmu.BuildResult": ("build:build_page", ""),
    "build.fmu.BuiltModels": ("build:built_page", ""),
    "reproduce.result.ReproduceResult": ("workbench.reproduce.page:reproduce_page", ""),
    "reproduce.result.TargetList": ("workbench.reproduce.page:targets_page", ""),
    "study.envelope.result.EnvelopeResult": (
        "workbench.study.envelope.page:envelope_page",
        "workbench.study.envelope.page:plot_envelope",
    ),
    "system.container.ContainerResult": ("build:container_page", ""),
    "to_fmu.compile_fmu.CompiledFmu": ("build:compiled_page", ""),
    "to_fmu.result.SystemFile": ("build:system_file_page", ""),
}


def picture_of(result: object, path: str | Path | None) -> Figure:
    """Draw the picture of a result.

    Args:
        result: of a class in `SHOWN` that has one.
        path: also write the picture here; png, svg or pdf by suffix.

    Raises:
        InputError: it has no picture, unknown suffix, file cannot be written.
    """
    return drawn(_function(result, "picture"), path, result)


def page_of(result: object, **told: object) -> Page:
    """Return what a result says of itself, without how it was made.

    Args:
        result: of a class in `SHOWN`.
        told: what the function of its page can be told.

    Raises:
        InputError: it has no page.
    """
    name = _function(result, "page")
    page: Page = named(name if name.startswith("workbench.") else f"workbench.report.{name}")(result, **told)
    return page


def _function(result: object, what: str) -> str:
    """Return the name of the function that makes the "page" or the "picture" of a result."""
    kind, column = type(result), ("page", "picture").index(what)
    name = SHOWN.get(f"{kind.__module__}.{kind.__qualname__}".removeprefix("workbench."), ("", ""))[column]
    if not name:
        known = ", ".join(sorted(key.rpartition(".")[2] for key, names in SHOWN.items() if names[column]))
        raise InputError(f"{kind.__name__} has no {what}; results that have one: {known}")
    return name


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
    text = one_line(f"{name}: {page.title}. {page.lead}")
    return f"<{text if len(text) <= _LINE else f'{text[: _LINE - 1]}…'}>"


def notebook_of(result: object) -> str:
    """Return the page of a result for a notebook: what was found, the first picture, the rest folded.

    Args:
        result: of a class in `SHOWN`.
    """
    page = page_of(result)
    figures = [figure for section in page.sections for figure in section.figures][:1]
    pictures = [svg_of(draw(), "workbench", words) for draw, words in figures]
    verdicts = "".join(f"<li>{escape(v.word)}: {escape(v.text)}</li>" for v in worst_first(page.summary)[:_VERDICTS])
    return "".join(
        [
            f"<strong>{escape(visible(page.title))}</strong><p>{escape(visible(page.lead))}</p>",
            f"<ul>{visible(verdicts)}</ul>" if verdicts else "",
            *pictures,
            "<details><summary>facts and values</summary>",
            f'<pre style="overflow-x:auto">{escape(text_of(page, None))}</pre></details>',
        ]
    )


def write_report(result: object, path: str | Path, origin: Origin | None = None) -> None:
    """Write the page of a result, and beside it the same facts as traceability metadata (STMD).

    Args:
        result: of a class in `SHOWN`, or a page that was made already.
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
    page = finished(replace(page, facts={**page.facts, **point_facts(data)}), known)
    write_page(replace(page, data=data), path)
    write_stmd(page, known, path)


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
