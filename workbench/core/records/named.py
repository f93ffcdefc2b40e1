"""Functions and classes that stand above, by name: looked up when they are used, so that imports go down only."""

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
