"""What is said of limit cycles: those that no describing function sees, their mean, what is not known."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from tests.platforms import needs_module
from workbench.build.fmu import build_fmu
from workbench.core.values.linear import LinearPart
from workbench.fmi.platforms import host
from workbench.jobs.options import Workers
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle, balance
from workbench.limit_cycles.limit_cycle.request import limit_cycle
from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.describe import standard_block
from workbench.loops.nyquist.page import crossings_section
from workbench.loops.nyquist.result import NyquistResult
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.zero_crossings import told_mean
from workbench.system.connect import connect
from workbench.system.description import FunctionComponent

RELAY = """
model Relay
  input Real u(start = 0);
  output Real y;
  parameter Real h = 0.3;
  Boolean on(start = true, fixed = true);
equation
  on = if pre(on) then u > -h else u > h;
  y = if on then 1 else -1;
end Relay;
"""


THIRD = control.tf([1.0], [1.0, 3.0, 3.0, 1.0])


def around(block: object, plant: control.TransferFunction, start: dict[str, float] | None = None) -> DescribedModel:
    return connect(
        {"block": block, "plant": control.ss(plant)},
        [("plant.y", "block.u"), ("block.y", "plant.u", {"gain": -1.0})],
        outputs={"y": "plant.y"},
        start_values=start,
    )


@pytest.fixture(scope="module")
def thermostat(tmp_path_factory: pytest.TempPathFactory) -> LimitCycleResult:
    needs_module("rumoca", "build")
    folder = tmp_path_factory.mktemp("relay")
    (folder / "Relay.mo").write_text(RELAY)
    build_fmu([folder / "Relay.mo"], out=folder / "Relay.fmu", platforms=[host()])
    with around(str(folder / "Relay.fmu"), control.tf([1.0], [1.0, 1.0])) as system:
        return limit_cycle(
            system, block="block", band=(0.1, 5.0), amplitudes=(0.35, 3.0), workers=Workers(in_process=True)
        )


def test_a_thermostat_oscillates_though_no_describing_function_says_so(thermostat: LimitCycleResult) -> None:
    """Half a period is ln(1.3/0.7) [Tsypkin]; −1/N lies left of the imaginary axis, 1/(1 + jω) right of it."""
    (cycle,) = [c for c in thermostat.limit_cycles if c.method == "simulation"]
    assert cycle.crossing is None
    assert cycle.frequency_hz == pytest.approx(0.5 / math.log(1.3 / 0.7), rel=1e-5)
    assert cycle.amplitude == pytest.approx(0.3, rel=0.02)
    assert cycle.stable
    assert thermostat.observed[0].outcome == "oscillation"
    assert "describing functions predict no limit cycle" in thermostat.none_predicted()
    assert "keeps oscillating at 0.8077 Hz" in thermostat.none_predicted()


def test_a_cycle_that_nobody_predicted_has_a_table_and_pages(thermostat: LimitCycleResult, tmp_path: Path) -> None:
    assert thermostat.to_dict()["limit_cycles"][0]["crossing"] is None
    assert thermostat.to_dict()["observed"][0]["outcome"] == "oscillation"
    thermostat.to_csv(tmp_path / "cycle.csv")
    thermostat.report(tmp_path / "cycle.html")
    assert "keeps oscillating" in (tmp_path / "cycle.html").read_text()


@pytest.mark.parametrize(
    ("plant", "gain", "outcome"),
    [(control.tf([1.0], [1.0, 1.0]), 1.0, "rest"), (control.tf([1.0], [1.0, -1.0]), 0.5, "divergence")],
)
def test_where_nothing_is_predicted_a_run_tells_what_happens(
    plant: control.TransferFunction, gain: float, outcome: str
) -> None:
    with around(lambda u: gain * np.tanh(u), plant) as system:
        result = limit_cycle(system, block="block")
    assert not result.limit_cycles
    assert {o.outcome for o in result.observed} == {outcome}


@pytest.mark.parametrize(("state", "size"), [("x1", 0.5), ("x3", 0.01)])
def test_a_start_off_rest_does_not_move_the_mean(state: str, size: float) -> None:
    """A relay is odd and so is its cycle, wherever the run begins; the relay has no equilibrium, being 1 at 0."""
    lag = control.tf([5.0], [1.0, 1.2, 1.2, 1.0])
    with around(lambda u: np.where(u >= 0.0, 1.0, -1.0), lag, {f"plant.{state}": size}) as system:
        result = limit_cycle(system, block="block", methods=("describing function", "harmonic balance"))
    (balanced,) = [c for c in result.limit_cycles if c.method == "harmonic balance"]
    assert abs(balanced.mean) < 1e-9
    assert balanced.frequency_hz == pytest.approx(0.174205, rel=1e-4)  # by shooting and by simulation
    assert balanced.stable


def test_the_mean_is_that_of_the_variable_in_every_table() -> None:
    """8 tanh(u − 0.5) is not odd: the cycle has a mean, and all methods give that of block.u itself."""
    with around(lambda u: 8.0 * np.tanh(u - 0.5), control.tf([3.0], [1.0, 3.0, 3.0, 1.0])) as system:
        result = limit_cycle(system, block="block")
    assert result.simulated is not None
    mean = result.simulated.mean["block.u"]
    assert abs(mean) > 0.01
    for c in result.limit_cycles:
        if c.method != "describing function":
            assert c.mean == pytest.approx(mean, rel=2e-2)


def test_van_der_pol_at_10_is_stable_and_has_its_period() -> None:
    """Period 19.078370 s at μ = 10 (independent integration); seven harmonics cannot tell its stability."""
    with around(lambda u: u**3 / 3.0, control.tf([10.0, 0.0], [1.0, -10.0, 1.0])) as system:
        found = {c.method: c for c in limit_cycle(system, block="block").limit_cycles}
    assert found["harmonic balance"].stable is None
    assert found["harmonic balance"].multiplier is None
    for method in ("shooting", "simulation"):
        assert 1.0 / found[method].frequency_hz == pytest.approx(19.078370, rel=1e-6)
        assert found[method].stable


def test_the_mean_of_a_symmetrical_cycle_is_0_not_rounding() -> None:
    """A relay and 1/(s + 1)³: the cycle is odd, so its mean is 0 on every processor."""
    plant = control.ss(THIRD)
    loop = LinearPart(plant.A, plant.B[:, 0], plant.C[0], 0.0)
    found = balance(loop, (standard_block("relay"),), frequency=math.sqrt(3.0) / (2.0 * math.pi), amplitude=0.16)
    assert found is not None
    assert found.v[0, 0] == 0.0


@pytest.mark.parametrize(("mean", "told"), [(1e-17, 0.0), (-3e-14, 0.0), (1e-9, 1e-9), (-0.2, -0.2)])
def test_a_mean_is_told_where_rounding_does_not_hide_it(mean: float, told: float) -> None:
    """Rounding of a sum of 4096 samples of amplitude 0.1 is 9.1e-14."""
    assert told_mean(mean, amplitude=0.1, residual=0.0) == told
    assert told_mean(mean, amplitude=0.1, residual=1e-10) == told


def test_harmonic_balance_that_leads_out_of_the_band_is_no_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 4e-15 Hz the equations hold as well, near the point of rest: that is not the cycle at 0.2757 Hz."""
    module = importlib.import_module("workbench.limit_cycles.limit_cycle.run")

    def slow(
        part: LinearPart,
        blocks: tuple[DescribedBlock, ...],
        *,
        frequency: float,
        amplitude: float,
        others: Sequence[complex],
        count: int,
    ) -> Cycle | None:
        found = balance(part, blocks, frequency=frequency, amplitude=amplitude, others=others, count=count)
        return None if found is None else replace(found, frequency=4e-15)

    monkeypatch.setattr(module, "balance", slow)
    relay = FunctionComponent(
        name="block", function=lambda u: math.copysign(1.0, float(np.ravel(u)[0])), inputs=("u",), outputs=("y",)
    )
    with around(relay, THIRD) as system:
        result = limit_cycle(system, block="block", band=(0.01, 10.0), workers=Workers(in_process=True))
    assert min(c.frequency_hz for c in result.limit_cycles) > 0.2
    assert any("leads out of the band, to 4e-15 Hz" in note for note in result.notes)


def test_the_table_of_crossings_has_units_where_those_of_the_block_are_known() -> None:
    curve = NyquistResult(
        name="L", block="b", frequency_hz=np.array([1.0, 2.0]), response=np.array([-1.0 + 0j, -0.5 + 0j]),
        crossings=(), amplitude=np.zeros(0), minus_inverse=np.zeros(0, dtype=np.complex128),
    )  # fmt: skip
    (table,) = crossings_section(curve, "rad/s", of=("rad/s", "N.m")).tables
    assert table.headings[:5] == (
        "crossing", "frequency [Hz]", "L there [rad/s per N.m]", "gain −1/L [N.m per rad/s]", "amplitude [rad/s]",
    )  # fmt: skip
    (plain,) = crossings_section(curve).tables
    assert plain.headings[2:4] == ("L there", "gain −1/L")
