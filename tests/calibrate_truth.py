"""Outputs of bundled models under a held input in closed form, for complex parameters, too: for complex steps.

W. Squire, G. Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998): the
derivative by p is Im y(p + ih)/h, without a difference.
"""

from __future__ import annotations

import cmath
import itertools
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy.integrate import solve_ivp

from workbench.core.values.arrays import Complex, Floats

__all__ = ["TRUTHS", "complex_step"]

_STEP = 1e-30
_BEFORE: Mapping[str, float] = {
    "stiffness": 1.0, "damping": 0.05, "cubic": 1.0, "rateLimit": 0.6981317007977318, "timeConstant": 0.005,
    "k": 2.0, "omegaC": 10.0, "halfWidth": 0.5, "tau": 1.0, "positiveByFlap[1]": 6.9, "negativeByFlap[1]": 5.8,
    "offsetByFlap[1]": 2.0, "rateMax": 30.0,
}  # fmt: skip
_Values = Mapping[str, complex]


def lag(u: Floats, dt: float, p: _Values) -> Iterator[complex]:
    """τ dx/dt = u − x."""
    x, a = 0j, cmath.exp(-dt / p["tau"])
    for value in u:
        yield x
        x = a * x + (1.0 - a) * value


def duffing(u: Floats, dt: float, p: _Values) -> Iterator[complex]:
    """x'' = u − damping x' − stiffness x − cubic x³, by a method of order 8 from each step of the input to the next."""
    x = np.zeros(2, dtype=np.complex128)
    edges = [0, *np.flatnonzero(np.diff(u)) + 1, len(u)]
    for first, last in itertools.pairwise(edges):
        run = solve_ivp(
            lambda _, s, value=u[first]: np.array(
                [s[1], value - p["damping"] * s[1] - p["stiffness"] * s[0] - p["cubic"] * s[0] ** 3]
            ),
            (0.0, dt * (last - first)), x, method="DOP853", rtol=1e-11, atol=1e-12,
            t_eval=dt * np.arange(last - first + 1),
        )  # fmt: skip
        x = run.y[:, -1]
        yield from run.y[0, :-1].tolist()


def actuator(u: Floats, dt: float, p: _Values) -> Iterator[complex]:
    """x' = (u − x)/T within ± rateLimit: a ramp until the rate is below its limit, then an exponential."""
    x, r, T = 0j, p["rateLimit"], p["timeConstant"]
    for value in u:
        yield x
        left = value - x
        sign = 1.0 if left.real > 0.0 else -1.0
        ramp = (sign * left - r * T) / r  # [s] until the limit is left
        if ramp.real >= dt:
            x = x + sign * r * dt
        elif ramp.real > 0.0:
            x = value - sign * r * T * cmath.exp(-(dt - ramp) / T)
        else:
            x = value - left * cmath.exp(-dt / T)


def hysteresis(u: Floats, dt: float, p: _Values) -> Iterator[complex]:
    """x' = −ω·(what of x − u exceeds the play): it decays, and stays on its side."""
    x, half = 0j, p["halfWidth"]
    for value in u:
        yield p["k"] * x
        v = x - value
        edge = value + half if v.real > half.real else value - half if v.real < -half.real else x
        x = edge + (x - edge) * cmath.exp(-p["omegaC"] * dt)


def elevator_law(u: Floats, dt: float, p: _Values) -> Iterator[complex]:
    """The sampled law in normal flight with flap 0: gain by the stick's sign, the stick's shape, offset, rate limit."""
    surface, most = 2.0 + 0j, p["rateMax"] * dt
    for stick in u:
        shaped = float(np.interp(stick, [-1.0, -0.5, 0.0, 0.5, 1.0], [-1.0, -0.48, 0.0, 0.48, 1.0]))
        left = p["positiveByFlap[1]" if stick >= 0.0 else "negativeByFlap[1]"] * shaped + p["offsetByFlap[1]"] - surface
        surface += left if abs(left.real) <= most.real else most if left.real > 0.0 else -most
        yield surface


TRUTHS: Mapping[str, Callable[[Floats, float, _Values], Iterator[complex]]] = {
    "fmu:FirstOrderLag": lag, "fmu:Duffing": duffing, "fmu:LimitedActuator": actuator, "fmu:Hysteresis": hysteresis,
    "fmu:ElevatorLaw": elevator_law,
}  # fmt: skip


def complex_step(model: str, u: Floats, dt: float, values: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return the output of a model, shape (n,), and its derivatives by some of its parameters, shape (n, q).

    Args:
        model: which.
        u: its input, held.
        dt: [s].
        values: these parameters; the others have their start values.
    """
    y: list[Complex] = []
    for name in values:
        moved = {**_BEFORE, **values, name: values[name] + 1j * _STEP}
        y.append(np.array(list(TRUTHS[model](u, dt, moved))))
    return np.asarray(y[0].real), np.column_stack([one.imag / _STEP for one in y])
