"""Samplers that coincide are one event in the order of the data flow, against counting and exact event simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

import workbench as wb
from scripts.promises.multirate import Simulated
from tests.drivers import (
    DRIVERS,
    driver,  # noqa: F401  used by pytest
)
from tests.lin_fmus import built
from tests.multirate import random_system
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import exact
from workbench.point.lin.request import lin_result

both = pytest.mark.parametrize("driver", DRIVERS, indirect=True)

# When it ticks is added up: after three ticks 0.30000000000000004 s.
ADDING = """model AddingCounter
  output Real y;
  discrete Real due(start = {period}, fixed = true);
  discrete Real n(start = 0, fixed = true);
equation
  when time >= pre(due) then
    due = pre(due) + {period};
    n = pre(n) + 1;
  end when;
  y = n;
end AddingCounter;
"""


def counter(name: str, period: float) -> wb.LinearComponent:
    """Return y = number of ticks before this one."""
    one = np.ones((1, 1))
    return wb.LinearComponent(
        name=name, A=one, B=one, C=one, D=np.zeros((1, 1)), dt=period, x0=np.zeros(1), input_names=("u",),
        output_names=("y",), state_names=("x",),
    )  # fmt: skip


READERS: Mapping[str, Mapping[str, object]] = {
    "zero_order_hold": {},
    "discrete_transfer_function": {"numerator": [1.0, 0.0], "denominator": [1.0, 0.0]},
}


def reader(name: str, period: float, kind: str = "zero_order_hold") -> wb.BlockComponent:
    return wb.BlockComponent(name=name, kind=kind, parameters={**READERS[kind], "period": period})


def held(model: wb.DescribedModel, times: Floats, names: list[str], signals: Mapping[str, wb.Signal]) -> list[Floats]:
    """Return what is seen at `times`, one run from the first to the last."""
    with model, model.open_session(signals=signals) as session:
        found = session.advance(float(times[-1]), signals=signals, record=names, points=times)
    rows = [int(np.flatnonzero(found.time == t)[-1]) for t in times]
    return [found.values[name][rows] for name in names]


@both
@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("first", ["counter", "reader"])
def test_a_counter_is_read_when_it_has_counted(driver: str, kind: str, first: str) -> None:  # noqa: F811
    parts: list[tuple[str, object]] = [("b", counter("b", 0.1)), ("a", reader("a", 0.3, kind))]
    model = wb.connect(
        dict(parts if first == "counter" else parts[::-1]), [("b.y", "a.u")], inputs={"u": "b.u"}, outputs={"y": "a.y"}
    )
    times: Floats = 0.3 * np.arange(100.0) + 0.15
    assert held(model, times, ["y"], {"u": wb.Constant(1.0)})[0].tolist() == [3.0 * k for k in range(100)]


@pytest.mark.parametrize(
    ("slow", "fast"),
    [(0.3, 0.1), (0.12, 0.04), (0.06, 0.04), (0.06, 0.02), (0.03, 0.01), (0.015, 0.005), (1.0, 1 / 3), (0.1, 0.7)],
)
@pytest.mark.parametrize("start", [0.0, 0.3, -0.7])
def test_two_rates_meet_where_their_numbers_say(slow: float, fast: float, start: float) -> None:
    """Rates that are nested, that are not, and runs that begin elsewhere: at a tick, between two, before 0."""
    model = wb.connect(
        {"b": counter("b", fast), "a": reader("a", slow)}, [("b.y", "a.u")], inputs={"u": "b.u"},
        outputs={"y": "a.y"}, start=start,
    )  # fmt: skip
    slowly, quickly = exact(slow), exact(fast)
    first, begun = math.ceil(exact(start) / slowly), math.ceil(exact(start) / quickly)
    times: Floats = slow * (np.arange(first, first + 300.0) + 0.5)
    # number of the counter's last tick; before its first one it shows 0
    expected = [max(0.0, float(math.floor(k * slowly / quickly) - begun)) for k in range(first, first + 300)]
    assert held(model, times, ["y"], {"u": wb.Constant(1.0)})[0].tolist() == expected


@both
@pytest.mark.parametrize("cut", [0.57, 0.3, 0.7])
def test_runs_that_end_a_rounding_beside_a_tick_go_on_as_one(driver: str, cut: float) -> None:  # noqa: F811
    """100 · 0.57 is 56.99999999999999, 3 · 0.1 is 0.30000000000000004; some pieces begin from a snapshot."""
    model = wb.connect(
        {"b": counter("b", cut / 3), "a": reader("a", cut)}, [("b.y", "a.u")], inputs={"u": "b.u"}, outputs={"y": "a.y"}
    )
    signals = {"u": wb.Constant(1.0)}
    with model, model.open_session(signals=signals) as session:
        for k in range(1, 121):
            until = k * cut
            found = session.advance(until, signals=signals, record=["y"], points=np.array([until - 0.5 * cut, until]))
            seen = found.values["y"][np.searchsorted(found.time, until - 0.5 * cut)]
            assert seen == 3.0 * (k - 1)
            if k % 10 == 0:
                kept = session.snapshot()
                session.advance(until + 1.3 * cut, signals=signals)
                session.restore(kept)


@both
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_an_fmu_that_adds_up_its_period_ticks_with_the_calendar(driver: str, interface: str) -> None:  # noqa: F811
    file = built(ADDING.format(period=0.1), "AddingCounter", fmi=3)
    model = wb.connect(
        {"b": wb.FmuComponent(name="b", file=file, interface=interface), "a": reader("a", 0.3)},
        [("b.y", "a.u")], outputs={"y": "a.y", "n": "b.y"},
    )  # fmt: skip
    times: Floats = 0.3 * np.arange(200.0) + 0.15
    y, n = held(model, times, ["y", "n"], {})
    assert n.tolist() == [3.0 * k + 1.0 for k in range(200)]
    assert y.tolist() == [3.0 * k for k in range(200)]


@pytest.mark.parametrize("seed", range(1000, 1012))
def test_random_systems_of_blocks(seed: int) -> None:
    assert Simulated.of(random_system(seed, fmus=False)).error <= 1e-6


@pytest.mark.parametrize(("interface", "fmi"), [("me", 2), ("me", 3), ("cs", 3)])
@pytest.mark.parametrize("seed", [0, 3, 5, 7])
def test_random_systems_with_fmus(seed: int, interface: str, fmi: int) -> None:
    """The samplers of one FMU feed each other: at a common tick the second sees what the first has just computed."""
    assert Simulated.of(random_system(seed), interface=interface, fmi=fmi).error <= 1e-6


# Without event mode: what it samples at an instant it may show only after its next step.
PLAIN = """model Plain{kind}
  {input}
  output Real y;
  discrete Real n(start = 0, fixed = true);
