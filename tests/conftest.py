"""What holds for all tests."""

from __future__ import annotations

import gc
import math
import os
import signal
from collections.abc import Generator
from itertools import accumulate
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.browsers import browser
from tests.compiled import quick_compiler, real_compiler
from tests.drivers import driver
from tests.nursery import copied_workers, started_workers
from tests.ui_pages import page

__all__ = ["browser", "copied_workers", "driver", "page", "quick_compiler", "real_compiler", "started_workers"]

# A shell starts background jobs with SIGINT ignored, nohup with SIGHUP, and their children inherit that; tests that
# interrupt would then wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


# Written by `dev.py test`: how long each test took.
LAST_RUN = Path(__file__).resolve().parents[1] / "build-cache" / "tests.xml"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare --quick."""
    words = "only the quickest tests of the last whole run, and new ones, which take so long one after the other"
    parser.addoption("--quick", type=float, metavar="SECONDS", help=words)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse --quick where nothing is known."""
    if config.getoption("--quick") is not None and not LAST_RUN.exists():
        raise pytest.UsageError("--quick: no whole run is recorded yet; run scripts/dev.py test once")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the longest tests if --quick is given."""
    most = config.getoption("--quick")
    if most is None:
        return
    cases = ET.parse(LAST_RUN).iter("testcase")  # noqa: S314 - pytest has written it
    took = {(case.get("classname"), case.get("name")): float(case.get("time", 0.0)) for case in cases}
    files = {item: item.nodeid.removesuffix(f"::{item.name}").replace(".py", "", 1) for item in items}
    seconds = {i: took.get((file.replace("/", ".").replace("::", "."), i.name), 0.0) for i, file in files.items()}
    together = dict(zip(sorted(items, key=seconds.__getitem__), accumulate(sorted(seconds.values())), strict=True))
    config.hook.pytest_deselected(items=[item for item in items if together[item] > most])
    items[:] = [item for item in items if together[item] <= most]


@pytest.fixture(autouse=True)
def _not_on_github(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command says does not depend on where the tests run."""
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)


@pytest.fixture(autouse=True)
def _no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command says on standard error is the same on a slow machine."""
    monkeypatch.setattr("workbench.requests.progress_bar.FIRST_LINE", math.inf)


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


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup() -> Generator[None, object, object]:
    """Leave it so where a fixture is made, too: the test goes on with the worker processes that made it."""
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    """Begin every test in the same folder: one that goes elsewhere (a worker's task, called here) is told."""
    done = yield
    there, here = Path.cwd(), item.config.invocation_params.dir
    os.chdir(here)
    assert there == here
    return done
