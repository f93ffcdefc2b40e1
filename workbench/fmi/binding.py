"""The table that chooses the façade for an FMI version."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from workbench.errors import FmuError, InputError
from workbench.fmi.description import ModelDescription
from workbench.fmi.fmi1 import Instance1
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.fmi3 import Instance3
from workbench.fmi.instance import Instance
from workbench.fmi.library import Library

__all__ = ["INTERFACES", "VERSIONS", "instantiate"]

VERSIONS: Mapping[int, type[Instance]] = {1: Instance1, 2: Instance2, 3: Instance3}
INTERFACES: Mapping[str, str] = {"me": "model exchange", "cs": "co-simulation"}


def instantiate(
    description: ModelDescription,
    folder: Path,
    *,
    interface: str,
    source: str,
    library: Library | None = None,
    event_mode: bool = True,
    update: int | None = None,
) -> Instance:
    """Return a new instance of an unpacked FMU.

    Args:
        description: what the FMU says about itself.
        folder: where it is unpacked.
        interface: "me" or "cs".
        source: what the user named.
        library: its binary, if it is loaded already; the instance closes it.
        event_mode: co-simulation: use event mode where the FMU declares it.
        update: co-simulation: address of what answers an FMU that asks for inputs inside a step; None: nobody.

    Raises:
        InputError: it does not offer `interface`.
        FmuError: no binary for this platform, not loadable, or it refuses to be instantiated.
    """
    if description.major not in VERSIONS:
        raise FmuError(f"{source}: FMI {description.fmi_version} is not supported")
    if interface not in description.interfaces:
        offered = ", ".join(description.interfaces) or "neither me nor cs"
        raise InputError(f"{source}: interface {interface} is not offered; it has: {offered}")
    return VERSIONS[description.major](
        description,
        folder,
        interface=interface,
        source=source,
        library=library,
        event_mode=event_mode,
        update=update,
    )
