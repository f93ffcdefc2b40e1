"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.forms import File
from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.show.files_written import Written

if TYPE_CHECKING:
    from workbench.limit_cycles.feed_forward.request import FeedForward
    from workbench.limit_cycles.feed_forward.result import FeedForwardResult

__all__ = ["FeedForwardFiles"]


class FeedForwardFiles(Written):
    """What can be asked of a filter."""

    plotted = ("figure",)

    _: KW_ONLY
    figure: str = option(
        "Which picture --plot writes.",
        choices=("overview", "reduced", "compensation", "mirrored", "simulated", "error", "poles"),
        default="overview",
    )
    out: File | None = option("Write the filter: .json (matrices) or .fmu.", default=None)

    def check(self, request: FeedForward) -> None:
        if request.inputs is None and (request.crude or self.figure == "simulated"):
            raise InputError("--crude and --figure simulated need a simulation: give --input, which starts the motion")
        if self.out is not None:
            from workbench.build.export import check_linear_file  # noqa: PLC0415 - seldom needed

            check_linear_file(Path(self.out))

    def write(self, record: FeedForwardResult) -> Iterator[str | Path]:
        from workbench.build.export import write_linear  # noqa: PLC0415 - seldom needed

        if self.out is not None:
            write_linear(record.filter_dict(), Path(self.out))
            yield self.out