equation
  when sample(0, 0.1) then
    n = pre(n) + {step};
  end when;
  y = n;
end Plain{kind};
"""


@both
@pytest.mark.parametrize("fed", [True, False])
def test_what_is_shown_too_late_is_told(driver: str, fed: bool) -> None:  # noqa: F811
    """An FMU of FMI 2.0 that is given an input shows its sample at once, others do after the step, and it is said."""
    words = {"kind": "Fed", "input": "input Real u;", "step": "u"} if fed else {"kind": "", "input": "", "step": "1"}
    b = wb.FmuComponent(name="b", file=built(PLAIN.format(**words), f"Plain{words['kind']}"), interface="cs")
    inputs = {"u": "b.u"} if fed else {}
    model = wb.connect({"b": b, "a": reader("a", 0.3)}, [("b.y", "a.u")], inputs=inputs, outputs={"y": "a.y"})
    signals = {"u": wb.Constant(1.0)} if fed else {}
    times: Floats = 0.3 * np.arange(20.0) + 0.15
    with model, model.open_session(signals=signals) as session:
        found = session.advance(float(times[-1]), signals=signals, record=["y"], points=times)
        told = [note for note in model.remarks() if "it sees the sample before" in note]
    seen = found.values["y"][np.searchsorted(found.time, times)]
    assert seen.tolist() == [1.0] + [3.0 * k + fed for k in range(1, 20)]
    late = (
        "b.y → a.u: b shows what it samples only after its step, and a samples at the same instant: it sees the sample "
    )
    remedy = "before; give b interface me, or export it with event mode (FMI 3.0)"
    # The oracle does not look for it.
    assert told == ([] if fed or driver == "python" else [late + remedy])


HOLD = """model Hold
  input Real u;
  output Real y;
  discrete Real h(start = 0, fixed = true);
