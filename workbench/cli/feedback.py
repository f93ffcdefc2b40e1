"""`workbench feedback`: a scalar feedback over its gain."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TextIO

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
    span,
)
from workbench.cli.table import table_of
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.feedback.result import FeedbackResult
    from workbench.analysis.feedback.settling import SettlingStudy
    from workbench.model.described import DescribedModel

__all__ = ["feedback"]

_MOST_CROSSINGS = 30  # printed
_QUANTITY = re.compile(r"\s*([-+0-9.eE]*[0-9.])\s*(.*?)\s*")


def feedback(
    model: ModelName,
    source: Annotated[str, typer.Option("--from", metavar="A.Y", help="Output that is fed back.")],
    target: Annotated[str, typer.Option("--to", metavar="B.U", help="Input that it acts on.")],
    gains: Annotated[
        str | None, typer.Option("--gains", metavar="LO:HI", help="Gains looked at; all unless given.")
    ] = None,
    block: Annotated[
        str | None,
        typer.Option("--block", metavar="COMPONENT", help="The nonlinear block; else the only static one there is."),
    ] = None,
    settle: Annotated[bool, typer.Option("--settle", help="Measure settling times over stable gains.")] = False,
    settle_gains: Annotated[
        str | None, typer.Option("--settle-gains", metavar="LO:HI", help="Gains of the settling study.")
    ] = None,
    count: Annotated[int, typer.Option("--count", metavar="N", help="How many gains.")] = 15,
    threshold: Annotated[
        float, typer.Option("--threshold", metavar="PART", help="Settled below this part of the motion before.")
    ] = 0.01,
    thresholds: Annotated[
        str | None, typer.Option("--thresholds", metavar="PART,..", help="Others, to see how the optimum moves.")
    ] = None,
    order: Annotated[int, typer.Option("--order", help="Of the polynomial through the settling times.")] = 4,
    longest: Annotated[
        float | None, typer.Option("--longest", metavar="S", help="Give a run up after this [s]; else 250 cycles.")
    ] = None,
    gain: Annotated[float | None, typer.Option("--gain", metavar="G", help="Simulate this gain closing.")] = None,
    pulse: Annotated[
        list[str] | None,
        typer.Option(
            "--pulse",
            metavar="INPUT=SIGNAL",
            help="Excite the motion from rest, as pulse:duration=0.1,value=1; else a predicted limit cycle.",
        ),
    ] = None,
    start_after: Annotated[
        float | None, typer.Option("--start-after", metavar="T", help="With --pulse: close the feedback after T [s].")
    ] = None,
    stop: Annotated[
        float | None, typer.Option("--stop", metavar="T", help="With --gain: end of that simulation [s].")
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option("--output", metavar="NAME", help="With --gain: record it too; repeatable.")
    ] = None,
    watch: Annotated[
        str | None,
        typer.Option("--watch", metavar="NAME", help="Whose magnitude counts; else the block's input, or the source."),
    ] = None,
    limit: Annotated[
        str | None, typer.Option("--limit", metavar="X", help="Of the deflection of the target, as 25deg.")
    ] = None,
    rate_limit: Annotated[
        str | None, typer.Option("--rate-limit", metavar="X", help="Of its rate, as 40deg/s.")
    ] = None,
    actuator: Annotated[
        str | None, typer.Option("--actuator", metavar="FMU", help="Between gain and target, instead of limits.")
    ] = None,
    at: At = None,
    time: Annotated[
        float | None,
        typer.Option("--time", metavar="T", help="Session time of the analysis [s]; else that of --at, or --start."),
    ] = None,
    method: Annotated[
        Literal["auto", "exact", "difference", "kalman-bertram", "response"],
        typer.Option("--method", help="How to linearise; auto chooses."),
    ] = "auto",
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
    plot_kind: Annotated[
        Literal["overview", "root-locus", "nyquist", "cycles", "settling", "run"],
        typer.Option("--plot-kind", help="Which picture --plot writes."),
    ] = "overview",
) -> int:
    """Feed an output back to an input, u = g·y: which gains stabilise, what they do to a limit cycle, how fast.

    All gains at which a pole reaches the border of stability, exactly; the poles between them counted; the limit cycles
    that a nonlinear block keeps; with --settle the settling times of the nonlinear system and the best gain.

    Example: `workbench feedback system:failed_aileron --from aircraft.outer_aileron_position
    --to aircraft.inner_aileron --settle --plot feedback.png`
    """
    from workbench.analysis.feedback.feedback import ALL
    from workbench.analysis.feedback.feedback import feedback as analyse
    from workbench.analysis.feedback.settling import THRESHOLDS
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.cli.progress import Bar
    from workbench.signals import parse_signal

    out = Output("feedback", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    _check_kind(plot_kind, plot, settle=settle, run=gain is not None)
    limits = span("--gains", gains, example="-2:0.5") if gains is not None else ALL
    chosen = span("--settle-gains", settle_gains, example="-2:0.5") if settle_gains is not None else None
    levels = numbers("--thresholds", thresholds) if thresholds is not None else THRESHOLDS
    signals = {name: parse_signal(text) for name, text in pairs("--pulse", pulse).items()} if pulse else None
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded, Bar(1) as bar:

        def progress(done: int, total: int) -> None:
            bar.update(done / total, f"{done} of {total} gains")

        result = analyse(
            loaded,
            source=source,
            target=target,
            gains=limits,
            block=block,
            at=at,
            time=time,
            method=method,
            settle=settle,
            settle_gains=chosen,
            count=count,
            threshold=threshold,
            thresholds=levels,
            order=order,
            longest=longest,
            signals=signals,
            start_after=start_after,
            watch=watch,
            limit=_size(loaded, "--limit", limit, target, per=""),
            rate_limit=_size(loaded, "--rate-limit", rate_limit, target, per="/s"),
            actuator=actuator,
            gain=gain,
            stop=stop,
            outputs=tuple(output or ()),
            progress=progress,
        )
    _show(result, out.console)
    for text in result.notes:
        note(text)
    out.write(
        result.to_dict(),
        csv=lambda target: _write_csv(result, target),
        plot=lambda path: _draw(result, plot_kind, path),
        report=result,
    )
    return 0


def _check_kind(kind: str, plot: Path | None, *, settle: bool, run: bool) -> None:
    if plot is None:
        if kind != "overview":
            raise InputError("--plot-kind: there is no --plot that it could choose for")
        return
    for wanted, option, given in (("settling", "--settle", settle), ("run", "--gain", run)):
        if kind == wanted and not given:
            raise InputError(f"--plot-kind: {wanted} needs {option}")


def _draw(result: FeedbackResult, kind: str, path: Path) -> None:
    if kind == "settling" and result.settling is not None:
        result.settling.plot(path)
    elif kind == "run" and result.run is not None:
        result.run.plot(path)
    else:
        pictures = {
            "overview": result.plot,
            "root-locus": result.plot_root_locus,
            "nyquist": result.plot_nyquist,
            "cycles": result.plot_cycles,
        }
        pictures[kind](path)


def _write_csv(result: FeedbackResult, target: str | TextIO) -> None:
    if result.run is not None and result.settling is None:
        result.run.to_csv(target)
    else:
        result.to_csv(target)


def _size(model: DescribedModel, option: str, text: str | None, target: str, *, per: str) -> float | None:
    """Return a limit in the target's unit; a number alone is in that unit."""
    from workbench.system.units import conversion, known_unit

    if text is None:
        return None
    found = _QUANTITY.fullmatch(text)
    try:
        value = float(found[1]) if found else None
    except ValueError:
        value = None
    if found is None or value is None:
        raise InputError(f"{option}: '{text}' is not a number with a unit, as in 25deg{per}")
    if not found[2]:
        return value
    own = next((v.unit for v in model.description.variables if v.name == target), None)
    given, wanted = known_unit(found[2]), known_unit(f"{own}{per}") if own else None
    factor = conversion(given, wanted) if given is not None and wanted is not None else None
    if factor is None:
        raise InputError(f"{option}: '{found[2]}' cannot be converted to {own or 'no unit'}{per}, that of {target}")
    return factor[0] * value


