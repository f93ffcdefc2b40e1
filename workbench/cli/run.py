"""`workbench run`: a study with requirements."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.core.machine.closable import Closable
from workbench.errors import InputError, unbroken
from workbench.jobs.end_signals import INTERRUPTED
from workbench.jobs.options import DEFAULT_TIMEOUT, Workers

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.cli.output import Output
    from workbench.requests.progress_bar import Bar
    from workbench.study.result import StudyResult
    from workbench.study.run import StudyRun

__all__ = ["run"]

_NOT_MET = 1

# The options, each with its help.
_Study = Annotated[
    str | None, typer.Argument(metavar="STUDY", help="Study file (.toml), or a bundled one: study:NAME.")
]
_Store = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="DIR",
        help="Folder in which finished analyses are kept; by default .workbench-store beside the study.",
    ),
]
_NoStore = Annotated[bool, typer.Option("--no-store", help="Keep nothing, and reuse nothing.")]
_Fresh = Annotated[bool, typer.Option("--fresh", help="Measure again what is in the store.")]
_Jobs = Annotated[
    int | None, typer.Option("--jobs", metavar="N", help="Number of worker processes; by default one per core.")
]
_Timeout = Annotated[
    float,
    typer.Option("--timeout", metavar="S", help="Time limit for one result [s]; inf for no limit."),
]
_Confine = Annotated[
    bool,
    typer.Option("--confine", help="Keep FMUs from networks, and from writing files; see any analysis's --help."),
]
_SchedulerAddress = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="tcp://..",
        help="Dask cluster on which the analyses run, as for nfr; the study must lie on a shared file system.",
    ),
]
_SchedulerFiles = Annotated[
    str | None,
    typer.Option(
        "--scheduler-tls",
        metavar="CA,CERT,KEY",
        help="Files for tls://..: certificate of the authority, own certificate, own key.",
    ),
]
_Example = Annotated[bool, typer.Option("--example", help="Print a small example study, or the one named.")]
_Json = Annotated[
    str | None, typer.Option("--json", metavar="PATH", help="Write the result as JSON; - is standard output.")
]
_Csv = Annotated[str | None, typer.Option("--csv", metavar="PATH", help="Write the result as CSV.")]
_Junit = Annotated[
    Path | None, typer.Option("--junit", metavar="PATH", help="Write the requirements as JUnit XML, for CI.")
]
_Report = Annotated[
    str | None,
    typer.Option("--report", metavar="PATH", help="Write one self-contained page, .html: pictures, tables, data."),
]


def run(
    study: _Study = None,
    store: _Store = None,
    no_store: _NoStore = False,
    fresh: _Fresh = False,
    jobs: _Jobs = None,
    timeout: _Timeout = DEFAULT_TIMEOUT,
    confine: _Confine = False,
    scheduler: _SchedulerAddress = None,
    scheduler_tls: _SchedulerFiles = None,
    example: _Example = False,
    json: _Json = None,
    csv: _Csv = None,
    junit: _Junit = None,
    report: _Report = None,
) -> int:
    """Run a study: analyses over a grid of parameters, compared with requirements. Exit code 1: one is not met.

    A study file names models, analyses (any command with its options) and requirements; `workbench run --example`
    prints one, `workbench run study:NAME --example` a bundled one. What an unchanged FMU with unchanged options already
    gave is not measured again. A study with a table [envelope] has options of its own: `workbench run STUDY --help`.

    Example: `workbench run study:rudder_specification --junit junit.xml --report rudder.html`
    """
    from workbench.cli.output import Output
    from workbench.study.run import StudyRun, default_store

    if example:
        return _print_example(study or "study:rudder_specification")
    if study is None:
        raise InputError(
            "name a study: a .toml file, or study:NAME; 'workbench run --example' prints one to begin with"
        )
    if no_store and (store is not None or fresh):
        raise InputError("--no-store and --store or --fresh: only one of them")
    out = Output("run", json=json, csv=csv, report=report)
    _check_junit(junit)
    folder = None if no_store else store or default_store(study)
    prepared = StudyRun(study, store=folder, fresh=fresh)
    place = Workers(jobs=jobs, timeout=timeout, confine=confine, scheduler=scheduler, tls=scheduler_tls)
    result = _run(prepared, place, kept=folder is not None)
    _show(result, out)
    out.write(result.to_dict, csv=result.to_csv, report=result)
    if junit is not None:
        result.to_junit(junit)
        out.console.print(f"wrote {junit}", soft_wrap=True, markup=False)
    if result.missing:
        return INTERRUPTED
    return 0 if result.passed else _NOT_MET


def _print_example(name: str) -> int:
    from workbench.study.read import locate_study

    sys.stdout.write(locate_study(name).read_text(encoding="utf-8"))
    return 0


def _check_junit(path: Path | None) -> None:
    from workbench.cli.output import check_kind
    from workbench.core.machine.files import file_to_write

    check_kind("--junit", str(path or ""), ".xml")
    if path is not None:
        file_to_write(path, option="--junit")


def _run(prepared: StudyRun, workers: Workers, *, kept: bool) -> StudyResult:
    """Run with a bar; Ctrl-C ends it, what is finished stays where it is kept."""
    from workbench.cli.command_line import command_line
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import flush, note
    from workbench.jobs.job import Job

    with _ProgressLines() as progress, (job := Job(progress.tell)).ended_by(), OnInterrupt(job.stop):
        result = prepared.run(lambda: workers, job, command=command_line())
    for text in result.notes:
        note(text)
    if result.missing:
        again = "; the same command continues" if kept else ""
        note(f"{interrupted()}: {result.missing} of {prepared.total} analyses were not run{again}")
    flush()
    return result


class _ProgressLines(Closable):
    """A bar that is loaded when there is something to tell: a study in its store is quick."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._bar: Bar | None = None

    def tell(self, label: object, done: int, total: int) -> None:
        """Tell what was done; before anything is, with an empty label."""
        from workbench.requests.progress_bar import Bar

        if self._bar is None:
            self._bar = self._stack.enter_context(Bar(total))
        self._bar.update(done, str(label))

    def close(self) -> None:
        self._stack.close()


