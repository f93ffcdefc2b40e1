"""Rational models from frequency responses: exact ones, noisy ones, those of the workbench's own analyses."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.io import savemat

import workbench as wb
from tests.random_systems import random_response, scattered
from workbench.cli.app import run
from workbench.core.values.arrays import Complex
from workbench.errors import InputError
from workbench.identification.fit.rational import fitted, paired

F = np.geomspace(0.01, 10.0, 40)
S = np.asarray(2j * np.pi * F, dtype=np.complex128)
POLES = np.array([-3.0 + 20.0j, -3.0 - 20.0j, -1.0, -0.5])
CIRCLE = np.sqrt(-np.log(0.05))  # radius that 95 % of complex normal numbers of E|e|² = 1 stay in


def response(poles: Complex = POLES) -> Complex:
    return np.asarray(np.polyval([2.0, 30.0, 100.0], S) / np.polyval(np.poly(poles).real, S), dtype=np.complex128)


def noisy(seed: int, size: float = 0.02) -> wb.Response:
    random = np.random.default_rng(seed)
    e = (random.standard_normal(len(F)) + 1j * random.standard_normal(len(F))) / np.sqrt(2.0)
    return wb.Response(F, response() * (1.0 + size * e), np.full(len(F), CIRCLE * size))


def test_an_exact_response_gives_its_poles_and_its_order() -> None:
    found = wb.fit(wb.Response(F, response()))
    assert found.order == 4
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(POLES), rel=1e-9)
    assert found.misfit.max() < 1e-10
    assert found.dt == 0.0
    assert np.abs(found.D).item() < 1e-9


def test_errors_of_the_poles_are_what_they_scatter_by() -> None:
    found = [wb.fit(noisy(seed), order=4, accuracy=0.0) for seed in range(40)]
    poles = np.array([sorted(f.poles, key=lambda p: (abs(p), p.imag)) for f in found])
    said = np.array([
        [f.pole_spread[np.argmin(np.abs(f.poles - p))] for p in row] for f, row in zip(found, poles, strict=True)
    ])  # fmt: skip
    true = np.array(sorted(POLES, key=lambda p: (abs(p), p.imag)))
    measured = np.sqrt(np.mean(np.abs(poles - true) ** 2, axis=0))
    # Of 40 the root mean square is known to about 11 %.
    assert np.median(said, axis=0) == pytest.approx(measured, rel=0.4)
    assert np.mean([f.chi_squared for f in found]) == pytest.approx(1.0, abs=0.1)


def test_the_order_is_right_under_noise() -> None:
    # At 0.5 % all four poles show; at 2 % the two slow ones and the zero beside them may be three states' worth.
    orders = [wb.fit(noisy(seed, 0.005), accuracy=0.0).order for seed in range(10)]
    assert np.mean(np.array(orders) == 4) >= 0.8


def test_noise_is_no_dynamics_where_no_errors_are_given() -> None:
    """Random responses with noise in proportion to the gain, and of one level: the order, and how far values scatter.

    Taken as exact to 0.3 %, all of them would have the highest orders tried.
    """
    frequency = np.geomspace(0.02, 50.0, 30)
    right, sizes = [], []
    for seed in range(4):
        random = np.random.default_rng(seed)
        true = random_response(random, 1 + seed % 4, frequency)
        for level in (False, True):
            found = wb.fit(wb.Response(frequency, scattered(random, true, 0.01, level=level)), max_order=6)
            right.append(found.order == 1 + seed % 4)
            sizes.append(np.median(found.sigma / (0.01 * (np.abs(true).max() if level else np.abs(true)))))
            assert any("rest on the scatter" in note for note in found.notes)
    assert np.mean(right) >= 0.75  # with the errors given it is 0.9
    assert np.median(sizes) == pytest.approx(1.0, rel=0.2)


def test_a_fit_says_where_its_order_rests_on_no_error() -> None:
    few = np.geomspace(0.1, 10.0, 6)
    plain = wb.fit(wb.Response(few, np.asarray(1.0 / (2j * np.pi * few + 1.0), dtype=np.complex128)))
    assert plain.order == 1
    assert any("no noise" in note or "rests on no error" in note for note in plain.notes)
    random = np.random.default_rng(0)
    four = scattered(random, random_response(random, 4, few), 0.01, level=False)
    assert any("rests on no error" in note for note in wb.fit(wb.Response(few, four)).notes)
    given = wb.fit(wb.Response(few, four, np.full(6, 0.0173)))
    assert not any("no errors" in note for note in given.notes)


def test_slopes_are_exact() -> None:
    """The coefficients' covariance rests on them: against a fit of perturbed values."""
    value, sigma = response(), np.abs(response())
    plain = fitted(S, value, sigma, 4, direct=True, stable=True)
    bump = np.zeros(len(F), dtype=np.complex128)
    bump[20] = 1e-5 * value[20]
    moved = fitted(S, value + bump, sigma, 4, direct=True, stable=True, start=POLES)
    far = np.linalg.norm(np.sort_complex(np.linalg.eigvals(moved.matrices[0])) - np.sort_complex(POLES))
    # One value of the forty moves the poles by less than its own σ times their spread.
    assert 0.0 < far < 1e-5 * np.linalg.norm(plain.pole_spread())


