"""Find where a rate limiter begins to act: the linear closed loop says when, the open loop says whether it jumps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from workbench.core.records.forms import several
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels
from workbench.core.values.modal import poles_of
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.job import Job
from workbench.loops.loop.request import loop
from workbench.loops.nyquist.grid import adaptive_grid
from workbench.loops.onset.boundary import boundary_db
from workbench.loops.onset.request import RateOnset
from workbench.loops.onset.result import Attitude, Jump, OnsetPoint, OnsetResult
from workbench.loops.opened_system import find_ports, linear_between, recipe_of, system_of
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.model.names import check_variables
from workbench.model.operating_point import standing, start_at
from workbench.point.lin.result import LinResult
from workbench.response.branches.request import branches
from workbench.system.description import BlockComponent

__all__ = ["run"]

_NEEDS = "the onset of rate limiting needs"
_LIMITED = "onset.limited"  # name of an output of the system, for the linear model
_AROUND = 3.0  # jumps are looked for so many times below and above the onset
_ON_AXIS = 1e-9  # of the largest pole: a real part below that is rounding
_MARGIN_DEG, _MARGIN_DB = 45.0, 6.0  # of a bandwidth
_HELD = 1e-6  # of the largest entry: an output that moves less between samples stands
_BELOW_NYQUIST = 0.999
_SHOWN = 400  # frequencies of the curves


def run(model: DescribedModel, request: RateOnset, job: Job) -> OnsetResult:
    """Find the onset of a rate limiter; see `RateOnset`."""
    ports = find_ports(model, request.limiter, needs=_NEEDS)
    check_variables(model, [request.input], "input", what="input")
    if request.attitude is not None:
        check_variables(model, [request.attitude], "output", "state", what="attitude")
    placed, remarks = start_at(model, request.at)
    rate, notes = _rate(model, request)
    point = standing(placed)
    opened, every = loop(placed, ports.w, in_process=True).linear, several(request.amplitudes)
    if opened is None:
        raise InputError(f"{model.name}: the loop through {request.limiter} has no linear model; {_NEEDS} one")
    with _watched(placed, ports.w) as watched:
        closed = linear_between(
            watched, {request.input: None}, [_LIMITED, *([request.attitude] if request.attitude else [])],
            x=point.x, u=point.u, time=point.time,
        )  # fmt: skip
        _check_stable(closed)
        if closed.dt > 0.0:
            _check_held(placed, closed, ports.w)
        band, told = _band(closed, request.band)
        notes += [f"doubtful: {d.row} by {d.column}: {d.reason}" for d in closed.doubts]
        notes += [*told, *closed.notes, *(f"{z.name}: {z.reason}" for z in closed.zeros if z.name == request.input)]
        motion = _LimiterMotion(closed, rate, *_curve(closed, 0, band))
        points = []
        for number, amplitude in enumerate(every, 1):
            result = _point(amplitude, motion, opened.lin)
            points.append(_followed(result, watched, request, motion) if request.jump else result)
            job.done(f"amplitude {amplitude:g}", number, len(every))
    shown = np.geomspace(*band, _SHOWN)
    through = -opened.lin.response(shown)[:, 0, 0]
    units = {v.name: v.unit for v in (*placed.inputs, *placed.description.variables)}
    return OnsetResult(
        model=model.name,
        interface=placed.interface,
        solver=placed.solver,
        input=request.input,
        input_unit=units.get(request.input),
        limiter=request.limiter,
        limited=ports.w,
        limited_unit=units.get(ports.w),
        rate=rate,
        points=tuple(points),
        frequency_hz=shown,
        closed_gain_db=decibels(closed.fundamental(shown)[:, 0, 0]),
        open_gain_db=decibels(through),
        open_phase_deg=_below(np.unwrap(np.angle(through))),
        attitude=None if request.attitude is None else _attitude(request.attitude, *_curve(closed, 1, band)),
        notes=(*remarks, *notes),
        operating_point=point,
    )


@contextmanager
def _watched(model: DescribedModel, limited: str) -> Iterator[DescribedModel]:
    """Give the system with the limiter's output among its outputs."""
    recipe = recipe_of(model)
    system = replace(recipe.system, outputs={**recipe.system.outputs, _LIMITED: limited})
    with recipe.changed(system).open() as watched:
        yield watched


