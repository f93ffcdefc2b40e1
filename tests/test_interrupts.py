"""Ctrl-C ends a function of the workbench also where Python drops the exception; the caller's handlers stay."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from types import FrameType

import pytest

import workbench as wb
from tests.misbehaving_fmus import build_misbehaving
from tests.platforms import posix_signals
from workbench.core.machine.interrupts import insisting

pytestmark = posix_signals


class _Key:
    """What a weak reference can point to."""


def _interrupt_that_is_dropped(*_: object) -> None:
    """Let Ctrl-C come while Python is in a callback of a weak reference, where it raises nothing."""
    key = _Key()
    reference = weakref.ref(key, lambda _: signal.raise_signal(signal.SIGINT))
    del key
    assert reference() is None


@pytest.fixture
def default_handler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C as in a program, and a hook by which whatever is dropped is seen."""
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    monkeypatch.setattr(sys, "unraisablehook", lambda what: pytest.fail(f"dropped: {what}"))


@pytest.mark.usefixtures("default_handler")
@pytest.mark.parametrize("in_process", [False, True])
def test_a_sweep_ends_by_an_interrupt_that_python_drops(in_process: bool) -> None:
    hook, dropped = sys.unraisablehook, list[int]()

    def progress(_what: object, done: int, _total: int) -> None:
        if not dropped:
            dropped.append(done)
            _interrupt_that_is_dropped()

    with wb.load("fmu:FirstOrderLag") as lag, pytest.raises(KeyboardInterrupt):
        wb.nfr(
            lag, "u", "y", [1.0 + i / 1000 for i in range(3000)], 1.0, progress=progress,
            workers=wb.Workers(jobs=1, in_process=in_process),
        )  # fmt: skip
    assert sys.unraisablehook is hook


@pytest.mark.usefixtures("default_handler")
def test_a_function_that_waits_for_a_worker_ends(tmp_path: Path) -> None:
    """The FMU hangs; the interrupt is dropped in the middle of the wait."""
    with wb.load(build_misbehaving(tmp_path, "hang", "newDiscreteStates"), "me") as model:
        timer = threading.Timer(1.0, lambda: signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGUSR1))
        before = signal.signal(signal.SIGUSR1, _interrupt_that_is_dropped)
        timer.start()
        try:
            with pytest.raises(KeyboardInterrupt):
                wb.simulate(model, stop=1.0, workers=wb.Workers(timeout=100.0))
        finally:
            timer.cancel()
            signal.signal(signal.SIGUSR1, before)


@pytest.mark.usefixtures("default_handler")
def test_an_interrupt_at_the_very_end_is_not_lost() -> None:
    with pytest.raises(KeyboardInterrupt), insisting():
        _interrupt_that_is_dropped()


def test_a_handler_of_the_users_own_is_left_alone() -> None:
    heard: list[int] = []

    def own(number: int, _: FrameType | None) -> None:
        heard.append(number)

    before = signal.signal(signal.SIGINT, own)
    try:
        with insisting():
            assert signal.getsignal(signal.SIGINT) is own
            _interrupt_that_is_dropped()
            time.sleep(0.2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]


_LATE = """
import os, signal
from workbench.cli import derive, main
show = derive._show
def late(*given):
    os.kill(os.getpid(), signal.SIGTERM)
    return show(*given)
derive._show = late
main(["lin", "fmu:FirstOrderLag", "--json", "out.json"])
"""
_EARLY = """
import runpy, sys
class Ctrl_C:
    def find_spec(self, name, *_):
        if name == "workbench.cli":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Ctrl_C())
runpy.run_module("workbench", run_name="__main__")
"""


def test_a_signal_between_the_work_and_its_files_loses_nothing(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", _LATE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 143
    assert json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["A"]
    assert "interrupted by SIGTERM: the result is written" in done.stderr


def test_ctrl_c_while_the_program_is_imported_is_no_traceback(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", _EARLY], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "")
