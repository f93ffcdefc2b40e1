"""`workbench feedback`: a scalar feedback over its gain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import typer

from workbench.analysis.feedback.request import Feedback
from workbench.cli.derive import Extras, command
from workbench.cli.output import Output
from workbench.errors import InputError

__all__ = ["feedback"]

_KIND = Annotated[
    Literal["overview", "root-locus", "nyquist", "cycles", "settling", "run"],
    typer.Option("--plot-kind", help="Which picture --plot writes."),
]


def _checked(asked: Feedback, given: Mapping[str, Any], out: Output) -> Feedback:
    """Refuse a picture that there will not be."""
    kind = given["plot_kind"]
    if out.plot is None and kind != "overview":
        raise InputError("--plot-kind: there is no --plot that it could choose for")
    for wanted, option, there in (("settling", "--settle", asked.settle), ("run", "--gain", asked.gain is not None)):
        if kind == wanted and not there:
            raise InputError(f"--plot-kind: {wanted} needs {option}")
    return asked


feedback = command(Feedback, Extras(plotted={"plot_kind": (_KIND, "overview")}, before=_checked))
