"""The elevator law: chapters 6.1 and 6.2 of the source report."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.identification import PERIOD
from scripts.reproduce.law_widths import ELEVATOR, FREQUENCIES, LAW, PUBLISHED, STICK, WidthComparison, study
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from workbench.jobs.options import Workers
from workbench.point.lin.result import LinResult
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.show.figure import COLOURS, LEGEND, rows
from workbench.signals.kinds import Constant, Signal, Sine
from workbench.system.load import load

__all__ = ["EXPERIMENTS", "draw_widths"]

HERE = Workers(in_process=True)
FLAPS = range(5)
HALF = 0.5  # of the stick: a full one meets the limit of 15 degrees with flaps out
GENTLE, SLOW = 0.4, 100  # of the stick; samples of a period: below the rate limit and the bends of block 8
RATES = (0.5, 1.0, 2.0)  # [Hz], of figure 29
# A demand of 7 degrees on both sides for a full stick, without shape and offset.
SEVEN = {
    "positiveByFlap[1]": 7.0,
    "negativeByFlap[1]": 7.0,
    "positiveGain": 7.0,
    "negativeGain": 7.0,
    "stickOut[2]": -0.5,
    "stickOut[4]": 0.5,
    "offsetByFlap[1]": 0.0,
    "deflection": 0.0,
}


def _steady(stick: float = 0.0, **inputs: float) -> float:
    """Return the elevator after a minute of constant inputs [deg]; those not named keep their start values."""
    signals: dict[str, Signal] = {name: Constant(value) for name, value in {**inputs, STICK: stick}.items()}
    with load(LAW, "me") as law:
        result = simulate(law, stop=60.0, inputs=signals, outputs=[ELEVATOR], verify_step=False)
    return float(result.signals[ELEVATOR][-1])


def _factors(**settings: float) -> tuple[float, float]:
    """Return block 5's factors for negative and positive deflection [deg]; the shape of the stick's curve taken out."""
    neutral, shaped = _steady(**settings), _shaped()
    aft, forward = (abs(_steady(s, **settings) - neutral) / shaped for s in (-HALF, HALF))
    return aft, forward


@cache
def _shaped() -> float:
    """Return what block 8 makes of half a stick: its share of what the full stick gives."""
    neutral = _steady()
    return (_steady(-HALF) - neutral) / (_steady(-1.0) - neutral)


def _configurations() -> Measurement:
    by_flap = np.array([_factors(flap=float(flap)) for flap in FLAPS])
    both, one = _factors(), _factors(elevator_failed=1.0)
    return Measurement(
        {
            "law-gains": [by_flap.min(), by_flap.max()],
            "law-positive": by_flap[:, 1] / by_flap[:, 0],
            "law-ground": _factors(on_ground=1.0),
            "law-failed": one[1] / both[1],
            "law-never-limited": [_steady(s) for s in (-1.0, 1.0)],
        }
    )


def _unequal_gains() -> Measurement:
    """Measure the law's response to a sine that stays clear of every limit: both gains and the offset show in it."""
    with load(LAW) as law:
        result = nfr(law, STICK, ELEVATOR, [1.0 / (SLOW * PERIOD)], GENTLE, workers=HERE)
    found = {"mean": result.offset, "fundamental": result.gain, "delay": result.phase_deg}
    return Measurement({f"law-{name}": float(values[0, 0]) for name, values in found.items()})


def _rate_limiter() -> Measurement:
    with load(LAW, start_values=SEVEN) as law:
        result = nfr(law, STICK, ELEVATOR, RATES, 1.0, workers=HERE, drift_check=False)
    third = [c.harmonics[1] if c is not None else None for c in result.certificates[0]]
    return Measurement(
        {
            "limiter-fundamental": result.gain[0],
            "limiter-harmonic": [np.nan if h is None else h for h in third],
        },
        pictures=[
            Picture((28, 29), "Demand (dotted in figure 29's manner) and what the rate limiter passes.", _draw_limiter)
        ],
    )


def _draw_limiter() -> Figure:
    figure, axes = rows(len(RATES), title="Figure 29: effect of the rate limiter on a sine of 7 deg")
    for ax, frequency in zip(axes, RATES, strict=True):
        with load(LAW, start_values=SEVEN) as law:
            sine = Sine(amplitude=1.0, frequency=frequency)
            done = simulate(law, stop=4.0, inputs={STICK: sine}, outputs=[STICK, ELEVATOR], interval=0.004)
        ax.plot(done.time, 7.0 * done.signals[STICK], color="#444444", linewidth=1.2, label="asked for")
        ax.step(done.time, done.signals[ELEVATOR], color=COLOURS[1], linestyle=":", linewidth=2.0, label="passed")
        ax.set_ylabel("elevator [deg]")
        ax.text(0.01, 0.05, f"{frequency:g} Hz", transform=ax.transAxes, fontweight="bold")
    axes[-1].set_xlabel("time [s]")
    axes[0].legend(**{**LEGEND, "loc": "upper right"})
    return figure


