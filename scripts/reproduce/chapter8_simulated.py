"""The limit cycle in simulation, and the feedback that removes it: chapters 8.2 to 8.4 of the source report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from scripts.reproduce.targets import read_targets
from workbench.core.values.arrays import Floats
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.response.simulate.zero_crossings import rising_passes
from workbench.show.figure import COLOURS, rows
from workbench.signals.kinds import Table
from workbench.system.load import load

__all__ = ["EXPERIMENTS", "PULSE", "frequency", "peak"]


# -- frequency and amplitude of a recorded oscillation ---------------------------------------------


GRAVITY = 9.80665  # [m/s²]
PULSE = Table([0.0, 0.1, 0.1], [0.8, 0.8, 0.0])  # hinge moment [N·m]; the source report does not print its own
STOP = 260.0  # [s]
CLOSES = 140.0  # [s], the feedback
STEP = 0.005  # of the record [s]
POSITION, RATE = "outer_aileron_position", "outer_aileron_rate"
BETWEEN = 3.0  # [Hz]: neither the free aileron nor the limit cycle
WINDOW = 4.0  # over which a frequency is told [s]
_DEGREES = float(np.degrees(1.0))


def _run(name: str, outputs: Sequence[str]) -> SimulationResult:
    with load(f"system:{name}") as system:
        return simulate(system, stop=STOP, inputs={"pulse": PULSE}, outputs=outputs, interval=STEP)


def _cycle() -> Measurement:
    names = ("z_wing_tip", "z_wing_tip_acceleration", "z_front_fuselage", "z_front_fuselage_acceleration")
    run = _run("failed_aileron", (POSITION, RATE, *names))
    late = run.time > STOP - 40.0
    size = {name: peak(values[late]) for name, values in run.signals.items()}
    told = _frequencies(run.time, run.signals[RATE])
    cockpit = "z_front_fuselage_acceleration"
    comfort = _run("failed_aileron_comfort", [cockpit])
    before = [_between(run, 10.0, 20.0), _between(run, 50.0, 60.0)]
    return Measurement(
        {
            "cycle-frequency": frequency(run.time[late], run.signals[RATE][late]),
            "cycle-rate": size[RATE],
            "cycle-rate-degrees": size[RATE] * _DEGREES,
            "cycle-position": size[POSITION] * _DEGREES,
            "cycle-wing-tip": size["z_wing_tip"],
            "cycle-wing-tip-acceleration": size["z_wing_tip_acceleration"] / GRAVITY,
            "cycle-cockpit": size["z_front_fuselage"],
            "cycle-cockpit-acceleration": size["z_front_fuselage_acceleration"] / GRAVITY,
            "cycle-start": before,
            "cycle-start-range": before,
            "cycle-onset": float(next(t for t, f in told if f < BETWEEN)),
            "comfort-control": peak(comfort.signals[cockpit][comfort.time > STOP - 40.0]) / size[cockpit],
        },
        pictures=[
            Picture(
                (49,), "Rate and position of the outer aileron after a pulse on it.", lambda: _draw_cycle(run, told)
            )
        ],
    )


def _between(run: SimulationResult, begin: float, end: float) -> float:
    shown = (run.time > begin) & (run.time < end)
    return frequency(run.time[shown], run.signals[RATE][shown])


def _frequencies(time: Floats, values: Floats) -> list[tuple[float, float]]:
    """Return (middle of a window [s], frequency in it [Hz]), one window after the other."""
    found = []
    for begin in np.arange(WINDOW, time[-1] - WINDOW, WINDOW / 2.0):
        shown = (time >= begin) & (time < begin + WINDOW)
        found.append((float(begin + WINDOW / 2.0), frequency(time[shown], values[shown])))
    return found


def _published() -> list[float]:
    """Return the published frequencies before and in the limit cycle [Hz]."""
    before, within = (np.atleast_1d(np.asarray(read_targets()[n].value)) for n in ("cycle-start", "cycle-frequency"))
    return [float(before[0]), float(within[0])]


def _draw_cycle(run: SimulationResult, told: Sequence[tuple[float, float]]) -> Figure:
    figure, (rate, position, hertz) = rows(3, title="Figure 49: the limit cycle in simulation")
    rate.plot(run.time, run.signals[RATE], color=COLOURS[0], linewidth=0.4)
    rate.set_ylabel("outer aileron, rate [rad/s]")
    position.plot(run.time, run.signals[POSITION] * _DEGREES, color=COLOURS[1], linewidth=0.4)
    position.set_ylabel("position [deg]")
    hertz.plot(*np.array(told).T, color="#444444", marker=".", linewidth=1.0)
    for value in _published():
        hertz.axhline(value, color=COLOURS[2], linestyle="--", linewidth=1.0)
        hertz.text(run.time[-1], value + 0.02, f"published {value:g} Hz", ha="right", va="bottom", fontsize=8.5)
    hertz.set(ylabel="frequency [Hz]", xlabel="time [s]", ylim=(2.5, 3.65))
    return figure


def _feedback() -> Measurement:
    names = (POSITION, RATE, "inner_aileron_position", "inner_aileron_rate")
    run = _run("failed_aileron_feedback", names)
    time, rate = run.time, run.signals[RATE]
    before = peak(rate[(time > CLOSES - 10.0) & (time < CLOSES)])
    inner = {name: float(np.max(np.abs(run.signals[name]))) * _DEGREES for name in names[2:]}
    return Measurement(
        {
            "feedback-left": peak(rate[time > CLOSES + 60.0]) / before,
            "feedback-deflection": inner["inner_aileron_position"],
            "feedback-rate": inner["inner_aileron_rate"],
        },
        pictures=[
            Picture(
                (50,),
                "Gain −1 from the outer aileron's position to the inner aileron, closed at 140 s.",
                lambda: _draw_feedback(run.time, {name: run.signals[name] for name in names}),
            )
        ],
    )


def _draw_feedback(time: Floats, signals: Mapping[str, Floats]) -> Figure:
    figure, axes = rows(4, title="Figure 50: feedback closed at 140 s")
    figure.set_size_inches(7.2, 7.6)
    texts = ("outer position [deg]", "outer rate [deg/s]", "inner position [deg]", "inner rate [deg/s]")
    for number, (ax, (_, values), text) in enumerate(zip(axes, signals.items(), texts, strict=True)):
        ax.plot(time, values * _DEGREES, color=COLOURS[number], linewidth=0.6)
        ax.axvline(CLOSES, color="#444444", linestyle=":", linewidth=1.0)
        ax.set_ylabel(text)
    axes[-1].set(xlabel="time [s]", xlim=(100.0, 220.0))
    figure.align_ylabels(axes)
    return figure


EXPERIMENTS = (
    Reproduction(
        "limit cycle simulated",
        (
            "cycle-frequency",
            "cycle-rate",
            "cycle-rate-degrees",
            "cycle-position",
            "cycle-wing-tip",
            "cycle-wing-tip-acceleration",
            "cycle-cockpit",
            "cycle-cockpit-acceleration",
            "cycle-start",
            "cycle-start-range",
            "cycle-onset",
            "comfort-control",
        ),
        _cycle,
        6.0,
    ),
    Reproduction("feedback closed", ("feedback-left", "feedback-deflection", "feedback-rate"), _feedback, 3.5),
)


def peak(values: Floats) -> float:
    """Return half the range.

    Args:
        values: shape (n,).
    """
    return float(np.ptp(values)) / 2.0


def frequency(time: Floats, values: Floats) -> float:
    """Return the mean frequency between the first and the last rising crossing of the middle [Hz]; NaN without two.

    Args:
        time: shape (n,), rising [s].
        values: shape (n,).
    """
    moved = values - (values.max() + values.min()) / 2.0
    at = rising_passes(time, moved)
    if len(at) < 2:
        return float("nan")
    return float((len(at) - 1) / (at[-1] - at[0]))
