"""What is asked of the record of `info`: how much of it is shown."""

from __future__ import annotations

from dataclasses import KW_ONLY

from workbench.core.records.option import option
from workbench.show.files_written import Written

__all__ = ["InfoFiles"]


class InfoFiles(Written):
    """What can be asked of what an FMU or a system is."""

    drawn = ("full",)

    _: KW_ONLY
    full: bool = option("Show everything: also states, parameters, capabilities, terminals, units.", default=False)
