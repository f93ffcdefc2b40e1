"""`workbench feed-forward`: a filter that feeds a nonlinear block's output forward to a control input."""

from __future__ import annotations

import json
from pathlib import Path
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
    span,
)
from workbench.cli.table import table_of
from workbench.errors import BuildError, InputError, suggest

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from workbench.analysis.feed_forward.result import FeedForwardResult

__all__ = ["feed_forward"]

_OUT = (".json", ".fmu")


def feed_forward(
    model: ModelName,
    block: Annotated[str, typer.Option("--block", metavar="COMPONENT", help="The nonlinear block of the system.")],
    to: Annotated[str, typer.Option("--to", metavar="NAME", help="Control input that the filter drives.")],
    feedback: Annotated[
        str | None,
        typer.Option("--feedback", metavar="NAME:GAIN", help="Scalar feedback to the same input, which stays."),
    ] = None,
    orders: Annotated[
        str | None, typer.Option("--orders", metavar="G,H", help="Orders of the reduced G and H, as in 36,29.")
    ] = None,
    hankel: Annotated[
        float, typer.Option("--hankel", metavar="TOL", help="Without --orders: relative singular values kept.")
    ] = 1e-4,
    method: Annotated[
        Literal["match-dc", "truncate"], typer.Option("--method", help="Of the balanced reduction.")
    ] = "match-dc",
    cancel: Annotated[
        float, typer.Option("--cancel", metavar="TOL", help="Relative distance at which poles and zeros cancel.")
    ] = 1e-5,
    low_pass: Annotated[float, typer.Option("--low-pass", metavar="F", help="Corner of the low-pass [Hz].")] = 5.0,
    low_pass_order: Annotated[
        int, typer.Option("--low-pass-order", metavar="N", help="Order of the low-pass; 0: none.")
    ] = 1,
    sign: Annotated[
        Literal["auto", "change", "keep"],
        typer.Option("--sign", help="Of the filter after mirroring; auto: by its phase at low frequency."),
    ] = "auto",
    band: Annotated[
        str | None, typer.Option("--band", metavar="LO:HI", help="Frequencies in which errors count [Hz].")
    ] = None,
    input: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="NAME=SIGNAL", help="Starts the motion; with it, simulate; repeatable."),
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option("--output", metavar="NAME", help="Variable to simulate besides; repeatable.")
    ] = None,
    closes_at: Annotated[
        float, typer.Option("--closes-at", metavar="T", help="Time at which control is connected [s].")
    ] = 0.0,
    stop: Annotated[
        float | None,
        typer.Option("--stop", metavar="T", help="End of the simulation [s]; the system's own unless given."),
    ] = None,
    actuator: Annotated[
        str | None,
        typer.Option("--actuator", metavar="MODEL", help="With limits, in front of the control input: .fmu, fmu:NAME."),
    ] = None,
    crude: Annotated[
        bool, typer.Option("--crude", help="Also try a plain gain in place of the filter, without and within limits.")
    ] = False,
    figure: Annotated[
        str,
        typer.Option(
            "--figure",
            metavar="NAME",
            help="What --plot draws: overview, reduced, compensation, mirrored, simulated, error, poles.",
        ),
    ] = "overview",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="PATH", help="Write the filter: .json (matrices) or .fmu.")
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
    """Design a filter F = H/G that makes a nonlinear block's output cancel itself, and try it.

    G leads from the control input to the block's input, H from the block's output. Both are reduced, joined, poles and
    zeros that meet are cancelled, unstable poles mirrored, the sign set, and a low-pass put behind. Each step is held
    against H/G. With --input the system is simulated: scalar feedback alone, with the filter, with a crude one.

    Example: `workbench feed-forward system:failed_aileron --block damper --to aircraft.inner_aileron --feedback
    aircraft.outer_aileron_position:-1 --orders 36,29 --cancel 3e-3 --input pulse=pulse:value=0.8,duration=0.1
    --closes-at 140 --actuator fmu:LimitedActuator --plot filter.png`
    """
    from workbench.analysis.feed_forward.feed_forward import feed_forward as analyse
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.plotting.feed_forward import FIGURES
    from workbench.signals import parse_signal

    written = Output("feed-forward", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    if figure not in FIGURES:
        raise InputError(f"--figure: '{figure}' is unknown; {suggest(figure, FIGURES)}")
    _check_out(out)
    signals = {name: parse_signal(text) for name, text in pairs("--input", input).items()} if input else None
    if signals is None and (crude or figure == "simulated"):
        raise InputError("--crude and --figure simulated need a simulation: give --input, which starts the motion")
    fed_back, sizes = _feedback(feedback), _orders(orders)
    limits = None if band is None else span("--band", band, above=0.0, example="0.1:5")
    loaded = open_named(
        model, interface=interface, solver=solver, step=step, tolerance=tolerance, start=start, set_=set_, bias=bias
    )
    with loaded:
        result = analyse(
            loaded,
            block=block,
            target=to,
            feedback=fed_back,
            orders=sizes,
            hankel=hankel,
            method=method,
            cancel=cancel,
            low_pass=low_pass,
            low_pass_order=low_pass_order,
            sign=sign,
            band=limits,
            inputs=signals,
            outputs=output or (),
            closes_at=closes_at,
            stop=stop,
            actuator=actuator,
            crude=crude,
            at=at,
        )
    _show(result, written.console)
    for text in result.notes:
        note(text)
    written.write(
        result.to_dict(), csv=result.to_csv, plot=lambda path: result.plot(path, figure=figure), report=result
    )
    if out is not None:
        _write_filter(result, out)
        written.console.print(f"wrote {out}", soft_wrap=True, markup=False)
    return 0


def _check_out(out: Path | None) -> None:
    if out is None:
        return
    if out.suffix.lower() not in _OUT:
        raise InputError(f"--out: '{out}' must end in one of {', '.join(_OUT)}")
    if not out.parent.is_dir():
        raise InputError(f"--out: the folder '{out.parent}' does not exist")
    if out.suffix.lower() == ".fmu":
        from importlib.util import find_spec

        if find_spec("ziglang") is None:
            raise BuildError('writing FMUs needs ziglang: pip install "fmi-workbench[build]"')


def _write_filter(result: FeedForwardResult, out: Path) -> None:
    found = result.filter_dict()
    if out.suffix.lower() == ".fmu":
        from workbench.build.export import export

        export(found, out)
        return
    rows = {k: [json.dumps(row) for row in found[k]] for k in "ABCD"}
    matrices = [f'  "{k}": [\n    ' + ",\n    ".join(v) + "\n  ]" for k, v in rows.items()]
    rest = [f'  "{k}": {json.dumps(v)}' for k, v in found.items() if k not in rows]
    try:
        out.write_text("{\n" + ",\n".join([*matrices, *rest]) + "\n}\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from None


def _feedback(text: str | None) -> tuple[str, float] | None:
    if text is None:
        return None
    name, colon, gain = text.rpartition(":")
    if not (colon and name.strip()):
        raise InputError(f"--feedback: '{text}' is not of the form NAME:GAIN, as in aircraft.outer_aileron_position:-1")
    return name.strip(), numbers("--feedback", gain)[0]


def _orders(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = numbers("--orders", text)
    if len(found) != 2 or any(x != int(x) for x in found):
        raise InputError(f"--orders: '{text}' is not of the form G,H with two whole numbers, as in 36,29")
    return int(found[0]), int(found[1])


def _show(result: FeedForwardResult, console: Console) -> None:
    low, high = result.band
    console.print(_steps(result))
    console.print(
        f"errors against H/G from {low:g} to {high:g} Hz; residual: largest |G·F − H| over the largest |H|; "
        f"unstable poles of the plant: {len(result.open_unstable)}, with the feedback {len(result.closed_unstable)}",
        markup=False, soft_wrap=True,
    )  # fmt: skip
    if result.trials:
        console.print(_trials(result))


def _steps(result: FeedForwardResult) -> Table:
    table = table_of(
        f"{result.model}: filter from {result.output} to {result.target}",
        "step", "order", "gain error at", "phase error at", "residual", "unstable", "what", left=("step", "what"),
    )  # fmt: skip
    for s in result.steps:
        table.add_row(
            s.name, str(s.order), f"{s.gain_error_db:.2f} dB, {s.gain_error_hz:.2f} Hz",
            f"{s.phase_error_deg:.1f}°, {s.phase_error_hz:.2f} Hz", f"{s.residual:.2g}",
            str(len(s.unstable_poles)) if s.name != "reduced" else "", s.remark,
        )  # fmt: skip
    return table


def _trials(result: FeedForwardResult) -> Table:
    first = result.trials[0]
    table = table_of(
        f"simulated: seconds after {first.closes_at:g} s until {result.input} stays below a part of {first.before:.4g}",
        "control", "limits", *(f"{100.0 * p:g} %" for p in first.settling_seconds), "left at the end",
        left=("control",),
    )  # fmt: skip
    for t in result.trials:
        row = ["never" if s is None else f"{s:.2f} s" for s in t.settling_seconds.values()]
        left = "" if t.rest is None else f"{t.rest:.2g}"
        if t.failure:
            row, left = ["" for _ in row], _end(t.divergence.kind if t.divergence else "stopped")
        table.add_row(t.name, "yes" if t.limited else "no", *row, left)
    return table


def _end(kind: str) -> str:
    return {"finite escape": "escapes in finite time", "exponential": "grows exponentially"}.get(kind, kind)
