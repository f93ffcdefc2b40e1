"""What is asked of a record rather than of its analysis: files to write, and which pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from workbench.core.records.forms import File
from workbench.core.records.named import named
from workbench.core.records.option import Options, option

if TYPE_CHECKING:
    from workbench.requests.request import Request

__all__ = ["Written", "written_of"]


class Written(Options):
    """The files that a record is written to, besides its JSON.

    Attributes:
        drawn: options that pages and pictures are told.
        plotted: options that the picture alone is told.
    """

    drawn: ClassVar[tuple[str, ...]] = ()
    plotted: ClassVar[tuple[str, ...]] = ()

    _: KW_ONLY
    csv: File | None = option("Write the result as CSV.", default=None, first=True)
    mat: File | None = option("Write the result as variables of MATLAB, .mat.", default=None)
    plot: File | None = option("Write the picture: .png, .svg or .pdf.", default=None, first=True)
    report: File | None = option(
        "Write one page, .html: pictures, tables, data; and its facts, .stmd, for tracing.",
        default=None,
        first=True,
    )

    def told(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return options by name.

        Args:
            names: `drawn`, `plotted` or both.
        """
        return {name: getattr(self, name) for name in names}

    def check(self, request: Any) -> None:  # noqa: ANN401 - of the command's class
        """Refuse what cannot be drawn or written, before the analysis is run.

        Args:
            request: the request.

        Raises:
            InputError: what is missing.
        """

    def write(self, record: Any) -> Iterator[str | Path]:  # noqa: ANN401 - of the command's class
        """Write further files; yield each that is written.

        Args:
            record: what was found.

        Raises:
            InputError: a file cannot be written.
        """
        yield from ()


def written_of(request: type[Request[Any, Any]]) -> type[Written]:
    """Return what can be asked of a request's record.

    Args:
        request: its class.
    """
    return named(request.written) if request.written else Written
