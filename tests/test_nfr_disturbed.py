"""Models that move by themselves: what the input does is told apart, and the error holds the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from scripts.promises.disturbed import KINDS, build, trials
from tests.fakes import FakeModel, FakeSession, Rows, forcing
from tests.platforms import needs_module
from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, InputError
from workbench.response.nfr.result import NfrResult
from workbench.session import Session
from workbench.signals.kinds import Sine

HERE = wb.Workers(in_process=True)
RIPPLE = math.sqrt(2.0) / (2.0 * math.pi)  # [Hz]


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the FMU of tests/modelica/Disturbed.mo, without pulses."""
    needs_module("rumoca", "build")
    return build(tmp_path_factory.mktemp("disturbed"), pulses=False)


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("method", ["auto", "settle"])
def test_a_ripple_inside_a_lag_is_no_part_of_its_response(disturbed: Path, interface: str, method: str) -> None:
    """1/(1 + s), a ripple of 1 % inside; at, within 1e-4 of and away from its frequency and its half."""
    near = RIPPLE * np.array([1.0, 1.0 + 1e-4, 1.0 - 3e-5, 1.001, 0.5, 0.5001])
    frequencies = [*near, 0.1, 0.2, 0.3, 1.0]
    values = {"share": 0.0, "a[1]": 0.01, "f[1]": RIPPLE}
    with wb.load(disturbed, interface, start_values=values) as model:
        found = wb.nfr(model, "u", "y", frequencies, 1.0, method=method, workers=HERE)
    off = np.abs(found.response[0] * (1.0 + 2j * math.pi * found.frequency_hz) - 1.0)
    assert np.all(off <= found.error[0])
    assert np.all(off < 1e-3)
    assert np.median(found.error[0]) < 3e-4  # the ripple alone is 1e-2
    assert {c.method for row in found.certificates for c in row if c is not None} == {"settled"}


def test_errors_hold_whatever_moves_the_model_from_within(tmp_path: Path) -> None:
    """One model of each kind and interface, some with a spring that hardens; see scripts/evidence.py disturbed."""
    needs_module("rumoca", "build")
    found = [t for *_, t in trials(tmp_path, 2 * len(KINDS), seed=7)]
    settled = [t for t in found if t.status == "settled"]
    assert len(settled) >= 0.8 * len(found)
    assert sum(t.true <= t.stated for t in settled) >= 0.95 * len(settled)
    assert np.median([t.stated / max(t.true, 1e-12) for t in settled]) < 100.0


@pytest.mark.parametrize("own", [{"a[1]": 0.01, "f[1]": 0.37}, {"ramp": 1e-3}, {"a[1]": 0.01, "seen": 1.0}])
def test_branches_of_a_model_that_changes_with_time_are_refused(disturbed: Path, own: dict[str, float]) -> None:
    """Else there were nine of a linear lag, some unstable."""
    with (
        wb.load(disturbed, "me", start_values=own) as model,
        pytest.raises(InputError, match="changes with time itself"),
    ):
        wb.branches(model, "u", "y", amplitudes=[1.0], band=(0.1, 0.4), workers=HERE)


def test_a_model_that_only_starts_away_from_rest_is_solved_for() -> None:
    """Its equations do not change with time: the transient is removed, not watched."""
    with wb.load("fmu:FirstOrderLag", "me", start_values={"x": 0.5}) as model:
        found = wb.nfr(model, "u", "y", [0.01, 0.3, 1.0], 1.0, workers=HERE)
    off = np.abs(found.response[0] * (1.0 + 2j * math.pi * found.frequency_hz) - 1.0)
    assert np.all(off <= found.error[0])
    assert {c.method for row in found.certificates for c in row if c is not None} == {"solved"}


class Moved(FakeSession):
    """y = 2u and what it does by itself, a function of time and of whether it is forced."""

    def __init__(self, own: Callable[[Floats, bool], Floats]) -> None:
        super().__init__()
        self.own = own

    def rows(self, time: Floats, sine: Sine) -> Rows:
        u = forcing(time, sine)
        return time, 2.0 * u + self.own(time, sine.amplitude > 0.0), u


def measured(own: Callable[[Floats, bool], Floats], interface: str = "cs") -> NfrResult:
    return wb.nfr(FakeModel(lambda: Moved(own), interface=interface), "u", "y", [1.0], 1.0, workers=HERE)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_what_lies_at_the_forcing_frequency_is_told_apart(interface: str) -> None:
    found = measured(lambda t, _: 0.1 * np.sin(2.0 * np.pi * t + 1.0), interface)
    assert abs(found.response[0, 0] - 2.0) <= 2.0 * found.error[0, 0] + 1e-12
    assert found.error[0, 0] < 1e-6


def test_a_pulse_that_comes_late_is_watched() -> None:
    found = measured(lambda t, _: np.where(np.abs(t - 5.3) < 0.1, 0.1, 0.0))
    assert found.zero_input is not None
    assert found.zero_input.movement == 0.0
    assert found.zero_input.most > 0.05
    assert abs(found.response[0, 0] - 2.0) <= 2.0 * found.error[0, 0] + 1e-12


def test_motion_that_the_forcing_takes_over_is_not_subtracted() -> None:
    """An oscillator that locks: by itself it swings at another frequency, forced at that of the forcing alone."""
    found = measured(lambda t, forced: np.zeros_like(t) if forced else np.sin(2.0 * np.pi * 1.37 * t))
    assert found.status == (("settled",),)
    assert found.response[0, 0] == pytest.approx(2.0, abs=1e-9)


def test_where_own_motion_changes_with_the_forcing_the_error_says_so() -> None:
    """A third of the own motion is left under the forcing, at the very frequency; harmonics tell of a bent model."""

    def own(t: Floats, forced: bool) -> Floats:
        swing = 0.03 * np.sin(2.0 * np.pi * t)
        return swing / 3.0 + 0.1 * np.sin(6.0 * np.pi * t) if forced else swing

    found = measured(own)
    assert abs(found.response[0, 0] - 2.0) <= 2.0 * found.error[0, 0]


def test_a_model_that_runs_once_at_a_time_has_its_own_motion_in_the_error() -> None:
    class Single(FakeModel):
        live = 0

        def open_session(self, **_: object) -> Session:
            if self.live:
                raise FmuError("one instance per process")
            self.live += 1
            return Ending(self)

    class Ending(Moved):
        def __init__(self, model: Single) -> None:
            super().__init__(lambda t, _: 0.01 * np.sin(2.0 * np.pi * t))
            self.model = model

        def close(self) -> None:
            self.model.live -= 1

    found = wb.nfr(Single(lambda: Moved(lambda t, _: t), interface="cs"), "u", "y", [1.0], 1.0, workers=HERE)
    assert abs(found.response[0, 0] - 2.0) == pytest.approx(0.01, rel=1e-3)
    assert abs(found.response[0, 0] - 2.0) <= 2.0 * found.error[0, 0] < 0.03
