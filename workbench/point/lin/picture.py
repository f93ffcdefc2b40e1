"""Pictures of linear models."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.core.values.arrays import Floats
from workbench.core.values.large import corners_hz
from workbench.core.values.poles import continuous, vanished
from workbench.errors import InputError
from workbench.point.lin.step_check import POINTS, step_response
from workbench.show.bode import bode_axes, draw_response
from workbench.show.figure import COLOURS, LEGEND, outside, rows
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.point.lin.result import LinResult
    from workbench.point.lin.step_check import StepCheck
    from workbench.point.lin.varying_result import VaryingModel

__all__ = ["frequency_band", "plot_curves", "plot_lin", "plot_step_check", "plot_varying"]

_LEAST_ERROR = 1e-12  # drawn

_DEPTH_DB = 80.0  # below the largest gain: what is smaller by more than four decimal places is not looked at
_SETTLED = 0.01  # of the largest value of a step response: what changes by less is at rest
_AFTER = 1.5  # times the time to rest are shown

_DASHES = ("-", "--", "-.", ":")


def plot_lin(result: LinResult) -> Figure:
    """Draw gain [dB] and phase [deg] over frequency [Hz] and the step responses over time [s].

    Args:
        result: the linear model; every pair of input and output is a curve.

    Raises:
        InputError: it has no input or no output.
    """
    if not result.input_names or not result.output_names:
        missing = "output" if result.input_names else "input"
        raise InputError(f"{result.model}: the linear model has no {missing}, so it has no response to draw")
    figure, (*axes, step) = rows(3, title=_title(result), shared=2)
    frequency = _seen(result, frequency_band([result]))
    nothing = set(result.without_effect)
    time, outputs = _step(result)
    pairs = len(result.input_names) * len(result.output_names)
    units = {result.units.get(name) or "1" for name in result.output_names}
    for j, source in enumerate(result.input_names):
        for i, target in enumerate(result.output_names):
            style = _style(i, j)
            label = _name(source, target, nothing)
            draw_response(axes[0], axes[1], result.curve(j, i, frequency), label=label, **style)
            draw: Any = step.step if result.dt > 0.0 else step.plot
            extra = {"where": "post"} if result.dt > 0.0 else {}
            draw(time, outputs[:, i, j], label=label, **style, **extra)
    _finish(axes, frequency)
    _floor(axes[0])
    axes[1].tick_params(labelbottom=True)
    step.set_xlabel("time [s]")
    step.set_ylabel(f"step response [{units.pop()}]" if len(units) == 1 else "step response")
    if pairs > 1 or nothing:
        step.legend(**LEGEND)
    return figure


def _seen(result: LinResult, frequency: Floats) -> Floats:
    """Return the frequencies without those beyond which every gain is too small to matter."""
    pairs = [(j, i) for j in range(len(result.input_names)) for i in range(len(result.output_names))]
    gain = np.max([np.abs(result.curve(j, i, frequency).value) for j, i in pairs], axis=0)
    large = np.flatnonzero(gain > 10.0 ** (-_DEPTH_DB / 20.0) * np.max(gain))
    last = int(large[-1]) if large.size else len(gain) - 1
    return frequency if last == len(gain) - 1 else np.geomspace(frequency[0], frequency[last], len(frequency))


def _floor(gain: Axes) -> None:
    """Show no gain that is too small to matter: as far below the largest one as the frequencies go."""
    curves = [np.asarray(line.get_ydata(), dtype=np.float64) for line in gain.lines]
    known = [y[np.isfinite(y)] for y in curves]
    top = max((float(y.max()) for y in known if y.size), default=0.0)
    low = min((float(y.min()) for y in known if y.size), default=0.0)
    if low < top - _DEPTH_DB:
        gain.set_ylim(top - _DEPTH_DB, top + 0.05 * _DEPTH_DB)


def _title(result: LinResult) -> str:
    pairs = len(result.input_names) * len(result.output_names)
    which = f"{result.input_names[0]} → {result.output_names[0]}" if pairs == 1 else "responses"
    return f"{result.model}: {which} of the linear model, method {result.method}"


def plot_curves(named: Sequence[tuple[str, LinResult]]) -> Figure:
    """Draw the Bode picture of the first input and output of several models.

    Args:
        named: label and model.
    """
    results = [result for _, result in named]
    first = results[0] if results else None
    title = f"{first.model}: {first.input_names[0]} → {first.output_names[0]}" if first else "no linear model"
    figure, axes = rows(2, title=title)
    frequency = frequency_band(results)
    for number, (name, result) in enumerate(named):
        style = {**_style(number, number // len(COLOURS)), "label": name}
        draw_response(axes[0], axes[1], result.curve(0, 0, frequency), **style)
    _finish(axes, frequency)
    if named:
        outside(figure, axes[0].get_legend_handles_labels()[0], "right upper", fontsize=8.5)
    return figure


def frequency_band(results: Sequence[LinResult]) -> Floats:
    """Return frequencies [Hz] around the poles, five decades at most, discrete models up to half their rate."""
    corners = [c for r in results for c in _corners(r)]
    low, high = (min(corners), max(corners)) if corners else (0.1, 10.0)
    low, high = low / 10.0, min(high * 10.0, low * 1e4)
    rates = [0.5 / r.dt for r in results if r.dt > 0.0]
    if rates:
        high = min(high, max(rates))
        low = min(low, high / 100.0)
    band: Floats = np.geomspace(low, high * (1.0 - 1e-6), POINTS)
    return band


def _corners(result: LinResult) -> list[float]:
    corners = corners_hz(result.slowest_poles, result.A, result.dt, least=1e-6)
    return list(corners) if corners else [0.05 / result.dt] if result.dt > 0.0 else []


def _style(i: int, j: int) -> dict[str, Any]:
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": _DASHES[j % len(_DASHES)], "linewidth": 1.3}


def _name(source: str, target: str, without_effect: Container[tuple[str, str]]) -> str:
    return f"{source} → {target}{': no effect' if (source, target) in without_effect else ''}"


def _finish(axes: Sequence[Axes], frequency: Floats) -> None:
    bode_axes(axes)
    for ax in axes[:2]:
        ax.set_xlim(float(frequency[0]), float(frequency[-1]))


def _step(result: LinResult) -> tuple[Floats, Floats]:
    """Return times (k,) [s] and unit step responses (k, q, m), until they rest or as long as the slowest pole takes."""
    horizon = _horizon(result)
    time, outputs = _steps(result, horizon)
    moving = np.abs(outputs - outputs[-1]) > _SETTLED * np.max(np.abs(outputs), axis=0)
    last = np.flatnonzero(np.any(moving, axis=(1, 2)))
    shown = _AFTER * float(time[min(int(last[-1]) + 1, len(time) - 1)]) if last.size else horizon
    return _steps(result, shown) if shown < time[-1] else (time, outputs)


def _steps(result: LinResult, horizon: float) -> tuple[Floats, Floats]:
    dt = result.dt or horizon / POINTS
    count = min(POINTS, max(20, round(horizon / dt))) if result.dt > 0.0 else POINTS
    outputs = [step_response(result, j, dt, count) for j in range(len(result.input_names))]
    return np.asarray(dt * np.arange(count + 1), dtype=np.float64), np.stack(outputs, axis=-1)


def _horizon(result: LinResult) -> float:
    """Return how long the step response takes [s]."""
    slow = result.slowest_poles
    poles = [p for p in continuous(slow[~vanished(slow, result.dt)], result.dt).tolist() if abs(p) > 1e-6]
    speeds = [abs(p.real) if abs(p.real) > 1e-3 * abs(p) else abs(p) / 5.0 for p in poles]
    return 5.0 / min(speeds) if speeds else 20.0 * (result.dt or 0.05)


def plot_step_check(check: StepCheck) -> Figure:
    """Draw the step responses of a linear model and of the model itself over time [s].

    Args:
        check: what to draw.
    """
    figure, axes = rows(1, title=f"{check.input} → {check.output}, step of {check.height:g}")
    axes[0].plot(check.time, check.nonlinear, color=COLOURS[0], linewidth=1.8, label="nonlinear model")
    axes[0].plot(check.time, check.linear, "--", color=COLOURS[1], linewidth=1.5, label="linear model")
    axes[0].set_ylabel(bracketed(check.output, check.unit))
    axes[0].set_xlabel("time [s]")
    axes[0].legend(**LEGEND)
    return figure


def plot_varying(result: VaryingModel) -> Figure:
    """Draw the errors at points held out: over one parameter, or as a map over the first two.

    Args:
        result: the parameter-varying model.
    """
    names, held_out = list(result.grid), result.held_out
    where = np.array([[h.values[name] for name in names] for h in held_out])
    labels = [bracketed(p.name, p.unit) for p in result.scheduling]
    if len(names) == 1:
        figure, (ax,) = rows(1, title=f"{result.model}: errors over {names[0]}", height=3.4)
        order = np.argsort(where[:, 0])
        for i, (kind, mark) in enumerate(zip(("poles", "response", "step", "equilibrium"), "osd^", strict=True)):
            error = np.array([getattr(h.errors, kind) for h in held_out])
            style: dict[str, Any] = {
                "color": COLOURS[i % len(COLOURS)],
                "markersize": 3.0,
                "linewidth": 0.8,
                "label": kind,
            }
            ax.plot(where[order, 0], np.maximum(error[order], _LEAST_ERROR), f"-{mark}", **style)
        ax.plot(result.grid[names[0]], [_LEAST_ERROR] * len(result.grid[names[0]]), "k|", label="grid")
        ax.axhline(result.asked_error, color="#444444", linewidth=0.9, linestyle="--", label="asked for")
        ax.set_yscale("log")
        ax.set_ylabel("relative error")
        ax.legend(**LEGEND)
    else:
        figure, (ax,) = rows(1, title=f"{result.model}: largest error over {' × '.join(names)}", height=4.2)
        error = np.array([max(h.errors.largest, _LEAST_ERROR) for h in held_out])
        order = np.argsort(error)
        ax.plot(*np.meshgrid(*list(result.grid.values())[:2]), "+", color="#444444", markersize=5.0)
        shown = ax.scatter(where[order, 0], where[order, 1], c=np.log10(error[order]), s=22.0, cmap="viridis")
        figure.colorbar(shown, ax=ax, label="log10 of the largest relative error; + grid")
        ax.set_ylabel(labels[1])
    ax.set_xlabel(labels[0])
    return figure
