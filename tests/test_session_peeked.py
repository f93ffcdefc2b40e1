"""What an FMU of Dymola 2023x sees: an input that moved is noticed though outputs were read before the next step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.lying_fmus import build_lying
from workbench.core.values.arrays import Floats
from workbench.signals.kinds import Step


@pytest.mark.parametrize("connected", [False, True])
def test_an_input_that_moves_is_seen_though_outputs_were_read_since(connected: bool, tmp_path: Path) -> None:
    """Dymola 2023x: a value that is asked for after an input was set hides from the next step that the input moved."""
    found: list[list[Floats]] = []
    for lie in ("honest", "peeked"):
        fmu = build_lying(tmp_path, lie)
        if connected:
            model = wb.connect(
                {"first": wb.load(fmu, "cs"), "second": wb.load(fmu, "cs")},
                [("first.f", "second.u")],
                inputs={"u": "first.u"},
                outputs={"y": "second.y", "f": "second.f"},
            )
        else:
            model = wb.load(fmu, "cs")
        with model:
            run = wb.simulate(model, stop=2.0, inputs={"u": Step(time=0.5, value=1.0)}, outputs=["y", "f"])
            found.append([run.signals["y"], run.signals["f"]])
    assert np.ptp(found[0]) > 0.01
    assert np.allclose(found[1], found[0], rtol=0.0, atol=1e-12)
