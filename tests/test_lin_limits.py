"""The limits from which linearisation says something, each against a model whose motion is a closed form."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.lin_fmus import built
from workbench.cli.app import run
from workbench.point.lin.realisation import realise

# All-pass: its gain is 1 at every pole, so that another pole changes the phase alone.
TURNING = """
model AllPass
  input Real u(start = 0);
  output Real y;
  Real x(start = 0, fixed = true);
equation
  der(x) = (if time < 0.01 then 1 else 1.3) * (u - x);
  y = 2 * x - u;
end AllPass;
"""

ACCUMULATOR = """
model Accumulator
  input Real u(start = 0);
  output Real y;
  parameter Real drift = 0;
  discrete Real z(start = 2, fixed = true, nominal = 1);
equation
  when sample(0, 0.1) then
    z = pre(z) + u + drift;
  end when;
  y = z;
end Accumulator;
"""

DELAYED = """
model Sampled
  input Real u(start = 0);
  output Real y;
  discrete Real z(start = 0, fixed = true, nominal = 1);
equation
  when sample(0, 0.1) then
    z = 0.5 * pre(z) + u;
  end when;
  y = z;
end Sampled;
"""

# A Monod law: everything happens within K, which is not declared as a nominal value.
SMALL = """
model Small
  input Real u(start = 0.6);
  output Real y;
  parameter Real K = 2e-8;
  Real x(start = 1e-8, fixed = true);
  Real z(start = 0, fixed = true);
equation
  der(x) = 1.5*K*u - 2*K*x/(K + x) - 0.5*z;
  der(z) = x*x/K - z - 1e-2*z*abs(z)/K;
  y = x*x/(K+x);
end Small;
"""


def _moving(notes: tuple[str, ...]) -> list[str]:
    return [note for note in notes if note.startswith("the point is not at rest")]


@pytest.mark.parametrize(("share", "told"), [(2e-3, True), (5e-4, False)])
def test_a_black_box_moves_where_its_drift_is_seen_beside_the_answers(share: float, told: bool) -> None:
    """x' = u − x from x0 drifts by x0 e^(−h) (1 − e^(−T)); a pulse of width w for h moves it by w (1 − e^(−h))."""
    width, period, points = 0.02, 0.1, 200
    drift = share * width * -math.expm1(-period)
    x0 = drift * math.exp(period) / -math.expm1(-period * (points - 1))
    with wb.load("fmu:FirstOrderLag", "me") as model:
        notes = wb.lin(model, method="response", x0={"x": x0}, du=width, period=period, points=points).result.notes
    assert bool(_moving(notes)) is told
    if told:
        assert f"y changes by {drift:.4g} within {period * (points - 1):.4g} s" in _moving(notes)[0]


@pytest.mark.parametrize(("drift", "told"), [(1e-5, True), (1e-7, False)])
def test_a_sampled_model_moves_where_a_state_is_another_after_a_period(drift: float, told: bool) -> None:
    """z grows by the drift with every sample; rounding of the run is far below 1e-7 of it."""
    with wb.load(built(ACCUMULATOR, "Accumulator"), "me", start_values={"drift": drift}) as model:
        result = wb.lin(model, method="kalman-bertram").result
    assert float(result.A.item()) == pytest.approx(1.0, abs=1e-9)
    assert bool(_moving(result.notes)) is told
    if told:
        assert f"z goes from 2 to {2.0 + drift:.4g} in one period" in _moving(result.notes)[0]


def test_sampled_models_are_compared_up_to_0_4_of_the_nyquist_frequency() -> None:
    """Half the rate is 5 Hz; the pole, ln 2/0.1 s, alone would reach to 3·6.93/2π = 3.3 Hz."""
    with wb.load(built(DELAYED, "Sampled"), "me") as model:
        found = wb.compare(model, "u", "y", measure=False)
    frequencies = [v.frequency_hz for v in found.verdicts]
    assert max(frequencies) == pytest.approx(0.4 * 5.0, rel=1e-9)


def test_equal_gains_with_other_phases_differ() -> None:
    """(a − s)/(a + s) with a = 1 where it is linearised and 1.3 where it is measured: a phase of −2 atan(ω/a)."""
    frequencies = [0.05, 0.2, 1.5]
    s = 2j * np.pi * np.array(frequencies)
    wanted = [math.degrees(cmath.phase(z)) for z in (1.0 - s) / (1.0 + s) * (1.3 + s) / (1.3 - s)]
    assert min(abs(abs(w) - 5.0) for w in wanted) > 0.5
    assert {abs(w) < 5.0 for w in wanted} == {True, False}
    with wb.load(built(TURNING, "AllPass"), "me") as model:
        found = wb.compare(model, "u", "y", frequencies=frequencies)
    verdicts = [v for v in found.verdicts if v.method == "exact (me)"]
    assert [v.gain_db for v in verdicts] == pytest.approx([0.0] * 3, abs=1e-3)
    assert [v.phase_deg for v in verdicts] == pytest.approx(wanted, abs=1e-2)
    assert [v.agrees for v in verdicts] == [abs(w) < 5.0 for w in wanted]