def test_a_delay_is_taken_out_and_told() -> None:
    late = response() * np.exp(-S * 0.05)
    found = wb.fit(wb.Response(F, late), order=4, delay=0.05)
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(POLES), rel=1e-9)
    assert found.fitted == pytest.approx(late)
    assert any("delay of 0.05 s" in note for note in found.notes)


def test_poles_stay_stable_unless_they_may_not() -> None:
    poles = np.array([0.5, -3.0 + 20.0j, -3.0 - 20.0j])
    curve = wb.Response(F, response(poles))
    assert np.all(wb.fit(curve, order=3).poles.real < 0.0)
    free = wb.fit(curve, order=3, stable=False)
    assert np.sort_complex(free.poles) == pytest.approx(np.sort_complex(poles), rel=1e-8)


def test_a_linear_model_comes_from_sines() -> None:
    """1/(s + 1) by its frequency response."""
    with wb.load("fmu:FirstOrderLag") as lag:
        measured = wb.nfr(lag, "u", "y", band=(0.02, 2.0), amplitudes=[1.0])
    found = wb.fit(measured)
    assert found.order == 1
    assert found.poles == pytest.approx([-1.0], rel=0.01)
    assert any("measured at 1" in note for note in found.notes)


def test_a_sampled_model_comes_from_multisines() -> None:
    """The sampled lag has its pole at exp(−dt)."""
    with wb.load("fmu:FirstOrderLag") as lag:
        measured = wb.bla(lag, "u", "y", rms=[1.0, 2.0], band=(0.05, 1.0), realisations=2)
    found = wb.fit(measured, amplitude=2.0)
    assert (found.order, found.dt) == (1, measured.dt)
    assert found.poles == pytest.approx([np.exp(-measured.dt)], rel=1e-3)
    with pytest.raises(InputError, match="none is given; there are 1, 2"):
        wb.fit(measured)
    with pytest.raises(InputError, match="3 was not measured"):
        wb.fit(measured, amplitude=3.0)


def test_the_command_reads_tables_and_writes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = np.column_stack([F, 20.0 * np.log10(np.abs(response())), np.degrees(np.angle(response()))])
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header="frequency [Hz],gain_db [dB],phase [deg]", comments="")
    files = ["--json", str(tmp_path / "m.json"), "--plot", str(tmp_path / "m.png"), "--csv", str(tmp_path / "m.csv")]
    assert run(["identify", str(tmp_path / "r.csv"), *files]) == 0
    assert "Order 4: smallest Bayesian criterion" in capsys.readouterr().out
    found = wb.FitResult.read(tmp_path / "m.json")
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(POLES), rel=1e-6)
    assert json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))["order"] == 4
    assert (tmp_path / "m.png").stat().st_size > 10_000
    with pytest.raises(InputError, match=r"columns frequency \[Hz\], gain or gain_db, and phase \[deg\] are needed"):
        wb.fit(tmp_path / "m.csv")
    assert run(["identify", str(tmp_path / "m.csv")]) == 2  # neither a response nor a record
    assert capsys.readouterr().err.count("\n") == 1
    assert run(["identify", str(tmp_path / "r.csv"), "--order", "50"]) == 2
    assert "40 points allow 38" in capsys.readouterr().err


