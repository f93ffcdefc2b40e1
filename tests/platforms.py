"""What a test needs that is not everywhere, each with the reason a reader of the log is told."""

from __future__ import annotations

import os
from importlib.util import find_spec

import pytest

__all__ = ["needs", "needs_module", "posix_shell", "posix_signals"]

posix_signals = pytest.mark.skipif(
    os.name == "nt",
    reason="Windows ends a process without SIGTERM, SIGKILL or SIGSEGV, which this test sends or finds in a message",
)

posix_shell = pytest.mark.skipif(os.name == "nt", reason="Windows has no bash with which this test runs lines of a CI")


def needs(module: str, extra: str) -> pytest.MarkDecorator:
    """Return the mark of a test that needs a module of an extra of the package."""
    return pytest.mark.skipif(find_spec(module) is None, reason=_missing(module, extra))


def needs_module(module: str, extra: str) -> None:
    """Skip the test where a module of an extra of the package is missing."""
    pytest.importorskip(module, reason=_missing(module, extra))


def _missing(module: str, extra: str) -> str:
    return f"{module} is not installed: pip install 'fmi-workbench[{extra}]'"
