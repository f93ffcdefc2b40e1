"""`workbench check`: whether an FMU keeps its promises, and what that means for the analyses here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import (
    Bias,
    Csv,
    InProcess,
    Jobs,
    Json,
    MemoryLimit,
    ModelName,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Step,
    Tolerance,
    numbers,
    pairs,
)
from workbench.core.forms import setting
from workbench.core.names import split_names

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.check import HealthCard, HealthLine
    from workbench.workers import Workers

__all__ = ["check"]

_BROKEN = 1  # exit code
_COLOURS = {"good": "green", "watch": "yellow", "broken": "bold red", "not applicable": "dim"}

_Names = Annotated[
    list[str] | None,
    typer.Option("--only", metavar="NAME,..", help="These checks only; repeatable."),
]


def check(
    model: ModelName,
    only: _Names = None,
    skip: Annotated[
        list[str] | None, typer.Option("--skip", metavar="NAME,..", help="Leave these checks out; repeatable.")
    ] = None,
    interface: Annotated[
        Literal["auto", "me", "cs"],
        typer.Option("--interface", help="Model exchange or co-simulation; auto: each that is offered."),
    ] = "auto",
    solver: Solver = "auto",
    step: Step = None,
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    bias: Bias = None,
    jobs: Jobs = None,
    in_process: InProcess = False,
    timeout: Annotated[
        float | None,
        typer.Option("--timeout", metavar="S", help="Longest time for one check [s]; 60 unless set, inf for none."),
    ] = None,
    memory_limit: MemoryLimit = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Check whether an FMU keeps its promises: a health card of each interface; of a system, of each FMU in it.

    Each line has a verdict (good, watch, broken, not applicable), the evidence, and what follows for the analyses. The
    FMU runs in worker processes; a crash or a hang is a line, too. Exit code 1: a promise is broken.

    Checks: validation, runs, step, reset, determinism, instances, snapshots, directional, dependencies, drift,
    start-time, nominals, inputs, jumps, memory.

    Example: `workbench check fmu:Rudder --report health.html`
    """
    from workbench.analysis.check import check as run
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.cli.progress import Bar

    out = Output("check", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    where = _workers(jobs, in_process, timeout, memory_limit)
    with Bar(1.0) as bar:
        card = run(
            model,
            interface=interface,
            only=_names(only),
            skip=_names(skip),
            solver=solver,
            step=step,
            tolerance=tolerance,
            start=start,
            start_values={n: setting(v) for n, v in pairs("--set", set_).items()},
            bias={n: numbers(f"--bias: {n}", v)[0] for n, v in pairs("--bias", bias).items()},
            workers=where,
            progress=bar.update,
        )
    _show(card, out.console)
    for text in card.notes:
        note(text)
    out.write(card.to_dict(), csv=card.to_csv, plot=card.plot, report=card)
    return 0 if card.passed else _BROKEN


def _workers(jobs: int | None, in_process: bool, timeout: float | None, memory: float | None) -> Workers:  # noqa: FBT001
    from workbench.analysis.check import DEFAULT_PATIENCE
    from workbench.workers import DEFAULT_TIMEOUT, Workers

    default = DEFAULT_TIMEOUT if in_process else DEFAULT_PATIENCE  # in this process there is no limit
    limit = default if timeout is None else timeout
    return Workers(jobs=jobs, in_process=in_process, timeout=limit, memory_limit=memory)


def _names(texts: Sequence[str] | None) -> list[str] | None:
    return None if texts is None else [n for text in texts for n in split_names(text)]


def _show(card: HealthCard, console: Console) -> None:
    from rich.markup import escape

    about = f"FMI {card.fmi_version}, made by {card.generation_tool}" if card.fmi_version else ""
    console.print(f"[bold]{escape(card.model)}[/bold]  {escape(about)}", soft_wrap=True)
    for component, interface in dict.fromkeys((c.component, c.interface) for c in card.checks):
        lines = [c for c in card.checks if (c.component, c.interface) == (component, interface)]
        console.print(_table(" ".join(filter(None, (component, interface))), lines))
    counts = Counter(c.verdict for c in card.checks)
    colour = _COLOURS[card.worst]
    words = ", ".join(f"{n} {word}" for word, n in sorted(counts.items(), key=lambda item: _rank(item[0])))
    console.print(f"[{colour}]{card.worst}[/{colour}]: {words}", soft_wrap=True)


def _rank(verdict: str) -> int:
    from workbench.analysis.check import VERDICTS

    return -VERDICTS.index(verdict)


def _table(title: str, lines: Sequence[HealthLine]) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, expand=False)
    table.add_column("check", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("evidence → consequence", overflow="fold")
    for line in lines:
        colour = _COLOURS[line.verdict]
        text = line.evidence + (f" → {line.consequence}" if line.consequence else "")
        table.add_row(line.name, f"[{colour}]{line.verdict}[/{colour}]", escape(text))
    return table