@dataclass(frozen=True, eq=False)
class _LimiterMotion:
    """How the limiter's output moves in the linear closed loop.

    That of a sampled limiter is a staircase. Its fundamental is F = F_k sin(x)/x with x = πfT, of samples F_k, and the
    largest change from one sample to the next, in the time T, is 2|F_k| sin(x)/T = 2πf|F|: the rate is that of the
    fundamental, without approximation.

    Attributes:
        closed: from the input to it; its fundamental is F.
        rate: limit of its rate.
        grid: shape (k,), rising [Hz].
        response: F there.
    """

    closed: LinResult
    rate: float
    grid: Floats
    response: Complex

    @property
    def ratios(self) -> Floats:
        """Highest rate on the grid of a sine of amplitude 1, in units of the limit."""
        return np.asarray(2.0 * np.pi * self.grid * np.abs(self.response) / self.rate, dtype=np.float64)

    def ratio(self, frequency_hz: float) -> float:
        """Return it at one frequency [Hz]."""
        return 2.0 * math.pi * frequency_hz * abs(_at(self.closed, frequency_hz)) / self.rate


def _rate(model: Model, request: RateOnset) -> tuple[float, list[str]]:
    """Return the limit of the rate, and what to know of it."""
    component = next(c for c in system_of(model, _NEEDS).components if c.name == request.limiter)
    own = None
    if isinstance(component, BlockComponent) and component.kind == "rate_limiter":
        own = component.block.packed()[:2]
    if request.rate is not None:
        if own is None or request.rate == min(own[1], -own[0]):
            return request.rate, []
        words = (
            f"the limit is {request.rate:g} as given, though {request.limiter} itself limits at {own[0]:g} and "
            f"{own[1]:g}, which act wherever the system is simulated (`start_values` changes {request.limiter}.rising)"
        )
        return request.rate, [words]
    if own is None:
        raise InputError(
            f"limiter: the limit of {request.limiter} is not known, as it is not a block rate_limiter; "
            "give it with `rate`"
        )
    falling, rising = own
    if -falling == rising:
        return rising, []
    return min(rising, -falling), [
        f"{request.limiter}: the limits differ, {falling:g} and {rising:g}; the lower counts"
    ]


def _at(closed: LinResult, frequency_hz: float) -> complex:
    return complex(closed.fundamental(np.array([frequency_hz]))[0, 0, 0])


def _curve(closed: LinResult, output: int, band: tuple[float, float]) -> tuple[Floats, Complex]:
    """Return frequencies [Hz], dense where the response turns, and what a sine makes of an output there."""
    f, _ = adaptive_grid(closed.part(0, output), band)
    return f, closed.fundamental(f)[:, output, 0]


def _check_stable(closed: LinResult) -> None:
    poles = poles_of(closed.A, dt=closed.dt)
    growing = poles.value[
        poles.value.real > np.maximum(poles.uncertain, _ON_AXIS * np.abs(poles.value).max(initial=0.0))
    ]
    if len(growing):
        raise InputError(
            f"the loop is not stable below the limit: a pole at {abs(growing[0]) / (2.0 * np.pi):.4g} Hz grows; "
            "there is no onset to speak of (see `workbench loop`)"
        )


def _check_held(model: DescribedModel, closed: LinResult, limited: str) -> None:
    """Refuse a limiter whose output does not stand from one sample of a sampled loop to the next."""
    between = closed.intersample
    rows = np.zeros((2, 1)) if between is None else np.concatenate([between.C, between.D], axis=3)[:, :, 0]
    if between is None or np.abs(rows - rows[0, 0]).max() > _HELD * np.abs(rows).max():
        raise InputError(
            f"{model.name}: {limited} does not stand over the {closed.dt:g} s after which the samples of the loop "
            f"repeat; {_NEEDS} a limiter that is sampled, with the loop's longest period, or a loop without samples"
        )


