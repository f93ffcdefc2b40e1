"""`workbench identify`: a linear model from recorded data."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from workbench.cli.options import Csv, Json, Plot, Report
from workbench.core.names import split_names
from workbench.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from workbench.analysis.identify import IdentifyResult
    from workbench.analysis.validate import Overlay, Validation
    from workbench.cli.output import Output
    from workbench.report import Page

__all__ = ["identify"]

_Names = list[str] | None
_WIDEST_BAR = 40


def identify(
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="CSV file, as workbench excite writes it, or any other.")
    ],
    input: Annotated[_Names, typer.Option("--input", "--inputs", metavar="U,..", help="Columns that force.")] = None,
    output: Annotated[
        _Names, typer.Option("--output", "--outputs", metavar="Y,..", help="Columns that follow.")
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            "--order", metavar="auto|N|ask", help="Number of states, 0 for a gain; ask shows the bars and asks."
        ),
    ] = "auto",
    method: Annotated[str, typer.Option("--method", metavar="moesp|n4sid|cva", help="Subspace weighting.")] = "moesp",
    validate: Annotated[
        Path | None, typer.Option("--validate", metavar="DATA2", help="Other data of the same model.")
    ] = None,
    basis: Annotated[
        str | None, typer.Option("--basis", metavar="combined|unscaled", help="Principal angles or singular values.")
    ] = None,
    biased: Annotated[bool, typer.Option("--biased", help="Regression on the state sequence.")] = False,
    horizon: Annotated[int | None, typer.Option("--horizon", metavar="N", help="Block rows of the method.")] = None,
    max_order: Annotated[int, typer.Option("--max-order", metavar="N", help="Largest order that auto considers.")] = 20,
    delay: Annotated[
        str, typer.Option("--delay", metavar="auto|N,..", help="Known delay of the inputs [samples].")
    ] = "0",
    feedthrough: Annotated[
        bool, typer.Option("--feedthrough/--no-feedthrough", help="Whether inputs act at once (D).")
    ] = True,
    stable: Annotated[bool, typer.Option("--stable", help="Move unstable poles inside the unit circle.")] = False,
    detrend: Annotated[
        str, typer.Option("--detrend", metavar="mean|linear|none", help="What is taken off the data.")
    ] = "mean",
    settle: Annotated[float, typer.Option("--settle", metavar="T", help="Cut so much off the beginning [s].")] = 0.0,
    dt: Annotated[
        float | None, typer.Option("--dt", metavar="S", help="Sampling interval of a file without times [s].")
    ] = None,
    bootstrap: Annotated[
        int, typer.Option("--bootstrap", metavar="N", help="Replicates for the confidence of the poles, e.g. 200.")
    ] = 0,
    lags: Annotated[int | None, typer.Option("--lags", metavar="N", help="Of the residual tests.")] = None,
    lin: Annotated[
        Path | None, typer.Option("--lin", metavar="LIN.JSON", help="Hold its frequency response against lin's.")
    ] = None,
    nfr: Annotated[
        Path | None, typer.Option("--nfr", metavar="NFR.JSON", help="Hold its frequency response against an NFR.")
    ] = None,
    bode: Annotated[
        Path | None, typer.Option("--bode", metavar="PATH", help="Write the Bode picture of model, --lin and --nfr.")
    ] = None,
    amplitude: Annotated[
        float | None, typer.Option("--amplitude", metavar="A", help="Of --nfr, where it has several.")
    ] = None,
    json_path: Json = None,
    csv_path: Csv = None,
    plot: Plot = None,
    report: Report = None,
) -> int:
    """Identify a discrete linear model from recorded data, judge the data, and validate the model.

    Without --validate the model is compared with the data of the fit, which flatters it.

    Example: `workbench identify rudder.csv --input delC --output del --validate rudder_validation.csv --report id.html`
    """
    from workbench.analysis.identify import identify as run
    from workbench.cli.output import Output

    _check_overlay(lin, nfr, bode, amplitude)
    out = Output("identify", json_path=json_path, csv_path=csv_path, plot=plot, report=report)
    options: dict[str, Any] = {
        "inputs": _names(input), "outputs": _names(output), "method": method, "basis": basis, "horizon": horizon,
        "max_order": max_order, "delay": _delay(delay), "feedthrough": feedthrough, "biased": biased, "stable": stable,
        "detrend": detrend, "settle": settle, "dt": dt,
    }  # fmt: skip
    wanted = _ask(data, options, out) if order == "ask" else _order(order)
    result = run(data, order=wanted, validation=validate, bootstrap=bootstrap, lags=lags, **options)
    overlay = _overlay(result, lin, nfr, bode, amplitude)
    _show(result, out)
    for text in overlay.words if overlay else ():
        out.console.print(text, markup=False, soft_wrap=True)
    out.write(
        {"model": result.data.name, **result.to_dict(), **({"overlay": overlay.to_dict()} if overlay else {})},
        csv=result.to_csv,
        plot=result.plot,
        report=result,
        page=lambda: _page(result, overlay),
    )
    return 1 if result.failed else 0


# -- what was asked for ------------------------------------------------------------------------


def _names(texts: Sequence[str] | None) -> list[str] | None:
    return [n for text in texts for n in split_names(text)] if texts else None


def _order(text: str) -> int | Literal["auto"]:
    if text == "auto":
        return "auto"
    if not text.isdecimal():
        raise InputError(f"--order: '{text}' is neither auto nor ask nor a number of states, 0 (a gain) or more")
    return int(text)


def _delay(text: str) -> Literal["auto"] | int | list[int]:
    if text == "auto":
        return "auto"
    parts = [p.strip() for p in text.split(",")]
    if not all(p.isdigit() for p in parts):
        raise InputError(f"--delay: '{text}' is neither auto nor numbers of samples, one for each input")
    return int(parts[0]) if len(parts) == 1 else [int(p) for p in parts]


def _ask(data: Path, options: Mapping[str, Any], out: Output) -> int:
    """Show singular values and principal angles, and ask for the order."""
    from workbench.analysis.identify import identify as run

    if not sys.stdin.isatty():
        raise InputError("--order ask: there is no terminal to ask; give a number or auto")
    proposal = run(data, order="auto", **options)
    _bars(proposal, out.console)
    answer = typer.prompt(f"order (0 … {options['max_order']})", default=str(proposal.order))
    chosen = _order(str(answer).strip())
    return proposal.order if chosen == "auto" else chosen


def _check_overlay(lin: Path | None, nfr: Path | None, bode: Path | None, amplitude: float | None) -> None:
    if bode is not None and lin is None and nfr is None:
        raise InputError("--bode: give what to compare the model with: --lin, --nfr or both")
    if amplitude is not None and nfr is None:
        raise InputError("--amplitude chooses one of --nfr, which is not given")


def _overlay(
    result: IdentifyResult, lin: Path | None, nfr: Path | None, bode: Path | None, amplitude: float | None
) -> Overlay | None:
    """Lay the model over what other commands wrote."""
    from workbench.analysis.lin.result import LinResult
    from workbench.analysis.nfr_result import NfrResult
    from workbench.analysis.validate import overlay
    from workbench.cli.files import read_json

    if lin is None and nfr is None:
        return None
    linear = None if lin is None else read_json("--lin", lin, LinResult.from_dict)
    measured = None if nfr is None else read_json("--nfr", nfr, NfrResult.from_dict)
    found = overlay(result.model, lin=linear, nfr=measured, amplitude=amplitude)
    if bode is not None:
        found.plot(bode)
    return found


# -- what is shown -----------------------------------------------------------------------------


def _show(result: IdentifyResult, out: Output) -> None:
    from workbench.cli.notes import note

    console, found, data = out.console, result.estimate, result.data
    for text in result.warnings:
        console.print(text, style="bold red", markup=False, soft_wrap=True)
        if console.quiet:
            note(text)
    columns = f"{', '.join(data.input_names)} → {', '.join(data.output_names)}"
    console.print(f"{data.name}: {columns}, {data.n_samples} samples every {data.dt:g} s", markup=False)
    for finding in result.advice.concerns:
        console.print(f"data, {finding}", markup=False, soft_wrap=True)
    kind = f"{found.method}, {found.basis}" + (", biased" if found.biased else "")
    console.print(f"order {found.order} by {kind}: {found.order_reason}", markup=False, soft_wrap=True)
    _bars(result, console)
    _poles(result, console)
    _verdicts("data of the fit", result.own, console)
    if result.other is not None:
        _verdicts(f"validation, {result.other.data.name}", result.other, console)
    for text in result.notes:
        note(text)


def _bars(result: IdentifyResult, console: Console) -> None:
    """Draw singular values (or principal angles) as bars; those of the order chosen are full."""
    found = result.estimate
    shown = min(len(found.singular_values), max(2 * found.order, found.order + 4))
    largest = float(found.singular_values[0]) or 1.0
    console.print("singular values (principal angles)", markup=False)
    pairs = zip(found.singular_values[:shown], found.principal_angles_deg[:shown], strict=False)
    for k, (value, angle) in enumerate(pairs, start=1):
        bar = ("█" if k <= found.order else "░") * max(1, round(_WIDEST_BAR * float(value) / largest))
        console.print(f"{k:4d} {value:10.4g} {angle:7.2f}° {bar}", markup=False)


def _poles(result: IdentifyResult, console: Console) -> None:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from workbench.core.poles import POLE_HEADINGS, pole_rows

    model = result.model.undelayed()
    if not model.order:
        return
    table = Table(box=box.SIMPLE_HEAD)
    for heading in POLE_HEADINGS:
        table.add_column(escape(heading), justify="right")
    for row in pole_rows(model.poles.tolist(), model.dt):
        table.add_row(f"{row.pole.real:.6g} {row.pole.imag:+.6g}j", row.natural, row.damping, row.damped)
    console.print(table)


def _verdicts(where: str, validation: Validation, console: Console) -> None:
    console.print(f"{where}:", style="bold")
    for text in validation.words:
        console.print(f"  {text}", markup=False, soft_wrap=True)


# -- files -------------------------------------------------------------------------------------


def _page(result: IdentifyResult, overlay: Overlay | None) -> Page:
    from workbench.report.identify import identify_page

    return identify_page(result, overlay=overlay)
