"""When a model samples: what is declared, what events show, and what only the map over several periods tells."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.lin_fmus import built
from tests.multirate import connected, departure, random_system, verdict_fault
from workbench.core.values.calendar import TOGETHER, PeriodsError
from workbench.core.values.margins import STABLE, UNSTABLE
from workbench.data.excite.recording import sampling_of
from workbench.errors import InputError
from workbench.loops.loop.request import loop
from workbench.model.load import load
from workbench.model.sample_rates import NoRatesError, basic_period, rates_of, sampled, sequences
from workbench.point.lin.request import lin_result
from workbench.session.compiled import CompiledMeSession

HEAD = """
model {name}
  input Real u(start = 0);
  output Real y;
  Real p(start = 0, fixed = true, nominal = 1);
  discrete Real f(start = 0, fixed = true, nominal = 1);
  discrete Real s(start = 0, fixed = true, nominal = 1);
{more}
equation
{equations}
  y = p;
end {name};
"""

NESTED = """
  when sample(0, 0.1) then f = 0.5 * pre(f) + 0.5 * (u - 0.3 * p); end when;
  when sample(0, 0.2) then s = 0.6 * pre(s) + 0.7 * p; end when;
  der(p) = f - 0.3 * s - p;
"""
# A counter lets every third event pass.
COUNTED = """
  when sample(0, 0.1) then
    n = pre(n) + 1;
    f = u;
    s = if mod(n, 3) == 0 then 0.5 * pre(s) - 2 * p else pre(s);
  end when;
  der(p) = s - p + f;
"""
SINGLE = """
  when sample(0, 0.1) then f = 0.5 * pre(f) + 0.5 * (u - 0.3 * p); s = 0.6 * pre(s) + 0.7 * p; end when;
  der(p) = f - 0.3 * s - p;
"""
LATE = """
  when sample(0.1, 0.1) then f = 0.5 * pre(f) + u; s = 0; end when;
  der(p) = -p + f + s;