equation
  when sample(0, 0.3) then
    h = u;
  end when;
  y = h;
end Hold;
"""


@both
@pytest.mark.parametrize(("interface", "fmi"), [("me", 2), ("cs", 3)])
def test_an_fmu_ticks_after_those_that_feed_it(driver: str, interface: str, fmi: int) -> None:  # noqa: F811
    """However they are listed: an FMU ticks once."""
    source = PLAIN.format(kind="Fed", input="input Real u;", step="u")
    files = {"a": built(HOLD, "Hold", fmi=fmi), "b": built(source, "PlainFed", fmi=fmi)}
    parts = {name: wb.FmuComponent(name=name, file=file, interface=interface) for name, file in files.items()}
    model = wb.connect(parts, [("b.y", "a.u")], inputs={"u": "b.u"}, outputs={"y": "a.y"})
    times: Floats = 0.3 * np.arange(30.0) + 0.15
    assert held(model, times, ["y"], {"u": wb.Constant(1.0)})[0].tolist() == [3.0 * k + 1.0 for k in range(30)]


@both
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("start", [0.05, 1.25])
def test_parts_and_fmus_sample_at_multiples_wherever_a_run_begins(driver: str, interface: str, start: float) -> None:  # noqa: F811
    """`sample(0, 0.1)` counts at multiples of 0.1 s, a part with dt = 0.3 reads at multiples of 0.3 s."""
    file = built(PLAIN.format(kind="Fed", input="input Real u;", step="u"), "PlainFed", fmi=3)
    b = wb.FmuComponent(name="b", file=file, interface=interface)
    model = wb.connect(
        {"b": b, "a": reader("a", 0.3)}, [("b.y", "a.u")], inputs={"u": "b.u"}, outputs={"y": "a.y"}, start=start
    )
    first, begun = math.ceil(exact(start) / exact(0.3)), math.ceil(exact(start) / exact(0.1))
    times: Floats = 0.3 * np.arange(first, first + 20.0) + 0.02  # before a reader that counts from the start reads
    expected = [3.0 * k - begun + 1.0 for k in range(first, first + 20)]
    assert held(model, times, ["y"], {"u": wb.Constant(1.0)})[0].tolist() == expected


def _lag_between(start: float) -> wb.DescribedModel:
    """Return dp/dt = −p − b / 2, b = a every 0.3 s (an FMU's sample(0, 0.3)), a = p every 0.2 s (a part)."""
    one = np.ones((1, 1))
    p = wb.LinearComponent(name="p", A=-one, B=-0.5 * one, C=one, D=0.0 * one, dt=0.0, x0=np.ones(1),
                           state_names=("x",), input_names=("u",), output_names=("y",))  # fmt: skip
    b = wb.FmuComponent(name="b", file=built(HOLD, "Hold"), interface="me")
    wires = [("p.y", "a.u"), ("a.y", "b.u"), ("b.y", "p.u")]
    return wb.connect({"p": p, "a": reader("a", 0.2), "b": b}, wires, outputs={"y": "p.y"}, start=start)


@pytest.mark.parametrize("start", [0.0, 0.05, 0.25])
def test_lin_has_the_phase_that_the_simulation_has(start: float) -> None:
    """From 0.6 k to 0.6 (k + 1) s, by hand: b reads what a read 0.1 s ago; a that ticked from the start would not."""

    def after(length: float, p: float, b: float) -> float:
        return b + (p - b) * math.exp(-length)

    seen = after(0.2, 1.0, -0.5)
    factor = after(0.3, after(0.3, 1.0, -0.5), -0.5 * seen)
    with _lag_between(start) as model:
        once, twice = held(model, np.array([0.6, 1.2]), ["y"], {})[0].tolist()
    assert twice / once == pytest.approx(factor, rel=1e-4)
    with _lag_between(start) as model:
        found = lin_result(model)
    assert np.linalg.eigvals(found.A) == pytest.approx(factor, rel=1e-6)
