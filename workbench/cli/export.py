"""`workbench export`: a linear model or a system as an FMU."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import Json, Report
from workbench.errors import BuildError, InputError

if TYPE_CHECKING:
    from workbench.build.export import ExportResult
    from workbench.cli.output import Output
    from workbench.system.container import ContainerResult

__all__ = ["export"]


def export(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL",
            help="Linear model: the JSON of workbench identify or lin. Or a system: .toml, .ssp, system:NAME.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="X.fmu", help="FMU to write.")],
    fmi: Annotated[Literal["2", "3"], typer.Option("--fmi", help="FMI version.")] = "2",
    name: Annotated[
        str | None,
        typer.Option(
            "--name", metavar="NAME", help="Name of the model in the FMU; by default made from the file name."
        ),
    ] = None,
    step: Annotated[
        float | None, typer.Option("--step", metavar="S", help="Systems: communication step between the parts [s].")
    ] = None,
    json_path: Json = None,
    report: Report = None,
) -> None:
    """Turn a linear model into an FMU for five platforms, or a system of FMUs into one container FMU.

    A linear model becomes model exchange and co-simulation: a discrete one is sampled at multiples of its period, a
    continuous one is integrated. Inputs start at the point where the model was found.

    A system becomes a container for co-simulation (FMPy's): it steps the FMUs inside by --step and passes values on in
    between, so that every connection carries a delay of one step, which the system itself does not have. Systems with
    blocks, gains, unit conversions or connections that close later cannot become a container; the message names the
    reason.

    Examples: `workbench export identified.json --out identified.fmu --fmi 3`,
    `workbench export loop.toml --out loop.fmu --step 0.001`
    """
    from workbench.cli.output import Output
    from workbench.system.read import is_system_file

    output = Output("export", json_path=json_path, report=report)
    if is_system_file(model):
        _export_system(model, out, int(fmi), name, step, output)
        return
    if step is not None:
        raise InputError("--step is for systems; a linear model has its own")
    _require_compiler()
    from workbench.build.export import export as run

    result = run(model, out, fmi=int(fmi), name=name)
    _tell(output, _lines(result))
    output.write({"interface": None, "solver": None, **result.to_dict()}, report=result)


def _export_system(model: Path, out: Path, fmi: int, name: str | None, step: float | None, output: Output) -> None:
    from workbench.system.container import export_container
    from workbench.system.read import read_system

    if step is None:
        raise InputError("--step is needed for a system: the communication step between its parts, in seconds")
    described = read_system(model)
    result = export_container(replace(described, name=name or described.name), out, step=step, fmi=fmi)
    _tell(output, _container_lines(result))
    output.write({"interface": "cs", "solver": None, **result.to_dict()}, report=result)


def _tell(output: Output, lines: list[str]) -> None:
    for line in lines:
        output.console.print(line, markup=False, soft_wrap=True)


def _container_lines(result: ContainerResult) -> list[str]:
    sizes = f"inputs {len(result.inputs)}, outputs {len(result.outputs)}, parameters {len(result.parameters)}"
    return [
        f"{result.model}: container of {', '.join(result.components)}; {sizes}",
        *(f"note: {note}" for note in result.notes),
        f"wrote {result.file} ({result.file.stat().st_size / 1024:.0f} KiB, FMI {result.fmi})",
    ]


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
