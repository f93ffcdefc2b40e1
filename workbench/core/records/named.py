"""Functions and classes by name, imported when they are used: what is only asked about needs no numerics."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["named"]


def named(name: str) -> Any:  # noqa: ANN401 - whatever stands there
    """Return what a module holds.

    Args:
        name: "module:name".
    """
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
