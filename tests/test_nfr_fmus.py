"""The response of real FMUs: the bundled ones and OpenModelica's."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import workbench as wb
from scripts.reproduce.targets import read_targets
from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.response.nfr.result import NfrResult

TARGETS = read_targets()


def errors(result: NfrResult, truth: Callable[[complex], complex]) -> tuple[float, float]:
    """Largest error of gain [%] and phase [deg]; NaN where a point failed."""
    exact = np.array([truth(2j * math.pi * f) for f in result.frequency_hz])
    quotient = result.response / exact
    return 100.0 * float(np.max(np.abs(np.abs(quotient) - 1.0))), float(np.max(np.abs(np.degrees(np.angle(quotient)))))


def mass_damper(s: complex) -> complex:
    return 1.0 / (s * s + 10.0 * s + 1e4)


@needs_gemseo
@pytest.mark.parametrize("solver", ["auto", "vkm", "gear"])
def test_mass_damper_from_1_to_60_hz(solver: str) -> None:
    # It starts half a metre from its rest: a transient 5000 to 66000 times the response to 1 N.
    with wb.load(gemseo_fmu("Mass_Damper"), solver=solver, tolerance=1e-8) as model:
        assert model.interface == "me"
        result = wb.nfr(model, "f", "y", band=(1.0, 60.0), amplitudes=1.0)
    gain, phase = errors(result, mass_damper)
    assert gain < 0.5
    assert phase < 0.5
    assert result.offset == pytest.approx(-0.5, abs=0.01)


@needs_gemseo
def test_mass_damper_by_co_simulation_is_right_although_it_is_explicit_euler() -> None:
    with wb.load(gemseo_fmu("Mass_Damper"), "cs") as model:
        result = wb.nfr(model, "f", "y", [1.0, 10.0, 60.0], 1.0)
    gain, phase = errors(result, mass_damper)
    assert gain < 0.5
    assert phase < 0.5
    assert np.all(result.step < 1e-3)


@needs_gemseo
def test_mass_damper_at_a_step_that_diverges_says_so() -> None:
    with wb.load(gemseo_fmu("Mass_Damper"), "cs") as model:
        result = wb.nfr(model, "f", "y", [1.0, 10.0], 1.0, step=1e-2)
    assert len(result.failed) == 2


@pytest.mark.parametrize("fmu", ["fmu:FirstOrderLag", "fmu:FirstOrderLag@3"])
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize(("errcrit", "name"), [(0.001, "fine"), (0.1, "default")])
def test_first_order_lag(fmu: str, interface: str, errcrit: float, name: str) -> None:
    with wb.load(fmu, interface) as model:
        tau = next(float(p.start or 0.0) for p in model.parameters if p.name == "tau")
        result = wb.nfr(model, "u", "y", amplitudes=1.0, band=(0.1, 10.0), ratio=1.5, errcrit=errcrit)
    gain, phase = errors(result, lambda s: 1.0 / (1.0 + tau * s))
    if interface == "cs":  # the FMU's own steps are part of what is measured; the target is of the model itself
        assert gain < min(0.01, 100.0 * float(np.max(result.error)))
    else:
        assert TARGETS[f"lag-gain-{name}"].accepts(gain)
    assert TARGETS[f"lag-phase-{name}"].accepts(phase)


@pytest.mark.parametrize("fmu", ["fmu:TwoRateQuantizer", "fmu:TwoRateQuantizer@3"])
def test_two_rate_quantiser(fmu: str) -> None:
    with wb.load(fmu) as model:
        result = wb.nfr(model, "u", "y", [15.39, 15.407, 15.42], 1.0, errcrit=0.08)
    assert TARGETS["quantiser-averaged"].accepts(result.averaged[0].astype(float))
    assert TARGETS["quantiser-neighbours-gain"].accepts(float(np.ptp(result.gain_db)))
    assert TARGETS["quantiser-neighbours-phase"].accepts(float(np.ptp(result.phase_deg)))


def test_rudder_at_the_published_point_whichever_way_it_is_run() -> None:
    found = []
    for fmu in ("fmu:Rudder", "fmu:Rudder@3"):
        for interface in ("me", "cs"):
            with wb.load(fmu, interface) as model:
                result = wb.nfr(model, "delC", "del", [10.0], 1.0)
            found.append((result.gain_db[0, 0], result.phase_deg[0, 0]))
    gain_db, phase_deg = np.array(found).T
    assert TARGETS["rudder-10hz-gain"].accepts(gain_db)
    assert TARGETS["rudder-10hz-phase"].accepts(phase_deg)
    assert TARGETS["rudder-interfaces-gain"].accepts(float(np.ptp(gain_db)))
    assert TARGETS["rudder-interfaces-phase"].accepts(float(np.ptp(phase_deg)))


def test_rudder_loses_gain_with_amplitude_above_its_bandwidth() -> None:
    with wb.load("fmu:Rudder") as model:
        result = wb.nfr(model, "delC", "del", [0.5, 10.0], [0.5, 2.0, 8.0])
    assert np.all(np.abs(result.gain_db[:, 0]) < 0.5)
    assert np.all(np.diff(result.gain_db[:, 1]) < 0.0)


def test_carrying_the_state_gives_the_same_rudder() -> None:
    with wb.load("fmu:Rudder") as model:
        fresh = wb.nfr(model, "delC", "del", [2.0, 5.0, 10.0], 1.0)
        carried = wb.nfr(model, "delC", "del", [10.0, 5.0, 2.0], 1.0, carry=True)
    assert TARGETS["rudder-carried-gain"].accepts(np.max(np.abs(carried.gain_db - fresh.gain_db)))
    assert TARGETS["rudder-carried-phase"].accepts(np.max(np.abs(carried.phase_deg - fresh.phase_deg)))
