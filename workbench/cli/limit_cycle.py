"""`workbench limit-cycle`: limit cycles of a system with one nonlinear block."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TextIO

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
    numbers,
    open_named,
    pairs,
    span,
    workers,
)
from workbench.cli.table import table_of
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.limit_cycle.free_run import FreeRun
    from workbench.analysis.limit_cycle.result import LimitCycleResult, SimulatedCycle

__all__ = ["limit_cycle"]

_MOST_OUTPUTS = 40  # printed; more belong into a file


def limit_cycle(
    model: ModelName,
    block: Annotated[str, typer.Option("--block", metavar="COMPONENT", help="The nonlinear block of the system.")],
    output: Annotated[
        list[str] | None, typer.Option("--output", metavar="NAME", help="Measure its amplitude; repeatable.")
    ] = None,
    band: Annotated[str, typer.Option("--band", metavar="LO:HI", help="Frequencies looked at [Hz].")] = "0.01:1000",
    amplitude: Annotated[
        str | None,
        typer.Option("--amplitude", metavar="LO:HI", help="Amplitudes at the block's input."),
    ] = None,
    harmonics: Annotated[int, typer.Option("--harmonics", metavar="K", help="Of harmonic balance.")] = 7,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            metavar="NAME",
            help="describing function, harmonic balance, shooting, simulation; repeatable; all unless given.",
        ),
    ] = None,
    periods: Annotated[int, typer.Option("--periods", metavar="N", help="Longest simulation.")] = 400,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="NAME=LO:HI", help="Follow the cycles over a parameter, or gain; repeatable."),
    ] = None,
    free_run: Annotated[
        float | None,
        typer.Option("--free-run", metavar="T", help="Also simulate from the start until T [s]; see --input."),
    ] = None,
    input: Annotated[
        list[str] | None,
        typer.Option(
            "--input", metavar="NAME=SIGNAL", help="What starts that run: pulse:value=1,duration=0.1; repeatable."
        ),
    ] = None,
    at: At = None,
    time: Annotated[
        float | None,
        typer.Option("--time", metavar="T", help="Session time of the analysis [s]; else that of --at, or --start."),
    ] = None,
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
    """Predict limit cycles from the crossings of L(jω) with −1/N(A), refine them, and confirm them by simulation.

    The system is cut at the block; the rest is taken as linear. Harmonic balance and shooting refine what the
    describing function predicts; a simulation from the predicted state confirms it.

    Example: `workbench limit-cycle system:failed_aileron --block damper --output z_wing_tip --plot cycle.png`
    """
    from workbench.analysis.limit_cycle.limit_cycle import METHODS
    from workbench.analysis.limit_cycle.limit_cycle import limit_cycle as analyse
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.signals import parse_signal

    out = Output("limit-cycle", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    limits = span("--band", band, above=0.0, example="0.1:10")
    sizes = span("--amplitude", amplitude, above=0.0, example="0.1:10") if amplitude is not None else None
    ranges = {name: _limits(name, text) for name, text in pairs("--vary", vary).items()}
    where = workers(in_process=in_process, timeout=timeout, memory_limit=memory_limit)
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded:
        result = analyse(
            loaded,
            block=block,
            outputs=output,
            band=limits,
            amplitudes=sizes,
            harmonics=harmonics,
            methods=tuple(method) if method else METHODS,
            periods=periods,
            vary=ranges,
            run_until=free_run,
            inputs={name: parse_signal(text) for name, text in pairs("--input", input).items()},
            at=at,
            time=time,
            workers=where,
        )
    _show(result, out.console)
    for text in result.notes:
        note(text)
    out.write(result.to_dict(), csv=lambda target: _write_csv(result, target), plot=result.plot, report=result)
    return 0


def _write_csv(result: LimitCycleResult, target: str | TextIO) -> None:
    try:
        result.to_csv(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None


def _limits(name: str, text: str) -> tuple[float, float]:
    limits = numbers("--vary", text, separator=":")
    if len(limits) != 2 or not limits[0] < limits[1]:
        raise InputError(f"--vary: {name}={text} is not of the form NAME=LO:HI with LO < HI")
    return limits[0], limits[1]


def _show(result: LimitCycleResult, console: Console) -> None:
    console.print(_crossings(result))
    if result.limit_cycles:
        console.print(_cycles(result))
    if words := result.none_predicted():
        console.print(words, soft_wrap=True, markup=False)
    if result.simulated is not None:
        console.print(_outputs(result.simulated))
    if result.free_run is not None:
        console.print(_history(result.free_run))
        console.print(f"run from rest: {result.free_run.words()}", soft_wrap=True, markup=False)
    for branch in result.branches:
        folds = ", ".join(f"{p.value:.5g} (amplitude {p.amplitude:.4g})" for p in branch.folds) or "none"
        console.print(
            f"over {branch.parameter}: {len(branch.points)} points; folds: {folds}", soft_wrap=True, markup=False
        )


def _crossings(result: LimitCycleResult) -> Table:
    table = table_of(
        f"{result.model}: crossings of the loop through {result.block}",
        "", "f [Hz]", "real part", "gain", "amplitude", "unstable below", "above", "stable",
    )  # fmt: skip
    for number, c in enumerate(result.crossings, 1):
        place = f"{c.real:.5g}" if not c.imag else f"{c.real:.4g} {c.imag:+.4g}j"
        size = "" if c.amplitude is None else f"{c.amplitude:.5g}"
        table.add_row(
            str(number), f"{c.frequency_hz:.6g}", place, f"{c.gain:.5g}", size,
            str(c.unstable_below), str(c.unstable_above), _word(c.stable),
        )  # fmt: skip
    return table


def _cycles(result: LimitCycleResult) -> Table:
    unit = f" [{result.input_unit}]" if result.input_unit else ""
    table = table_of(
        f"limit cycles, amplitude and mean of {result.input}{unit}",
        "crossing", "method", "f [Hz]", "amplitude", "fundamental", "mean", "multiplier", "stable",
    )  # fmt: skip
    for c in result.limit_cycles:
        multiplier = "" if c.multiplier is None else f"{c.multiplier:.4g}"
        table.add_row(
            c.number, c.method, f"{c.frequency_hz:.6g}", f"{c.amplitude:.5g}", f"{c.fundamental:.5g}",
            f"{c.mean:.3g}", multiplier, _word(c.stable),
        )  # fmt: skip
    return table


def _outputs(cycle: SimulatedCycle) -> Table:
    table = table_of(
        f"simulated at {cycle.frequency_hz:.6g} Hz {_begun(cycle)}, {cycle.periods} periods",
        "variable", "unit", "amplitude", "fundamental", "mean",
    )  # fmt: skip
    for name in list(cycle.amplitude)[:_MOST_OUTPUTS]:
        table.add_row(
            name, cycle.units.get(name) or "", f"{cycle.amplitude[name]:.5g}", f"{cycle.fundamental[name]:.5g}",
            f"{cycle.mean[name]:.3g}",
        )  # fmt: skip
    return table


def _begun(cycle: SimulatedCycle) -> str:
    return "from a free run" if cycle.crossing is None else "from the predicted state"


def _history(run: FreeRun) -> Table:
    unit = f" [{run.unit}]" if run.unit else ""
    table = table_of(
        f"run from rest, {run.signal}",
        "from [s]", "to [s]", "f [Hz]", "scatter of the periods", f"largest amplitude{unit}", "growth [1/s]",
    )  # fmt: skip
    for s in run.spans:
        if s.frequency_hz is None:
            table.add_row(f"{s.begin:.4g}", f"{s.end:.4g}", "", "", "", "")
            continue
        table.add_row(
            f"{s.begin:.4g}", f"{s.end:.4g}", f"{s.frequency_hz:.5g}", f"{100.0 * s.scatter:.2g} %",
            f"{s.amplitude:.4g}", f"{s.growth:.3g}",
        )  # fmt: skip
    return table


def _word(stable: bool | None) -> str:  # noqa: FBT001 - a column of a table
    return "" if stable is None else "yes" if stable else "no"
