"""`workbench identify`: a linear model from recorded data."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.analysis.identify.request import Identify
from workbench.cli.derive import Extras, command
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.cli.output import Output

__all__ = ["identify"]

_BODE = Annotated[
    Path | None, typer.Option("--bode", metavar="PATH", help="Write the Bode picture of model, --lin and --nfr.")
]


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


identify = command(
    Identify, Extras(pictures={"bode": (_BODE, lambda record, path: record.overlay.plot(path))}, before=_looked_at)
)
