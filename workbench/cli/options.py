"""Options that several commands share, and how their values are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.core.forms import setting
from workbench.core.loading import Loading
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.model.described import DescribedModel
    from workbench.workers import Workers

__all__ = [
    "Csv",
    "InProcess",
    "Interface",
    "Jobs",
    "Json",
    "MemoryLimit",
    "Plot",
    "Report",
    "Set",
    "Solver",
    "Start",
    "Timeout",
    "Tolerance",
    "numbers",
    "open_model",
    "open_named",
    "pairs",
    "workers",
]

Interface = Annotated[
    Literal["auto", "me", "cs"],
    typer.Option("--interface", help="Interface of the FMU; auto prefers me (model exchange)."),
]
Solver = Annotated[
    Literal["auto", "vkm", "gear"],
    typer.Option("--solver", help="Integrator for model exchange: vkm (Kutta-Merson) or gear (stiff)."),
]
Tolerance = Annotated[float | None, typer.Option("--tolerance", help="Relative tolerance of the integrator.")]
Start = Annotated[
    float | None,
    typer.Option("--start", metavar="T", help="Time at which runs begin [s]; by default the FMU's own, or 0."),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Value of a parameter, or start value; repeatable."),
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
MemoryLimit = Annotated[
    float | None, typer.Option("--memory-limit", metavar="MB", help="Memory that an FMU may allocate (Linux).")
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


def open_model(name: str, asked: Loading) -> DescribedModel:
    """Load the model that a command names; its notes go to standard error.

    Raises:
        InputError: nothing there, unknown variable, a value that is none.
        FmuError: no FMU, no binary for this platform.
    """
    from workbench.cli.notes import note
    from workbench.system.load import open_file

    model = open_file(name, asked)
    for text in model.notes:
        note(text)
    return model


def open_named(
    name: str,
    *,
    interface: str,
    solver: str,
    step: float | None,
    tolerance: float | None,
    start: float | None,
    set_: Sequence[str] | None,
    bias: Sequence[str] | None,
) -> DescribedModel:
    """Load the model that a command names, as its options say; see `open_model`."""
    asked = Loading(
        interface=interface,
        solver=solver,
        step=step,
        tolerance=tolerance,
        start=start,
        start_values={n: setting(v) for n, v in pairs("--set", set_).items()},
        bias={n: _number("--bias", n, v) for n, v in pairs("--bias", bias).items()},
    )
    return open_model(name, asked)


def pairs(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """Split repeated NAME=VALUE.

    Raises:
        InputError: no equals sign, no name, a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"{option}: '{text}' is not of the form NAME=VALUE")
        if name in found:
            raise InputError(f"{option}: '{name}' is given twice")
        found[name] = value
    return found


def numbers(option: str, text: str, *, separator: str = ",") -> tuple[float, ...]:
    """Split "1,2.5,10" into numbers.

    Raises:
        InputError: an item that is not a number.
    """
    return tuple(_number(option, None, item) for item in text.split(separator))


def _number(option: str, name: str | None, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        where = f"{option}: {name}" if name else option
        raise InputError(f"{where}: '{text.strip()}' is not a number") from None
