"""`workbench export`: a linear model as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import Json
from workbench.errors import BuildError

if TYPE_CHECKING:
    from workbench.build.export import ExportResult

__all__ = ["export"]


def export(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.json", help="Linear model: the JSON of workbench identify or lin.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="X.fmu", help="FMU to write.")],
    fmi: Annotated[Literal["2", "3"], typer.Option("--fmi", help="FMI version.")] = "2",
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="Model's name in the FMU; else made from the file's.")
    ] = None,
    json_path: Json = None,
) -> None:
    """Turn a linear model into an FMU for five platforms (model exchange and co-simulation).

    A discrete model is sampled at multiples of its period, a continuous one is integrated. Inputs start at the point
    where the model was found.

    Example: `workbench export identified.json --out identified.fmu --fmi 3`
    """
    from workbench.cli.output import Output

    report = Output("export", json_path=json_path)
    _require_compiler()
    from workbench.build.export import export as run

    result = run(model, out, fmi=int(fmi), name=name)
    for line in _lines(result):
        report.console.print(line, markup=False, soft_wrap=True)
    report.write({"interface": None, "solver": None, **result.to_dict()})


def _lines(result: ExportResult) -> list[str]:
    kind = f"discrete, sampled at {result.dt:.9g} s" if result.dt > 0.0 else "continuous"
    sizes = f"order {result.n_states}, inputs {result.n_inputs}, outputs {result.n_outputs}"
    return [
        f"{result.model}: {kind}, {sizes}",
        *(f"note: {note}" for note in result.notes),
        f"wrote {result.file} ({result.file.stat().st_size / 1024:.0f} KiB, FMI {result.fmi})",
        f"platforms: {', '.join(result.platforms)}",
    ]


def _require_compiler() -> None:
    from importlib.util import find_spec

    if find_spec("ziglang") is None:
        raise BuildError('writing FMUs needs ziglang: pip install "fmi-workbench[build]"')
