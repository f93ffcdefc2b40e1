"""`workbench simulate`: a time history."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import (
    At,
    Bias,
    Csv,
    InProcess,
    Interface,
    Json,
    MemoryLimit,
    ModelName,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Step,
    Timeout,
    Tolerance,
    open_model,
    pairs,
    workers,
)
from workbench.errors import SimulationError

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.simulate import SimulationResult
    from workbench.cli.output import Output

__all__ = ["simulate"]


def simulate(
    model: ModelName,
    stop: Annotated[
        float | None, typer.Option("--stop", metavar="T", help="End of the run [s]; else the FMU's default experiment.")
    ] = None,
    input: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            metavar="NAME=SIGNAL",
            help="Force an input: a number, sine:amplitude=1,frequency=2, step:time=1,value=2, file.csv; repeatable.",
        ),
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option("--output", metavar="NAME", help="Variable to record; repeatable.")
    ] = None,
    at: At = None,
    interface: Interface = "auto",
    solver: Solver = "auto",
    step: Step = None,
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    bias: Bias = None,
    in_process: InProcess = False,
    timeout: Timeout = None,
    memory_limit: MemoryLimit = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Simulate under given inputs and record a time history.

    Example: `workbench simulate fmu:Rudder --stop 1 --input delC=step:time=0.1,value=2 --output del --plot del.png`
    """
    from workbench.analysis.simulate import SimulationResult
    from workbench.analysis.simulate_job import SimulateJob, simulate_in_worker
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.signals import parse_signal

    out = Output("simulate", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    inputs = {name: parse_signal(text) for name, text in pairs("--input", input).items()}
    where = workers(jobs=1, in_process=in_process, timeout=timeout, memory_limit=memory_limit)
    loaded = open_model(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    job = SimulateJob(
        stop=stop,
        inputs=inputs,
        outputs=None if output is None else tuple(output),
        interval=step if loaded.interface == "me" else None,
    )
    with loaded:
        try:
            result = simulate_in_worker(loaded, job, workers=where, at=at)
        except SimulationError as error:
            if isinstance(error.before, SimulationResult):  # nothing is lost
                _write(error.before, out)
            raise
    _write(result, out)
    for text in result.notes:
        note(text)
    return 0


def _write(result: SimulationResult, out: Output) -> None:
    out.console.print(_table(result))
    envelope = {"model": result.model, "interface": result.interface, "solver": result.solver}
    out.write(
        {**envelope, **result.to_dict()},
        csv=result.to_csv,
        plot=lambda path: _save(result, path),
        report=result,
    )


def _save(result: SimulationResult, path: Path) -> None:
    """Write the picture of a time history."""
    from workbench.plotting.figure import save as write_figure

    write_figure(result.plot(), path)


def _table(result: SimulationResult) -> Table:
    """A summary: a time history itself belongs into a file."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    title = f"{escape(result.model)} ({result.interface}, {result.solver}), {result.time[0]:g} … {result.time[-1]:g} s"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("variable")
    table.add_column("unit")
    for heading in ("first", "last", "smallest", "largest"):
        table.add_column(heading, justify="right")
    for name, values in result.signals.items():
        numbers = (values[0], values[-1], values.min(), values.max())
        table.add_row(escape(name), escape(result.units[name] or ""), *(f"{x:.6g}" for x in numbers))
    return table
