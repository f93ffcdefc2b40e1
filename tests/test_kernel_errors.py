"""Errors of the compiled sessions: the same class and the same words as the oracle's."""

from __future__ import annotations

import ctypes
import math
import os
import signal as signals_of_the_system
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests import drivers
from tests.drivers import DRIVERS, GROUPS, MASTERS, driven_by
from tests.hybrid_fmus import DISCARD, ERROR, FakeC, Hybrid, open_fake
from tests.master_loops import lags
from tests.system_models import unity_feedback
from tests.test_session_events import Ball, Integrator, Lag, Slider, Stiff
from workbench.cli.app import run
from workbench.errors import WorkbenchError
from workbench.fmi.instance import DiscardError
from workbench.kernel import library
from workbench.kernel.structs import FUNCTIONS, STRUCTURES, name_in_c
from workbench.model.load import load
from workbench.session.compiled import CompiledSession
from workbench.session.compiled_errors import FAILURES, PAUSED
from workbench.signals.kinds import Constant, Signal, Sine

ROOT = Path(__file__).parent.parent


class ErrorC(FakeC):
    """Refuses derivatives for good from 0.5 s on."""

    def fmi2GetDerivatives(self, _c: object, dx: object, n: int) -> int:
        return ERROR if self.m.t > 0.5 else super().fmi2GetDerivatives(_c, dx, n)


class OutputDiscard(FakeC):
    """Discards outputs from 0.5 s on."""

    def fmi2GetReal(self, _c: object, vr: object, n: int, values: object) -> int:
        return DISCARD if self.m.t > 0.5 else self._get(_c, vr, n, values)


class Terminating(FakeC):
    """Ends the simulation after 0.5 s."""

    def fmi2CompletedIntegratorStep(self, _c: object, _n: int, event: object, terminate: object) -> int:
        terminate._obj.value = int(self.m.t > 0.5)  # type: ignore[attr-defined]
        return 0


class Restless(FakeC):
    """Its event iteration never settles."""

    def fmi2NewDiscreteStates(self, _c: object, info: object) -> int:
        status = super().fmi2NewDiscreteStates(_c, info)
        info._obj.newDiscreteStatesNeeded = int(self.m.t > 0.05)  # type: ignore[attr-defined]
        return status


class NotANumber(Integrator):
    def output(self) -> None:
        self.v["y"] = math.nan if self.t > 0.4 else 0.0


class RefusedStep(Integrator):
    def step(self, h: float) -> int:
        return DISCARD if self.t > 0.45 else super().step(h)


def complaint(driver: str, make: type[Hybrid], interface: str, c: type[FakeC], monkeypatch: pytest.MonkeyPatch) -> str:
    """What goes wrong in 2 s, as text with its class and its time."""
    monkeypatch.setattr(drivers, "fakes", driver)
    forced: dict[str, Signal] = {n: Sine(frequency=1.0) for n in make.inputs}
    solver = "vkm" if interface == "me" else "fmu"
    session = open_fake(make, solver, interface=interface, c=c, step=0.1)
    with session, pytest.raises(WorkbenchError) as caught:
        session.advance(2.0, signals=forced, record=["y"], points=np.arange(1, 21) / 10.0)
    return f"{type(caught.value).__name__}: {caught.value}"


CASES: list[tuple[type[Hybrid], str, type[FakeC], str]] = [
    (Lag, "me", ErrorC, "SimulationError: Lag: fmi2GetDerivatives returned error"),
    (Lag, "me", OutputDiscard, "DiscardError: Lag: fmi2GetReal returned discard"),
    (Lag, "me", Terminating, "EndedError: the FMU ended its run"),
    (Ball, "me", Restless, "SimulationError: Ball: event iteration does not settle after 1000 rounds"),
    (NotANumber, "me", FakeC, "SimulationError: y is nan, not a finite number (at t = 0.5 s)"),
    (NotANumber, "cs", FakeC, "SimulationError: y is nan, not a finite number (at t = 0.5 s)"),
    (RefusedStep, "cs", FakeC, "DiscardError: RefusedStep: fmi2DoStep returned discard (at t = 0.5 s)"),
    (Slider, "me", FakeC, "SimulationError: more and more events without time passing"),
]


@pytest.mark.parametrize(("make", "interface", "c", "words"), CASES)
def test_same_words(
    make: type[Hybrid], interface: str, c: type[FakeC], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = [complaint(d, make, interface, c, monkeypatch) for d in ("python", "compiled")]
    assert texts[1].startswith(words)
    # The time of an error is that of an evaluation; how far a solver looks ahead is its own affair.
    assert texts[0].partition(" (at")[0] == texts[1].partition(" (at")[0]


def test_restore_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drivers, "fakes", "compiled")
    with open_fake(RefusedStep, "fmu", interface="cs", step=0.1) as session:
        saved = session.snapshot()
        with pytest.raises(DiscardError):
            session.advance(2.0, signals={})
        session.restore(saved)
        assert session.advance(0.3, signals={}, record=["y"]).time[-1] == 0.3


