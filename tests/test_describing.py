"""Describing functions: closed forms against quadrature, and a block that is measured."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from scripts.reproduce.targets import read_targets
from tests.test_validate_overlay import measured
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.loops.describing.describe import STANDARD, describing_function, standard_block
from workbench.loops.describing.formulas import FormulaBlock, relay
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.describing.static import StaticBlock, find_levels, pointwise
from workbench.system.connect import connect
from workbench.system.load import load

AMPLITUDES = (0.3, 0.8, 1.0, 1.5, 3.0, 10.0)
STATIC = [
    ("saturation", {"limit": 0.7, "slope": 2.0}),
    ("dead_band", {"width": 0.6}),
    ("quantiser", {"resolution": 0.5}),
    ("relay", {}),
    ("relay", {"dead_zone": 0.4}),
    ("preload", {"level": 0.3, "slope": -1.0}),
    ("quadratic", {"coefficient": 7000.0}),
    ("cubic", {"coefficient": 2.0}),
]


@pytest.mark.parametrize(("kind", "parameters"), STATIC)
def test_quadrature_is_the_closed_form(kind: str, parameters: dict[str, float]) -> None:
    """Levels are looked for by the numeric block and known to the other; relays and quantisers to the last digits."""
    block = standard_block(kind, parameters)
    assert isinstance(block, FormulaBlock)
    numeric = StaticBlock(block.static)
    for a in AMPLITUDES:
        assert abs(numeric.gain(a) - block.gain(a)) <= 1e-12 * max(1.0, abs(block.gain(a)))


@pytest.mark.parametrize(
    ("kind", "parameters", "error"),
    [
        ("relay_with_hysteresis", {"half_width": 0.2}, 2e-6),
        ("backlash", {"half_width": 0.2, "slope": 1.5}, 2e-7),
        ("rate_limiter", {"rate": 5.0}, 2e-4),
    ],
)
def test_what_runs_over_a_period_is_the_closed_form(kind: str, parameters: dict[str, float], error: float) -> None:
    block = standard_block(kind, parameters)
    for a in (0.15, 0.3, 0.8, 1.65, 2.0, 2.5, 3.0, 10.0):
        found = complex(block.harmonics(a, 0.5)[1] / (-1j * a))
        assert abs(found - block.gain(a, 0.5)) < error


def test_the_published_block() -> None:
    """Chapter 8.3: α₂ = 7000, N(A) = 5942 A."""
    found = standard_block("quadratic", {"coefficient": 7000.0}).gain(1.0).real
    assert read_targets()["describing-function"].accepts(found)


def test_harmonics_of_a_relay() -> None:
    """A square wave: 4M/πk for odd k."""
    found = np.abs(relay(2.0).harmonics(3.0))
    assert found == pytest.approx([0 if k % 2 == 0 else 8.0 / (math.pi * k) for k in range(8)], abs=1e-12)


def test_a_function_without_symmetry_has_a_mean() -> None:
    block = StaticBlock(lambda v: 0.1 * v**3 + v**2 + v + 3.0, centre=1.0)
    found = block.harmonics(0.5)
    # About 1: f(1 + a) − f(1) = 0.1 a³ + 1.3 a² + 3.3 a.
    assert found[0].real == pytest.approx(1.3 * 0.5**2 / 2.0, rel=1e-12)
    assert block.gain(0.5).real == pytest.approx(3.3 + 0.075 * 0.5**2, rel=1e-12)


def test_levels_are_found_and_smooth_functions_have_none() -> None:
    def kinked(v: Floats) -> Floats:
        return np.where(v > 0.31, 1.0, 0.0) + np.maximum(v + 0.7, 0.0) + np.sin(3.0 * v)

    assert find_levels(kinked, -1.0, 1.0) == pytest.approx([-0.7, 0.0, 0.31], abs=1e-7)
    assert list(find_levels(np.tanh, -4.0, 4.0)) == [0.0]
    assert list(find_levels(lambda v: v**3 - v, -16.0, 16.0)) == [0.0]


def test_a_block_of_a_system_is_called_point_by_point() -> None:
    block = StaticBlock(pointwise(lambda u: u[0] ** 3))
    assert block.gain(2.0).real == pytest.approx(3.0, rel=1e-12)


def test_measured_is_the_closed_form() -> None:
    """fmu:Saturation without its dynamics is a saturation."""
    with load("fmu:Saturation", start_values={"C[1]": 0.0, "C[2]": 0.0, "D": 1.0}) as model:
        found = describing_function(model, [0.5, 2.0], [1.0], workers=Workers(in_process=True))
    exact = [standard_block("saturation").gain(a).real for a in (0.5, 2.0)]
    assert found.method == "measured"
    assert found.gain[:, 0].real == pytest.approx(exact, rel=1e-3)
    assert np.abs(found.gain.imag).max() < 1e-3
    wanted = np.abs(standard_block("saturation").harmonics(2.0))
    assert found.harmonics[1, 0] == pytest.approx(wanted / wanted[1], abs=1e-3)
    assert found.harmonics[0, 0, 2:] == pytest.approx(0.0, abs=1e-3)


def test_a_response_of_which_one_point_failed_makes_no_block() -> None:
    response = measured(np.array([0.5, 1.0, 2.0]), {1.0: [2.0, math.nan, 1.0], 4.0: [1.0, 1.0, 1.0]})
    with pytest.raises(InputError, match="its response could not be measured"):
        MeasuredBlock(response)


def test_measured_in_a_box_with_dynamics_depends_on_the_frequency() -> None:
    """A lag after a saturation: N(A) / (1 + jω)."""
    with connect(
        {"s": lambda u: np.clip(u, -1.0, 1.0), "g": "fmu:FirstOrderLag"},
        [("s.y", "g.u")],
        inputs={"u": "s.u"},
        outputs={"y": "g.y"},
    ) as model:
        found = describing_function(model, [0.5, 2.0], [0.1, 0.3], errcrit=0.001, workers=Workers(in_process=True))
    exact = [[standard_block("saturation").gain(a) / (1.0 + 2j * math.pi * f) for f in (0.1, 0.3)] for a in (0.5, 2.0)]
    assert np.abs(found.gain - np.array(exact)).max() < 2e-3


def test_result_and_picture(tmp_path: Path) -> None:
    result = describing_function(standard_block("saturation"), np.geomspace(0.5, 10.0, 20))
    assert result.method == "closed form"
    assert result.minus_inverse[0, 0] == pytest.approx(-1.0)
    result.plot(tmp_path / "n.png")
    result.to_csv(tmp_path / "n.csv")
    assert (tmp_path / "n.csv").read_text(encoding="utf-8").count("\n") == 21
    assert result.to_dict()["gain"][0] == [1.0]


def test_mistakes_are_one_line() -> None:
    with pytest.raises(InputError, match="did you mean saturation"):
        standard_block("saturatoin")
    with pytest.raises(InputError, match="block relay"):
        standard_block("relay", {"limit": 1.0})
    with pytest.raises(InputError, match="give frequencies"):
        describing_function(standard_block("rate_limiter"), [1.0])
    with pytest.raises(InputError, match="positive"):
        describing_function(standard_block("relay"), [0.0])
    assert set(STANDARD) >= {"saturation", "dead_band", "quantiser", "relay", "preload", "rate_limiter"}


def test_parameters_of_standard_blocks_are_named() -> None:
    with pytest.raises(InputError, match="block relay: no parameter 'output'; known: dead_zone, level"):
        standard_block("relay", {"output": 2.0})
