"""OpenModelica FMUs out of the package gemseo-fmu: third-party files with known physics."""

from __future__ import annotations

import importlib.util
import platform
import sys
from pathlib import Path

import pytest

__all__ = ["gemseo_fmu", "gemseo_folder", "needs_gemseo"]

_RUNNABLE = sys.platform == "linux" and platform.machine() == "x86_64"
_spec = importlib.util.find_spec("gemseo_fmu")
needs_gemseo = pytest.mark.skipif(
    _spec is None or not _RUNNABLE, reason="the FMUs of the package gemseo-fmu hold binaries for Linux on x86_64 only"
)


def gemseo_fmu(name: str) -> Path:
    assert _spec is not None
    roots = _spec.submodule_search_locations or []
    return next(Path(root) / "problems/fmu_files/linux" / f"{name}.fmu" for root in roots)


def gemseo_folder() -> Path:
    return gemseo_fmu("").parent.parent