"""


def model_of(name: str, equations: str, more: str = "") -> str:
    """Return the FMU of one of them."""
    return built(HEAD.format(name=name, equations=equations, more=more), name)


def flow(length: float, row: Sequence[float]) -> np.ndarray[Any, Any]:
    """Return what time does to (p, f, s), dp/dt = −p + row · (f, s)."""
    e = math.exp(-length)
    return np.array([[e, row[0] * (1.0 - e), row[1] * (1.0 - e)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def test_nested_samplers_of_one_fmu() -> None:
    """Samplers at 0.1 and 0.2 s read the plant: the map over 0.2 s, by hand; over 0.1 s its poles would be real."""
    fast = np.array([[1.0, 0.0, 0.0], [-0.15, 0.5, 0.0], [0.0, 0.0, 1.0]])
    slow = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.7, 0.0, 0.6]])
    step = flow(0.1, (1.0, -0.3))
    with load(model_of("Nested", NESTED), "me") as model:
        rates = rates_of(model)
        found = lin_result(model)
    assert rates.periods == (0.1, 0.2)
    assert (rates.period, found.dt) == (0.2, 0.2)
    assert np.allclose(found.A, step @ fast @ step @ slow @ fast, atol=1e-7)
    assert abs(found.poles.imag).max() == pytest.approx(0.142, abs=1e-3)
    assert any("repeats every 0.2 s only" in note for note in found.notes)


def test_an_event_that_counts() -> None:
    """What is behind every third event only shows in what events do; the counter is no state that lin perturbs."""
    with load(model_of("Counted", COUNTED, "  discrete Integer n(start = 0, fixed = true);"), "me") as model:
        assert rates_of(model).periods == (0.1, 0.3)
        found = lin_result(model)
    third = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-2.0, 0.0, 0.5]])  # n is 1, 2, 3 at 0, 0.1, 0.2 s
    other = np.diag([1.0, 0.0, 1.0])
    step = flow(0.1, (1.0, 1.0))
    whole = step @ third @ step @ other @ step @ other
    assert found.state_names == ("p", "s")
    assert np.allclose(found.A, whole[np.ix_([0, 2], [0, 2])], atol=1e-7)


def test_a_sampler_that_does_not_tick_at_the_start() -> None:
    """sample(0.1, 0.1) does nothing at 0: the first period that is as all others begins at 0.1 s."""
    e = math.exp(-0.1)
    with load(model_of("Late", LATE), "me") as model:
        assert rates_of(model).start(0.0) == 0.1
        found = lin_result(model)
        rest = wb.trim(model, u0={"u": 1.0})
    assert found.operating_point is not None
    assert (found.dt, found.operating_point.time) == (0.1, 0.1)
    assert np.allclose(found.A, [[e, 0.5 * (1.0 - e)], [0.0, 0.5]], atol=1e-7)
    assert rest.converged
    assert rest.operating_point.x["p"] == pytest.approx(2.0, rel=1e-6)


def test_one_rate_costs_four_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """From rest, with states and discrete states moved, and twice with the sequence, one period apart."""
    path = model_of("Single", SINGLE)
    with load(path, "me") as model:
        opened: list[float] = []
        begin = CompiledMeSession._make_solver  # each session makes one

        def counted(session: CompiledMeSession) -> None:
            opened.append(session.time)
            begin(session)

        monkeypatch.setattr(CompiledMeSession, "_make_solver", counted)
        rates = rates_of(model)
    assert rates.periods == (0.1,)
    assert rates.notes == ()
    assert len(opened) <= 4 + 4  # and points, where events and values are read


def test_every_analysis_has_the_same_answer() -> None:
    path = model_of("Nested", NESTED)
    with load(path, "me") as model:
        assert sampled(model).period == 0.2
        assert sampling_of(model, None, None).dt == 0.2
        assert wb.trim(model).operating_point.period == 0.2
        response = wb.nfr(model, "u", "y", [0.5], [0.1], max_periods=4, method="settle")
        with pytest.raises(wb.WorkbenchError, match=r"samples every 0\.1, 0\.2 s"):
            wb.branches(model, "u", "y", amplitudes=[1.0], band=(0.1, 0.2))
    assert response.gain.size == 1
    with load(path, "cs") as model:
        assert sampled(model).period == 0.2


def test_periods_that_are_told_stand_above_found_ones() -> None:
    with load(model_of("Nested", NESTED), "me", periods=[0.1, 0.4]) as model:
        assert rates_of(model).periods == (0.1, 0.4)
        assert lin_result(model).dt == 0.4


def test_periods_that_contradict_the_model_are_refused(tmp_path: Path) -> None:
    """No map over 0.07 s repeats where something samples every 0.1 s; every common multiple is as good as the first."""
    lag = '[components]\nlag = {A = [[0.5]], B = [[1.0]], C = [[1.0]], dt = 0.1, inputs = ["u"], outputs = ["y"]}\n'
    (tmp_path / "lag.toml").write_text(f'{lag}[inputs]\nu = "lag.u"\n[outputs]\ny = "lag.y"\n', encoding="utf-8")
    with pytest.raises(PeriodsError, match=r"every 0\.1 s.* 0\.07 s"):
        wb.load(tmp_path / "lag.toml", periods=[0.07])
    with wb.load(tmp_path / "lag.toml", periods=[0.3]) as model:
        assert lin_result(model).A[0, 0] == pytest.approx(0.5**3)
    with load(model_of("Nested", NESTED), "me", periods=[0.07]) as model:
        asked = (
            lambda: lin_result(model),
            lambda: wb.trim(model),
            lambda: wb.nfr(model, "u", "y", [0.5], [0.1]),
            lambda: wb.branches(model, "u", "y", amplitudes=[1.0], band=(0.1, 0.2)),
        )
        for analysis in asked:
            with pytest.raises(PeriodsError, match=r"every 0\.1 s.* 0\.07 s"):
                analysis()


SWITCHED = """
  when time >= 0.25 then s = 1; end when;
  f = 0;
  der(p) = u + s - p;
