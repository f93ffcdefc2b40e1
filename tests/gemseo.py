"""OpenModelica FMUs out of the package gemseo-fmu: third-party files with known physics."""

from __future__ import annotations

import importlib.util
import platform
import sys
from pathlib import Path

import pytest

__all__ = ["WITHOUT_GEMSEO", "gemseo_fmu", "gemseo_folder", "needs_gemseo"]

_RUNNABLE = sys.platform == "linux" and platform.machine() == "x86_64"
_spec = importlib.util.find_spec("gemseo_fmu")
WITHOUT_GEMSEO = (
    "needs OpenModelica's FMUs of the package gemseo-fmu, which scripts/dev.py installs, and Linux on x86_64, the only "
    "platform that they have binaries for"
)
needs_gemseo = pytest.mark.skipif(_spec is None or not _RUNNABLE, reason=WITHOUT_GEMSEO)


def gemseo_fmu(name: str) -> Path:
    assert _spec is not None
    roots = _spec.submodule_search_locations or []
    return next(Path(root) / "problems/fmu_files/linux" / f"{name}.fmu" for root in roots)


def gemseo_folder() -> Path:
    return gemseo_fmu("").parent.parent
