"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workbench.errors import InputError
from workbench.show.files_written import Written

if TYPE_CHECKING:
    from workbench.data.excite.request import Excite

__all__ = ["ExciteFiles"]


class ExciteFiles(Written):
    """What can be asked of a record that is made."""

    def check(self, request: Excite) -> None:
        """Refuse to choose the signal: nobody knows which amplitude a model tolerates."""
        if request.prbs is request.multisine is None:
            raise InputError("a signal is needed: --prbs amplitude=1,rate=.. or --multisine band=LOW:HIGH,amplitude=1")