# -- what is shown -----------------------------------------------------------------------------


def _show(result: StudyResult, out: Output) -> None:
    console = out.console
    if result.checked:
        console.print(_table(result))
        hidden = len(result.checked) - len(result.shown)
        if hidden:
            console.print(f"{hidden} more that passed, with larger margins, are not shown")
    for checked in result.violated:
        if checked.finding.reason:
            console.print(unbroken(f"{checked.name}: {checked.finding.reason}"), markup=False, soft_wrap=True)
    for run, outcome in result.failed:
        console.print(unbroken(f"analysis {run.label}: {_why(outcome.reason)}"), markup=False, soft_wrap=True)
    console.print(result.words, markup=False, soft_wrap=True)


def _why(reason: str) -> str:
    return f"failed: {reason}" if reason else "ended with exit code 1: points of it failed"


def _table(result: StudyResult) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from workbench.study.requirements.base import PASSED, number

    shown = result.shown
    table = Table(title=escape(unbroken(result.study.name)), title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("requirement", overflow="fold")
    pointed = any(c.point for c in shown)
    for heading in ["point"] if pointed else []:
        table.add_column(heading, overflow="fold")
    for heading in ("value", "limit", "margin"):
        table.add_column(heading, justify="right", overflow="fold")
    table.add_column("verdict")
    table.add_column("where", overflow="fold")
    for checked in shown:
        solution = checked.finding
        colour = "green" if solution.verdict == PASSED else "bold red"
        first = [checked.requirement.name, *([checked.point] if pointed else [])]
        numbers = [number(solution.value), solution.limit_words, solution.margin_words]
        cells = [escape(unbroken(text)) for text in (*first, *numbers, solution.where)]
        table.add_row(*cells[:-1], f"[{colour}]{solution.verdict}[/]", cells[-1])
    return table
