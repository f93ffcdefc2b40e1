"""`workbench build`: Modelica to FMU."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from workbench.cli.options import Json, Report
from workbench.errors import BuildError, InputError

if TYPE_CHECKING:
    from workbench.build.fmu import BuildResult
    from workbench.origin import Origin
    from workbench.report import Page

__all__ = ["build"]


def build(
    sources: Annotated[list[Path], typer.Argument(metavar="MODEL.mo..", help="Modelica files, or folders of them.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="X.fmu|FOLDER",
            help="FMU to write, or a folder: then every model is built into FOLDER/fmi2/ and FOLDER/fmi3/.",
        ),
    ],
    model: Annotated[
        str | None, typer.Option("--model", metavar="NAME", help="Model to build, if the sources contain several.")
    ] = None,
    fmi: Annotated[
        Literal["2", "3"] | None, typer.Option("--fmi", help="FMI version; 2 for one FMU, both for a folder.")
    ] = None,
    json_path: Json = None,
    report: Report = None,
) -> None:
    """Turn a Modelica model into an FMU for five platforms (model exchange and co-simulation).

    Example: `workbench build Rudder.mo --out Rudder.fmu --fmi 3`, or all models of a folder in one call:
    `workbench build models/ --out fmus/`
    """
    from workbench.cli.output import Output

    output = Output("build", json_path=json_path, report=report)
    folder = out.suffix != ".fmu"
    if folder and model is not None:
        raise InputError(f"--model: {out} is a folder, for all models; name the FMU to write, e.g. {out / model}.fmu")
    if not out.parent.is_dir():
        raise InputError(f"--out: the folder '{out.parent}' does not exist")
    _require_tools()
    from workbench.build import build_all, build_fmu

    if folder:
        results = build_all(sources, out=out, fmi=(2, 3) if fmi is None else (int(fmi),))
    else:
        results = [build_fmu(sources, model=model, out=out, fmi=int(fmi or 2))]
    files = [file for result in results for file in result.files]
    for file in files:
        output.console.print(f"wrote {file} ({file.stat().st_size / 1024:.0f} KiB)", markup=False, soft_wrap=True)
    output.console.print(f"platforms: {', '.join(results[0].platforms)}", markup=False, soft_wrap=True)
    output.write(
        {
            "model": ", ".join(result.model for result in results),
            "interface": None,
            "solver": None,
            "files": [str(f) for f in files],
            "platforms": list(results[0].platforms),
        },
        page=lambda: _page(results),
        origin=_origin(sources),
    )


def _page(results: list[BuildResult]) -> Page:
    from workbench.report.build import built_page

    return built_page(results)


def _origin(sources: list[Path]) -> Origin:
    """Return which files were read."""
    from workbench.origin import Origin
    from workbench.origin.call import files_of

    found = [file for path in sources for file in (sorted(path.rglob("*.mo")) if path.is_dir() else [path])]
    return Origin(files=files_of(found))


def _require_tools() -> None:
    from importlib.util import find_spec

    missing = [name for name in ("rumoca", "ziglang") if find_spec(name) is None]
    if missing:
        raise BuildError(f'building needs {" and ".join(missing)}: pip install "fmi-workbench[build]"')
