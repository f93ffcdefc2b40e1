"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.show.files_written import Written

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.request import Feedback

__all__ = ["FeedbackFiles"]


class FeedbackFiles(Written):
    """What can be asked of a feedback."""

    plotted = ("plot_kind",)

    _: KW_ONLY
    plot_kind: str = option(
        "Picture that --plot writes.",
        choices=("overview", "root-locus", "nyquist", "cycles", "settling", "run"),
        default="overview",
    )

    def check(self, request: Feedback) -> None:
        if self.plot is None and self.plot_kind != "overview":
            raise InputError("--plot-kind needs --plot")
        there = {"settling": ("--settle", request.settle), "run": ("--gain", request.gain is not None)}
        needed, given = there.get(self.plot_kind, ("", True))
        if not given:
            raise InputError(f"--plot-kind: {self.plot_kind} needs {needed}")