# -- tables ------------------------------------------------------------------------------------


def _show(result: FeedbackResult, console: Console) -> None:
    console.print(_crossings(result))
    console.print(result.words, markup=False, soft_wrap=True)
    for f in result.fastest:
        if f is not None:
            console.print(
                f"the slowest oscillation decays fastest with gain {f.gain:.5g}: {f.growth:.4g} 1/s at "
                f"{f.frequency_hz:.4g} Hz damped (slowest pole of all: {f.slowest:.4g} 1/s)",
                markup=False,
                soft_wrap=True,
            )
    _cycles(result, console)
    if result.settling is not None:
        console.print(_runs(result.settling))
        console.print(_optima(result.settling))
    if result.run is not None:
        run = result.run.to_dict()
        console.print(
            f"gain {run['gain']:g} closed at {run['closes_at']:.6g} s: {100.0 * run['left_at_end']:.3g} % of the motion"
            f" of {run['watch']} left at {run['stop']:.6g} s; peak deflection {run['peak_deflection']:.4g}, rate "
            f"{run['peak_rate']:.4g} [{result.target_unit or '-'}, {result.target_unit or '-'}/s]",
            markup=False,
            soft_wrap=True,
        )


def _crossings(result: FeedbackResult) -> Table:
    table = table_of(
        f"{result.model}: u = g·y from {result.source} to {result.target}; poles on the border of stability",
        "gain", "f [Hz]", "G = 1/gain", "unstable below", "above",
    )  # fmt: skip
    nearest = sorted(result.crossings, key=lambda c: abs(c.gain))[:_MOST_CROSSINGS]
    for c in sorted(nearest, key=lambda c: c.gain):
        cells = (
            f"{c.gain:.6g}",
            f"{c.frequency_hz:.6g}",
            f"{c.real:.6g}",
            str(c.unstable_below),
            str(c.unstable_above),
        )
        table.add_row(*cells)
    if len(result.crossings) > _MOST_CROSSINGS:
        table.caption = f"… and {len(result.crossings) - _MOST_CROSSINGS} with larger gains (all in the JSON)"
    return table


