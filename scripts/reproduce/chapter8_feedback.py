"""Scalar feedback over its gain: chapter 8.5 of the source report."""

from __future__ import annotations

from matplotlib.figure import Figure

from scripts.reproduce.drawings import titled
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from workbench.limit_cycles.feedback.request import feedback
from workbench.limit_cycles.feedback.result import FeedbackResult
from workbench.limit_cycles.feedback.settling import SettlingStudy
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]

POSITION, RATE = "aircraft.outer_aileron_position", "aircraft.outer_aileron_rate"
TARGET = "aircraft.inner_aileron"
GAINS = 15  # of the settling study


def _over_gains(source: str, *, settle: bool = False, threshold: float = 0.01) -> FeedbackResult:
    with load("system:failed_aileron") as system:
        return feedback(system, source=source, target=TARGET, settle=settle, threshold=threshold, count=GAINS)


def _position() -> Measurement:
    result = _over_gains(POSITION)
    (low, high), *others = result.stable_gains or ((float("nan"), float("nan")),)
    left = [cycle for at in result.cycles for cycle in at.cycles]
    several = {"position-gains": f"and {len(others)} further intervals"} if others else {}
    crossings = sorted(1.0 / c.gain for c in result.crossings if low <= c.gain <= high)
    return Measurement(
        {
            "position-gains": [low, high],
            "position-crossings": crossings,
            "position-cycles": float(sum(bool(cycle.stable) for cycle in left)),
        },
        {**several, "position-cycles": f"at {len(result.cycles)} gains; unstable ones: {len(left)}"},
        [
            Picture(
                (52,),
                "Outer aileron's position over the inner aileron: all, and around its crossings of the real axis.",
                lambda: titled(result.plot_nyquist(), "Figure 52: outer aileron's position over inner aileron"),
            ),
            Picture(
                (53,),
                "What the damper sees with four feedback gains.",
                lambda: titled(result.plot_cycles(), "Figure 53: linear part with four feedback gains"),
            ),
        ],
    )


def _rate() -> Measurement:
    result = _over_gains(RATE)
    negative = [pair for pair in result.stable_gains if pair[0] < 0.0]
    positive = [pair for pair in result.stable_gains if pair[1] > 0.0]
    gains = [c.gain for c in result.crossings if c.gain < 0.0]
    return Measurement(
        {
            "rate-crossings": float(len(gains)),
            "rate-gains-negative": float(len(negative)),
            "rate-gains-positive": float(len(positive)),
        },
        {"rate-crossings": "at gains " + ", ".join(f"{g:.4g}" for g in gains), "rate-gains-positive": result.words},
        [
            Picture(
                (51,),
                "Outer aileron's rate over the inner aileron: all, and around its crossings of the real axis.",
                lambda: titled(result.plot_nyquist(), "Figure 51: outer aileron's rate over inner aileron"),
            )
        ],
    )


def _settling() -> Measurement:
    study, small = (_over_gains(POSITION, settle=True, threshold=part).settling for part in (0.01, 1e-5))
    if study is None or small is None or study.optimum is None or small.optimum is None:
        return Measurement({})
    return Measurement(
        {"settling-optimum": study.optimum, "settling-optimum-small": small.optimum},
        {},
        [Picture((), "Time until the motion has settled, over the feedback gain.", lambda: _draw(study))],
    )


def _draw(study: SettlingStudy) -> Figure:
    return titled(study.plot(), "Chapter 8.5: settling time over the feedback gain")


EXPERIMENTS = (
    Reproduction("position feedback", ("position-gains", "position-crossings", "position-cycles"), _position, 2.5),
    Reproduction("rate feedback", ("rate-crossings", "rate-gains-negative", "rate-gains-positive"), _rate, 1.5),
    Reproduction("settling study", ("settling-optimum", "settling-optimum-small"), _settling, 20.0),
)
