"""`workbench compare`: motions of several models under the same signals."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import (
    Csv,
    InProcess,
    Interface,
    Json,
    MemoryLimit,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Timeout,
    Tolerance,
    numbers,
    open_named,
    pairs,
    workers,
)
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.model.described import DescribedModel

__all__ = ["compare"]

_POINTS_FAILED = 1


def compare(
    systems: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL..", help="Systems (.toml, .ssp, system:NAME) or FMUs; the first is the reference."
        ),
    ],
    signal: Annotated[list[str], typer.Option("--signal", metavar="NAME", help="Variable to compare; repeatable.")],
    window: Annotated[
        list[str], typer.Option("--window", metavar="BEGIN:END", help="Part of the runs to measure [s]; repeatable.")
    ],
    input: Annotated[
        list[str] | None,
        typer.Option(
            "--input", metavar="NAME=SIGNAL", help="Force an input: pulse:value=1,duration=0.1, gust:.., file.csv."
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option("--label", metavar="TEXT", help="Label of each model, in their order; repeatable."),
    ] = None,
    at: Annotated[
        list[Path] | None,
        typer.Option(
            "--at",
            metavar="POINT.JSON",
            help="Operating point of each model, in their order, as from trim; repeatable.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option("--unit", help="Unit in which to show signals, if they can be converted; g is standard gravity."),
    ] = None,
    stop: Annotated[
        float | None,
        typer.Option("--stop", metavar="T", help="End of the runs [s]; by default that of the last window."),
    ] = None,
    interval: Annotated[
        float | None, typer.Option("--interval", metavar="S", help="Interval between rows [s].")
    ] = None,
    interface: Interface = "auto",
    solver: Solver = "auto",
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    in_process: InProcess = False,
    timeout: Timeout = None,
    memory_limit: MemoryLimit = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Simulate several models under the same signals; peak and rms of chosen variables in windows of time.

    Example: `workbench compare system:failed_aileron system:failed_aileron_feedback --signal z_wing_tip
    --input pulse=pulse:value=0.8,duration=0.1 --window 120:140 --window 200:260`
    """
    from workbench.analysis.motions.compare import compare_motions
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.core.progress import Bar
    from workbench.report.results import page_of
    from workbench.report.terminal import text_of
    from workbench.signals import parse_signal

    out = Output("compare", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    inputs = {name: parse_signal(text) for name, text in pairs("--input", input).items()}
    windows = [_window(text) for text in window]
    names = _labels(systems, label or [])
    points = _points(names, at or [])
    where = workers(jobs=1, in_process=in_process, timeout=timeout, memory_limit=memory_limit)
    with ExitStack() as stack, Bar(len(systems)) as bar:
        opened: dict[str, DescribedModel] = {
            name: stack.enter_context(
                open_named(
                    system,
                    interface=interface,
                    solver=solver,
                    step=None,
                    tolerance=tolerance,
                    start=start,
                    set_=set_,
                    bias=None,
                )
            )
            for name, system in zip(names, systems, strict=True)
        }
        result = compare_motions(
            opened,
            signals=list(dict.fromkeys(signal)),
            windows=windows,
            inputs=inputs,
            at=points,
            stop=stop,
            interval=interval,
            unit=unit,
            workers=where,
            progress=lambda name, done, _: bar.update(done, name),
        )
    for text in result.notes:
        note(text)
    out.say(lambda width: text_of(page_of(result), width))
    out.write(result.to_dict(), csv=result.to_csv, plot=result.plot, report=result)
    return _POINTS_FAILED if result.failed else 0


def _window(text: str) -> tuple[float, float]:
    limits = numbers("--window", text, separator=":")
    if len(limits) != 2 or not 0.0 <= limits[0] < limits[1]:
        raise InputError(f"--window: '{text}' is not of the form BEGIN:END with 0 ≤ BEGIN < END, as in 120:140")
    return limits[0], limits[1]


def _points(names: list[str], at: list[Path]) -> dict[str, Path]:
    """Return the operating point of each model."""
    if at and len(at) != len(names):
        raise InputError(f"--at: {len(at)} operating points for {len(names)} models; give one for each, in their order")
    return dict(zip(names, at, strict=bool(at)))


def _labels(systems: list[str], labels: list[str]) -> list[str]:
    """Return a name for each model: as given, else from its file, numbered where it stands twice."""
    if labels and len(labels) != len(systems):
        raise InputError(f"--label: {len(labels)} names for {len(systems)} models")
    found = labels or [Path(s.removeprefix("fmu:").removeprefix("system:")).stem for s in systems]
    twice = {n for n in found if found.count(n) > 1}
    if labels and twice:
        raise InputError(f"--label: '{twice.pop()}' is given twice")
    return [f"{n} ({k})" if n in twice else n for k, n in enumerate(found, 1)]
