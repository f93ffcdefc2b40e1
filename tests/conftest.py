"""What holds for all tests."""

from __future__ import annotations

import gc
import math
import os
import signal
from collections.abc import Generator

import pytest

from tests.browsers import browser
from tests.compiled import quick_compiler, real_compiler
from tests.drivers import driver

__all__ = ["browser", "driver", "quick_compiler", "real_compiler"]

# A shell starts background jobs with SIGINT ignored, nohup with SIGHUP, and their children inherit that; tests that
# interrupt would then wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(autouse=True)
def _no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command says on standard error is the same on a slow machine."""
    monkeypatch.setattr("workbench.core.progress.FIRST_LINE", math.inf)


def pytest_collection_finish() -> None:
    """What is there before the first test is looked through for garbage no more: that takes 4 % of all."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _the_program_is_not_ended_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """`workbench.cli.main` takes over the signals of its process, and may end it: tests run `workbench.cli.app.run`."""

    def refused() -> None:
        pytest.fail("workbench.cli.main was called in the process of the tests; they call workbench.cli.app.run")

    monkeypatch.setattr("workbench.cli.interrupt.listen_for_endings", refused)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call() -> Generator[None, object, object]:
    """Leave the environment as it is from test to test: where it changes, all worker processes are started anew."""
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    return (yield)
