"""`workbench trim`: find an operating point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import (
    At,
    Bias,
    Csv,
    Interface,
    Json,
    ModelName,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Step,
    Tolerance,
    numbers,
    open_named,
    pairs,
)
from workbench.core.names import split_names
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.trim_result import TrimResult
    from workbench.cli.output import Output

__all__ = ["trim"]

_NOT_CONVERGED = 1

_Names = list[str] | None


def trim(
    model: ModelName,
    free: Annotated[_Names, typer.Option("--free", metavar="U,..", help="Inputs to find; repeatable.")] = None,
    fix: Annotated[
        _Names, typer.Option("--fix", metavar="NAME=VALUE", help="Value of a state, input or output; repeatable.")
    ] = None,
    bound: Annotated[
        _Names, typer.Option("--bound", metavar="NAME=LO:HI", help="Limits of a state, input or output; repeatable.")
    ] = None,
    floating: Annotated[
        _Names, typer.Option("--float", metavar="X,..", help="States whose derivative need not vanish; repeatable.")
    ] = None,
    x0: Annotated[
        _Names, typer.Option("--x0", metavar="NAME=VALUE", help="Where the search for a state begins; repeatable.")
    ] = None,
    u0: Annotated[
        _Names, typer.Option("--u0", metavar="NAME=VALUE", help="Input held there, or begun there if free; repeatable.")
    ] = None,
    time: Annotated[float | None, typer.Option("--time", metavar="T", help="Session time of the point [s].")] = None,
    family: Annotated[
        Literal["slowest", "nearest"],
        typer.Option("--family", help="Of many: least floating derivatives, or nearest to the start alone."),
    ] = "slowest",
    period: Annotated[
        float | None, typer.Option("--period", metavar="S", help="Basic period of a sampled model [s].")
    ] = None,
    longest: Annotated[
        float | None, typer.Option("--longest", metavar="S", help="Longest run of a co-simulation [s].")
    ] = None,
    at: At = None,
    interface: Interface = "auto",
    solver: Solver = "auto",
    step: Step = None,
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    bias: Bias = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Find an operating point: states, inputs and outputs at which nothing moves.

    Every state is unknown, every derivative must vanish and every input keeps its start value, unless told otherwise.
    The JSON is what `--at` of every command reads. Exit code 1: there is no equilibrium; the residuals are shown.

    Example: `workbench trim fmu:Rudder --u0 delC=2 --float p1,p2 --json trim.json`
    """
    from workbench.analysis.trim import trim as run
    from workbench.cli.output import Output

    out = Output("trim", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    fixed, begin_x, begin_u = (
        {n: _value(option, n, v) for n, v in pairs(option, texts).items()}
        for option, texts in (("--fix", fix), ("--x0", x0), ("--u0", u0))
    )
    bounds = {n: _limits(n, v) for n, v in pairs("--bound", bound).items()}
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded:
        result = run(
            loaded,
            free=_names(free),
            fix=fixed,
            bound=bounds,
            floating=_names(floating),
            x0=begin_x,
            u0=begin_u,
            at=at,
            time=time,
            family=family,
            period=period,
            step=step,
            longest=longest,
        )
    _show(result, out)
    out.write(result.to_dict(), csv=result.to_csv, plot=result.plot, report=result)
    return 0 if result.converged else _NOT_CONVERGED


def _names(texts: Sequence[str] | None) -> list[str]:
    return [name for text in texts or () for name in split_names(text)]


def _value(option: str, name: str, text: str) -> float:
    found = numbers(f"{option}: {name}", text)
    if len(found) != 1:
        raise InputError(f"{option}: {name} needs one value, not '{text}'")
    return found[0]


def _limits(name: str, text: str) -> tuple[float, float]:
    """Read LO:HI; either may be left out."""
    low, colon, high = (part.strip() for part in text.partition(":"))
    if not colon or not (low or high):
        raise InputError(f"--bound: {name} needs LO:HI, LO: or :HI, not '{text}'")
    return _value("--bound", name, low or "-inf"), _value("--bound", name, high or "inf")


def _show(result: TrimResult, out: Output) -> None:
    from workbench.cli.notes import note

    console = out.console
    console.print(f"{result.model} ({result.interface}), by {result.method}: {result.message}", markup=False)
    console.print(_values(result))
    console.print(_residuals(result))
    for number, direction in enumerate(result.null_directions, 1):
        console.print(f"open direction {number}: {direction}", markup=False, soft_wrap=True)
    for text in result.notes:
        note(text)


def _values(result: TrimResult) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    point = result.point
    table = Table(title=f"operating point at {point.time:g} s", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("")
    table.add_column("variable")
    for heading in ("value", "derivative \\[1/s]"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    table.add_column("")
    groups = (("state", point.x), ("discrete", point.discrete), ("input", point.u), ("output", point.y))
    for kind, values in groups:
        for name, value in values.items():
            slope = f"{point.dx[name]:.4g}" if kind == "state" and name in point.dx else ""
            found = "found" if name in result.unknowns and kind == "input" else ""
            unit = escape(point.units.get(name) or "")
            table.add_row(kind, escape(name), f"{value:.8g}", slope, unit, found)
    return table


def _residuals(result: TrimResult) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="residuals", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("equation")
    table.add_column("left over", justify="right")
    table.add_column("unit")
    table.add_column("scaled", justify="right")
    table.add_column("")
    for r in result.residuals:
        remark = "floating" if not r.required else "no unknown changes it" if r.idle and r.value else ""
        table.add_row(escape(r.name), f"{r.value:.4g}", escape(r.unit or ""), f"{r.scaled:.2g}", remark)
    return table
