"""The source report's figures, measured now from the bundled FMUs: `workbench reproduce`.

Targets and tolerances stand in `targets.toml`, once; what measures them in a file for each chapter, found through
`registry`. Nothing there knows a target's number.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from workbench.reproduce.request import reproduce
    from workbench.reproduce.result import Outcome, ReproduceResult
    from workbench.reproduce.targets import Target, read_targets

__all__ = ["Outcome", "ReproduceResult", "Target", "read_targets", "reproduce"]

_HOMES = {
    "Outcome": "result",
    "ReproduceResult": "result",
    "Target": "targets",
    "read_targets": "targets",
    "reproduce": "request",
}


def __getattr__(name: str) -> object:
    """Import a public name from its module: a test that reads a target need not load what measures them."""
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    value: object = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    return value
