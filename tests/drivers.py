"""Runs a module's tests once with each driver: import `each_driver` there."""

from __future__ import annotations

import importlib

import pytest

from tests import hybrid_fmus
from workbench.kernel.library import why_kernel_missing
from workbench.model.fmu_model import DRIVERS

__all__ = ["each_driver", "needs_kernel"]

needs_kernel = pytest.mark.skipif(
    bool(why_kernel_missing()),
    reason="the compiled kernel is not installed (pip install -e . compiles it); the Python driver runs",
)


@pytest.fixture(params=[pytest.param("compiled", marks=needs_kernel), "python"], autouse=True)
def each_driver(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The driver of all sessions that the test opens without naming one."""
    name: str = request.param
    assert name in DRIVERS
    monkeypatch.setattr(hybrid_fmus, "driver", name)
    # As a name, `workbench.model.load` is the function.
    module = importlib.import_module("workbench.model.load")
    monkeypatch.setattr(module, "choose_driver", lambda wanted: (name if wanted == "auto" else wanted, ""))
    return name
