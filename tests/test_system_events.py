"""Events in connected systems, on fakes that keep FMI's state machine: a call in the wrong mode is an error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from tests.drivers import each_driver  # noqa: F401  used by pytest
from tests.hybrid_fmus import FakeC, FakeInstance, Hybrid, describe
from tests.test_session_events import Ball, Integrator, Sampler
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.session.base import Recorded
from workbench.signals.kinds import Signal, Sine, Step
from workbench.system.components import OpenComponent, Opened
from workbench.system.connection_checks import resolve
from workbench.system.description import Connection, FmuComponent, SystemDescription
from workbench.system.model import SystemModel
from workbench.system.openable import OpenableSystem


class Plain(Integrator):
    """dx/dt = u, y = x."""

    integers = ()

    def derivatives(self) -> list[float]:
        return [self.v["u"]]


class Broken(Plain):
    """Refuses to give derivatives after 0.5 s."""

    def derivatives(self) -> list[float]:
        if self.t > 0.5:
            raise ArithmeticError
        return [1.0]


class FailingC(FakeC):
    def fmi2GetDerivatives(self, c: object, dx: object, n: int) -> int:
        try:
            return super().fmi2GetDerivatives(c, dx, n)
        except ArithmeticError:
            return 3


def part(name: str, make: type[Hybrid]) -> OpenComponent:
    description = describe(make(), state=True)
    names = [v.name for v in description.variables]
    return OpenComponent(
        component=FmuComponent(name=name, file=name),
        description=description,
        interface="me",
        starts={},
        notes=(),
        model=None,
        make=lambda: FakeInstance(description, FailingC(make(), names), "me"),
    )


def fakes(models: Mapping[str, type[Hybrid]], wires: Sequence[tuple[str, str]], inputs: Sequence[str]) -> SystemModel:
    parts = tuple(part(name, make) for name, make in models.items())
    description = SystemDescription(
        name="fakes",
        components=tuple(p.component for p in parts),
        connections=tuple(Connection(source=a, destination=b) for a, b in wires),
        inputs={name: (name,) for name in inputs},
    )
    resolved = resolve(description, [p.description.variables for p in parts])
    recipe = OpenableSystem(source="fakes", system=description, tolerance=1e-9)
    return SystemModel(Opened(description, parts, resolved), recipe)


def run(model: SystemModel, until: float, signals: Mapping[str, Signal], record: Sequence[str]) -> Recorded:
    points: Floats = until * np.arange(1.0, 58.0) / 57.0
    with model, model.open_session(signals=signals) as session:
        return session.advance(until, signals=signals, record=record, points=points)


def test_a_sampler_before_an_integrator() -> None:
    model = fakes({"s": Sampler, "i": Plain}, [("s.y", "i.u")], ["s.u"])
    record = run(model, 1.0, {"s.u": Sine(frequency=0.5)}, ["s.y", "i.u", "i.y"])
    samples = np.sin(np.pi * 0.1 * np.arange(10))
    t = record.time
    truth = [np.sum(samples * np.clip(x - 0.1 * np.arange(10), 0.0, 0.1)) for x in t]
    assert np.array_equal(record.values["s.y"], record.values["i.u"])
    assert record.values["i.y"] == pytest.approx(truth, abs=1e-8)
    assert np.count_nonzero(np.diff(t) == 0.0) == 9


def test_a_state_event_of_one_part_is_an_event_of_all() -> None:
    model = fakes({"b": Ball, "i": Plain}, [("b.y", "i.u")], [])
    record = run(model, 1.0, {}, ["b.h", "i.x", "b.y"])
    doubled = np.flatnonzero(np.diff(record.time) == 0.0)
    assert record.time[doubled[0]] == pytest.approx(np.sqrt(2.0 / 9.81), rel=1e-7)
    assert record.values["i.x"][doubled] == pytest.approx(record.values["i.x"][doubled + 1])


def test_a_step_at_the_input_reaches_the_last_integrator() -> None:
    model = fakes({"a": Plain, "b": Plain, "c": Plain}, [("b.y", "c.u"), ("a.y", "b.u")], ["a.u"])
    record = run(model, 1.0, {"a.u": Step(time=0.25, value=6.0)}, ["c.y"])
    since = np.maximum(record.time - 0.25, 0.0)
    assert record.values["c.y"] == pytest.approx(since**3, abs=1e-7)


def test_an_error_names_the_component() -> None:
    model = fakes({"good": Plain, "bad": Broken}, [("good.y", "bad.u")], [])
    with pytest.raises(SimulationError, match=r"bad: fmi2GetDerivatives returned error"):
        run(model, 1.0, {}, ["bad.y"])


def test_snapshots_of_fakes_are_replayed_or_restored_alike() -> None:
    model = fakes({"s": Sampler, "i": Plain}, [("s.y", "i.u")], ["s.u"])
    signals = {"s.u": Sine(frequency=0.5)}
    with model, model.open_session(signals=signals) as session:
        session.advance(0.35, signals=signals)
        saved = session.snapshot()
        first = session.advance(0.8, signals=signals, record=["i.y"]).values["i.y"]
        session.restore(saved)
        assert session.time == 0.35
        again = session.advance(0.8, signals=signals, record=["i.y"]).values["i.y"]
    assert again == pytest.approx(first, abs=1e-8)


def test_samplers_in_a_row_see_each_other_at_the_same_instant() -> None:
    """Outputs that change only when the event is handled: the later one is asked after the earlier one has answered."""
    model = fakes({"c": Sampler, "b": Sampler, "a": Sampler}, [("b.y", "c.u"), ("a.y", "b.u")], ["a.u"])
    record = run(model, 1.0, {"a.u": Sine(frequency=0.5)}, ["a.y", "b.y", "c.y"])
    values = record.values
    inside = np.append(np.diff(record.time) > 0.0, False)
    assert np.abs(values["a.y"]).max() > 0.9
    assert np.array_equal(values["b.y"][inside], values["a.y"][inside])
    assert np.array_equal(values["c.y"][inside], values["a.y"][inside])
