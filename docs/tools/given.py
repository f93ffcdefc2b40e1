"""Files that examples need and that no example makes: the FMU of another tool."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import sys
from pathlib import Path

__all__ = ["THIRD_PARTY", "provide", "third_party_fmu"]

THIRD_PARTY = "massdamper.fmu"
_INSIDE = "problems/fmu_files/linux/Mass_Damper.fmu"


def third_party_fmu() -> Path | None:
    """Return OpenModelica's FMU out of the package gemseo-fmu; None where it is missing or does not run."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return None
    found = importlib.util.find_spec("gemseo_fmu")
    if found is None:
        return None
    roots = [Path(root) for root in found.submodule_search_locations or []]
    return next((root / _INSIDE for root in roots if (root / _INSIDE).is_file()), None)


def provide(page: str, folder: Path) -> bool:
    """Copy what a page's examples need into their folder.

    Args:
        page: its Markdown.
        folder: where its examples run.

    Returns:
        Whether everything is there.
    """
    if THIRD_PARTY not in page:
        return True
    fmu = third_party_fmu()
    if fmu is not None:
        shutil.copy(fmu, folder / THIRD_PARTY)
    return fmu is not None
