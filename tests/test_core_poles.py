"""One pole, one frequency: the convention, and that every command keeps it."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.cli.app import run
from workbench.core.values.poles import (
    continuous,
    damped_frequency_hz,
    damping_ratio,
    natural_frequency_hz,
    pole_keys,
    pole_rows,
)
from workbench.point.modes.request import modes
from workbench.system.connect import connect

PORTS = '[inputs]\nu = "plant.u"\n[outputs]\ny = "plant.y"\n'

# ζ = 0.6, ω0 = 10 rad/s: s = −6 ± 8j; natural 10/2π = 1.59155 Hz, damped 8/2π = 1.27324 Hz.
PAIR = [-6.0 + 8.0j, -6.0 - 8.0j]
NATURAL, DAMPED = 10.0 / (2.0 * np.pi), 8.0 / (2.0 * np.pi)


def test_the_three_numbers_of_a_pair() -> None:
    assert natural_frequency_hz(PAIR) == pytest.approx([NATURAL, NATURAL])
    assert damped_frequency_hz(PAIR) == pytest.approx([DAMPED, DAMPED])
    assert damping_ratio(PAIR) == pytest.approx([0.6, 0.6])


@pytest.mark.parametrize(
    ("pole", "natural", "ratio", "damped"),
    [
        (-3.0, 3.0, 1.0, 0.0),
        (3.0, 3.0, -1.0, 0.0),
        (3.0 + 4.0j, 5.0, -0.6, 4.0),
        (2.0j, 2.0, 0.0, 2.0),
        (0.0, 0.0, np.nan, 0.0),
    ],
)
def test_real_unstable_undamped_poles_and_one_at_zero(
    pole: complex, natural: float, ratio: float, damped: float
) -> None:
    assert float(natural_frequency_hz(pole)) * 2.0 * np.pi == pytest.approx(natural)
    assert float(damping_ratio(pole)) == pytest.approx(ratio, nan_ok=True)
    assert float(damped_frequency_hz(pole)) * 2.0 * np.pi == pytest.approx(damped)


@pytest.mark.parametrize("dt", [0.001, 0.05, 0.3])
def test_discrete_poles_are_those_of_the_continuous_model_behind_them(dt: float) -> None:
    s = np.array([*PAIR, -2.0, 1.0])
    assert continuous(np.exp(s * dt), dt) == pytest.approx(s)


def test_the_numbers_are_those_of_python_control() -> None:
    for dt in (0.0, 0.05):
        system = control.ss(control.tf([1.0], [1.0, 12.0, 100.0]))
        plant = control.sample_system(system, dt) if dt else system
        omega, ratio, _ = control.damp(plant, doprint=False)
        poles = continuous(np.linalg.eigvals(plant.A), dt)
        assert np.sort(natural_frequency_hz(poles)) == pytest.approx(np.sort(omega) / (2.0 * np.pi))
        assert np.sort(damping_ratio(poles)) == pytest.approx(np.sort(ratio))


def test_rows_of_a_table_are_slowest_first_with_the_sign_of_damping() -> None:
    rows = pole_rows([3.0 + 4.0j, 3.0 - 4.0j, -1.0, 1e-14, -20.0], 0.0)
    assert [r.pole for r in rows] == [1e-14, -1.0, 3.0 + 4.0j, 3.0 - 4.0j, -20.0]
    assert [r.damping for r in rows] == ["-", "1", "-0.6", "-0.6", "1"]
    assert [r.natural for r in rows] == ["0", "0.15915", "0.79577", "0.79577", "3.1831"]
    assert [r.damped for r in rows] == ["0", "0", "0.63662", "0.63662", "0"]


def test_a_discrete_pole_at_zero_is_a_delay() -> None:
    rows = pole_rows([1e-13, 0.5, 1.0], 0.1)
    assert [(r.pole, r.natural, r.damping) for r in rows] == [
        (1.0, "0", "-"), (0.5, f"{np.log(2.0) / 0.1 / 2.0 / np.pi:.5g}", "1"), (1e-13, "delay", "-"),
    ]  # fmt: skip


# -- every command says the same of one pole ------------------------------------------------------


def test_lin_modes_and_feedback_say_the_same_of_one_pole() -> None:
    plant = control.ss(control.tf([1.0], [1.0, 12.0, 100.0]))
    with connect({"k": 1.0, "plant": plant}, [("plant.y", "k.u"), ("k.y", "plant.u")]) as system:
        (only,) = modes(system, vary="k.gain", values=[-44.0, 0.0, 62.75]).sets
    (mode,) = only.modes
    # ω0² = 100 − k, damped: ω0² − 36; at 62.75 it is 1.25² = 1.5625 from the real axis: ω0 = √37.25
    size = np.sqrt(100.0 - only.value)
    assert mode.natural_frequency_hz == pytest.approx(size / (2.0 * np.pi))
    assert mode.damped_frequency_hz == pytest.approx(np.sqrt(size**2 - 36.0) / (2.0 * np.pi))
    assert mode.frequency_hz.tolist() == mode.damped_frequency_hz.tolist()  # the name of version 0.1
    assert mode.damping == pytest.approx(6.0 / size)
    written = only.to_dict()
    assert written["natural_frequency_hz"] == [mode.natural_frequency_hz.tolist()]
    assert written["damped_frequency_hz"] == written["frequency_hz"] == [mode.damped_frequency_hz.tolist()]


@needs_gemseo
def test_the_commands_show_one_frequency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Mass_Damper: ω0 = 100 rad/s whatever the damper does; ζ = d/200, 0.6 for 120 N·s/m."""
    fmu, out = str(gemseo_fmu("Mass_Damper")), str(tmp_path / "out.json")
    assert run(["lin", fmu, "--set", "damper.d=120", "--json", out]) == 0
    told = capsys.readouterr().out
    assert [line.split()[-3:] for line in told.splitlines() if "-60 " in line] == [["15.915", "0.6", "12.732"]] * 2
    lin = json.loads(Path(out).read_text(encoding="utf-8"))
    assert lin["natural_frequency_hz"] == pytest.approx([100.0 / 2.0 / np.pi] * 2)
    assert lin["damping"] == pytest.approx([0.6] * 2)
    assert lin["damped_frequency_hz"] == pytest.approx([80.0 / 2.0 / np.pi] * 2)
    page = str(tmp_path / "page.html")
    assert run(["modes", fmu, "--vary", "damper.d=10,120", "--json", out, "--report", page]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "mode natural first [Hz] last [Hz] damping first [%] last [%]" in told
    assert "1 15.92 15.92 5 60" in told
    (found,) = json.loads(Path(out).read_text(encoding="utf-8"))["sets"]
    assert found["natural_frequency_hz"][0] == pytest.approx([100.0 / 2.0 / np.pi] * 2, rel=1e-6)
    assert found["frequency_hz"][0][1] == pytest.approx(80.0 / 2.0 / np.pi, rel=1e-6)


@pytest.mark.parametrize("ratio", [0.2, -0.2])
@pytest.mark.parametrize("dt", [0.0, 0.01])
def test_the_sign_of_damping_in_table_and_page(
    ratio: float, dt: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """1/(s² + 2ζ·2π s + (2π)²), continuous and sampled: what decays is positive, what grows is negative."""
    omega = 2.0 * np.pi
    model = control.ss(control.tf([1.0], [1.0, 2.0 * ratio * omega, omega**2]))
    model = control.sample_system(model, dt) if dt else model
    matrices = ", ".join(f"{n} = {np.asarray(getattr(model, n)).tolist()}" for n in "ABCD")
    system = tmp_path / "system.toml"
    system.write_text(f"[components]\nplant = {{{matrices}, dt = {dt}}}\n{PORTS}", encoding="utf-8")
    assert run(["lin", str(system), "--report", str(tmp_path / "page.html")]) == 0
    rows = [line.split()[-3:] for line in capsys.readouterr().out.splitlines() if "j  " in line]
    assert rows == [["1", f"{ratio:g}", "0.9798"]] * 2  # √(1 − 0.04)
    page = " ".join((tmp_path / "page.html").read_text(encoding="utf-8").split())
    assert f"is at 1 Hz (natural), damping ratio {ratio:g}." in page
    assert ("2 poles in the right half-plane" in page) == (ratio < 0.0)


@pytest.mark.parametrize(
    ("dt", "pole", "words"),
    [
        (0.001, 1.0 + 1.4e-9, "1 pole on the boundary of stability."),  # what rounding makes of an integrator
        (0.001, 1.0 - 1.4e-9, "1 pole on the boundary of stability."),
        (0.001, 1.0 + 1e-7, "1 pole in the right half-plane."),
        (0.0, 1e-12, "1 pole on the boundary of stability."),
        (0.0, 1e-5, "1 pole in the right half-plane."),
    ],
)
def test_a_pole_on_the_boundary_is_not_counted_as_unstable(
    dt: float, pole: float, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = tmp_path / "system.toml"
    matrices = f"A = [[{pole!r}, 0.0], [0.0, -0.5]], B = [[1.0], [1.0]], C = [[1.0, 1.0]], D = [[0.0]], dt = {dt}"
    system.write_text(f"[components]\nplant = {{{matrices}}}\n{PORTS}", encoding="utf-8")
    assert run(["lin", str(system)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"1 output. {words}" in said
    assert said.count("1 pole") == 1


def test_the_page_names_the_oscillation_with_the_least_damping_ratio(tmp_path: Path) -> None:
    """Neither the slowest mode nor that with the smallest real part: ζ = 0.3, 0.02, 0.1 at 0.1, 10, 1 Hz."""
    blocks = [
        np.array([[0.0, 1.0], [-((2.0 * np.pi * f) ** 2), -4.0 * np.pi * f * ratio]])
        for f, ratio in ((0.1, 0.3), (10.0, 0.02), (1.0, 0.1))
    ]
    A = block_diag(*blocks).tolist()
    B, C = [[0.0], [1.0]] * 3, [[1.0, 0.0] * 3]
    system = tmp_path / "system.toml"
    system.write_text(f"[components]\nplant = {{A = {A}, B = {B}, C = {C}}}\n{PORTS}", encoding="utf-8")
    assert run(["lin", str(system), "--report", str(tmp_path / "page.html")]) == 0
    page = " ".join((tmp_path / "page.html").read_text(encoding="utf-8").split())
    assert "The oscillation damped least is at 10 Hz (natural), damping ratio 0.02." in page


def test_a_slow_pole_is_not_at_rest_and_a_fast_discrete_one_is_not_a_delay() -> None:
    """Only what rounding leaves counts as 0: a pole a million times slower than the fastest has a frequency."""
    keys = pole_keys([-1.0, -1e-6, -1e-12], 0.0)
    assert keys["damping"] == [1.0, 1.0, None]
    assert keys["natural_frequency_hz"] == pytest.approx([1.0 / (2.0 * np.pi), 1e-6 / (2.0 * np.pi), 0.0], abs=1e-18)
    keys = pole_keys([0.05, 1e-4, 1e-8], 0.1)  # ln(z)/dt; the last is over within a sample
    expected = [float(-np.log(z)) / 0.1 / (2.0 * np.pi) for z in (0.05, 1e-4)]
    assert keys["natural_frequency_hz"][:2] == pytest.approx(expected, rel=1e-12)
    assert keys["damping"] == [1.0, 1.0, None]
    assert [row.natural for row in pole_rows([1e-8, 0.05], 0.1)][-1] == "delay"
