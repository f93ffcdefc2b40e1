"""The published table of linearised blocks (source report, chapter 3.3), to every digit."""

from __future__ import annotations

import pytest

from tests.lin_fmus import fmu
from workbench.analysis.lin import lin
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.task import Width
from workbench.model import load

C, D = (0.6407, 0.6794), 0.43
SUM = sum(C)
# 0.1 wide where it reaches the block
DX, DU = [0.1 / c for c in C], 0.1 / D


def linearised(name: str, x0: list[float], u0: float, dx: Width, du: Width, method: str = "difference") -> LinResult:
    with load(fmu(name), "me") as model:
        states = dict(zip([v.name for v in model.states], x0, strict=True))
        return lin(model, x0=states, u0={"u": u0}, dx=dx, du=du, method=method).result


@pytest.mark.parametrize(
    ("name", "x0", "u0", "dx", "du", "c", "d", "digits"),
    [
        ("Saturation", [1, 1], 1, [4, 2], 1, (0.132825, 0.0), 0.0, 6),
        ("Saturation", [0, 0], 0, [1, 1], 1, (0.6407, 0.6794), 0.43, 12),
        ("DeadBand", [0.5, 0.3], -2.5, [1, 2], 3, (0.62118, 0.490115), 0.315277, 6),
        ("Quantizer", [0, 0], 0, [5, 5], 5, (0.6, 0.6), 0.4, 12),
        ("GainScheduler", [1, 1], 1, [2, 3], 10, (1.9221, 2.7692), 1.21002, 5),
    ],
    ids=["2-1", "2-1b", "2-3", "2-4", "2-5"],
)
def test_blocks(
    name: str, x0: list[float], u0: float, dx: list[float], du: float, c: tuple[float, ...], d: float, digits: int
) -> None:
    result = linearised(name, x0, u0, dx, du)
    assert result.C[0] == pytest.approx(c, abs=0.51 * 10.0**-digits)
    assert result.D[0, 0] == pytest.approx(d, abs=0.51 * 10.0**-digits)
    assert result.A.tolist() == [pytest.approx([-0.51, -0.42]), pytest.approx([0.5, 0.0])]
    assert result.B.ravel() == pytest.approx([1.0, 0.0])
    assert (result.dt, result.method) == (0.0, "difference")


@pytest.mark.parametrize(("middle", "slope"), [(2.0, 6.20025), (1.577, 4.9003287)], ids=["2-2", "2-2b"])
def test_algebraic_expression(middle: float, slope: float) -> None:
    result = linearised("AlgebraicExpression", [1, 1], (middle - SUM) / D, DX, DU)
    assert result.C[0] / C == pytest.approx([slope, slope], rel=1e-9)
    assert result.D[0, 0] / D == pytest.approx(slope, rel=1e-9)


def test_hysteresis_becomes_a_lag() -> None:
    with load(fmu("Hysteresis"), "me") as model:
        start = {v.name: float(v.start or 0) for v in model.parameters}
    result = linearised("Hysteresis", [2], 1, 0.1, 0.1)
    omega, k = start["omegaC"], start["k"]
    found = [result.A[0, 0], result.B[0, 0], result.C[0, 0], result.D[0, 0]]
    assert found == pytest.approx([-omega, omega, k, 0.0], rel=1e-12)


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
