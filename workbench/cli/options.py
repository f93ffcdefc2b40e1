"""Options that several commands share, and how their values are read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from workbench.workers import Workers

__all__ = [
    "Csv",
    "InProcess",
    "Jobs",
    "Json",
    "Plot",
    "Report",
    "Timeout",
    "workers",
]

Json = Annotated[
    str | None, typer.Option("--json", metavar="PATH", help="Write the result as JSON; - is standard output.")
]
Csv = Annotated[str | None, typer.Option("--csv", metavar="PATH", help="Write the result as CSV.")]
Plot = Annotated[Path | None, typer.Option("--plot", metavar="PATH", help="Write the picture: .png, .svg or .pdf.")]

Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="PATH", help="Write one self-contained page, .html: pictures, tables, data."),
]

Jobs = Annotated[
    int | None, typer.Option("--jobs", metavar="N", help="Number of worker processes; by default one per core.")
]
InProcess = Annotated[
    bool, typer.Option("--in-process", help="Run the FMU in this process, for debugging; a crash ends everything.")
]
Timeout = Annotated[
    float | None,
    typer.Option("--timeout", metavar="S", help="Time limit for one result [s]; 3600 by default, inf for no limit."),
]


def workers(
    *,
    jobs: int | None = None,
    in_process: bool = False,
    timeout: float | None = None,
    memory_limit: float | None = None,
    scheduler: str | None = None,
) -> Workers:
    """Return where and under which limits an FMU runs.

    Raises:
        InputError: a value out of range, options that contradict each other.
    """
    from workbench.workers import DEFAULT_TIMEOUT, Workers

    return Workers(
        jobs=jobs,
        in_process=in_process,
        timeout=DEFAULT_TIMEOUT if timeout is None else timeout,
        memory_limit=memory_limit,
        scheduler=scheduler,
    )
