"""Load a model from a file: a system where the file describes one, else one FMU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from workbench.core.records.option import with_options
from workbench.errors import InputError
from workbench.model.described_model import DescribedModel
from workbench.model.load import load_fmu
from workbench.model.loading import Loading
from workbench.system.files.read import is_system_file, read_system

__all__ = ["load", "open_file", "open_files"]


def open_file(path: str | Path, request: Loading) -> DescribedModel:
    """Load an FMU or a system; see `load`.

    Args:
        path: of either.
        request: how.
    """
    if not is_system_file(path):
        return load_fmu(path, request)
    from workbench.system.connect import open_description  # noqa: PLC0415  loading a single FMU stays quick

    if request.hold_inputs:
        raise InputError(f"{path}: hold_inputs is for one co-simulation FMU, not for a system")
    system = read_system(path)
    if request.step is not None and system.master.step_tolerance is not None:
        note = f"step_tolerance of the file is not used: the communication step is given, {request.step:g} s"
        system = replace(system, master=replace(system.master, step_tolerance=None), notes=(*system.notes, note))
    return open_description(system, request)


@contextmanager
def open_files(paths: Sequence[str | Path], request: Loading) -> Iterator[dict[str, DescribedModel]]:
    """Open FMUs and systems; name of the file, numbered where it occurs twice → model.

    Args:
        paths: of each.
        request: how, all of them.
    """
    names = [Path(str(path).removeprefix("fmu:").removeprefix("system:")).stem for path in paths]
    with ExitStack() as stack:
        yield {
            f"{name} ({k})" if names.count(name) > 1 else name: stack.enter_context(open_file(path, request))
            for k, (name, path) in enumerate(zip(names, paths, strict=True), 1)
        }


_FILE = (
    "An `.fmu` file, the folder of an unpacked FMU, `fmu:NAME` or `fmu:NAME@3`; or a system: a `.toml`, `.ssp` or "
    "`.ssd` file, the folder of an unpacked `.ssp`, or `system:NAME`."
)
load = with_options(
    Loading,
    open_file,
    name="load",
    first=("path", "str | Path", _FILE),
)