@pytest.mark.parametrize("size", [1e-3, 1e-5])
def test_a_plateau_of_singular_values_is_not_dynamics_and_what_stands_out_of_it_is(size: float) -> None:
    """Two modes, the second of the given size, under errors of a hundredth of it that nobody stated as noise."""
    k = np.arange(201.0)
    true = np.where(k > 0, 0.9 ** (k - 1.0) + size * (-0.8) ** (k - 1.0), 0.0)
    errors = 1e-2 * size * np.random.default_rng(11).uniform(-1.0, 1.0, len(k))
    found = realise((true + errors)[:, None, None], noise=0.0)
    assert len(found.A) == 2
    assert sorted(np.linalg.eigvals(found.A).real) == pytest.approx([-0.8, 0.9], abs=0.05)


AUTONOMOUS = """
model Autonomous
  output Real y;
  Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
equation
  der(x) = v;
  der(v) = -4 * x - 0.4 * v;
  y = 3 * x;
end Autonomous;
"""


def test_a_model_without_inputs_has_poles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = built(AUTONOMOUS, "Autonomous")
    with wb.load(file, "me") as model:
        system = wb.lin(model)
    result = system.result
    np.testing.assert_allclose(system.A, [[0.0, 1.0], [-4.0, -0.4]], atol=1e-6)
    np.testing.assert_allclose(result.C, [[3.0, 0.0]], atol=1e-6)
    assert (result.B.shape, system.input_labels) == ((2, 0), ["no_input"])
    pages = {name: tmp_path / f"lin.{name}" for name in ("json", "csv", "html")}
    files = [
        word for name, page in pages.items() for word in ("--report" if name == "html" else f"--{name}", str(page))
    ]
    assert run(["lin", file, *files]) == 0
    assert all(page.exists() for page in pages.values())
    assert run(["lin", file, "--plot", str(tmp_path / "lin.png")]) == 2
    assert "the linear model has no input, so it has no response to draw" in capsys.readouterr().err
    assert run(["lin", file, "--interface", "cs"]) == 2
    assert (
        "a linear model needs an input or states, and this interface shows neither; use interface me"
        in capsys.readouterr().err
    )


IRREGULAR = """
model Irregular
  input Real u(start = 0);
  output Real y;
  Real x(start = 0, fixed = true);
  discrete Real z(start = 0, fixed = true);
  discrete Real due(start = 0.1, fixed = true);
equation
  der(x) = u - 2 * x + z;
  when time >= pre(due) then
    z = 0;
    due = pre(due) * 1.5;
  end when;
  y = x;
end Irregular;
"""


def test_time_events_without_rates_are_held_where_the_method_is_chosen() -> None:
    with wb.load(built(IRREGULAR, "Irregular"), "me") as model:
        result = wb.lin(model).result
        assert (result.dt, result.method) == (0.0, "difference")
        assert "the time events have no constant rates; what is discrete is held" in result.why
        np.testing.assert_allclose(result.A, [[-2.0]], atol=1e-6)
        with pytest.raises(wb.WorkbenchError, match="no constant rates; give periods"):
            wb.lin(model, method="kalman-bertram")


@pytest.mark.parametrize("method", ["difference", "exact"])
@pytest.mark.parametrize("K", [3e-13, 2e-8, 2.0])
@pytest.mark.parametrize(("x", "z"), [(0.03, 0.0), (0.5, 0.4)])
def test_states_without_nominal_value_are_perturbed_at_the_scale_that_the_model_shows(
    method: str, K: float, x: float, z: float
) -> None:
    """∂f by hand; x and z in units of K. Nothing is doubtful, and the FMU's own derivatives are not blamed."""
    with wb.load(built(SMALL, "Small"), start_values={"K": K}) as model:
        found = wb.lin(model, method=method, x0={"x": x * K, "z": z * K}, in_process=True).result
    np.testing.assert_allclose(found.A, [[-2.0 / (1.0 + x) ** 2, -0.5], [2.0 * x, -1.0 - 0.02 * z]], rtol=1e-4)
    np.testing.assert_allclose(found.C, [[(x * x + 2.0 * x) / (1.0 + x) ** 2, 0.0]], rtol=1e-4)
    assert not found.doubts
    assert any("the model is linear only over a short range: x (" in n for n in found.notes) == (K < 1e-6)


def test_a_kink_beside_a_point_is_still_told_where_nothing_is_declared() -> None:
    """Stepping over less than the way to a kink would hide it only where the model shows so small a scale."""
    kink = SMALL.replace("- z - 1e-2*z*abs(z)/K", "- z - max(z, 1e-9)")
    with wb.load(built(kink, "Kink"), start_values={"K": 1.0}) as model:
        found = wb.lin(model, method="difference", x0={"x": 0.5, "z": 0.0}, in_process=True).result
    (doubt,) = found.doubts
    assert (doubt.row, doubt.column) == ("z", "z")
    assert "a kink or jump at the point: slope -1" in doubt.reason
