"""The files that a build has written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.show.files_written import Written

if TYPE_CHECKING:
    from workbench.build.compile_fmu import CompiledFmu
    from workbench.build.container import ContainerResult
    from workbench.build.export import ExportResult
    from workbench.build.fmu import BuiltModels
    from workbench.build.result import SystemFile

__all__ = ["BuildFiles", "ExportFiles"]


class BuildFiles(Written):
    """The FMUs that were built."""

    def write(self, record: BuiltModels) -> Iterator[str | Path]:
        """Yield the FMUs, which are there already."""
        yield from record.files


class ExportFiles(Written):
    """The one file that was written."""

    def write(self, record: CompiledFmu | ExportResult | ContainerResult | SystemFile) -> Iterator[str | Path]:
        """Yield the file, which is there already."""
        yield record.file
