"""Steady gains that are held in the refinement: kept, with the bound that theory gives, and doubted where wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

import workbench as wb
from tests.random_systems import truth_spread
from workbench.cli.app import run
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.identification.prediction.innovations import Innovations

NUM, DEN, GAIN = [0.0, 0.1, 0.05], [1.0, -1.6, 0.8], 0.75


def recorded(seed: int, samples: int = 1200) -> wb.Experiment:
    """A lag of order 2 with a disturbance of order 1, whose slow part hides the steady gain."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], samples // 2), 2)
    e = signal.lfilter([1.0], [1.0, -0.95], random.normal(size=samples)) * np.sqrt(1.0 - 0.95**2)
    y = signal.lfilter(NUM, DEN, u) + 0.3 * e
    return wb.make_experiment(0.1, u, y, input_names=["u"], output_names=["y"], name="lag")


def steady(model: wb.IdentifiedModel) -> Floats:
    return np.asarray(model.C @ np.linalg.solve(np.eye(model.order) - model.A, model.B) + model.D)


def test_a_gain_that_is_known_is_kept_and_makes_low_frequencies_exact() -> None:
    f = np.array([0.02, 0.05])
    true = signal.freqz(NUM, DEN, 2.0 * np.pi * f * 0.1)[1]
    free: list[Floats] = []
    held: list[Floats] = []
    for seed in range(5):
        for errors, gains in ((free, None), (held, {"y/u": GAIN})):
            found = wb.identify(recorded(seed), order=2, gains=gains)
            errors.append(np.abs(found.model.response(f)[:, 0, 0] - true))
            if gains is not None:
                assert steady(found.model).item() == pytest.approx(GAIN, rel=1e-10)
                assert "steady gain held: y/u = 0.75, the data agree" in found.refinement.words
    assert np.mean(np.square(held)) < 0.04 * np.mean(np.square(free))


def test_the_bound_is_that_of_an_exact_measurement_of_the_gain() -> None:
    """The covariance of the free model, given the gain: S − S h hᵀ S / (hᵀ S h), for the response at any frequency."""
    A, B, C = np.array([[1.6, -0.8], [1.0, 0.0]]), np.array([[1.0], [0.0]]), np.array([[0.1, 0.05]])
    true = Innovations(
        A=A, B=B, C=C, D=np.zeros((1, 1)), K=np.array([[0.3], [0.1]]), offset=np.zeros(1), x0=np.zeros(2), plant=2,
        shared=True,
    ).balanced()  # fmt: skip
    data = recorded(0)
    z = np.exp(2j * np.pi * np.array([0.0, 0.01, 0.05, 0.1, 0.3]))

    def response(entries: Floats) -> Complex:
        a, b, c, d = np.split(entries, np.cumsum([4, 2, 2]))
        return np.array([c @ np.linalg.solve(w * np.eye(2) - a.reshape(2, 2), b) + d[0] for w in z])

    entries = np.concatenate([part.ravel() for part in (true.A, true.B, true.C, true.D)])
    steps = 1e-6 * np.eye(len(entries))
    slopes = np.array([(response(entries + e) - response(entries - e)) / 2e-6 for e in steps]).T
    of = [truth_spread(m, data.u, data.y, np.array([0.1])) for m in (true, replace(true, gains=np.array([[GAIN]])))]
    free, held = (slopes @ spread @ spread.T @ slopes.conj().T for spread in of)
    h = free[:, :1]  # the covariance with the response at z = 1
    expected = free - h @ h.conj().T / free[0, 0]
    assert np.abs(held - expected).max() < 1e-6 * np.abs(free).max()
    assert np.abs(held[0, 0]) < 1e-9 * np.abs(free[0, 0])
    assert of[1].shape[1] == of[0].shape[1] - 1


def test_some_gains_of_several_inputs_and_outputs_are_held() -> None:
    random = np.random.default_rng(3)
    u = random.normal(size=(1500, 2))
    A = np.array([[0.9, 0.1], [0.0, 0.7]])
    B, C = np.array([[0.1, 0.0], [0.2, 0.5]]), np.array([[1.0, 0.0], [3.0, 1.0]])
    x, y = np.zeros(2), np.zeros((1500, 2))
    for k in range(1500):
        y[k] = C @ x + 0.1 * random.normal(size=2)
        x = A @ x + B @ u[k]
    gain = C @ np.linalg.solve(np.eye(2) - A, B)
    data = wb.make_experiment(
        0.5, u * [1.0, 100.0], y * [1.0, 0.01], input_names=["a", "b"], output_names=["p", "q"], output_units=["m", "V"]
    )
    gains = {"p/b": gain[0, 1] / 100.0, "q/a": gain[1, 0] * 0.01}
    found = wb.identify(data, also=[data.part(0, 700)], order=2, gains=gains)
    assert steady(found.model)[0, 1] == pytest.approx(gains["p/b"], rel=1e-9)
    assert steady(found.model)[1, 0] == pytest.approx(gains["q/a"], rel=1e-9)
    assert steady(found.model)[0, 0] == pytest.approx(gain[0, 0], rel=0.05)
    assert steady(found.model)[0, 0] != pytest.approx(gain[0, 0], rel=1e-6)


def test_a_wrong_gain_is_doubted_and_wrong_input_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(0).to_csv(tmp_path / "lag.csv")
    command = ["identify", str(tmp_path / "lag.csv"), "--input", "u", "--output", "y", "--order", "1"]
    assert run([*command, "--gain", "y/u=3"]) == 0
    assert "steady gain held: y/u = 3, the data disagree (p = " in capsys.readouterr().out
    for more, said in (
        (["--gain", "y/v=3"], "'y/v' is not an output/input of"),
        (["--gain", "y/u=3", "--refine", "never"], "refine=never rules out"),
        (["--gain", "y/u=inf"], "not a finite number"),
        (["--gain", "y/u"], "NAME=VALUE"),
        (["--gain", "y/u=3", "--structure", "wiener"], "--gain is not for --structure wiener"),
        (["--order", "0", "--no-feedthrough", "--gain", "y/u=3"], "no model of this order has the gains y/u = 3"),
    ):
        assert run([*command, *more]) == 2
        assert said in capsys.readouterr().err
    clean = wb.make_experiment(0.1, recorded(0).u, signal.lfilter(NUM, DEN, recorded(0).u[:, 0]))
    with pytest.raises(InputError, match="free of noise"):
        wb.identify(clean, order=2, gains={"y/u": GAIN})