"""


def test_a_single_event_is_no_rate() -> None:
    """A lag whose input steps once, in a unit feedback, is 1/(s + 2): once it had no verdict."""
    with wb.connect(
        {"p": model_of("Switched", SWITCHED), "e": wb.SumComponent(name="e", signs=(1.0, -1.0))},
        [("p.y", "e.u2"), ("e.y", "p.u")], inputs={"r": "e.u1"}, outputs={"y": "p.y"},
    ) as model:  # fmt: skip
        rates, found = sampled(model), loop(model, "e.y")
    assert (rates.periods, rates.complete) == ((), True)
    assert found.margins.verdict == STABLE
    assert any("no sample rate, at 0.25 s" in note for note in found.notes)


def test_single_events_beside_a_rate() -> None:
    """Tenths of a second and one or two events of none; of three nobody knows."""
    tenths = 0.1 * np.arange(100)
    for single in ([0.253], [0.253, 7.777]):
        assert sequences(np.sort([*tenths, *single])) == ([(0.0, 0.1)], single)
    with pytest.raises(NoRatesError):
        sequences(np.sort([*tenths, 0.253, 1.77, 7.777]))


def test_two_rates_with_a_common_period() -> None:
    """0.06 and 0.04 s: lin once said that the events have no constant rates, and u no effect."""
    with two_rates(0.06, 0.04) as model:
        found = lin_result(model, inputs=["u"], outputs=["y"])
    assert found.method == "kalman-bertram"
    assert found.dt == pytest.approx(0.12, rel=1e-12)
    assert not found.without_effect


def two_rates(slow: float, fast: float) -> wb.DescribedModel:
    """Return u → hold → lag → hold → y."""
    parts: dict[str, Any] = {
        "a": wb.BlockComponent(name="a", kind="zero_order_hold", parameters={"period": slow}),
        "b": wb.BlockComponent(name="b", kind="zero_order_hold", parameters={"period": fast}),
        "p": wb.BlockComponent(
            name="p", kind="transfer_function", parameters={"numerator": [1], "denominator": [1, 1]}
        ),
    }
    return wb.connect(parts, [("a.y", "p.u"), ("p.y", "b.u")], inputs={"u": "a.u"}, outputs={"y": "b.y"})


def sampler(name: str, A: float, B: float, C: float, D: float, dt: float) -> wb.LinearComponent:
    """Return x(k+1) = A x + B u, y = C x + D u."""
    a, b, c, d = (np.array([[v]]) for v in (A, B, C, D))
    return wb.LinearComponent(
        name=name, A=a, B=b, C=c, D=d, dt=dt, x0=np.zeros(1), input_names=("u",), output_names=("y",),
        state_names=("x1",),
    )  # fmt: skip


def nested_loop(slow: wb.LinearComponent, fast: wb.LinearComponent, lag: float, gain: float) -> wb.DescribedModel:
    """Return slow → gain → fast → 1/(lag·s + 1) → −slow."""
    plant = wb.BlockComponent(
        name="p", kind="transfer_function", parameters={"numerator": [1], "denominator": [lag, 1]}
    )
    minus = wb.SumComponent(name="e", signs=(1.0, -1.0))
    return wb.connect(
        {"e": minus, "slow": slow, "k": gain, "fast": fast, "p": plant},
        [("p.y", "e.u2"), ("e.y", "slow.u"), ("slow.y", "k.u"), ("k.y", "fast.u"), ("fast.y", "p.u")],
        inputs={"r": "e.u1"}, outputs={"y": "p.y"},
    )  # fmt: skip


def test_a_nested_loop_that_is_unstable() -> None:
    """A proportional law at 1 s, a filter of gain 1 at 0.1 s, a lag: once called stable with a margin of 12 dB."""
    e = math.exp(-0.1)
    rows = np.eye(3)  # plant, filter, what the law makes of its sample of the plant
    rows[2] = [-5.0, 0.0, 0.0]
    for _ in range(10):
        out = rows[2].copy()  # D = 1, C = 0
        rows[1] = 0.2 * rows[1] + 0.8 * rows[2]
        rows[0] = e * rows[0] + (1.0 - e) * out
    pole = np.linalg.eigvals(rows[:2, :2])
    with nested_loop(
        sampler("slow", 0.0, 5.0, 0.0, 5.0, 1.0), sampler("fast", 0.2, 0.8, 0.0, 1.0, 0.1), 1.0, 1.0
    ) as model:
        found = {at: loop(model, at).margins for at in ("p.y", "slow.y", "fast.y")}
    assert pole.real.min() == pytest.approx(-2.7927, abs=1e-4)
    for margins in found.values():
        assert margins.verdict == UNSTABLE
        assert "-2.793" in margins.words


def test_a_nested_loop_that_is_stable() -> None:
    """An integrating law at 0.4 s: once called unstable. A factor on its one signal is the same factor everywhere."""
    law, law_filter = sampler("slow", 1.0, 1.0, 1.0, 0.0, 0.4), sampler("fast", 0.5, 0.5, 1.0, 0.0, 0.05)
    with nested_loop(law, law_filter, 0.2, 0.8) as model:
        once, often = loop(model, "slow.y"), loop(model, "fast.y")
    assert [r.margins.verdict for r in (once, often)] == [STABLE, STABLE]
    assert often.margins.gain_margin == pytest.approx(once.margins.gain_margin, rel=1e-5)
    assert often.margins.phase_margin_deg == pytest.approx(once.margins.phase_margin_deg, rel=1e-4)
    assert math.isfinite(once.margins.delay_margin_s)
    assert math.isnan(often.margins.delay_margin_s)
    assert any("acts 8 times in a basic period of 0.4 s" in note for note in often.notes)


def test_a_continuous_place_of_a_sampled_loop_has_no_margins() -> None:
    """A lag with feedback −2 in continuous time and a sampler: stability is known, the inner loop's margins are not."""
    parts: dict[str, Any] = {
        "p": wb.BlockComponent(
            name="p", kind="transfer_function", parameters={"numerator": [1], "denominator": [1, 1]}
        ),
        "f": -2.0,
        "d": sampler("d", 0.5, 0.5, 1.0, 0.0, 0.1),
        "e": wb.SumComponent(name="e", signs=(1.0, 1.0)),
    }
    ends = [("p.y", "f.u"), ("f.y", "e.u1"), ("p.y", "d.u"), ("d.y", "e.u2"), ("e.y", "p.u")]
    with wb.connect(parts, ends, outputs=["p.y"]) as model:
        found = loop(model, "f.y")
    assert found.margins.verdict == STABLE
    assert math.isnan(found.margins.gain_margin)
    assert any("acts between the samples too" in note for note in found.notes)


