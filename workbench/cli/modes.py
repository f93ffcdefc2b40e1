"""`workbench modes`: frequency and damping of every mode over a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

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
from workbench.cli.table import table_of
from workbench.core.forms import setting
from workbench.core.names import split_names
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.modes.result import Mode, ModeSet, ModesResult

__all__ = ["modes"]

_MOST_ROWS = 12  # of a table; more belong into a file


def modes(
    model: ModelName,
    vary: Annotated[
        str, typer.Option("--vary", metavar="NAME=LO:HI", help="Parameter, input or state; or NAME=A,B,.. for a list.")
    ],
    points: Annotated[int, typer.Option("--points", metavar="N", help="Values between LO and HI.")] = 41,
    against: Annotated[
        list[str] | None,
        typer.Option("--against", metavar="NAME=VALUE,..", help="Another configuration to compare with; repeatable."),
    ] = None,
    at: At = None,
    x0: Annotated[list[str] | None, typer.Option("--x0", metavar="NAME=VALUE", help="State at the point.")] = None,
    u0: Annotated[list[str] | None, typer.Option("--u0", metavar="NAME=VALUE", help="Input at the point.")] = None,
    time: Annotated[float | None, typer.Option("--time", metavar="T", help="Session time of the point [s].")] = None,
    trim: Annotated[bool, typer.Option("--trim", help="Find the equilibrium at each value, inputs held.")] = False,
    method: Annotated[
        Literal["auto", "exact", "difference", "kalman-bertram", "response"],
        typer.Option("--method", help="Of the linearisation."),
    ] = "auto",
    precision: Annotated[
        float | None, typer.Option("--precision", metavar="D", help="Of critical values; 1e-6 of the range unless set.")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Worker processes at a time.")] = 1,
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
    """Follow every mode over a parameter through crossings, and find where modes become unstable: a flutter diagram.

    The model is linearised at each value; models are put in between where the eigenvectors leave a doubt which mode is
    which. Critical values are refined by root finding.

    Example: `workbench modes fmu:Aircraft --vary airspeed=150:350 --against outer_aileron_failed=true --plot out.png`
    """
    from workbench.analysis.modes.modes import modes as analyse
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.cli.progress import Bar

    out = Output("modes", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    name, where = _range(vary, points)
    others = [_settings(text) for text in against or ()]
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded, Bar(1.0) as bar:
        result = analyse(
            loaded,
            vary=name,
            **where,
            against=others,
            at=at,
            x0=_values("--x0", x0),
            u0=_values("--u0", u0),
            time=time,
            trimmed=trim,
            method=method,
            tolerance=precision,
            jobs=jobs,
            progress=lambda label, done, total: bar.update(done / total, label or name),
        )
    _show(result, out.console)
    for text in result.notes:
        note(text)
    out.write(result.to_dict(), csv=result.to_csv, plot=result.plot, report=result)
    return 0


def _range(text: str, points: int) -> tuple[str, dict[str, Any]]:
    """Return the name, and the values or the band with its number of points."""
    ((name, limits),) = pairs("--vary", [text]).items()
    if ":" not in limits:
        return name, {"values": numbers(f"--vary: {name}", limits)}
    found = numbers(f"--vary: {name}", limits, separator=":")
    if len(found) != 2 or not found[0] < found[1]:
        raise InputError(f"--vary: '{text}' is not of the form NAME=LO:HI with LO < HI, as in airspeed=150:350")
    return name, {"band": (found[0], found[1]), "points": points}


def _settings(text: str) -> dict[str, Any]:
    return {name: setting(value) for name, value in pairs("--against", split_names(text)).items()}


def _values(option: str, texts: Sequence[str] | None) -> Mapping[str, float]:
    return {name: numbers(f"{option}: {name}", value)[0] for name, value in pairs(option, texts).items()}


def _show(result: ModesResult, console: Console) -> None:
    unit = f" [{result.unit}]" if result.unit and result.unit != "1" else ""
    for modes in result.sets:
        console.print(_modes_table(result, modes))
        if modes.critical:
            console.print(_critical_table(modes, f"{result.parameter}{unit}"))
        for line in _words(modes, result.parameter):
            console.print(line, markup=False, soft_wrap=True)


def _modes_table(result: ModesResult, modes: ModeSet) -> Table:
    import numpy as np

    title = f"{result.model}{': ' if modes.label else ''}{modes.label}"
    first, last = modes.value[0], modes.value[-1]
    table = table_of(
        title,
        "mode",
        f"natural Hz at {first:g}",
        f"at {last:g}",
        f"damping at {first:g}",
        f"at {last:g}",
        "least",
        "states",
    )
    shown = {m.number for m in modes.modes} if len(modes.modes) <= _MOST_ROWS else modes.relevant(_MOST_ROWS)
    for mode in (m for m in modes.modes if m.number in shown):
        f, d = mode.natural_frequency_hz, mode.damping
        least = np.nanmin(np.append(d, np.inf))
        cells = (_cell(f[0], "g"), _cell(f[-1], "g"), _cell(d[0], "f"), _cell(d[-1], "f"), _cell(least, "f"))
        table.add_row(str(mode.number), *cells, _names(mode))
    return table


def _cell(value: float, kind: str) -> str:
    import math

    if not math.isfinite(value):
        return ""
    return f"{value:.4g}" if kind == "g" else f"{value:.4f}"


def _names(mode: Mode) -> str:
    from rich.markup import escape

    return escape(", ".join(mode.states[:2]))


def _critical_table(modes: ModeSet, heading: str) -> Table:
    table = table_of("critical values", heading, "mode", "f [Hz]", "becomes", "kind")
    for c in modes.critical:
        table.add_row(f"{c.value:.8g}", str(c.mode), f"{c.frequency_hz:.5g}", c.becomes, c.kind)
    return table


def _words(modes: ModeSet, parameter: str) -> list[str]:
    """Return what the tables do not say."""
    count = modes.unstable_count
    words = [] if modes.critical else [f"no mode becomes unstable or stable over {parameter}"]
    if count and count[0]:
        words.append(f"at {parameter} = {modes.value[0]:g}, {count[0]} of the modes are unstable already")
    if len(modes.modes) > _MOST_ROWS:
        left = len(modes.modes) - len(modes.relevant(_MOST_ROWS))
        words.append(f"{left} modes that are not near instability are left out; --csv writes all {len(modes.modes)}")
    return words
