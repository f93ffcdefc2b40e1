"""The kernel's master beside its readable twin in tests/oracle/master: the same rows, the same ends, the same words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drivers import driven_by
from tests.fmi1_fmus import build_fmi1
from tests.foreign_fmus import build_foreign
from tests.master_loops import fmu, lags
from tests.reference_fmus import build_reference
from tests.system_models import difference
from workbench.errors import SimulationError
from workbench.model.described_model import DescribedModel
from workbench.session.base import Recorded
from workbench.signals.kinds import Signal, Sine, Table
from workbench.system.connect import connect

Make = Callable[[Path], DescribedModel]

FORCED: Mapping[str, Signal] = {"r": Sine(frequency=0.3)}


def relays(*names: str, step: float | None = None, tolerance: float | None = None, order: str = "auto") -> Make:
    """Return a loop of lags behind relays, whose events lie between communication points."""

    def make(_: Path) -> DescribedModel:
        parts: dict[str, Any] = {n: fmu(n, f"fmu:Hysteresis{v}") for n, v in zip("hk", names, strict=False)}
        last = list(parts)[-1]
        chain = [(f"{a}.y", f"{b}.u") for a, b in zip(parts, list(parts)[1:], strict=False)]
        return connect(
            {**parts, "a": fmu("a", "fmu:FirstOrderLag@3"), "e": difference("e", 1.0, -1.0)},
            [("e.y", f"{next(iter(parts))}.u"), *chain, (f"{last}.y", "a.u"), ("a.y", "e.u2")],
            inputs={"r": "e.u1"},
            outputs={"y": "a.y"},
            step=step,
            tolerance=tolerance,
            order=order,
        )

    return make


def mixed(step: float) -> Make:
    """Return FMI 1.0, 2.0 and 3.0 in one loop with a block, one connection of which closes later."""

    def make(folder: Path) -> DescribedModel:
        return connect(
            {
                "a": fmu("a", str(build_fmi1(folder, "FirstOrderLag", "cs"))),
                "b": fmu("b", "fmu:FirstOrderLag"),
                "c": fmu("c", "fmu:FirstOrderLag@3", "me"),
                "e": difference("e", 1.0, -1.0),
            },
            [("e.y", "a.u"), ("a.y", "b.u"), ("b.y", "c.u"), ("c.y", "e.u2", {"gain": 3.0, "closes_at": 1.003})],
            inputs={"r": "e.u1"},
            outputs={"y": "c.y"},
            step=step,
        )

    return make


def stair(folder: Path) -> DescribedModel:
    """Return a lag behind an FMU that counts seconds and ends its run itself."""
    path = build_reference(folder, "stair", 3)
    return connect(
        {"s": fmu("s", str(path)), "a": fmu("a", "fmu:FirstOrderLag")},
        [("s.counter", "a.u")],
        outputs={"y": "a.y"},
        step=0.3,
    )


SYSTEMS: Mapping[str, Make] = {
    "fixed": lambda _: lags(step=0.05),
    "Jacobi, FMI 3.0": lambda _: lags(step=0.05, order="jacobi", version="@3"),
    "order 0": lambda _: lags(step=0.05, order="jacobi", extrapolation=0),
    "order 2": lambda _: lags("me", step=0.05, order="jacobi", extrapolation=2),
    "held": lambda _: lags(step=0.05, hold_inputs=True),
    "model exchange": lambda _: lags("me", step=0.05),
    "controlled": lambda _: lags(tolerance=1e-5),
    "controlled, model exchange": lambda _: lags("me", tolerance=1e-5, version="@3"),
    "one relay": relays("@3", step=0.07),
    "two relays": relays("@3", "@3", step=0.07),
    "relays of two versions": relays("@3", "", step=0.07, order="jacobi"),
    "controlled relays": relays("@3", "@3", tolerance=1e-5),
    "three versions": mixed(0.06),
}


def record(driver: str, make: Make, folder: Path, until: float, signals: Mapping[str, Signal]) -> Recorded:
    """Return all rows of a run in three pieces, the second of which is repeated from a snapshot."""
    names = ["y"]
    with driven_by(driver), make(folder) as model:
        names += ["a.u", "a.y"] if signals else []
        with model.open_session(signals=signals) as session:
            rows = [session.advance(0.3 * until, signals=signals, record=names)]
            saved = session.snapshot()
            session.advance(0.5 * until, signals=signals)
            session.restore(saved)
            points = np.linspace(0.3, 0.8, 8)[1:] * until
            rows.append(session.advance(0.8 * until, signals=signals, record=names, points=points))
            other = dict.fromkeys(signals, Table((0.0, until), (0.0, 1.0)))
            rows.append(session.advance(until, signals=other, record=names))
    return Recorded(
        time=np.concatenate([r.time for r in rows]),
        values={n: np.concatenate([r.values[n] for r in rows]) for n in names},
        inputs={n: np.concatenate([r.inputs[n] for r in rows]) for n in signals},
    )


@pytest.mark.parametrize("name", SYSTEMS)
def test_both_masters_record_the_same_rows(name: str, tmp_path: Path) -> None:
    signals = FORCED if "relay" not in name else {"r": Sine(frequency=0.3, amplitude=2.0)}
    until = 1.25 if "controlled" in name else 2.5  # [s]: each of its steps is taken several times
    python, compiled = (record(d, SYSTEMS[name], tmp_path, until, signals) for d in ("python", "compiled"))
    np.testing.assert_allclose(compiled.time, python.time, rtol=1e-12)
    for kind in ("values", "inputs"):
        for variable, column in getattr(python, kind).items():
            np.testing.assert_allclose(getattr(compiled, kind)[variable], column, rtol=1e-9, atol=1e-12)


def ended(driver: str, make: Make, folder: Path) -> tuple[str, float | None, Recorded]:
    with driven_by(driver), make(folder) as model, model.open_session() as session:
        with pytest.raises(SimulationError) as caught:
            session.advance(20.0, signals={}, record=["y"])
        rows = caught.value.before
        assert isinstance(rows, Recorded)
        return f"{type(caught.value).__name__}: {caught.value}", caught.value.time, rows


def foreign(folder: Path) -> DescribedModel:
    """Return a system with an FMU that discards a step and says that it has ended."""
    path = str(build_foreign(folder, "event"))
    return connect({"s": fmu("s", path)}, outputs={"y": "s.y[1,2]"}, step=0.03)


def burst(_: Path) -> DescribedModel:
    """Return a system in which a block passes on what is not a number."""
    return connect(
        {"a": fmu("a", "fmu:FirstOrderLag"), "f": lambda u: math.nan if u > 0.5 else 1.0},
        [("a.y", "f.u"), ("f.y", "a.u")],
        outputs={"y": "a.y"},
        step=0.05,
    )


@pytest.mark.parametrize("make", [stair, foreign, burst])
def test_both_masters_end_alike(make: Make, tmp_path: Path) -> None:
    python, compiled = (ended(d, make, tmp_path) for d in ("python", "compiled"))
    assert compiled[0] == python[0]
    assert compiled[1] == python[1]
    np.testing.assert_allclose(compiled[2].time, python[2].time, rtol=1e-12)
    np.testing.assert_allclose(compiled[2].values["y"], python[2].values["y"], rtol=1e-9)
    assert make is burst or "s ended its run" in compiled[0]
