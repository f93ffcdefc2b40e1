"""The compiled sessions against the oracle: the same rows on random signals, points, resumes and snapshots."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.drivers import driven_by
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.kernel_signals import signals
from workbench.build.fmu import build_all
from workbench.fmi.platforms import host
from workbench.model.load import load
from workbench.session.base import Recorded
from workbench.session.fmu import FmuSession
from workbench.signals.kinds import Signal

# Their vkm is the same to rounding. Their gear is not (CVODE looks for events in Python, the kernel
# itself in C), and what it computes, event times included, is right to its tolerance only.
TOLERANCE = {"gear": 1e-9}
USUAL = 1e-7
EVENTS = {"gear": 1e-7}  # [s] by how much the times of an event may differ; else 1e-9
SPAN = 1.0
# A few here, always the same; `scripts/evidence.py sessions` tries as many others as it is asked for.
CASES = int(os.environ.get("WORKBENCH_SESSIONS", "0"))
RANDOM = settings(
    max_examples=CASES or 3,
    deadline=None,
    derandomize=not CASES,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@dataclass(frozen=True)
class Act:
    """One thing to do with a session: advance, or go back to the snapshot taken before it."""

    until: float
    signals: Mapping[str, Signal]
    points: tuple[float, ...]
    snapshot: bool
    restore: bool


@st.composite
def plays(draw: st.DrawFn, inputs: Sequence[str], span: float) -> list[Act]:
    """Return what happens to a session: two or three advances, some with snapshots around them."""
    ends = sorted(draw(st.lists(st.integers(1, 40), min_size=2, max_size=3, unique=True)))
    acts, forced = [], {n: draw(signals(span)) for n in inputs}
    for end in ends:
        if draw(st.booleans()):
            forced = {n: draw(signals(span)) for n in inputs}
        fractions = draw(st.lists(st.integers(1, 19), max_size=4, unique=True))
        acts.append(
            Act(end * span / 40, dict(forced), tuple(k / 20 for k in sorted(fractions)), draw(st.booleans()),
                draw(st.booleans()))
        )  # fmt: skip
    return acts


def perform(session: FmuSession, acts: Sequence[Act], names: Sequence[str]) -> list[Recorded]:
    records = []
    for act in acts:
        start = session.time
        points = np.array([start + f * (act.until - start) for f in act.points])
        saved = session.snapshot() if act.snapshot else None
        records.append(session.advance(act.until, signals=act.signals, record=names, points=points))
        if saved is not None and act.restore:
            session.restore(saved)
            records.append(session.advance(act.until, signals=act.signals, record=names, points=points))
    return records


@contextmanager
def both(file: str | Path, interface: str, solver: str, step: float | None) -> Iterator[list[FmuSession]]:
    """Yield a session of the oracle and a compiled one."""
    with ExitStack() as stack:
        sessions = []
        tolerance = TOLERANCE.get(solver, USUAL)
        for driver in ("python", "compiled"):
            model = stack.enter_context(load(file, interface, solver, step=step, tolerance=tolerance))
            with driven_by(driver):
                sessions.append(stack.enter_context(model.open_session()))
        yield sessions


def assert_alike(a: Recorded, b: Recorded, *, solver: str, exact: bool) -> None:
    assert a.time.shape == b.time.shape
    if exact:
        assert np.array_equal(a.time, b.time)
    np.testing.assert_allclose(a.time, b.time, rtol=0.0, atol=EVENTS.get(solver, 1e-9))
    for mine, other in ((a.values, b.values), (a.inputs, b.inputs)):
        assert list(mine) == list(other)
        for name, column in mine.items():
            if exact:
                assert np.array_equal(column, other[name]), name
            size = max(1.0, float(np.max(np.abs(column))))
            np.testing.assert_allclose(column, other[name], rtol=0.0, atol=50.0 * USUAL * size)


BUNDLED = {"FirstOrderLag": ("u", "y", 0.01), "Rudder": ("delC", "del", 2e-4), "TwoRateQuantizer": ("u", "y", 0.01)}


@pytest.mark.parametrize("version", ["", "@3"])
@pytest.mark.parametrize(("interface", "solver"), [("me", "vkm"), ("me", "gear"), ("cs", "auto")])
@pytest.mark.parametrize("name", BUNDLED)
@RANDOM
@given(data=st.data())
def test_bundled_fmus(name: str, interface: str, solver: str, version: str, data: st.DataObject) -> None:
    u, y, step = BUNDLED[name]
    span = 0.1 if name == "Rudder" else SPAN
    acts = data.draw(plays([u], span))
    chosen = "auto" if name == "TwoRateQuantizer" else solver
    with both(f"fmu:{name}{version}", interface, chosen, step if interface == "cs" else None) as sessions:
        python, compiled = (perform(s, acts, [y, u]) for s in sessions)
    for a, b in zip(python, compiled, strict=True):
        assert_alike(a, b, solver=solver, exact=interface == "cs")


GEMSEO = {"Mass_Damper": (["f"], ["y"]), "add": (["u1", "u2"], ["y"]), "MassSpringSystem": ([], [])}


@needs_gemseo
@pytest.mark.parametrize(("interface", "solver"), [("me", "vkm"), ("me", "gear"), ("cs", "auto")])
@pytest.mark.parametrize("name", GEMSEO)
@RANDOM
@given(data=st.data())
def test_third_party_fmus(name: str, interface: str, solver: str, data: st.DataObject) -> None:
    inputs, outputs = GEMSEO[name]
    acts = data.draw(plays(inputs, SPAN))
    chosen = "auto" if name == "add" else solver
    with both(gemseo_fmu(name), interface, chosen, 0.01 if interface == "cs" else None) as sessions:
        names = [*outputs, *(v.name for v in sessions[0].instance.description.states)]
        python, compiled = (perform(s, acts, names) for s in sessions)
    for a, b in zip(python, compiled, strict=True):
        assert_alike(a, b, solver=solver, exact=interface == "cs")


@pytest.fixture(scope="module")
def hybrid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The hybrid test model, built for this machine as FMI 2 and FMI 3."""
    folder = tmp_path_factory.mktemp("fmus")
    build_all([Path(__file__).parent / "modelica" / "Hybrid.mo"], out=folder, platforms=[host()])
    return folder


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("interface", "solver"), [("me", "vkm"), ("me", "gear"), ("cs", "auto")])
@RANDOM
@given(data=st.data())
def test_a_hybrid_fmu(hybrid: Path, interface: str, solver: str, version: int, data: st.DataObject) -> None:
    file = hybrid / f"fmi{version}" / "Hybrid.fmu"
    with both(file, interface, solver, 0.01 if interface == "cs" else None) as sessions:
        description = sessions[0].instance.description
        inputs = [v.name for v in description.variables if v.causality == "input"]
        names = [v.name for v in description.variables if v.causality == "output" and v.is_number]
        acts = data.draw(plays(inputs, SPAN))
        python, compiled = (perform(s, acts, names) for s in sessions)
    for a, b in zip(python, compiled, strict=True):
        assert_alike(a, b, solver=solver, exact=interface == "cs")