def _cycles(result: FeedbackResult, console: Console) -> None:
    """Say what each gain leaves, gains with the same answer together."""
    told: dict[str, list[float]] = {}
    for c in result.cycles:
        told.setdefault(c.words, []).append(c.gain)
    for words, found in told.items():
        span = f"{found[0]:.4g}" if len(found) == 1 else f"{len(found)} gains, {found[0]:.4g} … {found[-1]:.4g}"
        console.print(f"with {result.block}, gain {span}: {words} (describing function)", markup=False, soft_wrap=True)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _runs(study: SettlingStudy) -> Table:
    unit = study.target_unit or "-"
    heads = [f"to {100.0 * t:g} % [s]" for t in _levels(study)]
    table = table_of(
        f"settling of {study.variable} ({study.start.how})",
        "gain",
        *heads,
        f"peak [{unit}]",
        f"rate [{unit}/s]",
        "limit",
    )
    for r in study.runs:
        settled = [_seconds(r.settled[t]) for t in _levels(study)]
        table.add_row(
            f"{r.gain:.4g}",
            *settled,
            f"{r.peak_deflection:.4g}",
            f"{r.peak_rate:.4g}",
            _limited(r.deflection_limited, r.rate_limited),
        )
    return table


def _limited(deflection: float | None, rate: float | None) -> str:
    if deflection is None and rate is None:
        return ""
    hit = [f"{name} {s:.3g} s" for name, s in (("deflection", deflection), ("rate", rate)) if s]
    return ", ".join(hit) or "no"


def _levels(study: SettlingStudy) -> Sequence[float]:
    """Return the chosen threshold and the smallest one."""
    return tuple(dict.fromkeys((study.settings.threshold, study.settings.every[-1])))


def _optima(study: SettlingStudy) -> Table:
    table = table_of(
        f"best gain, polynomial of order {study.settings.order}",
        "threshold [%]", "best gain", "[s]", "fastest measured", "[s]", "not settled",
    )  # fmt: skip
    for o in study.optima:
        best = "-" if o.gain is None else f"{o.gain:.4g}{' (end)' if o.at_end else ''}"
        fastest = "-" if o.fastest_gain is None else f"{o.fastest_gain:.4g}"
        mark = " ←" if o.threshold == study.settings.threshold else ""
        table.add_row(
            f"{100.0 * o.threshold:g}{mark}",
            best,
            _seconds(o.seconds),
            fastest,
            _seconds(o.fastest_seconds),
            str(o.unsettled),
        )
    return table