# ── Figures 30 and 31 ────────────────────────────────────────────────────────────────────────────────────────────


def _widths() -> Measurement:
    done = study()
    shifts = {f: [abs(done.trials[name, f].phase_shift) for name in PUBLISHED] for f in FREQUENCIES}
    errors = [done.trials[name, FREQUENCIES[0]].error for name in PUBLISHED]
    fastest, half, slow = (shifts[f] for f in FREQUENCIES)
    fitted = done.trials["fitted", FREQUENCIES[0]].phase_shift
    return Measurement(
        {
            "law-period": done.models["30a"].dt,
            "law-equilibria": float(len(done.trim.null_directions)),
            "law-fourth-state": done.trim.operating_point.discrete["deflection"],
            "figure-31-untouched": _untouched([done.models[name] for name in PUBLISHED]),
            "figure-31-phase-5hz": fastest,
            "figure-31-phase-half-hz": np.divide(half, fastest),
            "figure-31-phase-slow": np.divide(slow, fastest),
            "figure-31-phase-best": [min(half) / min(fastest), min(slow) / min(fastest)],
            "figure-31-errors": np.diff(errors),
        },
        {
            "law-equilibria": done.trim.message,
            "figure-31-phase-5hz": f"a fifth set of ours, fitted to 5 Hz, has {fitted:+.2f} deg",
            "figure-31-phase-half-hz": _degrees(half),
            "figure-31-phase-slow": _degrees(slow),
            "figure-31-errors": "errors " + ", ".join(f"{100.0 * e:.1f}" for e in errors) + " %",
        },
        [
            Picture(
                (30, 31),
                "The four published sets of widths, and one so narrow that nothing is limited, beside the law.",
                lambda: draw_widths(done),
            )
        ],
    )


def _degrees(values: list[float]) -> str:
    return f"sets {', '.join(PUBLISHED)}: " + ", ".join(f"{x:.2f}" for x in values) + " deg"


def _untouched(models: list[LinResult]) -> float:
    """Return the largest difference between the models outside the fourth state and the fifth input."""
    kept = [np.vstack([np.hstack([m.A[:3, :3], m.B[:3, :4]]), np.hstack([m.C[:, :3], m.D[:, :4]])]) for m in models]
    return float(max(np.max(np.abs(other - kept[0])) for other in kept[1:]))


def draw_widths(result: WidthComparison) -> Figure:
    """Draw two periods of the law and of the published linear models at 5 Hz and at 0.5 Hz.

    Args:
        result: of the study.
    """
    figure, axes = rows(2, title="Figure 30: elevator law and its linear models, full stick")
    curves = {"30a": "30a, 30b", "30c": "30c", "30d": "30d", "narrow": "narrow widths (ours)"}
    for ax, frequency in zip(axes, FREQUENCIES, strict=False):
        law = result.trials["30a", frequency].law
        shown = law.time - law.time[0] < 2.0 / frequency + 1e-9
        turns = frequency * (law.time - law.time[0])[shown]
        ax.step(turns, law.values[shown], where="post", color="#222222", linewidth=2.2, label="law")
        for number, (name, text) in enumerate(curves.items()):
            wave = result.trials[name, frequency].linear
            style: dict[str, Any] = {
                "color": COLOURS[number],
                "linewidth": 1.4,
                "linestyle": ("-", "--", "-.", ":")[number],
            }
            ax.step(turns, wave.values[shown], where="post", label=text, **style)
        ax.set_ylabel(f"{ELEVATOR} [deg]")
        ax.text(0.01, 0.03, f"{frequency:g} Hz", transform=ax.transAxes, fontweight="bold")
    axes[-1].set_xlabel("time [periods]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8.5)
    return figure


EXPERIMENTS = (
    Reproduction(
        "law's configurations",
        ("law-gains", "law-positive", "law-ground", "law-failed", "law-never-limited"),
        _configurations,
    ),
    Reproduction("law's unequal gains", ("law-mean", "law-fundamental", "law-delay"), _unequal_gains),
    Reproduction("rate limiter", ("limiter-fundamental", "limiter-harmonic"), _rate_limiter),
    Reproduction(
        "widths of figure 31",
        (
            "law-period",
            "law-equilibria",
            "law-fourth-state",
            "figure-31-untouched",
            "figure-31-phase-5hz",
            "figure-31-phase-half-hz",
            "figure-31-phase-slow",
            "figure-31-phase-best",
            "figure-31-errors",
        ),
        _widths,
        2.0,
    ),
)
