"""The motion that a frequency response reports is the one that the model reaches from its operating point."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import workbench as wb
from scripts.promises.motion import KINDS, Oscillator, Trial, measure, oscillators, truth_of
from tests.lin_fmus import built

HERE: dict[str, Any] = {"in_process": True, "drift_check": False}

# Of the issue: the linear motion stays below the wall, but the model does not come to it.
WALL = Oscillator(
    "wall", {"z": 0.09123493791496548, "gap": 0.6485985872832047, "r": 0.8765060656901087}, 0.52389, 4.169
)


def test_a_motion_that_is_not_reached_is_named_beside_the_one_that_is() -> None:
    truth = truth_of(WALL)
    with WALL.model() as model:
        found = wb.nfr(model, "u", "y", frequencies=[WALL.frequency], amplitudes=[WALL.amplitude], **HERE)
    assert truth is not None
    assert truth.order == 2
    assert found.status == (("averaged",),)
    assert abs(found.response[0, 0] / truth.response - 1.0) <= found.error[0, 0] <= 0.01
    certificate = found.certificates[0][0]
    assert certificate is not None
    assert certificate.reached == "run"
    w = 2.0 * math.pi * WALL.frequency
    linear = 1.0 / (1.0 - w * w + 2j * WALL.values["z"] * w)
    assert certificate.other_gain == pytest.approx(abs(linear), rel=1e-5)
    assert certificate.other_phase_deg == pytest.approx(math.degrees(np.angle(linear)), abs=1e-3)
    assert "which the model does not come to from its operating point" in found.warnings[1]
    again = wb.NfrResult.from_dict(found.to_dict())
    assert again.certificates == found.certificates


# Of the random ones those whose truth is quick: subharmonics of order 2 and 5, one among two stable motions, others.
CHOSEN = (1, 2, 10, 11, 13, 18, 22, 24, 34, 37)


@pytest.mark.parametrize("number", CHOSEN)
def test_random_oscillators_do_what_is_reported(number: int) -> None:
    oscillator = list(oscillators(6, 1))[number]
    trial = measure(oscillator, truth_of(oscillator))
    assert trial.verdict in ("settled, right", "averaged, within its error"), trial


def test_all_kinds_are_among_them() -> None:
    every = list(oscillators(6, 1))
    assert {every[n].kind for n in CHOSEN} == set(KINDS)


def test_what_has_no_events_and_is_linear_along_its_run_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("workbench.response.nfr.job.run_point", refused)
    with wb.load("fmu:Aircraft") as model:
        found = wb.nfr(model, "elevator", "z_front_fuselage", [2.0, 3.0, 7.0], [1e-3], **HERE)
    assert {c.reached for c in found.certificates[0] if c is not None} == {"contracts"}
    assert found.status == (("settled",) * 3,)


HIDDEN = """model Hidden
  input Real u(start = 0); output Real o;
  Real x(start = 0, fixed = true); Real v(start = 0, fixed = true);
equation
  der(x) = v; o = x;
  der(v) = u - 0.04*v - x - noEvent(if x > 0.15 then 3*(x - 0.15) else 0);
end Hidden;
"""


def test_a_stop_without_an_event_is_seen_where_the_run_meets_it() -> None:
    """The motion of the linear model stays within the gap, and its transient does not."""
    with wb.load(built(HIDDEN, "Hidden"), tolerance=1e-8) as model:
        found = wb.nfr(model, "u", "o", [0.45], [0.9], **HERE)
        settled = wb.nfr(model, "u", "o", [0.45], [0.9], method="settle", max_periods=200, **HERE)
    certificate = found.certificates[0][0]
    assert certificate is not None
    assert certificate.reached == "run"
    assert abs(found.response[0, 0] / settled.response[0, 0] - 1.0) <= found.error[0, 0] + settled.error[0, 0]


def test_what_is_not_known_is_said() -> None:
    """Two periods, and two more, of a run that comes to rest in hundreds do not show where it ends."""
    slow = Oscillator("stops", {"z": 0.004, "gap": 0.5, "gap2": 0.7, "k": 20.0}, 0.3, 1.5)
    trial: Trial = measure(slow, None, max_periods=2)
    assert trial.status != "settled"
    assert not trial.error < 0.01
