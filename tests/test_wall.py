"""What one FMU does to its process reaches nobody else, and whatever it answers is told in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

import workbench as wb
from tests.misbehaving_fmus import CALLS, build_misbehaving
from tests.platforms import posix_signals
from workbench.cli.app import run

pytestmark = posix_signals

# What a failure of these cannot change, or what is not needed to simulate.
_NO_MATTER = {"instantiate", "freeInstance", "terminate", "getFMUstate"}


@pytest.mark.parametrize(
    ("interface", "call"), [(i, c) for i, calls in CALLS.items() for c in calls if c not in _NO_MATTER]
)
def test_a_status_that_fmi_does_not_know_is_one_line(interface: str, call: str, tmp_path: Path) -> None:
    """Negative ones are no sign of the workbench's own, such as for a function that the binary does not have."""
    with (
        wb.load(build_misbehaving(tmp_path, "negative", call), interface) as model,
        pytest.raises(wb.SimulationError, match=r"fmi2\w+ returned -1") as caught,
    ):
        wb.simulate(model, stop=1.0, inputs={"u": wb.Sine(amplitude=1.0, frequency=2.0)})
    assert f"fmi2{call[0].upper()}{call[1:]}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_an_fmu_answers_out_of_the_standard_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for way, words in {"past": "(chattering)", "never": "fmi2NewDiscreteStates gave is not a number"}.items():
        assert run(["simulate", str(build_misbehaving(tmp_path, way, "nowhere")), "--stop", "1"]) == 2
        told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("workbench: ")]
        assert len(told) == 1
        assert words in told[0]
