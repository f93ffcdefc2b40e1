"""`workbench build`: Modelica to FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from workbench.cli.options import Json
from workbench.errors import BuildError, InputError

__all__ = ["build"]


def build(
    sources: Annotated[list[Path], typer.Argument(metavar="MODEL.mo..", help="Modelica files, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", metavar="X.fmu", help="FMU to write.")],
    model: Annotated[
        str | None, typer.Option("--model", metavar="NAME", help="Which model, where the sources hold several.")
    ] = None,
    fmi: Annotated[Literal["2", "3"], typer.Option("--fmi", help="FMI version.")] = "2",
    json_path: Json = None,
) -> None:
    """Turn a Modelica model into an FMU for five platforms (model exchange and co-simulation).

    Example: `workbench build Rudder.mo --out Rudder.fmu --fmi 3`
    """
    from workbench.cli.output import Output

    report = Output("build", json_path=json_path)
    if not out.parent.is_dir():
        raise InputError(f"--out: the folder '{out.parent}' does not exist")
    _require_tools()
    from workbench.build import build_fmu

    result = build_fmu(sources, model=model, out=out, fmi=int(fmi))
    for file in result.files:
        report.console.print(f"wrote {file} ({file.stat().st_size / 1024:.0f} KiB)", markup=False, soft_wrap=True)
    report.console.print(f"platforms: {', '.join(result.platforms)}", markup=False, soft_wrap=True)
    report.write(
        {
            "model": result.model,
            "interface": None,
            "solver": None,
            "files": [str(f) for f in result.files],
            "platforms": list(result.platforms),
        }
    )


def _require_tools() -> None:
    from importlib.util import find_spec

    missing = [name for name in ("rumoca", "ziglang") if find_spec(name) is None]
    if missing:
        raise BuildError(f'building needs {" and ".join(missing)}: pip install "fmi-workbench[build]"')
