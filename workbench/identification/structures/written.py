"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.forms import File
from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.show.files_written import Written

if TYPE_CHECKING:
    from workbench.identification.identify.request import Identify
    from workbench.identification.identify.result import IdentifyResult
    from workbench.identification.structures.result import StructureResult

__all__ = ["IdentifyFiles"]


class IdentifyFiles(Written):
    """What can be asked of an identified model."""

    _: KW_ONLY
    bode: File | None = option("Write a Bode plot of the model beside what --lin, --nfr or both hold.", default=None)

    def check(self, request: Identify) -> None:
        if self.bode is not None and request.lin is request.nfr is None:
            raise InputError("--bode: give what to compare the model with: --lin, --nfr or both")

    def write(self, record: IdentifyResult | StructureResult) -> Iterator[str | Path]:
        overlay = getattr(record, "overlay", None)
        if self.bode is not None and overlay is not None:
            overlay.plot(self.bode)
            yield self.bode
