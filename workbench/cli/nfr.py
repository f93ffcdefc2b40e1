"""`workbench nfr`: the nonlinear frequency response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.analysis.nfr import Nfr
from workbench.cli.derive import command

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.nfr_result import NfrResult
    from workbench.cli.output import Output
    from workbench.report import Page

__all__ = ["nfr"]

_POINTS_FAILED = 1


def _present(result: NfrResult, out: Output, asked: Mapping[str, Any]) -> int:
    from workbench.cli.notes import flush, note

    for text in result.warnings:
        note(text)
    flush()
    offset = bool(asked["offset"])
    _show(result, out)
    out.write(
        result.to_dict(),
        csv=result.to_csv,
        plot=lambda path: result.plot(path, offset=offset),
        report=result,
        page=lambda: _page(result, offset=offset),
    )
    return _POINTS_FAILED if result.failed else 0


_OFFSET = Annotated[bool, typer.Option("--offset", help="Draw the output's mean too.")]
nfr = command(Nfr, _present, extra={"offset": (_OFFSET, False)})


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
