"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from dataclasses import KW_ONLY

from workbench.core.records.option import option
from workbench.show.files_written import Written

__all__ = ["NfrFiles"]


class NfrFiles(Written):
    """What can be asked of a frequency response."""

    drawn = ("offset",)

    _: KW_ONLY
    offset: bool = option("Also draw the mean of the output.", default=False)
