"""The picture of a run from rest shows the frequencies that it says it shows."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.limit_cycles.limit_cycle.free_run import FreeRun
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