def test_a_bound_stops_a_run_that_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drivers, "fakes", "compiled")
    with open_fake(Integrator, "vkm") as session:
        assert isinstance(session, CompiledSession)
        session.recording.bound = 0.75
        with pytest.raises(WorkbenchError, match=r"y is 0\.8, beyond the bound set for it \(at t = 0\.8 s\)"):
            session.advance(1.0, signals={"u": Constant(1.0)}, record=["y"], points=np.arange(1, 11) / 10.0)


class Faulty(Constant):
    def __call__(self, t: float) -> float:
        if t > 0.5:
            message = "no signal here"
            raise ZeroDivisionError(message)
        return 0.0


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_the_exception_of_a_users_own_signal_comes_through(interface: str) -> None:
    with load("fmu:FirstOrderLag", interface, step=0.01) as model:
        session = model.open_session()
        with session, pytest.raises(ZeroDivisionError, match="no signal here"):
            session.advance(1.0, signals={"u": Faulty(0.0)})


@pytest.mark.skipif(
    not hasattr(signals_of_the_system, "pthread_kill"),
    reason="the kernel pauses for signals of POSIX, which this system does not have",
)
@pytest.mark.parametrize(("interface", "step"), [("me", None), ("cs", 1e-6)])
def test_a_long_run_can_be_interrupted_from_the_keyboard(interface: str, step: float | None) -> None:
    with load("fmu:FirstOrderLag", interface, step=step) as model, model.open_session() as session:
        timer = threading.Timer(0.1, os.kill, (os.getpid(), signals_of_the_system.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            session.advance(1e3, signals={"u": Sine(frequency=1e3)}, points=np.linspace(1e-3, 1e3, 10**6))


def test_a_stiff_model_is_told_to_use_gear(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drivers, "fakes", "compiled")
    with open_fake(Stiff, "vkm") as session, pytest.raises(WorkbenchError, match=r"vkm: .*use solver gear"):
        session.advance(1.0, signals={})


def test_a_closed_session_says_so() -> None:
    with load("fmu:FirstOrderLag", "me") as model:
        session = model.open_session()
        session.close()
        session.close()
        with pytest.raises(WorkbenchError, match="closed"):
            session.advance(1.0, signals={})


# ---- the library ----


def test_codes_and_structures_agree() -> None:
    assert len(FAILURES) + 1 == PAUSED
    loaded = library.kernel()
    for structure in STRUCTURES:
        assert loaded.kernel_sizeof(name_in_c(structure).encode()) == ctypes.sizeof(structure)
    assert loaded.kernel_function_name(len(FUNCTIONS)) is None


@pytest.fixture
def unloaded() -> Iterator[None]:
    library._load.cache_clear()
    yield
    library._load.cache_clear()


@pytest.mark.usefixtures("unloaded")
class TestMissing:
    @pytest.mark.parametrize(
        "file", ["fmu:FirstOrderLag", ROOT / "systems" / "rudder_loop.toml"], ids=["fmu", "system"]
    )
    def test_loading_says_what_to_do(self, file: str | Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        library._load.cache_clear()
        with pytest.raises(library.KernelMissingError, match=r"not in this installation; .*pip install \.") as caught:
            wb.load(file)
        assert "\n" not in str(caught.value)

    def test_the_command_line_says_so_too(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        library._load.cache_clear()
        assert run(["simulate", "fmu:FirstOrderLag"]) == 2
        assert capsys.readouterr().err.startswith("workbench: the compiled kernel for ")

    def test_another_version_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "VERSION", library.VERSION + 1)
        library._load.cache_clear()
        assert "install the package again" in library.why_kernel_missing()
        with pytest.raises(library.KernelMissingError, match=r"this package needs \d+; install the package again"):
            wb.load("fmu:FirstOrderLag")

    def test_another_layout_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class Cs(ctypes.Structure):
            _fields_ = (("only", ctypes.c_int),)

        monkeypatch.setattr(library, "STRUCTURES", (Cs,))
        library._load.cache_clear()
        assert "structure Cs has another size" in library.why_kernel_missing()


@pytest.mark.parametrize("name", DRIVERS)
def test_the_driver_is_a_name_of_the_table(name: str) -> None:
    """What `driven_by` names advances FMUs, systems and the groups of a master."""
    kinds = DRIVERS[name]
    with driven_by(name):
        for interface, kind in kinds.items():
            with load("fmu:FirstOrderLag", interface) as model, model.open_session() as session:
                assert type(session) is kind
        with unity_feedback("fmu:FirstOrderLag", gain=4.0) as system, system.open_session() as session:
            assert type(session) is kinds["me"]
        with lags("me", step=0.05) as mixed, mixed.open_session() as session:
            assert type(session) is MASTERS[name][1]
            assert isinstance(session.instance, MASTERS[name][0])
            assert [type(group.session) for group in session.instance.groups.values()] == [GROUPS[name]]
