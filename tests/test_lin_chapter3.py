"""The published table of linearised blocks (source report, chapter 3.3), to every digit."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.reproduce.chapter3 import EXPERIMENTS, Example, examples, slopes
from scripts.reproduce.chapter3 import linearised as linearised_as_published
from scripts.reproduce.measurement import Reproduction
from scripts.reproduce.targets import read_targets
from tests.lin_fmus import fmu
from workbench.core.records.forms import Widths
from workbench.model.load import load
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult

EXAMPLES = examples()
TARGETS = read_targets()
C, D = np.array([0.6407, 0.6794]), 0.43  # in front of the blocks


def linearised(
    name: str, x0: list[float], u0: float, dx: Widths | None, du: Widths | None, method: str = "difference"
) -> LinResult:
    with load(fmu(name), "me") as model:
        states = dict(zip([v.name for v in model.states], x0, strict=True))
        return lin(model, x0=states, u0={"u": u0}, dx=dx, du=du, method=method).result


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda e: e.name)
def test_published_digits(experiment: Reproduction) -> None:
    """Each target is met, or it says why it cannot be and is not."""
    found = experiment.measure()
    for name in experiment.targets:
        assert TARGETS[name].accepts(found.values[name]) == (TARGETS[name].reason is None), name


@pytest.mark.parametrize("example", EXAMPLES.values(), ids=lambda e: e.name)
def test_dynamics_in_front_of_the_block_are_linear(example: Example) -> None:
    result = linearised_as_published(example)
    assert (result.dt, result.method) == (0.0, "difference")
    if example.name.startswith("2-"):
        assert result.A.tolist() == [pytest.approx([-0.51, -0.42]), pytest.approx([0.5, 0.0])]
        assert result.B.ravel() == pytest.approx([1.0, 0.0])


def test_every_example_is_there() -> None:
    names = ["2-1", "2-1b", "2-2", "2-2b", "2-3", "2-4", "2-5", "3.3.6", "3.3.7"]
    assert list(EXAMPLES) == names
    assert len(EXPERIMENTS) == len(names)


@pytest.mark.parametrize("name", ["2-2", "2-2b"])
def test_slope_of_the_polynomial_in_closed_form(name: str) -> None:
    """The derivative, and a tenth of the half width squared for the cubic term."""
    example = EXAMPLES[name]
    v = float(np.dot(C, example.x0) + D * example.u0)
    slope = 0.3 * v**2 + 2.0 * v + 1.0 + 0.1 * 0.05**2
    assert slopes(linearised_as_published(example)) == pytest.approx([slope] * 3, rel=1e-9)


@pytest.mark.parametrize("x2", [0.45, 0.5])
def test_small_nonlinear_system_is_exact(x2: float) -> None:
    result = linearised("SmallNonlinear", [0.45, x2], 0.45, [1.0, 0.2], None)
    found = [m.tolist() for m in (result.A, result.B, result.C, result.D)]
    assert found == [
        [pytest.approx([1.0, 1.0]), pytest.approx([1.0, 0.0])], [[pytest.approx(1.0)], [0.0]],
        [[0.0, pytest.approx(1.0)]], [[0.0]],
    ]  # fmt: skip


@pytest.mark.parametrize("method", ["difference", "exact"])
@pytest.mark.parametrize("u0", [0.0, 0.3])
def test_a_quantiser_at_default_widths_is_flat_and_said_to_be(method: str, u0: float) -> None:
    result = linearised("Quantizer", [1, 1], u0, None, None, method)
    assert not result.C.any()
    assert not result.D.any()
    reasons = {d.column: d.reason for d in result.doubts}
    assert set(reasons) == {"x[1]", "x[2]", "u"}
    assert all("locally flat" in r for r in reasons.values())
    assert [(z.kind, z.name) for z in result.zeros] == [("output", "y")]


def test_a_jump_at_the_very_point_is_doubtful() -> None:
    # 0.43 u = 0.25 is where the quantiser steps; a difference there is 1e4 and more
    result = linearised("Quantizer", [0, 0], 0.25 / D, None, None)
    if result.D[0, 0]:
        assert any(d.column == "u" and "jump" in d.reason for d in result.doubts)
    else:
        assert any(d.column == "u" and "flat" in d.reason for d in result.doubts)


def test_a_saturated_output_is_explained() -> None:
    result = linearised("Saturation", [1, 1], 1, None, None)
    assert "saturated" in result.zeros[0].reason
    assert "falls" in result.zeros[0].reason
