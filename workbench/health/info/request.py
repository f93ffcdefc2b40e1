"""What an FMU or a system is and can do: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.option import option
from workbench.jobs.options import InWorker
from workbench.requests.request import MODEL_FILE, Request, function

if TYPE_CHECKING:
    from workbench.health.info.result import FmuInfo, SystemInfo  # noqa: F401 - the record's types, below

__all__ = ["Info", "info"]


class Info(InWorker, Request[str | Path, "FmuInfo | SystemInfo"]):
    """Show what an FMU is and can do: interfaces, platforms, variables; of a system: components and connections.

    What is declared is read from the FMU's description. Whether its binary can be loaded, and whether saving and
    restoring the state works, is tried.

    Returns:
        Facts as they stand in the page: `inputs`, `outputs`, `parameters`, `states`, `capabilities`.

    Raises:
        InputError: no such file, or a system whose parts do not fit.
        FmuError: the FMU cannot be read.

    Examples:
        >>> facts = wb.info("fmu:Rudder", probe=False)
        >>> print(facts.fmi_version, *(v.name for v in facts.inputs))
        2.0 delC pS mH bypass
    """

    command = "info"
    written = "workbench.health.info.written:InfoFiles"
    algorithm = "workbench.health.info.run:run"
    example = "workbench info fmu:Rudder"
    subject = MODEL_FILE
    unwritten = ("csv", "mat", "plot")

    _: KW_ONLY
    probe: bool = option(
        "Try in a worker process whether the FMU can be loaded and its saved state works.", default=True
    )


info = function(Info)
