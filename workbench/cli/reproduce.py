"""`workbench reproduce`: the source report's figures, measured now from the bundled FMUs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from workbench.cli.options import Csv, InProcess, Jobs, Json, Report
from workbench.endings import INTERRUPTED
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.reproduce.result import ReproduceResult
    from workbench.reproduce.targets import Target

__all__ = ["reproduce"]

_T = TypeVar("_T")

_LONGEST = 600.0  # [s], of one experiment


def reproduce(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CHAPTER|FIGURE|TARGET]...",
            help="3, 8.3, fig31, figure 48, cycle-rate, or the beginning of names: rudder. By default all.",
        ),
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="Show targets and tolerances; measure nothing.")] = False,
    pictures: Annotated[
        Path | None, typer.Option("--pictures", metavar="FOLDER", help="Write the pictures into a folder, as png.")
    ] = None,
    jobs: Jobs = None,
    in_process: InProcess = False,
    json_path: Json = None,
    csv_path: Csv = None,
    report: Report = None,
) -> int:
    """Measure figures and tables of the source report now, from the bundled FMUs, and compare with what it prints.

    Each is met, missed, or not reachable for a reason in the source report itself. Exit code 1: one is missed.

    Example: `workbench reproduce figure 48 --report page.html`
    """
    from workbench.cli.interrupt import interrupted
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.core.progress import Bar
    from workbench.reproduce.page import reproduce_page
    from workbench.reproduce.run import reproduce as measure
    from workbench.reproduce.select import select
    from workbench.workers import Workers

    out = Output("reproduce", json_path=json_path, csv_path=csv_path, report=report)
    words = tuple(what or ())
    chosen = select(words)
    if list_:
        if json_path or csv_path or report or pictures:
            raise InputError("--list measures nothing; leave --json, --csv, --report and --pictures out")
        _list(chosen, out.console)
        return 0
    where = Workers(jobs=jobs, in_process=True) if in_process else Workers(jobs=jobs, timeout=_LONGEST)
    with Bar(1.0) as bar:
        result = measure(
            words,
            drawings=report is not None,
            folder=pictures,
            workers=where,
            progress=lambda done, total, name: bar.update(done / total, name),
        )
    _show(result, out.console)
    out.write(result.to_dict(), csv=result.to_csv, page=lambda: reproduce_page(result))
    if result.interrupted:
        note(f"{interrupted()}: the rest was not measured")
        return INTERRUPTED
    return 1 if result.missed else 0


def _list(chosen: tuple[Target, ...], console: Console) -> None:
    from rich.markup import escape

    for title, targets in _by_chapter([(t.chapter, t) for t in chosen]):
        table = _table(title, "target", "figures", "what", "published", "tolerance")
        for t in targets:
            cells = (t.name, ", ".join(str(n) for n in t.figures), t.what, t.text, t.tolerance)
            table.add_row(*(escape(cell) for cell in cells))
        console.print(table)


def _show(result: ReproduceResult, console: Console) -> None:
    from rich.markup import escape

    colours = {"met": "green", "missed": "bold red", "not reachable": "yellow"}
    for title, outcomes in _by_chapter([(o.target.chapter, o) for o in result.outcomes]):
        table = _table(title, "target", "published", "tolerance", "measured", "verdict")
        for o in outcomes:
            cells = (o.target.name, o.target.text, o.target.tolerance, o.text)
            table.add_row(*(escape(cell) for cell in cells), f"[{colours[o.verdict]}]{o.verdict}[/]")
        console.print(table)
    for o in result.outcomes:
        if not o.passed:
            console.print(f"{o.target.name}: {o.verdict}: {o.reason}", soft_wrap=True, markup=False)
    console.print(result.words, soft_wrap=True, markup=False)


def _by_chapter(chapters: Sequence[tuple[str, _T]]) -> list[tuple[str, list[_T]]]:
    """Return (title, members) of each main chapter."""
    from workbench.reproduce.page import TITLES

    found: dict[str, list[_T]] = {}
    for chapter, member in chapters:
        found.setdefault(chapter.split(".", maxsplit=1)[0], []).append(member)
    return [(f"{number} {TITLES.get(number, '')}".strip(), members) for number, members in found.items()]


def _table(title: str, name: str, *headings: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title, title_justify="left")
    table.add_column(name, no_wrap=True)
    for heading in headings:
        table.add_column(heading)
    return table
