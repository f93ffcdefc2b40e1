"""Co-simulation parts solve for themselves: what their solvers leave is part of the error."""

from __future__ import annotations

from pathlib import Path

import pytest

import workbench as wb
from scripts.promises.cosimulation import Loop, trials
from tests.lying_fmus import build_lying


@pytest.mark.parametrize(
    ("loop", "step"),
    [
        (Loop(("me", "cs"), (2.6, 2.65), 2.67, 0.072), 5e-4),
        (Loop(("me", "cs"), (4.93, 3.41), 2.08, 0.301), 5e-4),
        (Loop(("cs", "me"), (0.5, 2.0), 1.0, 0.2), 1e-4),
    ],
)
def test_a_short_step_does_not_hide_what_the_parts_solvers_leave(tmp_path: Path, loop: Loop, step: float) -> None:
    """Their tolerance is 1e-6: halving a step below what they need changes nothing, a tighter tolerance does."""
    found = loop.measure(tmp_path / "loop.toml", step, 1e-6)
    assert found.true <= found.stated < 10.0 * found.true + 1e-5


def test_errors_hold_in_random_loops() -> None:
    found = [t for *_, t in trials(6, seed=11) if t.status == "settled"]
    assert len(found) >= 12
    assert sum(t.true <= t.stated for t in found) >= 0.95 * len(found)


@pytest.mark.parametrize(
    ("lie", "frequency", "told"), [("late-inputs", 2.5, True), ("euler", 2.5, False), ("honest", 20.0, False)]
)
def test_a_solver_that_nothing_shows_is_said_to_be_unknown(
    tmp_path: Path, lie: str, frequency: float, told: bool
) -> None:
    """Steps of 1 ms inside, whatever is asked; Euler's method at the communication step; Runge's, good to rounding."""
    with wb.load(build_lying(tmp_path, lie), "cs") as model:
        found = wb.nfr(model, "u", "y", [frequency], 1.0, workers=wb.Workers(in_process=True))
    assert any("own solver is unknown and not included" in w for w in found.warnings) == told
