"""Gusts and turbulence, as signals."""

from __future__ import annotations

import math

from workbench.core.records.quantity import plain
from workbench.errors import InputError
from workbench.signals.kinds import Table, check_finite, check_positive, check_whole

__all__ = ["gust", "turbulence"]

_GUST_POINTS = 64
_MOST_POINTS = 1 << 20


def gust(
    *,
    time: float = 0.0,
    value: float = 1.0,
    duration: float | None = None,
    gradient: float | None = None,
    speed: float | None = None,
) -> Table:
    """Return the pulse of a discrete gust, value · (1 − cos(2π (t − time)/duration))/2, by 64 straight lines.

    Args:
        time: when it begins [s].
        value: height of the gust, in the middle.
        duration: how long it lasts [s], positive.
        gradient: distance H from its beginning to its middle [m], in place of the duration, which is then 2·H/speed;
            the rule asks for 9 to 107 m.
        speed: true airspeed at which it is met [m/s], with a gradient.

    Raises:
        InputError: a value out of range; neither a duration nor gradient and speed, or both.

    Source: the "1 − cosine" gust of CS-25.341(a).

    Examples:
        The largest value is in the middle.

        >>> gust = wb.gust(value=3.0, duration=2.0)
        >>> print(gust.times[gust.values.index(3.0)])
        1.0
        >>> print(wb.gust(gradient=107.0, speed=250.0).times[-1])
        0.856
    """
    time, value, duration, gradient, speed = map(plain, (time, value, duration, gradient, speed))
    if gradient is not None and speed is not None and duration is None:
        check_positive("gust", gradient=gradient, speed=speed)
        duration = 2.0 * gradient / speed
    elif duration is None or gradient is not None or speed is not None:
        raise InputError("gust: give either duration [s], or gradient [m] and speed [m/s]")
    check_positive("gust", duration=duration)
    check_finite("gust", time=time, value=value)
    share = [k / _GUST_POINTS for k in range(_GUST_POINTS + 1)]
    values = [0.5 * value * (1.0 - math.cos(2.0 * math.pi * s)) for s in share]
    return Table([time + s * duration for s in share], values)


def turbulence(
    *, intensity: float = 1.0, speed: float, duration: float, length: float = 762.0, step: float = 0.01, seed: int = 1
) -> Table:
    """Return vertical turbulence with von Kármán's spectrum, a Gaussian process of which each seed gives another piece.

    White noise is filtered in the frequency domain, so that the spectrum is the exact one,

        Φ(ω) = σ²·L/(πV) · (1 + 8/3·(1.339·Lω/V)²) / (1 + (1.339·Lω/V)²)^(11/6),    ∫ Φ dω from 0 to ∞ = σ²,

    up to 1/(2·step); the rational filters in use have lost 36 % of its power at Lω/V = 100, where elastic modes are.
    What is beyond, and of periods longer than the duration, is left out. Between the points are straight lines, which
    lower its power by 6 % at a tenth of 1/step. It is periodic, begins where it passes through zero, and
    stays there after the duration.

    Args:
        intensity: root mean square σ, in the unit of the input.
        speed: true airspeed V [m/s].
        duration: [s].
        length: scale of turbulence L [m]; 762 (2500 ft) above 2500 ft in the rule.
        step: distance of the points [s].
        seed: of the noise, 0 or more.

    Raises:
        InputError: a value out of range, or more than 2^20 points.

    Source: CS-25.341(b) and appendix G; F. M. Hoblit, Gust Loads on Aircraft, AIAA 1988, section 4.3.

    Examples:
        >>> signal = wb.turbulence(intensity=1.5, speed=250.0, duration=60.0)
        >>> print(len(signal.times), abs(signal(0.0)) < 0.1)
        6001 True
    """
    import numpy as np  # noqa: PLC0415  slow to import

    intensity, speed, duration, length, step = map(plain, (intensity, speed, duration, length, step))
    check_whole("turbulence", seed=seed)
    check_positive("turbulence", intensity=intensity, speed=speed, duration=duration, length=length, step=step)
    n = round(duration / step)
    if not 2 <= n <= _MOST_POINTS:
        raise InputError(f"turbulence: {n} points; duration/step must be from 2 to 2^20")
    if seed < 0:
        raise InputError(f"turbulence: seed must be 0 or more, not {seed}")
    x = 2.0 * math.pi * np.fft.rfftfreq(n, step) * length / speed  # Lω/V
    square = (1.339 * x) ** 2
    density = intensity**2 * length / (math.pi * speed) * (1.0 + 8.0 / 3.0 * square) / (1.0 + square) ** (11.0 / 6.0)
    density[0] = 0.0  # no mean: that is a wind
    # White noise of variance 1 has 1/n of its power in each line of both signs; they are 2π/(n·step) apart in ω.
    noise = np.random.default_rng(seed).standard_normal(n)
    values = np.fft.irfft(np.fft.rfft(noise) * np.sqrt(math.pi * density / step), n)
    values = np.roll(values, -int(np.argmin(np.abs(values))))
    return Table((step * np.arange(n + 1)).tolist(), [*values.tolist(), float(values[0])])
