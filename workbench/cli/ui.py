"""The command `ui`: the browser workbench."""

from __future__ import annotations

from pathlib import Path

import click

from workbench.cli.plain import PlainCommand
from workbench.errors import InputError
from workbench.jobs.store import FILE_NAME

__all__ = ["ui"]


@click.command(cls=PlainCommand)
@click.argument(
    "path",
    required=False,
    metavar="[PATH]",
    help="Folder to work in, or a model, system, study or store, which is opened; by default this folder. "
    "Bundled ones by name: fmu:Rudder.",
)
@click.option("--port", metavar="N", type=click.IntRange(0, 65535), default=0, help="Port; 0 takes a free one.")
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def ui(*, path: str | None, port: int, no_browser: bool) -> int:
    """Open the workbench in the browser: cards, operating points, live frequency responses, loops, studies.

    The address is the first line of standard output. The server answers on this machine only, to whoever has that
    address; it opens files from its folder and nothing else. Ctrl-C ends it, and what it runs.

    Example: `workbench ui fmu:Rudder`
    """
    from workbench.ui.serve import serve

    folder, opened = _split(path)
    serve(folder, port=port, browser=not no_browser, opened=opened)
    return 0


def _split(path: str | None) -> tuple[Path, str]:
    """Return the folder that is shown, and what is opened in it."""
    here = Path.cwd()
    if path is None or path.startswith(("fmu:", "system:", "study:")):
        return here, path or ""
    result = Path(path)
    if not result.exists():
        raise InputError(f"{path}: no such file or folder")
    result = result.resolve()
    model = result.is_file() or any((result / name).is_file() for name in ("modelDescription.xml", FILE_NAME))
    return (result.parent, result.name) if model else (result, "")
