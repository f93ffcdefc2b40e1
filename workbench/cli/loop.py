"""`workbench loop`: margins of a system's loop."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import (
    At,
    Bias,
    Csv,
    InProcess,
    Interface,
    Jobs,
    Json,
    MemoryLimit,
    ModelName,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Timeout,
    Tolerance,
    numbers,
    open_named,
    span,
    workers,
)
from workbench.endings import INTERRUPTED
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from workbench.analysis.loop.margins import Margins
    from workbench.analysis.loop.measured import LoopCurve, LoopPoint
    from workbench.analysis.loop.result import LoopResult
    from workbench.cli.output import Output
    from workbench.core.operating_point import OperatingPoint
    from workbench.model import Model

__all__ = ["loop"]

# Tighter than for a time history, as for a frequency response.
_TOLERANCE = 1e-8

_POINTS_FAILED = 1


def loop(
    model: ModelName,
    open_: Annotated[
        str | None,
        typer.Option("--open", metavar="PLANT.Y", help="Where the loop is opened: a source, or 'a.y -> b.u'."),
    ] = None,
    at: At = None,
    amplitude: Annotated[
        str | None, typer.Option("--amplitude", metavar="A,..", help="Measure too, at amplitudes of the signal there.")
    ] = None,
    freq: Annotated[str | None, typer.Option("--freq", metavar="F,..", help="Measure at frequencies [Hz].")] = None,
    band: Annotated[
        str | None, typer.Option("--band", metavar="LO:HI", help="Measure in a band [Hz]; else around the crossovers.")
    ] = None,
    ratio: Annotated[float, typer.Option("--ratio", help="Of neighbouring frequencies in a band.")] = 1.2,
    how: Annotated[
        Literal["auto", "break", "inject", "both"],
        typer.Option("--how", help="Break the loop, or inject a sine in closed loop; auto breaks stable open loops."),
    ] = "auto",
    point: Annotated[
        Path | None, typer.Option("--point", metavar="POINT.JSON", help="Another word for --at.", hidden=True)
    ] = None,
    trim: Annotated[bool, typer.Option("--trim", help="Trim the closed loop first.")] = False,
    method: Annotated[
        Literal["auto", "exact", "difference", "kalman-bertram", "response"],
        typer.Option("--method", help="How to linearise; auto chooses."),
    ] = "auto",
    refine: Annotated[int, typer.Option("--refine", help="Rounds of more points at the crossovers.")] = 2,
    errcrit: Annotated[
        float, typer.Option("--errcrit", help="Settled when phase [rad] and 10 x gain change by less in a period.")
    ] = 0.1,
    max_periods: Annotated[int, typer.Option("--max-periods", help="Average and mark a point after so many.")] = 20,
    interface: Interface = "auto",
    solver: Solver = "auto",
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    bias: Bias = None,
    jobs: Jobs = None,
    in_process: InProcess = False,
    timeout: Timeout = None,
    memory_limit: MemoryLimit = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Open a system's loop at a connection: gain, phase, delay and disk margins, stability, crossovers.

    Negative feedback: L is minus what returns over what is passed on, the closed loop 1/(1 + L). With amplitudes the
    loop is measured too, for loops that are not linear.

    Example: `workbench loop system:rudder_loop --open plant.del --amplitude 1,4 --band 4:15 --plot loop.png`
    """
    from workbench.analysis.loop.loop import loop as run
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import flush, note
    from workbench.cli.output import Output
    from workbench.cli.progress import Bar

    place, begin = _asked(open_, at, point)
    if begin is not None and trim:
        raise InputError("--at and --trim: only one of them")
    out = Output("loop", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    amplitudes = numbers("--amplitude", amplitude) if amplitude is not None else None
    frequencies = numbers("--freq", freq) if freq is not None else None
    limits = span("--band", band, above=0.0, rising=False, example="0.1:10 [Hz]") if band is not None else None
    where = workers(jobs=jobs, in_process=in_process, timeout=timeout, memory_limit=memory_limit)
    loaded = open_named(
        model,
        interface=interface,
        solver=solver,
        step=None,
        tolerance=_TOLERANCE if tolerance is None else tolerance,
        start=start,
        set_=set_,
        bias=bias,
    )
    stops: list[bool] = []
    with loaded, Bar(1) as bar, OnInterrupt(lambda: stops.append(True)):

        def progress(found: LoopPoint, done: int, total: int) -> None:
            bar.update(done / total, f"{found.frequency_hz:.4g} Hz")

        result = run(
            loaded,
            place,
            amplitudes,
            frequencies,
            band=limits,
            ratio=ratio,
            how=how,
            at=_trimmed(loaded) if trim else begin,
            method=method,
            refine=refine,
            errcrit=errcrit,
            max_periods=max_periods,
            workers=where,
            progress=progress,
            stopped=lambda: bool(stops),
        )
    for text in result.notes:
        note(text)
    flush()
    _show(result, out)
    out.write(result.to_dict(), csv=result.to_csv, plot=result.plot, report=result)
    if stops:
        note(f"{interrupted()}: points are missing")
        return INTERRUPTED
    return _POINTS_FAILED if any(c.failed for c in result.curves) else 0


def _asked(open_: str | None, at: Path | None, point: Path | None) -> tuple[str, Path | None]:
    """Return where to open the loop, and the file of the operating point; once they were --at and --point."""
    from workbench.cli.notes import note

    if open_ is None:
        if at is None or at.is_file():
            raise InputError("--open: at which connection? Name its source, as in --open plant.y")
        note(f"--at {at} is taken as the connection: that is --open {at} now, and --at the operating point")
        open_, at = str(at), None
    if at is not None and point is not None:
        raise InputError("--at and --point: only one of them")
    return open_, at or point


def _trimmed(model: Model) -> OperatingPoint:
    from workbench.analysis.trim.request import trim

    found = trim(model)
    if not found.converged:
        raise InputError(f"--trim: {found.message}")
    return found.point


# -- tables ---------------------------------------------------------------------------------------


def _show(result: LoopResult, out: Output) -> None:
    console = out.console
    unit = f" {result.place.unit}" if result.place.unit and result.place.unit != "1" else ""
    console.print(f"{result.system}: loop opened at {result.place.label} ({result.value:.6g}{unit})", markup=False)
    if result.linear is not None:
        lin = result.linear
        sampled = f", sampled every {lin.transfer.dt:.6g} s" if lin.transfer.dt > 0.0 else ""
        console.print(f"linear loop ({lin.lin.method}{sampled})", markup=False)
        _margins(console, lin.margins)
    for curve in result.curves:
        console.print(f"measured ({curve.how}), amplitude {curve.amplitude:g}{unit}", markup=False)
        _points(console, curve)
        for text in curve.notes:
            console.print(f"  {text}", markup=False, soft_wrap=True)
        _margins(console, curve.margins)
    if result.why:
        console.print(f"measured so because {result.why}", markup=False, soft_wrap=True)


def _margins(console: Console, m: Margins) -> None:
    console.print(f"  {m.words}", markup=False, soft_wrap=True)
    rows = [
        ("gain margin", _db(m.gain_margin), _hz(m.phase_crossover_hz)),
        ("gain may fall to", _db(m.gain_reduction), ""),
        ("phase margin", _number(m.phase_margin_deg, "deg"), _hz(m.gain_crossover_hz)),
        ("delay margin", _number(m.delay_margin_s, "s"), ""),
    ]
    if m.disk is not None:
        factors = (
            f"{m.disk.alpha:.5g}: gain x {m.disk.low:.4g} to {m.disk.high:.4g}, phase ± {m.disk.phase_deg:.4g} deg"
        )
        rows.append(("disk margin", factors, _hz(m.disk.frequency_hz)))
    rows.append(("largest |S|", f"{m.peak_sensitivity:.5g}", _hz(m.peak_sensitivity_hz)))
    if m.meaningful:
        for name, value, where in rows:
            console.print(f"  {name:<17} {value}{where}", markup=False, soft_wrap=True)
    crossed = [*m.gain_crossovers, *m.phase_crossovers]
    if len(crossed) > 2 or not m.meaningful:
        gains = ", ".join(f"{c.frequency_hz:.5g} Hz ({c.phase_margin_deg:.4g} deg)" for c in m.gain_crossovers)
        phases = ", ".join(f"{c.frequency_hz:.5g} Hz ({c.db:.4g} dB)" for c in m.phase_crossovers)
        console.print(f"  all gain crossovers: {gains or 'none'}", markup=False, soft_wrap=True)
        console.print(f"  all phase crossovers: {phases or 'none'}", markup=False, soft_wrap=True)


def _db(factor: float) -> str:
    if not math.isfinite(factor):
        return _unbounded(factor)
    return "0 (no lower limit)" if factor <= 0.0 else f"{20.0 * math.log10(factor):.4f} dB (factor {factor:.5g})"


def _number(value: float, unit: str) -> str:
    return f"{value:.5g} {unit}" if math.isfinite(value) else _unbounded(value)


def _unbounded(value: float) -> str:
    return "infinite" if math.isinf(value) else "not seen in the band"


def _hz(frequency: float) -> str:
    return f" at {frequency:.5g} Hz" if math.isfinite(frequency) else ""


def _points(console: Console, curve: LoopCurve) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    headings = ("Hz", "gain", "dB", "deg", "THD passed %", "THD returned %", "injected", "balance %", "periods", "")
    for heading in headings:
        table.add_column(heading, justify="right")
    for p in curve.points:
        value = [] if p.value is None else [abs(p.value), 20.0 * math.log10(abs(p.value)), _degrees(p.value)]
        texts = [format(x, form) for x, form in zip(value, (".5g", ".3f", ".2f"), strict=True)] if value else ["-"] * 3
        percent = [None if x is None else 100.0 * x for x in (p.thd_passed, p.thd_returned)]
        rest = [*percent, p.injected, None if p.balance is None else 100.0 * p.balance]
        shown = ["-" if x is None else f"{x:.3g}" for x in rest]
        mark = "" if p.status == "settled" else p.status
        table.add_row(f"{p.frequency_hz:.5g}", *texts, *shown, str(p.periods), mark)
    console.print(table)


def _degrees(value: complex) -> float:
    return math.degrees(math.atan2(value.imag, value.real))