def _band(closed: LinResult, band: tuple[float, float]) -> tuple[tuple[float, float], list[str]]:
    """Return the band as far as samples show it, and what to say of it."""
    low, high = band
    if high < closed.highest_hz:
        return band, []
    top = _BELOW_NYQUIST * closed.highest_hz
    if low >= top:
        raise InputError(f"band: {low:g} Hz is not below {closed.highest_hz:g} Hz, half the sample rate")
    return (low, top), [f"sampled every {closed.dt:g} s: searched up to {top:.4g} Hz, half the sample rate"]


def _point(amplitude: float, motion: _LimiterMotion, opened: LinResult) -> OnsetPoint:
    """Return the lowest frequency at which the limit is reached, and the open loop there."""
    ratios = amplitude * motion.ratios
    top = int(ratios.argmax())
    plain = OnsetPoint(
        amplitude=amplitude,
        highest_ratio=float(ratios[top]),
        highest_hz=float(motion.grid[top]),
        rises=top == len(ratios) - 1,
    )
    reached = np.flatnonzero(ratios >= 1.0)
    if not len(reached):
        return plain
    first = int(reached[0])
    between = motion.grid[max(first - 1, 0)], motion.grid[first]
    if first == 0:
        result = float(between[1])
    else:
        result = float(brentq(lambda f: amplitude * motion.ratio(f) - 1.0, *between, xtol=1e-14, rtol=1e-14))
    value = -complex(opened.response(result)[0, 0, 0])
    phase = float(np.degrees(np.angle(value)) % 360.0 - 360.0)
    return replace(
        plain,
        frequency_hz=result,
        phase_deg=phase,
        gain_db=float(decibels(np.array([value]))[0]),
        boundary_db=boundary_db(phase),
    )


def _followed(point: OnsetPoint, watched: Model, request: RateOnset, motion: _LimiterMotion) -> OnsetPoint:
    """Return the point with the folds of the model's own periodic responses around the onset."""
    if point.frequency_hz is None:
        return replace(point, jumps=(), jumps_told="the limit is not reached")
    low, high = request.band
    band = (max(low, point.frequency_hz / _AROUND), min(high, point.frequency_hz * _AROUND))
    try:
        result = branches(watched, request.input, _LIMITED, [point.amplitude], band=band, seeds=0, in_process=True)
    except WorkbenchError as error:
        return replace(point, jumps_told=f"the periodic responses could not be followed: {error}")
    jumps = [
        Jump(
            frequency_hz=f.frequency_hz,
            rate_ratio=point.amplitude * motion.ratio(f.frequency_hz),
            kind=f.kind,
        )
        for f in result.folds
    ]
    where = f"from {band[0]:.4g} to {band[1]:.4g} Hz"
    words = f"{len(jumps)} folds {where}" if jumps else f"no fold {where}"
    return replace(point, jumps=tuple(jumps), jumps_told="; ".join([words, *result.warnings]))


def _below(phase: Floats) -> Floats:
    """Return unwrapped phases [deg], shifted by whole turns so that they begin between −360° and 0."""
    degrees = np.degrees(phase)
    return np.asarray(degrees - 360.0 * np.ceil(degrees[0] / 360.0), dtype=np.float64)


# -- bandwidth and phase delay ------------------------------------------------------------------


def _attitude(name: str, f: Floats, value: Complex) -> Attitude:
    """Return bandwidth and phase delay of an attitude's response (MIL-STD-1797), as far as the band shows them."""
    phase, gain = np.degrees(np.unwrap(np.angle(value))), decibels(value)
    half = _falls(f, phase, -180.0)
    by_gain = delay = None
    if half is not None:
        by_gain = _falls(f, gain, float(np.interp(half, f, gain)) + _MARGIN_DB)
        if 2.0 * half <= f[-1]:
            delay = -(float(np.interp(2.0 * half, f, phase)) + 180.0) / (720.0 * half)
    return Attitude(
        output=name,
        phase_bandwidth_hz=_falls(f, phase, _MARGIN_DEG - 180.0),
        gain_bandwidth_hz=by_gain,
        phase_delay_s=delay,
    )


def _falls(f: Floats, values: Floats, level: float) -> float | None:
    """Return the lowest frequency at which values fall through a level; None: they do not."""
    falls = np.flatnonzero((values[:-1] > level) & (values[1:] <= level))
    if not len(falls):
        return None
    k = int(falls[0])
    return float(np.interp(level, values[[k + 1, k]], f[[k + 1, k]]))
