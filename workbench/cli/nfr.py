"""`workbench nfr`: the nonlinear frequency response."""

from __future__ import annotations

from typing import Annotated

import typer

from workbench.analysis.nfr import Nfr
from workbench.cli.derive import Extras, command

__all__ = ["nfr"]

_OFFSET = Annotated[bool, typer.Option("--offset", help="Draw the output's mean too.")]
nfr = command(Nfr, Extras(drawn={"offset": (_OFFSET, False)}))
