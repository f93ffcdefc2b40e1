"""Plants that run in a closed loop: directly, and by a recorded reference."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

import workbench as wb
from workbench.cli.app import run
from workbench.errors import InputError

GAIN = 3.0  # of the plant at rest: 0.3/(1 − 0.9)


def looped(seed: int, *, samples: int = 4000, pole: float = 0.9) -> wb.Experiment:
    """x(k + 1) = pole x(k) + 0.3 u(k), y = x + v, v of one pole at 0.8, held by u(k) = r(k) − 0.8 y(k − 1)."""
    random = np.random.default_rng(seed)
    r = random.choice([-1.0, 1.0], samples)
    v = signal.lfilter([1.0], [1.0, -0.8], 0.5 * random.standard_normal(samples))
    x, u, y = 0.0, np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        y[k] = x + v[k]
        u[k] = r[k] - 0.8 * (y[k - 1] if k else 0.0)
        x = pole * x + 0.3 * u[k]
    return wb.make_experiment(0.1, np.column_stack([r, u]), y, input_names=["r", "u"], output_names=["y"])


def at_rest(found: wb.IdentifyResult) -> float:
    return float(found.model.response([0.0])[0, 0, 0].real)


@pytest.mark.parametrize("how", ["direct", "r"])
def test_the_plant_is_found_in_a_closed_loop(how: str) -> None:
    """Four records: the mean of the poles within three of its standard deviations, as each says them if it does."""
    found = [
        wb.identify(looped(s), inputs=["u"], outputs=["y"], order=1, feedthrough=False, closed_loop=how)
        for s in range(4)
    ]
    poles = np.array([f.model.poles[0].real for f in found])
    regions = [f.uncertainty.regions[0].spread for f in found if f.uncertainty is not None]
    each = np.mean(regions) if regions else poles.std(ddof=1)
    assert abs(poles.mean() - 0.9) < 3.0 * each / 2.0
    assert np.mean([at_rest(f) for f in found]) == pytest.approx(GAIN, rel=0.25)
    assert all(f.closed_loop and not f.warnings for f in found)
    open_loop = wb.identify(looped(0), inputs=["u"], outputs=["y"], order=1, feedthrough=False, refine="never")
    assert abs(at_rest(open_loop) - GAIN) > 1.5
    assert open_loop.warnings


def test_the_order_is_found_in_a_closed_loop() -> None:
    orders = [
        wb.identify(looped(s), inputs=["u"], outputs=["y"], feedthrough=False, closed_loop="direct").order
        for s in range(2)
    ]
    assert orders == [1, 1]


def test_an_unstable_plant_is_found_directly() -> None:
    """Its disturbance has another pole, so that the model in innovations form has both."""
    data = looped(0, pole=1.05)
    found = wb.identify(data, inputs=["u"], outputs=["y"], order=2, feedthrough=False, closed_loop="direct")
    assert np.max(found.model.poles.real) == pytest.approx(1.05, abs=0.02)


def test_the_prediction_after_two_stages_uses_the_inputs_as_they_were() -> None:
    found = wb.identify(looped(1), inputs=["u"], outputs=["y"], order=1, feedthrough=False, closed_loop="r")
    assert found.model.noise is not None
    residual = found.own.prediction.residual[:, 0]
    # The innovations of the disturbance are 0.5 large.
    assert residual.std() == pytest.approx(0.5, rel=0.05)


def test_regions_by_a_reference_hold_the_truth() -> None:
    """95 % of 16 records: 12 or more but with a probability of 1e-3. Their size is what the poles scatter by."""
    found = [
        wb.identify(looped(s, samples=1500), inputs=["u"], outputs=["y"], order=1, feedthrough=False, closed_loop="r")
        for s in range(16)
    ]
    poles = np.array([f.model.poles[0].real for f in found])
    regions = [f.uncertainty.regions[0] for f in found if f.uncertainty is not None]
    assert len(regions) == 16
    assert sum(region.contains(0.9) for region in regions) >= 12
    # Of 16 the standard deviation is known to 18 %.
    assert np.median([region.spread for region in regions]) == pytest.approx(poles.std(ddof=1), rel=0.6)
    assert any("as an instrument" in note for note in found[0].notes)


def test_the_instrument_meets_its_equations() -> None:
    """The errors of the model know nothing of what the reference makes, by sums over the record alone."""
    data = looped(3)
    found = wb.identify(data, inputs=["u"], outputs=["y"], order=1, feedthrough=False, closed_loop="r").model
    assert found.noise is not None
    u, y = data.u[:, 1:] - found.u0, data.y - found.y0
    r = data.u[:, 0]
    left = y - found.simulate(u + found.u0, found.x0) + found.y0
    # The disturbance's model is inverted by its own recursion.
    z, e = np.zeros(len(found.noise.A)), np.zeros(len(left))
    for k, v in enumerate(left[:, 0]):
        e[k] = v - (found.noise.C @ z).item()
        z = found.noise.A @ z + found.noise.K[:, 0] * e[k]
    far = [np.corrcoef(e[20 + lag :], r[20 : len(r) - lag])[0, 1] * np.sqrt(len(r)) for lag in range(12)]
    # The reference's correlations with white errors are standard normal numbers.
    assert np.sqrt(np.mean(np.square(far))) < 1.8


def test_the_command_takes_the_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    looped(0, samples=1500).to_csv(tmp_path / "data.csv")
    command = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y", "--order", "1"]
    assert run([*command, "--closed-loop", "r", "--json", str(tmp_path / "found.json")]) == 0
    told = capsys.readouterr()
    assert "NOT A MODEL OF THE PLANT" not in told.out
    assert "by what r makes of the inputs (two stages)" in told.err
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert (found["closed_loop"], found["closed_loop_method"]) == (True, "r")
    assert run([*command, "--closed-loop", "w"]) == 2
    assert "no column 'w'" in capsys.readouterr().err
    assert run([*command, "--closed-loop", "direct", "--refine", "never"]) == 2
    assert "biased in a closed loop" in capsys.readouterr().err


def test_a_reference_that_does_nothing_is_refused() -> None:
    data = looped(0, samples=1500)
    random = np.random.default_rng(9)
    silent = data.with_data(u=np.column_stack([np.append(np.zeros(1499), 1.0), random.standard_normal(1500)]))
    with pytest.raises(InputError, match="does not drive the inputs"):
        wb.identify(silent, inputs=["u"], outputs=["y"], order=1, closed_loop="r")
    with pytest.raises(InputError, match="only input"):
        wb.identify(data, inputs=["r"], outputs=["y"], order=1, closed_loop="r")


def test_delays_are_estimated_and_told() -> None:
    random = np.random.default_rng(3)
    u = random.choice([-1.0, 1.0], 2000)
    y = signal.lfilter([0.0, 0.0, 0.0, 0.0, 0.5], [1.0, -0.8], u) + 0.1 * random.standard_normal(2000)
    found = wb.identify(wb.make_experiment(0.1, u, y), delay="auto")
    assert (found.order, found.model.delay) == (1, (3,))
    assert any("acts after 4 samples" in note for note in found.notes)


@pytest.mark.parametrize("scale", [1.0, 50.0])
def test_without_an_instrument_the_disturbance_is_told_in_the_units_of_the_output(
    scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """v(k) = 0.8 v(k − 1) + e(k): an innovation comes back as 0.8, 0.64 … of itself, whatever the output's unit."""
    monkeypatch.setattr("workbench.identification.identify.closed_loop.instrumented_model", lambda *_: None)
    data = looped(1)
    data = data.with_data(y=scale * data.y)
    found = wb.identify(data, inputs=["u"], outputs=["y"], order=1, feedthrough=False, closed_loop="r").model
    assert found.noise is not None
    C, A, K = found.noise.C, found.noise.A, found.noise.K
    assert [(C @ K).item(), (C @ A @ K).item()] == pytest.approx([0.8, 0.64], abs=0.06)
