"""`workbench excite`: identification experiments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.analysis.excite.request import Excite
from workbench.cli.derive import Extras, command
from workbench.errors import InputError

__all__ = ["excite"]


def _with_signal(asked: Excite, given: Mapping[str, Any], _: object) -> Excite:
    """Refuse a command line that names no signal: nobody knows which amplitude a model tolerates."""
    if given["prbs"] is given["multisine"] is None:
        raise InputError("a signal is needed: --prbs amplitude=1,rate=.. or --multisine band=LOW:HIGH,amplitude=1")
    return asked


excite = command(Excite, Extras(before=_with_signal))
