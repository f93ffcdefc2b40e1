"""A run from rest sees the cycle wherever its input begins; its picture shows the frequencies that it says it shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.linalg import expm
from scipy.optimize import brentq

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.limit_cycles.limit_cycle.free_run import FreeRun, free_run
from workbench.limit_cycles.limit_cycle.picture_free_run import draw_frequency


@pytest.mark.parametrize("periods", [1, 8, 12, 60])
@pytest.mark.parametrize("marks", [{}, {0.2757: "crossing 1"}])
def test_the_frequency_lies_inside_the_picture_however_short_the_run(periods: int, marks: dict[float, str]) -> None:
    time = np.arange(periods) / 0.297
    run = FreeRun(
        signal="u", unit=None, time=np.linspace(0.0, time[-1] + 4.0, 50), value=np.zeros(50), period_time=time,
        frequency_hz=np.full(periods, 0.297), amplitude=np.exp(0.08 * time), spans=(),
    )  # fmt: skip
    ax = Figure().subplots()
    draw_frequency(ax, run, marks)
    low, high = ax.get_ylim()
    assert all(low < f < high for f in (0.297, *marks))


# A relay around 4 / (s (s + 1) (s + 4)).
RELAY = """
[components]
p = {A = [[0, 1, 0], [0, -1, 1], [0, 0, -4]], B = [[0], [0], [4]], C = [[1, 0, 0]]}
e = {sum = "+-"}
n = {block = "relay", lower = -1.0, upper = 1.0}
[connections]
"e.u2" = "p.y"
"n.u" = "e.y"
"p.u" = "n.y"
[inputs]
r = "e.u1"
"""


def test_the_cycle_is_seen_although_it_never_passes_where_the_run_begins(tmp_path: Path) -> None:
    """The input is 0.5 at once; the relay's cycle is the one whose state is turned round after half a period."""
    (tmp_path / "relay.toml").write_text(RELAY, encoding="utf-8")
    A, B = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -4.0]]), np.array([[0.0], [0.0], [4.0]])
    both = np.block([[A, B], [np.zeros((1, 4))]])  # the state and a constant input of 1

    def begins(half: float) -> Floats:
        """Return the state at a switch to +1 of the motion with this half period."""
        whole = expm(both * half)
        return np.asarray(np.linalg.solve(np.eye(3) + whole[:3, :3], -whole[:3, 3]))

    half = float(brentq(lambda h: begins(h)[0], 0.5, 5.0))
    course = [(expm(both * t) @ [*begins(half), 1.0])[0] for t in np.linspace(0.0, half, 2001)]
    with wb.load(tmp_path / "relay.toml") as model:
        pulse = wb.pulse(value=0.5, duration=0.1)
        found = free_run(model, "n.u", stop=60.0, inputs={"r": pulse}, fastest=1.0)
    assert found.frequency_hz[-5:] == pytest.approx(0.5 / half, rel=1e-4)
    assert found.amplitude[-5:] == pytest.approx(np.max(np.abs(course)), rel=1e-3)
