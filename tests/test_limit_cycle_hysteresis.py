"""Cycles of a relay with a hysteresis that rests nowhere: mean and frequency by the map of its switchings."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve

from tests.platforms import needs_module
from workbench import connect, limit_cycle
from workbench.build.fmu import build_fmu
from workbench.build.toolchain import host_only
from workbench.jobs.options import Workers
from workbench.limit_cycles.limit_cycle.cut import cut, driven_block
from workbench.limit_cycles.limit_cycle.driven import DrivenBlock
from workbench.limit_cycles.limit_cycle.entries import contradictions
from workbench.limit_cycles.limit_cycle.harmonic_balance import balance
from workbench.limit_cycles.limit_cycle.result import LimitCycle
from workbench.model.described_model import DescribedModel

RELAY = """
model TwoLevels
  input Real u(start = 0);
  output Real y;
  parameter Real h = 0.1;
  parameter Real high = 1;
  parameter Real low = -1;
  Boolean on(start = true, fixed = true);
equation
  on = if pre(on) then u > -h else u > h;
  y = if on then high else low;
end TwoLevels;
"""
HALF_WIDTH = 0.1
# numerator, denominator, a frequency [Hz] and an amplitude near the symmetric cycle
PLANTS = {
    "light damping": ([1.0], [1.0, 0.05, 1.0], 0.22, 1.35),
    "stiffer": ([1.0], [1.0, 0.05, 2.0], 0.28, 1.2),
    "well damped": ([1.0], [1.0, 1.0, 1.0], 0.39, 0.23),
    "third order": ([5.0], [1.0, 1.2, 1.2, 1.0], 0.17, 5.4),
    "three lags": ([4.0], [1.0, 3.0, 3.0, 1.0], 0.23, 0.7),
    "with a zero": ([-0.5, 2.0], [1.0, 1.0, 2.0], 0.27, 1.9),
}
LEVELS = [(1.0, -1.0), (2.0, -1.0)]


@pytest.fixture(scope="module")
def relay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    needs_module("rumoca", "build")
    folder = tmp_path_factory.mktemp("relay")
    (folder / "TwoLevels.mo").write_text(RELAY)
    build_fmu([folder / "TwoLevels.mo"], out=folder / "TwoLevels.fmu", platforms=[p.name for p in host_only()])
    return folder / "TwoLevels.fmu"


@pytest.fixture(params=PLANTS)
def plant(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def around(relay: Path, plant: str, levels: tuple[float, float]) -> DescribedModel:
    numerator, denominator, _, _ = PLANTS[plant]
    return connect(
        {"relay": str(relay), "plant": control.tf(numerator, denominator)},
        [("plant.y", "relay.u"), ("relay.y", "plant.u", {"gain": -1.0})],
        outputs={"y": "plant.y"},
        start_values={"relay.high": levels[0], "relay.low": levels[1]},
    )


def exact(plant: str, levels: tuple[float, float]) -> tuple[float, float]:
    """Return frequency [Hz] and mean of the plant's output by the map from switching to switching [Tsypkin].

    x runs for T₁ under −high and for T₂ under −low; C x is h where it switches up and −h where it switches down. The
    mean is that of a linear plant: G(0) times the mean of its input.
    """
    numerator, denominator, frequency, _ = PLANTS[plant]
    system = control.ss(control.tf(numerator, denominator))
    n = system.nstates

    def flow(seconds: float, u: float) -> tuple[np.ndarray, np.ndarray]:
        whole = expm(np.block([[system.A, system.B * u], [np.zeros((1, n + 1))]]) * seconds)
        return whole[:n, :n], whole[:n, n]

    def switchings(spans: np.ndarray) -> list[float]:
        up, by_up = flow(spans[0], -levels[0])
        down, by_down = flow(spans[1], -levels[1])
        x = np.linalg.solve(np.eye(n) - down @ up, down @ by_up + by_down)
        after = up @ x + by_up
        return [float((system.C @ x)[0]) - HALF_WIDTH, float((system.C @ after)[0]) + HALF_WIDTH]

    share = levels[0] / (levels[0] - levels[1])
    spans, info, flag, words = fsolve(
        switchings, [(1.0 - share) / frequency, share / frequency], xtol=1e-13, full_output=True
    )
    assert np.abs(info["fvec"]).max() < 1e-9, (flag, words)
    mean = -float(np.dot(spans, levels) / spans.sum())
    return 1.0 / float(spans.sum()), numerator[-1] / denominator[-1] * mean


@pytest.mark.parametrize("levels", LEVELS)
def test_the_mean_of_harmonic_balance_is_that_of_the_switchings(
    relay: Path, plant: str, levels: tuple[float, float]
) -> None:
    """With levels ±1 everything is odd: the mean is 0. With 2 and −1 seven harmonics are good for some percent."""
    frequency, mean = exact(plant, levels)
    with around(relay, plant, levels) as system, ExitStack() as keep:
        loop = cut(system, "relay", at=None, time=0.0, keep=keep)
        alone = keep.enter_context(driven_block(system, loop.ports, 7, centre=loop.centre))
        block = DrivenBlock(alone, count=7, name="relay", time=0.0, centre=loop.centre, rest=loop.outputs[0])
        keep.callback(block.close)
        cycle = balance(loop.part, (block,), frequency=PLANTS[plant][2], amplitude=PLANTS[plant][3])
    assert cycle is not None
    found = loop.centre + float(cycle.v[0, 0].real)
    assert cycle.frequency == pytest.approx(frequency, rel=0.02)
    if levels[0] == -levels[1]:
        assert mean == pytest.approx(0.0, abs=1e-9)
        assert loop.centre == 0.0
        assert abs(found) < 1e-6 * cycle.amplitude
    else:
        assert abs(mean) > 0.01 * cycle.amplitude
        assert found == pytest.approx(mean, abs=0.02 * cycle.amplitude)
    assert not any("the point is not at rest" in note for note in loop.notes)


@pytest.mark.parametrize(("levels", "count"), [(LEVELS[0], 7), (LEVELS[1], 7), (LEVELS[0], 25)])
def test_the_driven_relay_answers_with_the_harmonics_of_its_pulse(
    relay: Path, levels: tuple[float, float], count: int
) -> None:
    """Under c + A cos φ it is high from −arccos((h − c)/A) to arccos(−(h + c)/A): a pulse, of known coefficients."""
    high, low = levels
    with around(relay, "well damped", levels) as system, ExitStack() as keep:
        ports = cut(system, "relay", at=None, time=0.0, keep=keep).ports
        alone = keep.enter_context(driven_block(system, ports, 1, centre=0.0))
        block = DrivenBlock(alone, count=1, name="relay", time=0.0)
        keep.callback(block.close)
        for amplitude, centre in [(0.5, 0.0), (0.37, 0.123), (0.23, -0.0731), (1.7, 0.511)]:
            found = block.answer(np.array([centre, amplitude], dtype=np.complex128), 0.31, count)
            up = -np.arccos((HALF_WIDTH - centre) / amplitude)
            down = np.arccos(-(HALF_WIDTH + centre) / amplitude)
            k = np.arange(1, count + 1)
            pulse = (np.exp(-1j * k * up) - np.exp(-1j * k * down)) / (1j * k * np.pi)
            wanted = np.append(low + (high - low) * (down - up) / (2.0 * np.pi), (high - low) * pulse)
            assert np.abs(found - wanted).max() < block.accuracy * np.abs(wanted).max()
    assert block.settled


def test_the_command_gives_mean_0_in_every_row(relay: Path) -> None:
    with around(relay, "well damped", (1.0, -1.0)) as system:
        result = limit_cycle(
            system, block="relay", band=(0.2, 1.0), amplitudes=(0.15, 0.6), workers=Workers(in_process=True)
        )
    assert {c.method for c in result.limit_cycles} == {"describing function", "harmonic balance", "simulation"}
    assert all(abs(c.mean) < 1e-5 * c.amplitude for c in result.limit_cycles)
    assert not any("contradicts" in note for note in result.notes)
    assert any("hysteresis, its middle line, is met" in note for note in result.notes)


def row(method: str, *, mean: float = 0.0, frequency: float = 1.0, stable: bool | None = True) -> LimitCycle:
    return LimitCycle(
        method=method, crossing=0, frequency_hz=frequency, amplitude=1.0, fundamental=1.0, mean=mean, stable=stable
    )  # fmt: skip


def test_rows_that_contradict_each_other_are_said() -> None:
    said = contradictions(
        [row("describing function", mean=-1.0), row("harmonic balance", frequency=1.03), row("simulation")], "relay.u"
    )
    assert said == [
        "crossing 1: describing function contradicts simulation about relay.u: mean -1, not 0; rely on simulation",
        "crossing 1: harmonic balance contradicts simulation about relay.u: frequency 1.03, not 1; rely on simulation",
    ]


def test_rows_within_their_errors_are_not() -> None:
    assert not contradictions([row("describing function", frequency=1.05), row("simulation")], "relay.u")


def test_a_simulation_that_is_not_steady_contradicts_nothing() -> None:
    assert not contradictions([row("describing function", mean=-1.0), row("simulation", stable=None)], "relay.u")
