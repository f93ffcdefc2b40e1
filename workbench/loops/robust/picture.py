"""Picture of a robustness analysis: µ over frequency, and the gain or the poles at the worst parameter set."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.core.values.decibels import decibels
from workbench.core.values.poles import continuous
from workbench.show.bode import log_axis
from workbench.show.figure import AXIS, COLOURS, LEGEND, UNSTABLE, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from workbench.loops.robust.result import RobustResult

__all__ = ["plot_robust"]

_NOTHING = 0.01  # a lower bound below it is of sets beyond a hundred times the ranges: a dot on the axis


def plot_robust(result: RobustResult) -> Figure:
    """Draw both bounds of µ over frequency, and beside them the worst-case gain or the poles.

    Args:
        result: of `robust`.
    """
    figure, ((left, right),) = panels(1, 2, title=f"{result.model}: {_title(result)}", width=9.6, height=4.0)
    _mu(left, result)
    if result.worst_gain is None:
        _poles(right, result)
    else:
        _gain(right, result)
    return figure


def _title(result: RobustResult) -> str:
    s = result.stability
    upper = f", unstable from {s.upper:.3g} times" if np.isfinite(s.upper) else ""
    return f"stable up to {s.lower:.3g} times the ranges{upper}" if s.lower > 0.0 else f"nothing is proved{upper}"


def _mu(ax: Axes, result: RobustResult) -> None:
    f = np.array([p.frequency_hz for p in result.mu])
    upper = np.array([p.upper for p in result.mu])
    lower = np.array([p.lower for p in result.mu])
    if len(f):
        ax.semilogx(
            f, np.where(np.isfinite(upper), upper, np.nan), color=COLOURS[0], linewidth=1.5, label="upper bound"
        )
        known = lower > _NOTHING
        if known.any():
            ax.semilogx(f[known], lower[known], ".", color=COLOURS[2], markersize=5, label="lower bound")
    worst = result.stability.worst
    if worst.unstable and worst.frequency_hz > 0.0:
        ax.semilogx(
            [worst.frequency_hz], [1.0 / worst.size], "o", color=COLOURS[1], markersize=6, label="unstable set found"
        )
    if len(f):  # after all that is drawn on a logarithmic axis
        log_axis(ax, float(f[0]), float(f[-1]))
    top = max(1.25, 1.1 * float(np.nanmax(np.where(np.isfinite(upper), upper, np.nan), initial=0.0)))
    ax.axhspan(1.0, top, **UNSTABLE)
    ax.axhline(1.0, **AXIS)
    ax.set_ylim(0.0, top)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("µ of the ranges")
    ax.legend(**{**LEGEND, "loc": "best"})


def _poles(ax: Axes, result: RobustResult) -> None:
    worst = result.stability.worst
    words = "unstable set" if worst.unstable else "slowest in the ranges"
    for poles, mark, colour, label in (
        (result.nominal_poles, "x", COLOURS[0], "middle of the ranges"), (worst.poles, "o", COLOURS[1], words),
    ):  # fmt: skip
        s = continuous(np.asarray(poles), result.dt)
        ax.plot(s.real, s.imag / (2.0 * np.pi), mark, color=colour, fillstyle="none", markersize=6, label=label)
    slow = np.abs(continuous(np.concatenate([result.nominal_poles, worst.poles]), result.dt))
    reach = 5.0 * float(np.abs(continuous(np.array([worst.pole]), result.dt))[0] or slow.min(initial=1.0))
    ax.set_xlim(-reach, 0.4 * reach)
    ax.set_ylim(-1.2 * reach / (2.0 * np.pi), 1.2 * reach / (2.0 * np.pi))
    ax.axvspan(0.0, 0.4 * reach, **UNSTABLE)
    ax.axvline(0.0, **AXIS)
    ax.axhline(0.0, **AXIS)
    ax.set_xlabel("growth rate [1/s]")
    ax.set_ylabel("frequency [Hz]")
    ax.legend(**{**LEGEND, "loc": "upper left"})


def _gain(ax: Axes, result: RobustResult) -> None:
    gain = result.worst_gain
    if gain is None:
        return
    f = np.asarray(gain.shown_hz)
    ax.semilogx(f, decibels(gain.nominal_curve), color=COLOURS[0], linewidth=1.3, label="middle of the ranges")
    ax.semilogx(f, decibels(gain.worst_curve), color=COLOURS[1], linewidth=1.3, label="worst parameters found")
    if np.isfinite(gain.upper):
        ax.axhline(float(decibels(gain.upper)), color="#b3261e", linewidth=1.4, label="proved bound")
    log_axis(ax, float(f[0]), float(f[-1]))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("|S - T| [dB]" if result.disk_margins else "gain [dB]")
    ax.legend(**{**LEGEND, "loc": "best"})
