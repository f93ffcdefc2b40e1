"""Nonlinear feed-forward: chapter 8.6 of the source report."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scripts.reproduce.chapter8_simulated import CLOSES, PULSE
from scripts.reproduce.drawings import titled
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from workbench.limit_cycles.feed_forward.design_step import FilterStep
from workbench.limit_cycles.feed_forward.request import feed_forward
from workbench.limit_cycles.feed_forward.result import FeedForwardResult
from workbench.limit_cycles.feed_forward.weighting import WEIGHTINGS
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]

ORDERS = (36, 29)  # of the reduced G and H
STOP = 220.0  # [s]
PARTS = (0.1, 0.05, 0.01)  # of the limit cycle, to which it settles

_PICTURES: Mapping[str, tuple[tuple[int, ...], str, str]] = {
    "reduced": ((55,), "Figure 55: filter before and after the reduction", "H/G and the reduced filter."),
    "compensation": ((56,), "Figure 56: G F and H", "What the filter makes of the control, and what it is to cancel."),
    "mirrored": (
        (57,),
        "Figure 57: filter before and after mirroring",
        "Mirroring keeps the gain and turns the phase.",
    ),
    "simulated": ((58,), "Figure 58: filter and scalar feedback in simulation", "Both closed at 140 s."),
    "error": ((59,), "Figure 59: error of the filter", "G F/H − 1."),
}


def _designed(
    *, orders: tuple[int, int] | None, simulated: bool = False, second: str | None = None, weighting: str = "absolute"
) -> FeedForwardResult:
    with load("system:failed_aileron") as system:
        return feed_forward(
            system,
            block="damper",
            target="aircraft.inner_aileron",
            second=second,
            weighting=weighting,
            feedback=("aircraft.outer_aileron_position", -1.0),
            orders=orders,
            inputs={"pulse": PULSE} if simulated else None,
            closes_at=CLOSES,
            stop=STOP,
            crude=simulated,
        )


def _filter() -> Measurement:
    free, result = _designed(orders=None), _designed(orders=ORDERS)
    steps = {step.name: step for step in result.steps}
    f = result.frequency_hz
    corner = int(np.argmin(np.abs(f - result.band[1])))
    kept = np.abs(steps["low-pass"].response / steps["sign"].response)[corner]
    return Measurement(
        {
            "feed-forward-orders": [float(r.order) for r in (free.design.G, free.design.H)],
            "feed-forward-joined": float(steps["joined"].order),
            "feed-forward-compensation": steps["joined"].residual,
            "feed-forward-cancelled": float(steps["cancelled"].order),
            "feed-forward-mirrored": float(_mirrored(steps["cancelled"])),
            "feed-forward-sign": float(steps["sign"].remark.startswith("changed")),
            "feed-forward-stable": float(len(steps["mirrored"].unstable_poles)),
            "feed-forward-cutoff": float(kept),
        },
        {
            "feed-forward-orders": f"with the published ones the filter is off by {_off(steps['joined'])}",
            "feed-forward-cancelled": steps["cancelled"].remark,
            "feed-forward-mirrored": steps["mirrored"].remark,
            "feed-forward-sign": steps["sign"].remark,
        },
        [_picture(result, name) for name in _PICTURES if name != "simulated"],
    )


def _tried() -> Measurement:
    result = _designed(orders=ORDERS, simulated=True)
    scalar, filtered, crude = result.trials
    return Measurement(
        {
            "feed-forward-left": float("nan") if filtered.rest is None else filtered.rest,
            "feed-forward-slower": [_ratio(filtered.settling_seconds[p], scalar.settling_seconds[p]) for p in PARTS],
            "feed-forward-escape": float(crude.divergence is not None and crude.divergence.kind == "finite escape"),
        },
        {
            "feed-forward-slower": "; ".join(result.notes[:1]),
            "feed-forward-escape": crude.failure,
        },
        [_picture(result, "simulated")],
    )


def _both_surfaces() -> Measurement:
    made = [_designed(orders=ORDERS, second="aircraft.elevator", weighting=error) for error in WEIGHTINGS]
    found = [result.shared for result in made if result.shared is not None]
    words = "; ".join(f"least {one.method} error: {100.0 * (1.0 - one.left / one.left_alone):.2g} %" for one in found)
    return Measurement(
        {
            "feed-forward-weight": [100.0 * one.weights[0] for one in found],
            "feed-forward-second": [100.0 * (1.0 - one.left / one.left_alone) for one in found],
        },
        {"feed-forward-second": words},
    )


def _off(step: FilterStep) -> str:
    return f"{step.gain_error_db:.2g} dB and {step.phase_error_deg:.2g} deg at most up to 5 Hz"


def _mirrored(step: FilterStep) -> int:
    """Return how many poles are right of the imaginary axis before they are mirrored."""
    return len(step.unstable_poles)


def _ratio(one: float | None, other: float | None) -> float:
    return float("nan") if one is None or other is None else one / other


def _picture(result: FeedForwardResult, name: str) -> Picture:
    figures, title, words = _PICTURES[name]
    return Picture(figures, words, lambda: titled(result.plot(figure=name), title))


EXPERIMENTS = (
    Reproduction(
        "feed-forward",
        (
            "feed-forward-orders",
            "feed-forward-joined",
            "feed-forward-compensation",
            "feed-forward-cancelled",
            "feed-forward-mirrored",
            "feed-forward-sign",
            "feed-forward-stable",
            "feed-forward-cutoff",
        ),
        _filter,
        2.0,
    ),
    Reproduction(
        "feed-forward simulated", ("feed-forward-left", "feed-forward-slower", "feed-forward-escape"), _tried, 9.0
    ),
    Reproduction("feed-forward of both surfaces", ("feed-forward-weight", "feed-forward-second"), _both_surfaces, 2.0),
)
