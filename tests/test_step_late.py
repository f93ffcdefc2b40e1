"""What moves only after a test run has ended: the step check looks at the whole default experiment, or says not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.health.check import step as checked
from workbench.health.check.step import _late, _with_late
from workbench.health.check.subject import Trajectory

STEP, BEGINS = 0.2, 100.0  # [s]


def _subject(experiment: float, *, shorten: float = 1.0, fails: bool = False) -> Any:  # noqa: ANN401
    """A lag of 1 s by Euler's method whose input rises at 100 s, beside a constant: a test run lasts 50 s."""

    def run(_signals: Mapping[str, Any], *, step: float = STEP, points: Floats | None = None) -> Trajectory:
        time = STEP * np.arange(5.0, 251.0, 5.0) if points is None else points
        if fails and time[-1] > BEGINS:
            raise SimulationError("y is not a finite number")
        late = np.maximum(time - BEGINS, 0.0)
        return Trajectory(time, np.column_stack([np.ones_like(time), 1.0 - (1.0 - step) ** (late / step)]))

    return SimpleNamespace(
        step=STEP, own_step=STEP, experiment=experiment, shorten=shorten, steps=250, span=50.0, start=0.0,
        names=("still", "y"), run=run, constants=dict,
        model=SimpleNamespace(way_out=lambda *words: ", or ".join(words)),
    )  # fmt: skip


def test_what_moves_late_is_seen_by_its_closed_form() -> None:
    late = _late(_subject(120.0))
    t = STEP * np.unique(np.round(np.linspace(1.0, 600.0, 200)))
    after = np.maximum(t - BEGINS, 0.0)
    off = np.abs((1.0 - STEP) ** (after / STEP) - (1.0 - STEP / 2) ** (2.0 * after / STEP))
    assert late.change == pytest.approx(float(np.minimum(off[1:], off[:-1]).max()), rel=1e-3)
    assert late.moves
    assert late.words.startswith("over 120 s half of it changes y by ")


def test_a_change_of_more_than_a_percent_makes_a_good_step_one_to_watch() -> None:
    subject = _subject(120.0)
    late = _late(subject)
    assert late.change > 0.01
    assert _with_late(subject, late, "good", "")[0] == "watch"
    assert _with_late(subject, late, "broken", "x") == ("broken", "x")


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        (_subject(50.0), ""),
        (_subject(120.0, shorten=0.1), "only 50 s of 120 s were seen"),
        (_subject(120.0, fails=True), "only 50 s of 120 s were seen: the run fails later on"),
    ],
)
def test_what_is_not_seen_is_said(subject: Any, words: str) -> None:  # noqa: ANN401
    late = _late(subject)
    assert (late.words, math.isnan(late.change), late.moves) == (words, True, False)


def test_a_long_experiment_is_left_out_with_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked, "_AFFORDABLE", 0.0)
    assert _late(_subject(120.0)).words.startswith("only 50 s of 120 s were seen: all of it would take ")