# -- random systems against Kalman and Bertram's map by hand, and against what they do in the long run -----------------


@pytest.mark.parametrize("seed", range(10))
def test_the_linear_model_is_the_map_over_the_basic_period(seed: int) -> None:
    system = random_system(seed)
    with connected(system) as model:
        found = lin_result(model)
    assert found.dt == pytest.approx(float(system.basic_period), rel=1e-9)
    assert departure(system, found) < 1e-6
    seen, every = (np.sort(np.abs(p)[np.abs(p) > 1e-2]) for p in (found.poles, system.truth.multipliers))
    assert seen == pytest.approx(every, rel=1e-3)


@pytest.mark.parametrize("seed", [*range(20, 27), 236])  # 236: at factor 1, L held has almost the loop's poles
def test_verdict_and_gain_margin_are_those_of_the_loop(seed: int) -> None:
    system = random_system(seed)
    number = seed % len(system.nodes)
    with connected(system) as model:
        margins = loop(model, system.nodes[number].y).margins
    assert verdict_fault(system, number, margins) == ""


def test_the_basic_period_of_random_systems_is_exact() -> None:
    for seed in range(6):
        system = random_system(seed, fmus=False)
        with connected(system) as model:
            assert Fraction(rates_of(model).period).limit_denominator(10_000) == system.basic_period


def test_periods_that_are_nearly_multiples_are_refused() -> None:
    """0.0333333 s is not a third of 0.1 s: a period of either, or of a mean of them, would hold four of its ticks."""
    with pytest.raises(InputError, match=r"3\.000003 .*never repeat together; round them"):
        basic_period([0.1, 0.0333333], TOGETHER)
    assert basic_period([0.1, 1.0 / 30.0], TOGETHER) == pytest.approx(0.1, rel=1e-15)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_what_is_behind_the_rates_is_in_the_record_of_nfr(interface: str) -> None:
    with load(model_of("Switched", SWITCHED), interface) as model:
        found = wb.nfr(model, "u", "y", frequencies=[0.2], amplitudes=[1.0])
    assert any("no sample rate, at 0.25 s" in note for note in found.to_dict()["warnings"])


def test_what_is_behind_the_rates_is_in_the_record_of_branches() -> None:
    with load(model_of("Switched", SWITCHED), "me", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "y", amplitudes=[1.0], band=(0.2, 0.3))
    assert any("no sample rate, at 0.25 s" in note for note in found.to_dict()["warnings"])


RING = """model Ring
  input Real u(start = 0);
  output Real y;
  discrete Real h(start = 0, fixed = true);
equation
  when sample(0, 0.1) then h = u; end when;
  y = h + 0.1 * u;
end Ring;
"""


@pytest.mark.parametrize("able", [True, False])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_what_can_sample_only_once_in_a_circle_is_told(interface: str, able: bool, tmp_path: Path) -> None:
    file = Path(built(RING, "Ring", fmi=3))
    if not able:
        file = without_state(file, tmp_path)
    parts = {n: wb.FmuComponent(name=n, file=str(file), interface=interface) for n in ("a", "b")}
    wires = [("a.y", "b.u"), ("b.y", "a.u")]
    with wb.connect(parts, wires, outputs={"y": "a.y"}) as model:
        told = [note for note in model.notes if "cannot save its state: where it samples" in note]
    assert [note[:2] for note in told] == ([] if able else ["a:", "b:"])


def without_state(file: Path, folder: Path) -> Path:
    """Return a copy of an FMU that does not claim to save its state."""
    copy = folder / file.name
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(copy, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                data = data.replace(b'canGetAndSetFMUState="true"', b"").replace(b'canSerializeFMUState="true"', b"")
            target.writestr(name, data)
    return copy
