"""`workbench nfr`: the nonlinear frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    Scheduler,
    Set,
    Solver,
    Start,
    Step,
    Timeout,
    Tolerance,
    numbers,
    open_model,
    span,
    workers,
)
from workbench.endings import INTERRUPTED
from workbench.errors import WorkbenchError

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.nfr import NfrSweep
    from workbench.analysis.nfr_result import NfrResult
    from workbench.cli.output import Output
    from workbench.report import Page

__all__ = ["nfr"]

# Tighter than for a time history: the response may be a small part of a large output or transient.
_TOLERANCE = 1e-8

_POINTS_FAILED = 1


def nfr(
    model: ModelName,
    input: Annotated[str, typer.Option("--input", metavar="U", help="Input to force.")],
    output: Annotated[str, typer.Option("--output", metavar="Y", help="Output (or state) to measure.")],
    amplitude: Annotated[str, typer.Option("--amplitude", metavar="A,..", help="Amplitudes of the sine.")],
    freq: Annotated[str | None, typer.Option("--freq", metavar="F,..", help="Frequencies [Hz].")] = None,
    band: Annotated[str | None, typer.Option("--band", metavar="LO:HI", help="Band of frequencies [Hz].")] = None,
    ratio: Annotated[float, typer.Option("--ratio", help="Of neighbouring frequencies in a band.")] = 1.2,
    errcrit: Annotated[
        float, typer.Option("--errcrit", help="Settled when phase [rad] and 10 x gain change by less in a period.")
    ] = 0.1,
    max_periods: Annotated[int, typer.Option("--max-periods", help="Average and mark a point after so many.")] = 20,
    carry: Annotated[
        bool, typer.Option("--carry", help="Carry the state to the next frequency; they may then fall (HI:LO).")
    ] = False,
    offset: Annotated[bool, typer.Option("--offset", help="Draw the output's mean too.")] = False,
    at: At = None,
    interface: Interface = "auto",
    solver: Solver = "auto",
    step: Step = None,
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    bias: Bias = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Measure model exchange once more with a hundredth of the tolerance.")
    ] = False,
    drift_check: Annotated[
        bool, typer.Option("--drift-check/--no-drift-check", help="Watch the model with zero input first.")
    ] = True,
    store: Annotated[
        Path | None,
        typer.Option("--store", metavar="DIR", help="Keep finished points there; the same command goes on."),
    ] = None,
    redo: Annotated[
        str | None,
        typer.Option("--redo", metavar="STATUS,..", help="Measure such points of the store again: averaged, failed."),
    ] = None,
    jobs: Jobs = None,
    in_process: InProcess = False,
    timeout: Timeout = None,
    memory_limit: MemoryLimit = None,
    scheduler: Scheduler = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Measure gain, phase and offset over frequency and amplitude (nonlinear frequency response).

    Example: `workbench nfr fmu:Rudder --input delC --output del --band 0.5:20 --amplitude 1,4 --plot bode.png`
    """
    from workbench.analysis.nfr import NfrSweep
    from workbench.cli.output import Output

    out = Output("nfr", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    frequencies = numbers("--freq", freq) if freq is not None else None
    amplitudes = numbers("--amplitude", amplitude)
    limits = span("--band", band, above=0.0, rising=False, example="0.1:10 [Hz]") if band is not None else None
    where = workers(jobs=jobs, in_process=in_process, timeout=timeout, memory_limit=memory_limit, scheduler=scheduler)
    loaded = open_model(
        model,
        interface=interface,
        solver=solver,
        step=step,
        tolerance=_TOLERANCE if tolerance is None else tolerance,
        start=start,
        set_=set_,
        bias=bias,
    )
    with loaded:
        sweep = NfrSweep(
            loaded,
            input,
            output,
            frequencies,
            amplitudes,
            at=at,
            band=limits,
            ratio=ratio,
            errcrit=errcrit,
            max_periods=max_periods,
            carry=carry,
            step=step,
            verify=verify,
            drift_check=drift_check,
            workers=where,
            store=store,
            redo=[] if redo is None else [status.strip() for status in redo.split(",")],
        )
        return _run(sweep, out, offset=offset)


def _run(sweep: NfrSweep, out: Output, *, offset: bool) -> int:
    """Measure; whatever ends it, what was measured is written."""
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import note
    from workbench.cli.progress import Bar

    stopped: BaseException | None = None
    result: NfrResult | None = None
    with OnInterrupt(sweep.stop) as wish:
        with Bar(sweep.total) as bar:
            try:
                for point in sweep.run():
                    bar.update(sweep.done, f"{point.amplitude:g} at {point.frequency:.4g} Hz")
            except (KeyboardInterrupt, WorkbenchError) as error:
                stopped = error
        if sweep.done or stopped is None:
            result = sweep.result()
            _write(result, sweep.notes, out, offset=offset)
    if wish.came or isinstance(stopped, KeyboardInterrupt):
        note(f"{interrupted()} after {sweep.done} of {sweep.total} points")
        return INTERRUPTED
    if stopped is not None:
        raise stopped
    return _POINTS_FAILED if result is not None and result.failed else 0


def _write(result: NfrResult, notes: Sequence[str], out: Output, *, offset: bool) -> None:
    from workbench.cli.notes import flush, note

    for text in (*notes, *result.warnings):
        note(text)
    flush()
    _show(result, out)
    out.write(
        result.to_dict(),
        csv=result.to_csv,
        plot=lambda path: result.plot(path, offset=offset),
        report=result,
        page=lambda: _page(result, offset=offset),
    )


def _page(result: NfrResult, *, offset: bool) -> Page:
    from workbench.report.nfr import nfr_page

    return nfr_page(result, offset=offset)


def _show(result: NfrResult, out: Output) -> None:
    console = out.console
    console.print(
        f"{result.model} ({result.interface}, {result.solver}): {result.input} → {result.output}", markup=False
    )
    for i in range(result.amplitude.size):
        console.print(_table(result, i))
    for reason, count, first in _reasons(result):
        others = f" and {count - 1} more" if count > 1 else ""
        console.print(f"failed: {first}{others}: {reason}", markup=False, soft_wrap=True)


def _reasons(result: NfrResult) -> list[tuple[str, int, str]]:
    """Each reason once: how many points have it, and the first of them."""
    points: dict[str, list[str]] = {}
    for failed in result.failed:
        where = f"{failed.frequency_hz:.6g} Hz, amplitude {failed.amplitude:g}"
        points.setdefault(failed.reason, []).append(where)
    return [(reason, len(where), where[0]) for reason, where in points.items()]


def _table(result: NfrResult, i: int) -> Table:
    from rich import box
    from rich.table import Table

    from workbench.analysis.nfr_result import MISSING

    table = Table(
        title=f"amplitude {result.amplitude[i]:g}{_blank(result.input_unit)}",
        title_justify="left",
        box=box.SIMPLE_HEAD,
    )
    ratio = _ratio(result.output_unit, result.input_unit)
    offset = f"offset{_brackets(result.output_unit)}"
    for heading in ("Hz", f"gain{ratio}", "dB", "deg", "error %", offset, "THD %", "periods"):
        table.add_column(heading, justify="right")
    table.add_column("")
    reasons = {f.frequency_hz: f.reason for f in result.failed if f.amplitude == result.amplitude[i]}
    columns = (
        result.gain, result.gain_db, result.phase_deg, 100.0 * result.error, result.offset, 100.0 * result.thd
    )  # fmt: skip
    for j, frequency in enumerate(result.frequency_hz):
        if reasons.get(frequency) == MISSING:
            continue  # said once below the table
        status = result.status[i][j]
        mark = "no effect" if result.no_effect[i, j] else "" if status == "settled" else status
        numbers = [float(column[i, j]) for column in columns]
        texts = [_text(x, form) for x, form in zip(numbers, (".5g", ".3f", ".2f", ".2g", ".4g", ".3g"), strict=True)]
        table.add_row(f"{frequency:.5g}", *texts, str(result.periods[i, j]), mark)
    return table


def _text(value: float, form: str) -> str:
    return "-" if value != value else format(value, form)  # noqa: PLR0124 - NaN is what differs from itself


def _blank(unit: str | None) -> str:
    return f" {unit}" if unit and unit != "1" else ""


def _brackets(unit: str | None) -> str:
    # Rich reads brackets as markup.
    return f" \\[{unit}]" if unit and unit != "1" else ""


def _ratio(output: str | None, input: str | None) -> str:
    """Unit of the gain, where it is worth a word."""
    if output == input:
        return ""
    return f" \\[{output or '1'}/{input or '1'}]"