def test_responses_of_python_control_and_matlab_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    expected = np.sort_complex(POLES)
    found = wb.fit(control.frd(response(), 2.0 * np.pi * F), order=4)
    assert np.sort_complex(found.poles) == pytest.approx(expected, rel=1e-9)
    both = wb.fit(control.frd(np.multiply.outer([[1.0], [2.0]], response()), 2.0 * np.pi * F), order=4)
    assert np.sort_complex(both.poles) == pytest.approx(expected, rel=1e-9)
    assert both.output_names == ("y[0]", "y[1]")
    sampled = control.frd(response(), F, dt=True)
    with pytest.raises(InputError, match="does not say how often"):
        wb.fit(sampled)
    as_frd = {"ResponseData": response().reshape(1, 1, -1), "Frequency": 2.0 * np.pi * F[:, None]}
    for name, held in (
        ("frd", as_frd),
        ("structure", {"sys": {**as_frd, "FrequencyUnit": "rad/TimeUnit"}}),
        ("hertz", {"sys": {**as_frd, "Frequency": F, "FrequencyUnit": "Hz"}}),
        ("plain", {"H": response(), "f": F}),
        ("omega", {"H": response(), "w": 2.0 * np.pi * F}),
    ):
        savemat(tmp_path / f"{name}.mat", held)
        poles = wb.fit(tmp_path / f"{name}.mat", order=4).poles
        assert np.sort_complex(poles) == pytest.approx(expected, rel=1e-9), name
    savemat(tmp_path / "empty.mat", {"x": F})
    savemat(tmp_path / "many.mat", {"H": np.ones((2, len(F)), dtype=np.complex128), "f": F})
    savemat(tmp_path / "axis.mat", {"f": F})
    savemat(tmp_path / "values.mat", {"H": response()})
    savemat(tmp_path / "longer.mat", {"H": np.ones((2, 1, len(F) + 1), dtype=np.complex128), "f": F})
    for name, said in (
        ("empty", "holds no response"), ("axis", "holds no response"), ("values", "holds no response"),
        ("many", "one response is needed"), ("longer", "one response is needed"), ("none", "no such file"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            wb.fit(tmp_path / f"{name}.mat")


def test_pairs_of_poles_are_the_factors_of_their_polynomial() -> None:
    poles = np.array([-3.0 + 20.0j, -3.0 - 20.0j, 0.5 + 0.1j, 0.5 - 0.1j, -1.0, -0.5, -7.0], dtype=np.complex128)
    pairs, single = paired(poles)
    assert single is not None
    product = np.array([1.0, single])
    for a1, a0 in pairs:
        product = np.polymul(product, [1.0, a1, a0])
    assert product == pytest.approx(np.poly(poles).real, rel=1e-12)


def test_tables_say_their_units(tmp_path: Path) -> None:
    columns = {
        "w,real,imag": (2.0 * np.pi * F, response().real, response().imag),
        "frequency [rad/s],gain,phase [rad]": (2.0 * np.pi * F, np.abs(response()), np.angle(response())),
        "frequency [Hz],gain,phase": (F, np.abs(response()), np.degrees(np.angle(response()))),
    }
    path = tmp_path / "response.csv"
    for heading, values in columns.items():
        np.savetxt(path, np.column_stack(values), delimiter=",", header=heading, comments="", fmt="%.17g")
        poles = wb.fit(path, order=4).poles
        assert np.sort_complex(poles) == pytest.approx(np.sort_complex(POLES), rel=1e-6), heading
    np.savetxt(path, np.column_stack([F, F, F]), delimiter=",", header="frequency [d],gain,phase", comments="")
    with pytest.raises(InputError, match="frequency is in 'd'; known: hz"):
        wb.fit(path)
