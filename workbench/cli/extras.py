"""What some commands have besides the options of their request."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from workbench.cli.derive import Extras
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.analysis.excite.request import Excite
    from workbench.analysis.feed_forward.request import FeedForward
    from workbench.analysis.feed_forward.result import FeedForwardResult
    from workbench.analysis.feedback.request import Feedback
    from workbench.analysis.identify.request import Identify
    from workbench.cli.output import Output

__all__ = ["EXTRAS"]

_OFFSET = Annotated[bool, typer.Option("--offset", help="Also draw the mean of the output.")]
_KIND = Annotated[
    Literal["overview", "root-locus", "nyquist", "cycles", "settling", "run"],
    typer.Option("--plot-kind", help="Picture that --plot writes."),
]
_FIGURE = Annotated[
    Literal["overview", "reduced", "compensation", "mirrored", "simulated", "error", "poles"],
    typer.Option("--figure", help="Which picture --plot writes."),
]
_OUT = Annotated[Path | None, typer.Option("--out", metavar="PATH", help="Write the filter: .json (matrices) or .fmu.")]
_BODE = Annotated[
    Path | None, typer.Option("--bode", metavar="PATH", help="Write a Bode plot of the model, --lin and --nfr.")
]


def _with_signal(asked: Excite, given: Mapping[str, Any], _: object) -> Excite:
    """Refuse a command line that names no signal: nobody knows which amplitude a model tolerates."""
    if given["prbs"] is given["multisine"] is None:
        raise InputError("a signal is needed: --prbs amplitude=1,rate=.. or --multisine band=LOW:HIGH,amplitude=1")
    return asked


def _with_picture(asked: Feedback, given: Mapping[str, Any], out: Output) -> Feedback:
    """Refuse a picture that there will not be."""
    kind = given["plot_kind"]
    if out.plot is None and kind != "overview":
        raise InputError("--plot-kind needs --plot")
    for wanted, option, there in (("settling", "--settle", asked.settle), ("run", "--gain", asked.gain is not None)):
        if kind == wanted and not there:
            raise InputError(f"--plot-kind: {wanted} needs {option}")
    return asked


def _tried(asked: FeedForward, given: Mapping[str, Any], _: object) -> FeedForward:
    """Refuse what cannot be drawn or written."""
    if asked.inputs is None and (asked.crude or given["figure"] == "simulated"):
        raise InputError("--crude and --figure simulated need a simulation: give --input, which starts the motion")
    if given["out"] is not None:
        from workbench.build.export import check_linear_file

        check_linear_file(given["out"])
    return asked


def _write_filter(record: FeedForwardResult, path: Path) -> None:
    from workbench.build.export import write_linear

    write_linear(record.filter_dict(), path)


def _looked_at(asked: Identify, given: Mapping[str, Any], out: Output) -> Identify:
    """Refuse a picture of nothing, and ask for the order where that is wanted."""
    if given["bode"] is not None and asked.lin is asked.nfr is None:
        raise InputError("--bode: give what to compare the model with: --lin, --nfr or both")
    return replace(asked, order=_ask(asked, given["data"], out)) if given["order"] == "ask" else asked


def _ask(asked: Identify, data: str, out: Output) -> int:
    """Show singular values and principal angles, and ask for the order."""
    from workbench.core.job import Job
    from workbench.report.identify import order_section
    from workbench.report.terminal import section_text

    if not sys.stdin.isatty():
        raise InputError("--order ask: there is no terminal to ask; give a number or auto")
    proposal = replace(asked, validation=None, bootstrap=0, lin=None, nfr=None, amplitude=None).run(data, Job())
    out.say(lambda width: section_text(order_section(proposal), width))
    answer = str(typer.prompt(f"order (0 … {asked.max_order})", default=str(proposal.order))).strip()
    if answer == "auto":
        return proposal.order
    if not answer.isdecimal():
        raise InputError(f"--order: '{answer}' is neither auto nor a number of states, 0 (a gain) or more")
    return int(answer)


EXTRAS: dict[str, Extras] = {
    "nfr": Extras(drawn={"offset": (_OFFSET, False)}),
    "excite": Extras(before=_with_signal),
    "feedback": Extras(plotted={"plot_kind": (_KIND, "overview")}, before=_with_picture),
    "feed-forward": Extras(
        plotted={"figure": (_FIGURE, "overview")}, files={"out": (_OUT, _write_filter)}, before=_tried
    ),
    "identify": Extras(files={"bode": (_BODE, lambda record, path: record.overlay.plot(path))}, before=_looked_at),
}
