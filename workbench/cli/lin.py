"""`workbench lin`: linear models."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TextIO

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
from workbench.csv_file import write_csv
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.lin.compare import LinComparison
    from workbench.analysis.lin.result import LinResult
    from workbench.analysis.lin.sweep import LinGrid
    from workbench.cli.output import Output
    from workbench.model import DescribedModel
    from workbench.session.base import Floats

__all__ = ["lin"]

_POINTS_FAILED = 1
_AT_REST = 1e-6  # [rad/s]: what rounding makes of an integrator
_WIDEST = 12  # so many states are printed; more belong into a file

_NUMBER = 10  # characters of -1.234e+05, which must not be broken
_LABEL = 30  # of the name of a row, which may be

_Names = list[str] | None


def lin(
    model: ModelName,
    at: At = None,
    x0: Annotated[
        _Names, typer.Option("--x0", metavar="NAME=VALUE", help="State or discrete state at the point; repeatable.")
    ] = None,
    u0: Annotated[_Names, typer.Option("--u0", metavar="NAME=VALUE", help="Input at the point; repeatable.")] = None,
    dx: Annotated[
        _Names, typer.Option("--dx", metavar="[NAME=]WIDTH", help="Total width for states: all, by name, or A,B,.. .")
    ] = None,
    du: Annotated[
        _Names, typer.Option("--du", metavar="[NAME=]WIDTH", help="Total width for inputs, likewise.")
    ] = None,
    method: Annotated[
        Literal["auto", "exact", "difference", "kalman-bertram", "response"],
        typer.Option("--method", help="How; auto chooses and says why."),
    ] = "auto",
    inputs: Annotated[_Names, typer.Option("--inputs", metavar="U,..", help="Inputs; repeatable.")] = None,
    outputs: Annotated[_Names, typer.Option("--outputs", metavar="Y,..", help="Outputs or states; repeatable.")] = None,
    time: Annotated[float | None, typer.Option("--time", metavar="T", help="Session time of the point [s].")] = None,
    periods: Annotated[
        str | None, typer.Option("--periods", metavar="S,..", help="Sample periods, if not found.")
    ] = None,
    btptol: Annotated[float, typer.Option("--btptol", help="Relative tolerance of the basic time period.")] = 1e-6,
    period: Annotated[
        float | None, typer.Option("--period", metavar="S", help="Method response: hold inputs so long.")
    ] = None,
    points: Annotated[int, typer.Option("--points", help="Method response: record so many periods.")] = 400,
    order: Annotated[int | None, typer.Option("--order", help="Method response: number of states.")] = None,
    continuous: Annotated[
        bool, typer.Option("--continuous", help="Turn a discrete model into the continuous one behind its hold.")
    ] = False,
    over: Annotated[
        _Names, typer.Option("--over", metavar="NAME=A,B,..", help="Vary a parameter, input or state; repeatable.")
    ] = None,
    snapshot: Annotated[
        str | None, typer.Option("--snapshot", metavar="T1,T2,..", help="Linearise along a simulation.")
    ] = None,
    input: Annotated[
        _Names, typer.Option("--input", metavar="NAME=SIGNAL", help="Force an input of that simulation; repeatable.")
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="All methods and interfaces, and a measured response, from one input.")
    ] = False,
    freq: Annotated[str | None, typer.Option("--freq", metavar="F,..", help="Compare there [Hz].")] = None,
    amplitude: Annotated[float | None, typer.Option("--amplitude", help="Of the sine that is measured.")] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="Worker processes for --over.")] = 1,
    store: Annotated[
        Path | None, typer.Option("--store", metavar="DIR", help="Keep finished models of --over; go on from there.")
    ] = None,
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
    """Linearise at an operating point: A, B, C, D with names, what is doubtful, and why rows and columns are zero.

    Without widths they are chosen and verified. Widths are total: the model is evaluated half of it above and below.

    Example: `workbench lin fmu:Rudder --at trim.json --inputs delC --plot bode.png --json lin.json`
    """
    from workbench.analysis.frequency_grid import positive_values
    from workbench.cli.output import Output

    out = Output("lin", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    if sum([bool(over), snapshot is not None, compare]) > 1:
        raise InputError("--over, --snapshot and --compare: only one of them at a time")
    if not compare:
        for option, given in (("--amplitude", amplitude), ("--freq", freq)):
            if given is not None:
                raise InputError(
                    f"{option} belongs to the measurement that --compare makes; add --compare, or leave it out"
                )
    where: dict[str, Any] = {
        "at": at,
        "x0": _values("--x0", x0),
        "u0": _values("--u0", u0),
        "dx": _widths("--dx", dx),
        "du": _widths("--du", du),
        "time": time,
        "period": period,
    }
    chosen: dict[str, Any] = {"inputs": _names(inputs), "outputs": _names(outputs), "method": method}
    sampled: dict[str, Any] = {
        "periods": numbers("--periods", periods) if periods is not None else None,
        "btptol": btptol,
    }
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded:
        if over:
            return _over(loaded, over, {**where, **chosen}, out, jobs=jobs, store=store)
        if snapshot is not None:
            return _along(loaded, snapshot, input, {**where, **chosen}, out)
        if compare:
            grid = positive_values("--freq", numbers("--freq", freq), unit="Hz") if freq is not None else None
            if amplitude is not None:
                positive_values("--amplitude", [amplitude], unit="unit of the input")
            pair = _pair(loaded, chosen)
            return _compare(loaded, pair, {**where, **sampled, "frequencies": grid, "amplitude": amplitude}, out)
        more = {"points": points, "order": order, "continuous": continuous}
        return _one(loaded, {**where, **chosen, **sampled, **more}, out)


# -- what was asked for ------------------------------------------------------------------------


def _names(texts: Sequence[str] | None) -> list[str] | None:
    return [n for text in texts for n in split_names(text)] if texts else None


def _values(option: str, texts: Sequence[str] | None) -> dict[str, float]:
    return {name: numbers(f"{option}: {name}", value)[0] for name, value in pairs(option, texts).items()}


def _widths(option: str, texts: Sequence[str] | None) -> float | list[float] | dict[str, float] | None:
    """Read one width for all, a list in the order of the variables, or NAME=WIDTH."""
    if not texts:
        return None
    if any("=" in text for text in texts):
        return _values(option, texts)
    found = [w for text in texts for w in numbers(option, text)]
    return found[0] if len(found) == 1 else found


def _pair(model: DescribedModel, chosen: Mapping[str, Any]) -> tuple[str, str]:
    """Return the one input and output to compare."""
    inputs = chosen["inputs"] or [v.name for v in model.inputs]
    outputs = chosen["outputs"] or [v.name for v in model.outputs]
    if (
        not inputs
        or not outputs
        or len(chosen["inputs"] or inputs[:1]) > 1
        or len(chosen["outputs"] or outputs[:1]) > 1
    ):
        raise InputError("--compare: it takes one input and one output; name them with --inputs and --outputs")
    return inputs[0], outputs[0]


def _one(model: DescribedModel, options: Mapping[str, Any], out: Output) -> int:
    from workbench.analysis.lin import lin as run

    result = run(model, **options).result
    _show(result, out)
    out.write(result.to_dict(), csv=_to_csv([({}, result)]), plot=result.plot, report=result)
    return _POINTS_FAILED if result.refused else 0


def _over(
    model: DescribedModel,
    texts: Sequence[str],
    options: Mapping[str, Any],
    out: Output,
    *,
    jobs: int,
    store: Path | None,
) -> int:
    from workbench.analysis.lin.sweep import lin_over
    from workbench.cli.progress import Bar

    grid = {name: numbers(f"--over: {name}", text) for name, text in pairs("--over", texts).items()}
    total = 1
    for values in grid.values():
        total *= len(values)
    with Bar(total) as bar:
        result = lin_over(
            model,
            grid,
            jobs=jobs,
            store=store,
            progress=lambda p, done, _: bar.update(done, _label(p.values)),
            **options,
        )
    return _write_grid(model, result, out)


def _along(
    model: DescribedModel, times: str, texts: Sequence[str] | None, options: Mapping[str, Any], out: Output
) -> int:
    from workbench.analysis.lin.sweep import lin_along
    from workbench.signals import parse_signal

    given = [n for n in ("at", "x0", "u0", "time") if options[n]]
    if given:
        raise InputError(f"--snapshot: the simulation sets the point; leave --{given[0]} out")
    signals = {name: parse_signal(text) for name, text in pairs("--input", texts).items()}
    kept = {k: options[k] for k in ("dx", "du", "method", "inputs", "outputs", "period")}
    return _write_grid(model, lin_along(model, numbers("--snapshot", times), signals=signals, **kept), out)


def _write_grid(model: DescribedModel, grid: LinGrid, out: Output) -> int:
    for point in grid.points:
        out.console.print(_label(point.values), style="bold", markup=False)
        if point.result is None:
            out.console.print(f"failed: {point.reason}", markup=False, soft_wrap=True)
        else:
            _show(point.result, out)
    members = [(p.values, p.result) for p in grid.points if p.result is not None]
    out.write(
        {"model": model.name, "interface": model.interface, "solver": model.solver, **grid.to_dict()},
        csv=_to_csv(members),
        plot=grid.plot,
        report=grid,
    )
    return _POINTS_FAILED if grid.failed else 0


def _compare(model: DescribedModel, pair: tuple[str, str], options: Mapping[str, Any], out: Output) -> int:
    from workbench.analysis.lin.compare import compare

    result = compare(model, *pair, **options)
    _show_comparison(result, out)
    out.write(
        {"model": model.name, "interface": model.interface, "solver": model.solver, **result.to_dict()},
        csv=_verdicts_csv(result),
        plot=result.plot,
        report=result,
    )
    return 0 if result.compared else _POINTS_FAILED


# -- what is shown -----------------------------------------------------------------------------


def _label(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in values.items())


def _show(result: LinResult, out: Output) -> None:
    from workbench.cli.notes import note

    console = out.console
    kind = f"discrete, period {result.dt:.9g} s" if result.dt > 0.0 else "continuous"
    console.print(f"{result.model} ({result.interface}): {kind}, by {result.method} ({result.why})", markup=False)
    if len(result.state_names) <= _WIDEST:
        _matrices(result, console)
    else:
        console.print(f"{len(result.state_names)} states; --json writes the matrices")
    _poles(result, console)
    for zero in result.zeros:
        console.print(f"zero: {zero.kind} {zero.name}: {zero.reason}", markup=False, soft_wrap=True)
    for doubt in result.doubts:
        where = f"{doubt.row} by {doubt.column} = {doubt.value:.6g}"
        console.print(f"doubtful: {where}: {doubt.reason}", markup=False, soft_wrap=True)
    for text in result.notes:
        note(text)


def _matrices(result: LinResult, console: Console) -> None:
    """Print A beside B above C beside D, names with units; as many tables below each other as the width asks for."""
    import numpy as np

    from workbench.report.tables import bracketed, rate_unit

    prime = "next" if result.dt > 0.0 else "d/dt"
    rows = [f"{prime} {bracketed(n, rate_unit(result.units.get(n), result.dt))}" for n in result.state_names]
    rows += [bracketed(n, result.units.get(n)) for n in result.output_names]
    columns = [bracketed(n, result.units.get(n)) for n in (*result.state_names, *result.input_names)]
    values = np.block([[result.A, result.B], [result.C, result.D]])
    label = min(max((len(name) for name in rows), default=0), _LABEL)
    each = max(1, (console.width - label - 2) // (_NUMBER + 1))
    for first in range(0, len(columns), each):
        chosen = slice(first, first + each)
        console.print(_matrix(rows, columns[chosen], values[:, chosen], label))


def _matrix(rows: Sequence[str], columns: Sequence[str], values: Floats, label: int) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column("", overflow="fold", min_width=label, max_width=_LABEL)
    for name in columns:
        table.add_column(escape(name), justify="right", overflow="fold", min_width=min(_NUMBER, len(name)))
    for name, line in zip(rows, values.tolist(), strict=True):
        table.add_row(escape(name), *(f"{x:.4g}" for x in line))
    return table


def _poles(result: LinResult, console: Console) -> None:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from workbench.core.poles import POLE_HEADINGS, pole_rows

    if not len(result.A) or len(result.A) > _WIDEST:
        return
    table = Table(box=box.SIMPLE_HEAD)
    for heading in POLE_HEADINGS:
        table.add_column(escape(heading), justify="right")
    for row in pole_rows(result.poles.tolist(), result.dt):
        table.add_row(f"{row.pole.real:.6g} {row.pole.imag:+.6g}j", row.natural, row.damping, row.damped)
    console.print(table)


def _show_comparison(result: LinComparison, out: Output) -> None:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    console = out.console
    for words in result.words:
        console.print(words, markup=False, soft_wrap=True)
    table = Table(title=f"{escape(result.input)} → {escape(result.output)}", title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("method", "Hz", "gain less measured \\[dB]", "phase \\[deg]", ""):
        table.add_column(heading, justify="right" if heading != "method" else "left")
    for v in result.verdicts:
        off = [f"{x:.{d}f}" if math.isfinite(x) else "-" for x, d in ((v.gain_db, 3), (v.phase_deg, 2))]
        table.add_row(escape(v.method), f"{v.frequency_hz:.5g}", *off, v.words)
    console.print(table)
    for name, why in result.failed.items():
        console.print(f"not applicable: {name}: {why}", markup=False, soft_wrap=True)


# -- CSV ---------------------------------------------------------------------------------------

_Writer = Callable[[str | TextIO], None]


def _to_csv(members: Sequence[tuple[Mapping[str, float], LinResult]]) -> _Writer:
    """Return what writes one line per matrix entry."""
    names = list(members[0][0]) if members else []
    rows: list[list[Any]] = [[*names, "matrix", "row", "column", "value"]]
    for values, r in members:
        sides = {"A": (r.state_names, r.state_names), "B": (r.state_names, r.input_names)}
        sides |= {"C": (r.output_names, r.state_names), "D": (r.output_names, r.input_names)}
        for matrix, (left, top) in sides.items():
            table = getattr(r, matrix)
            rows += [
                [*values.values(), matrix, a, b, table[i, j]] for i, a in enumerate(left) for j, b in enumerate(top)
            ]
    return _rows_writer(rows)


def _verdicts_csv(result: LinComparison) -> _Writer:
    rows: list[list[Any]] = [["method", "frequency_hz", "gain_db", "phase_deg", "agrees", "measured_gain", "word"]]
    rows += [
        [v.method, v.frequency_hz, v.gain_db, v.phase_deg, v.agrees, v.measured_gain, v.word] for v in result.verdicts
    ]
    return _rows_writer(rows)


def _rows_writer(rows: list[list[Any]]) -> _Writer:
    def write(target: str | TextIO) -> None:
        write_csv(target, rows)

    return write
