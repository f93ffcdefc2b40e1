"""`workbench excite`: identification experiments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
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
    Timeout,
    Tolerance,
    open_named,
    workers,
)
from workbench.core.names import split_names
from workbench.endings import INTERRUPTED
from workbench.errors import InputError, WorkbenchError

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.excite import Design, Excitation, ExciteResult
    from workbench.analysis.experiment import Experiment
    from workbench.cli.output import Output

__all__ = ["excite"]

# Tighter than for a time history: integration errors must stay far below the model's own noise.
_TOLERANCE = 1e-8

_Names = list[str] | None


def excite(
    model: ModelName,
    input: Annotated[_Names, typer.Option("--input", metavar="U", help="Input to force; repeatable.")] = None,
    inputs: Annotated[_Names, typer.Option("--inputs", metavar="U,..", help="Several inputs at once.")] = None,
    output: Annotated[_Names, typer.Option("--output", metavar="Y", help="Variable to record; repeatable.")] = None,
    outputs: Annotated[_Names, typer.Option("--outputs", metavar="Y,..", help="Several outputs at once.")] = None,
    prbs: Annotated[
        str | None,
        typer.Option(
            "--prbs",
            metavar="KEY=VALUE,..",
            help="Binary sequence: amplitude, rate [Hz] (one bit a sample), order (the shortest that does not repeat), "
            "seed, offset (the operating point).",
        ),
    ] = None,
    multisine: Annotated[
        str | None,
        typer.Option(
            "--multisine",
            metavar="KEY=VALUE,..",
            help="Sines of a band: band=LOW:HIGH [Hz], amplitude (peak), periods, lines (all or odd), seed, offset.",
        ),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option("--step", metavar="DT", help="Sampling interval [s]; the model's own period where it has one."),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="For identification.")] = 3000,
    validation: Annotated[
        int | None, typer.Option("--validation", metavar="N", help="For validation; as many by default, 0 for none.")
    ] = None,
    at: At = None,
    settle: Annotated[
        float, typer.Option("--settle", metavar="T", help="Let the inputs rest before so long [s].")
    ] = 0.0,
    verify_step: Annotated[
        bool, typer.Option("--verify-step/--no-verify-step", help="Co-simulation: run again with half the step.")
    ] = True,
    interface: Interface = "auto",
    solver: Solver = "auto",
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
    """Record an identification experiment: force inputs by a PRBS or a multisine, from an operating point.

    Several values go with a colon, one for each input: amplitude=2:0.5. The validation data go beside the CSV file, as
    NAME_validation.

    Example: `workbench excite fmu:Rudder --input delC --output del --prbs amplitude=2 --step 0.01 --csv rudder.csv`
    """
    from workbench.analysis.excite import Excitation
    from workbench.cli.output import Output

    out = Output("excite", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    signal = _design(prbs, multisine)
    where = workers(jobs=1, in_process=in_process, timeout=timeout, memory_limit=memory_limit)
    forced, recorded = _listed("--input", input, inputs), _listed("--output", output, outputs)
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
    with loaded:
        excitation = Excitation(
            loaded,
            forced,
            recorded,
            samples=samples,
            validation_samples=validation,
            signal=signal,
            dt=step,
            at=at,
            settle=settle,
            verify_step=verify_step,
            workers=where,
        )
        return _run(excitation, out)


def _design(prbs: str | None, multisine: str | None) -> Design:
    from workbench.analysis.excite import parse_design

    if prbs is not None and multisine is not None:
        raise InputError("--prbs and --multisine: only one of them at a time")
    if prbs is not None:
        return parse_design("prbs", prbs)
    if multisine is not None:
        return parse_design("multisine", multisine)
    raise InputError("a signal is needed: --prbs amplitude=1,rate=.. or --multisine band=LOW:HIGH,amplitude=1")


def _listed(option: str, one: Sequence[str] | None, several: Sequence[str] | None) -> list[str]:
    names = [*(one or ()), *(n for text in several or () for n in split_names(text))]
    found = list(dict.fromkeys(n for n in names if n))
    if not found:
        raise InputError(f"{option}: name at least one")
    return found


def _run(excitation: Excitation, out: Output) -> int:
    """Record; whatever ends it, what was recorded is written."""
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import flush, note
    from workbench.cli.progress import Bar

    stopped: BaseException | None = None
    with OnInterrupt(excitation.stop) as wish:
        with Bar(1.0) as bar:
            try:
                for done in excitation.run():
                    bar.update(done / excitation.total, f"{done} of {excitation.total} samples")
            except (KeyboardInterrupt, WorkbenchError) as error:
                stopped = error
        if excitation.recorded:
            result = excitation.result()
            for text in result.notes:
                note(text)
            if out.csv_path == "-" and result.validation is not None:
                note("--csv -: the validation data are not written; name a file, or take --validation 0")
            flush()
            _write(result, out)
    if wish.came or isinstance(stopped, KeyboardInterrupt):
        note(f"{interrupted()} after {excitation.done} of {excitation.total} samples")
        return INTERRUPTED
    if stopped is not None:
        raise stopped
    return 0


def _write(result: ExciteResult, out: Output) -> None:
    from workbench.analysis.excite.result import validation_path

    files: list[str] = []
    if out.csv_path is not None and out.csv_path != "-":
        first = Path(out.csv_path)
        files = [str(first), *([str(validation_path(first))] if result.validation is not None else [])]
    console = out.console
    console.print(_facts(result), markup=False, soft_wrap=True)
    console.print(_table(result))
    out.write(
        {**result.to_dict(), "files": files},
        csv=lambda target: _to_csv(result, target),
        plot=result.plot,
        report=result,
    )
    for path in files[1:]:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


def _to_csv(result: ExciteResult, target: str | TextIO) -> None:
    if isinstance(target, str):
        result.to_csv(target)
    else:
        result.identification.to_csv(target)


def _facts(result: ExciteResult) -> str:
    design, data = result.design, result.identification
    second = f" + {result.validation.n_samples}" if result.validation is not None else ""
    who = f"{result.model} ({result.interface}, {result.solver})"
    parts = [f"{who}: {data.n_samples}{second} samples every {design.dt:.6g} s"]
    if design.kind == "prbs":
        parts.append(f"PRBS of order {design.order} at {design.clock:.6g} Hz, repeats after {design.period:.6g} s")
    else:
        parts.append(f"multisine of {design.lines} lines an input, period {design.period:.6g} s")
    parts.append(f"spectrum holds −3 dB from {design.band[0]:.4g} to {design.band[1]:.4g} Hz")
    parts.append("crest factor " + ", ".join(f"{c:.3f}" for c in design.crest_factor))
    if design.cross_correlation is not None:
        parts.append(f"cross-correlation of the inputs at most {design.cross_correlation:.3f}")
    return "\n".join(parts)


def _table(result: ExciteResult) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("variable")
    table.add_column("unit")
    for heading in ("before", "smallest", "largest", "mean", "std"):
        table.add_column(heading, justify="right")
    data: Experiment = result.identification
    before = {**result.u0, **result.y0}
    columns = [*zip(data.input_names, data.u.T, strict=True), *zip(data.output_names, data.y.T, strict=True)]
    for name, values in columns:
        numbers = (before[name], values.min(), values.max(), values.mean(), values.std())
        table.add_row(escape(name), escape(data.units[name] or ""), *(f"{x:.6g}" for x in numbers))
    return table
