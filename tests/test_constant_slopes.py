"""Derivative of the period map where the slopes are the same all along: as from slopes that differ by nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.response.periodic import monodromy
from workbench.response.periodic.monodromy import tangent


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("seed", range(12))
def test_one_exponential_and_its_powers_give_what_many_do(
    monkeypatch: pytest.MonkeyPatch, seed: int, order: int
) -> None:
    chance = np.random.default_rng(seed)
    n, k, period = int(chance.integers(6, 12)), 64, 10.0 ** chance.uniform(-2.0, 0.5)
    A = 3.0 * chance.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.1) * np.eye(n)
    slopes: Any = SimpleNamespace(
        x=np.zeros((k + 1, n)), A=np.repeat(A[None], k + 1, 0), dx=chance.normal(size=(k + 1, n)),
        C=np.repeat(chance.normal(size=(1, 1, n)), k + 1, 0),
    )  # fmt: skip
    unit = 10.0 ** chance.uniform(-2.0, 2.0, n)
    once = tangent(slopes, period, unit, order)
    monkeypatch.setattr(monodromy, "_FEW", n)
    many = tangent(slopes, period, unit, order)
    assert once is not None
    assert many is not None
    for name in ("Phi", "rows", "stretch", "through"):
        truth = getattr(many, name)
        assert getattr(once, name) == pytest.approx(truth, rel=1e-8, abs=1e-9 * np.abs(truth).max())
