"""`workbench run`: a study with requirements."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from workbench.cli.plain import PlainCommand
from workbench.errors import InputError, unbroken
from workbench.jobs.end_signals import INTERRUPTED
from workbench.jobs.options import DEFAULT_TIMEOUT, Workers

if TYPE_CHECKING:
    from workbench.cli.interrupt import OnInterrupt
    from workbench.cli.output import Output
    from workbench.show.page import Section
    from workbench.study.result import StudyResult
    from workbench.study.run import StudyRun

__all__ = ["run"]

_NOT_MET = 1

_FILE = click.Path(path_type=Path)


@click.command(cls=PlainCommand)
@click.argument("study", required=False, metavar="[STUDY]", help="Study file (.toml), or a bundled one: study:NAME.")
@click.option(
    "--store",
    metavar="DIR",
    type=_FILE,
    help="Folder in which finished analyses are kept; by default .workbench-store beside the study.",
)
@click.option("--no-store", is_flag=True, help="Keep nothing, and reuse nothing.")
@click.option("--fresh", is_flag=True, help="Measure again what is in the store.")
@click.option("--jobs", metavar="N", type=int, help="Number of worker processes; by default one per core.")
@click.option(
    "--timeout",
    metavar="S",
    type=float,
    default=DEFAULT_TIMEOUT,
    help="Time limit for one result [s]; inf for no limit.",
)
@click.option(
    "--confine", is_flag=True, help="Keep FMUs from networks, and from writing files; see any analysis's --help."
)
@click.option(
    "--scheduler",
    metavar="tcp://..",
    help="Dask cluster on which the analyses run, as for nfr; the study must lie on a shared file system.",
)
@click.option(
    "--scheduler-tls",
    metavar="CA,CERT,KEY",
    help="Files for tls://..: certificate of the authority, own certificate, own key.",
)
@click.option("--update-baselines", is_flag=True, help="Write the baselines of the study that are missing or not met.")
@click.option("--example", is_flag=True, help="Print a small example study, or the one named.")
@click.option("--json", metavar="PATH", help="Write the result as JSON; - is standard output.")
@click.option("--csv", metavar="PATH", help="Write the result as CSV.")
@click.option("--junit", metavar="PATH", type=_FILE, help="Write the requirements as JUnit XML, for CI.")
@click.option(
    "--report",
    metavar="PATH",
    help="Write one page, .html: pictures, tables, data; and its facts, .stmd, for tracing.",
)
def run(
    *,
    study: str | None,
    store: Path | None,
    no_store: bool,
    fresh: bool,
    jobs: int | None,
    timeout: float,
    confine: bool,
    scheduler: str | None,
    scheduler_tls: str | None,
    update_baselines: bool,
    example: bool,
    json: str | None,
    csv: str | None,
    junit: Path | None,
    report: str | None,
) -> int:
    """Run a study: analyses over a grid of parameters, compared with requirements. Exit code 1: one is not met.

    A study file names models, analyses (any command with its options) and requirements; `workbench run --example`
    prints one, `workbench run study:NAME --example` a bundled one. Analyses whose FMU and
    options have not changed are not run again. A study with a table [envelope] has options of its own:
    `workbench run STUDY --help`.

    Example: `workbench run study:rudder_specification --junit junit.xml --report rudder.html`
    """
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.study.read import bundled_studies, is_bundled_study
    from workbench.study.run import StudyRun, default_store

    if example:
        return _print_example(study or "study:rudder_specification")
    if study is None:
        raise InputError(
            "name a study: a .toml file, or study:NAME; 'workbench run --example' prints one to begin with; "
            f"bundled: {', '.join(bundled_studies())}"
        )
    if no_store and (store is not None or fresh):
        raise InputError("--no-store and --store or --fresh: only one of them")
    out = Output("run", json=json, csv=csv, report=report, junit=junit, judged=True)
    folder = None if no_store else store or default_store(study)
    with out.failing():
        if update_baselines and is_bundled_study(study):
            raise InputError(f"--update-baselines: {study} is a bundled one; --example prints it, to keep as a file")
        prepared = StudyRun(study, store=folder, fresh=fresh)
        place = Workers(jobs=jobs, timeout=timeout, confine=confine, scheduler=scheduler, tls=scheduler_tls)
    with OnInterrupt() as wish:
        with out.failing():
            result = _run(prepared, place, wish, kept=folder is not None, update=update_baselines)
        _show(result, out)
        _write(result, out, junit)
    if wish.came and not result.missing:
        note(f"{interrupted()}: the result is written")
    if wish.came or result.missing:
        return INTERRUPTED
    return 0 if result.passed else _NOT_MET


def _print_example(name: str) -> int:
    from workbench.study.read import locate_study

    sys.stdout.write(locate_study(name).read_text(encoding="utf-8"))
    return 0


def _run(prepared: StudyRun, workers: Workers, wish: OnInterrupt, *, kept: bool, update: bool) -> StudyResult:
    """Run with a bar; Ctrl-C ends it, what is finished stays where it is kept."""
    from workbench.cli.command_line import command_line
    from workbench.cli.interrupt import interrupted
    from workbench.cli.notes import flush, note
    from workbench.jobs.job import Job
    from workbench.requests.progress_bar import Bar

    def tell(label: object, done: int, total: int) -> None:
        bar.update(done / (total or 1), str(label))

    job = Job(tell)
    wish.act = job.stop
    with Bar(1.0) as bar, job.ended_by():
        result = prepared.run(lambda: workers, job, command=command_line(), update_baselines=update)
    for text in result.notes:
        note(text)
    if result.missing:
        again = "; the same command continues" if kept else ""
        note(f"{interrupted()}: {result.missing} of {prepared.total} analyses were not run{again}")
    flush()
    return result


# -- what is shown -----------------------------------------------------------------------------


def _show(result: StudyResult, out: Output) -> None:
    from workbench.cli.command_line import in_flags
    from workbench.show.terminal import section_text

    if result.checked:
        out.say(lambda width: section_text(_section(result), width).lstrip())
    hidden = len(result.checked) - len(result.shown)
    lines = [f"{hidden} more that passed, with larger margins, are not shown"] if hidden else []
    lines += [f"{c.name}: {c.finding.reason}" for c in result.violated if c.finding.reason]
    lines += [f"analysis {run.label}: {_why(outcome.reason)}" for run, outcome in result.failed]
    lines.append(result.words)
    out.say(lambda _: "".join(f"{unbroken(in_flags(line))}\n" for line in lines))


def _write(result: StudyResult, out: Output, junit: Path | None) -> None:
    from workbench.cli.command_line import in_flags
    from workbench.cli.github import tell_github
    from workbench.show.result import page_of

    page = lambda: in_flags(page_of(result))  # noqa: E731
    out.write(result.to_dict, csv=result.to_csv, report=result, page=page)
    if junit is not None:
        result.to_junit(junit)
        out.wrote(junit)
    tell_github(result, page)


def _why(reason: str) -> str:
    return f"failed: {reason}" if reason else "ended with exit code 1: points of it failed"


def _section(result: StudyResult) -> Section:
    from workbench.show.page import PageTable, Section
    from workbench.study.requirements.base import number

    shown = result.shown
    pointed = ["point"] if any(c.point for c in shown) else []
    headings = ("requirement", *pointed, "value", "limit", "margin", "verdict", "where")
    rows = [
        (
            c.requirement.name,
            *([c.point] if pointed else []),
            number(c.finding.value),
            c.finding.limit_words,
            c.finding.margin_words,
            c.finding.verdict,
            c.finding.where,
        )
        for c in shown
    ]
    first = headings.index("value")
    return Section(result.study.name, tables=[PageTable(headings, rows, right=range(first, first + 3))])
