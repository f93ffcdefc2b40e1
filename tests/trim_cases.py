"""Random trims with a known answer: what is at rest, where, or that nothing is.

`python scripts/evidence.py trim` judges many.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.trim_models import Equations, Plant, Values
from workbench.point.trim.request import trim

Truth = Callable[[Values], bool]  # whether values of the states are an equilibrium


@dataclass(frozen=True)
class Case:
    """A model, how it is trimmed, and the truth.

    Attributes:
        name: for messages.
        plant: the model.
        truth: whether a point is an equilibrium; None: there is none.
        family: whether equilibria are connected.
        options: of `trim`.
        hard: whether rounding hides the answer; "there may be one" is right then.
    """

    name: str
    plant: Plant
    truth: Truth | None
    family: bool = False
    options: dict[str, Any] = field(default_factory=dict)
    hard: bool = False


def cases(count: int, seed: int) -> list[Case]:
    """Return so many random cases, each kind in turn."""
    rng = np.random.default_rng(seed)
    kinds = list(KINDS)
    return [KINDS[kinds[i % len(kinds)]](rng, ("me", "cs", "sampled")[(i // len(kinds)) % 3]) for i in range(count)]


def judged(case: Case) -> str:
    """Return what is wrong with the verdict of a trim; "" if nothing is."""
    result = trim(case.plant, **case.options)
    x = {**result.operating_point.x, **result.operating_point.discrete}
    if result.converged:
        right = case.truth is not None and case.truth(x) and (bool(result.null_directions) or not case.family)
    else:
        right = case.truth is None or (case.hard and "there may be one" in result.message)
    return "" if right else f"{case.name} ({result.method}): {result.message}; {x}"


def near(truth: Values, *, relative: float = 1e-4, absolute: float = 0.0) -> Truth:
    """Return whether states are those of the truth."""
    return lambda x: all(math.isclose(x[n], v, rel_tol=relative, abs_tol=absolute) for n, v in truth.items())


def plant(how: str, equations: Equations, rate: float = 1.0) -> Plant:
    """Return the equations as model exchange, as co-simulation (Euler), or as a sampled model (Euler every 1/20).

    Args:
        how: "me", "cs" or "sampled".
        equations: continuous.
        rate: fastest rate [1/s].
    """
    if how != "sampled":
        return Plant(equations, interface=how, step=0.02 / max(rate, 1.0))
    h = 0.05 / rate

    def tick(v: Values) -> list[float]:
        slopes = equations.rates(v)
        return [v[n] + h * s for n, s in zip(equations.x, slopes.tolist(), strict=True)]

    return Plant(
        Equations(memory=equations.x, u=equations.u, tick=tick, period=h, nominal=equations.nominal), interface="me"
    )


# -- none ------------------------------------------------------------------------------------


def _runaway(rng: np.random.Generator, how: str) -> Case:
    """A positive function that fades away, perhaps seen through other states."""
    a, s = 10.0 ** rng.uniform(-1, 1, 2)
    shapes: dict[str, Callable[[float], float]] = {
        "e^-x": lambda z: math.exp(-z),
        "1/(1+x²)": lambda z: 1.0 / (1.0 + z * z),
        "1 − tanh x": lambda z: 1.0 - math.tanh(z),
        "e^-x²": lambda z: math.exp(-z * z),
        "1/√(1+x²)": lambda z: 1.0 / math.sqrt(1.0 + z * z),
    }
    name = str(rng.choice(list(shapes)))
    shape, start = shapes[name], s * float(rng.uniform(-1, 2))
    if rng.random() < 0.5:
        eq = Equations(x={"x": start}, f=lambda v: [a * shape(v["x"] / s)])
        return Case(f"{a:.3g}·({name}) / {s:.3g}", plant(how, eq, a / s), None)
    stiff = 10.0 ** rng.uniform(0, 1)
    eq = Equations(
        x={"x": start, "y": 0.0},
        f=lambda v: [a * shape(v["x"] / s) + stiff * (v["y"] - v["x"]), stiff * (v["x"] - v["y"])],
    )
    return Case(f"hidden {a:.3g}·({name}) / {s:.3g}, {stiff:.3g}", plant(how, eq, a / s + 2 * stiff), None)


def _no_root(rng: np.random.Generator, how: str) -> Case:
    gap, centre = 10.0 ** rng.uniform(-4, 1), float(rng.normal())
    eq = Equations(x={"x": float(rng.normal())}, f=lambda v: [(v["x"] - centre) ** 2 + gap])
    return Case(f"(x − {centre:.3g})² + {gap:.3g}", plant(how, eq, 10.0), None)


def _saturated(rng: np.random.Generator, how: str) -> Case:
    push, limit = float(rng.uniform(1.5, 3.0)), 1.0
    size = 10.0 ** rng.uniform(-6, 6)
    eq = Equations(
        x={"x": 0.0, "v": 0.0},
        f=lambda v: [size * (push - min(max(v["v"], -limit), limit)), v["x"] / size - v["v"]],
    )
    return Case(f"saturated integrator, {size:.3g}", plant(how, eq), None)


def _out_of_bounds(rng: np.random.Generator, how: str) -> Case:
    root, low = float(rng.uniform(0.5, 2.0)), float(rng.uniform(2.5, 4.0))
    eq = Equations(x={"x": 3.0}, f=lambda v: [root**3 - v["x"] ** 3])
    name = f"{root:.3g}³ − x³, x ≥ {low:.3g}"
    return Case(name, plant(how, eq, 30.0), None, options={"bound": {"x": (low, math.inf)}})


# -- one, several ----------------------------------------------------------------------------


def _one(rng: np.random.Generator, how: str) -> Case:
    n = int(rng.integers(1, 5))
    a = -np.eye(n) * (n + 1.0) + rng.uniform(-1, 1, (n, n))
    x = rng.normal(size=n)
    names = [f"x{i}" for i in range(n)]
    offset = -(a @ x - 0.1 * x**3)

    def f(v: Values) -> list[float]:
        z = np.array([v[k] for k in names])
        return list(a @ z - 0.1 * z**3 + offset)

    truth = dict(zip(names, x.tolist(), strict=True))
    eq = Equations(x=dict.fromkeys(names, 0.0), f=f)
    return Case(f"{n} states", plant(how, eq, 10.0), near(truth, absolute=1e-6))


def _several(rng: np.random.Generator, how: str) -> Case:
    roots = np.cumsum(rng.uniform(0.3, 1.0, 3)) - 1.0

    def value(x: float) -> float:
        return -float(np.prod(x - roots))

    eq = Equations(x={"x": float(rng.uniform(-2, 3))}, f=lambda v: [value(v["x"])])
    truth: Truth = lambda x: bool(np.min(np.abs(x["x"] - roots)) < 1e-5)  # noqa: E731
    return Case(f"roots {np.round(roots, 3).tolist()}", plant(how, eq, 30.0), truth)


def _bounded(rng: np.random.Generator, how: str) -> Case:
    root = float(rng.uniform(1.0, 2.0))
    low, high = (0.2, 5.0) if rng.random() < 0.5 else (-5.0, -0.2)
    eq = Equations(x={"x": float(rng.uniform(0.3, 3.0))}, f=lambda v: [root**2 - v["x"] ** 2])
    inside: Truth = lambda x: abs(abs(x["x"]) - root) < 1e-5 and low <= x["x"] <= high  # noqa: E731
    return Case(f"±{root:.3g} in {low:g}:{high:g}", plant(how, eq, 10.0), inside, options={"bound": {"x": (low, high)}})


# -- flat ------------------------------------------------------------------------------------


def _degenerate(rng: np.random.Generator, how: str) -> Case:
    p, root = int(rng.choice([2, 3, 4, 5])), float(rng.choice([0.0, rng.normal()]))
    start = root + float(rng.choice([1e-6, 1e-2, 1.0]))
    eq = Equations(x={"x": start}, f=lambda v: [-((v["x"] - root) ** p)])
    # Its position is known to the p-th root of rounding, of the period map coarser.
    coarse = {2: 1e-4, 3: 5e-3, 4: 3e-2, 5: 0.1}[p]
    name = f"−(x − {root:.3g})^{p} from {start - root:.3g}"
    # Where its rate is below rounding from the start on, whether it rests there cannot be told.
    hidden = p > 3 or (start - root) ** p < sys.float_info.epsilon
    return Case(name, plant(how, eq), near({"x": root}, relative=0.0, absolute=coarse), hard=hidden)


def _dead_zone(rng: np.random.Generator, how: str) -> Case:
    half, start = float(rng.uniform(0.2, 1.0)), float(rng.uniform(-4, 4))

    def f(v: Values) -> list[float]:
        return [-math.copysign(max(abs(v["x"]) - half, 0.0), v["x"])]

    inside: Truth = lambda x: abs(x["x"]) <= half * (1 + 1e-6)  # noqa: E731
    return Case(f"dead zone ±{half:.3g} from {start:.3g}", plant(how, Equations(x={"x": start}, f=f)), inside)


def _family(rng: np.random.Generator, how: str) -> Case:
    a, b = rng.uniform(0.5, 2.0, 2)
    eq = Equations(
        x={"x": float(rng.normal()), "y": float(rng.normal())}, f=lambda v: [-(e := a * v["x"] - b * v["y"]), e]
    )
    on: Truth = lambda x: abs(a * x["x"] - b * x["y"]) < 1e-6  # noqa: E731
    return Case("a line", plant(how, eq, 4.0), on, family=True)


def _circle(rng: np.random.Generator, how: str) -> Case:
    radius = float(rng.uniform(0.5, 2.0))
    start = {"x": float(rng.uniform(1, 3)), "y": float(rng.uniform(1, 3))}
    eq = Equations(x=start, f=lambda v: [radius**2 - v["x"] ** 2 - v["y"] ** 2, 0.0])
    on: Truth = lambda x: abs(math.hypot(x["x"], x["y"]) - radius) < 1e-5  # noqa: E731
    return Case(f"a circle {radius:.3g}", plant(how, eq, 10.0), on, family=True)


# -- badly scaled ----------------------------------------------------------------------------


def _scaled(rng: np.random.Generator, how: str) -> Case:
    n = int(rng.integers(1, 4))
    size = 10.0 ** rng.uniform(-9, 9, n)
    a = -np.eye(n) * (n + 1.0) + rng.uniform(-1, 1, (n, n))
    x = rng.uniform(0.5, 2.0, n) * rng.choice([-1.0, 1.0], n)
    names = [f"x{i}" for i in range(n)]
    cubic = float(rng.choice([0.0, 0.3]))
    offset = -(a @ x - cubic * x**3)

    def f(v: Values) -> list[float]:
        z = np.array([v[k] for k in names]) / size
        return list(size * (a @ z - cubic * z**3 + offset))

    truth = dict(zip(names, (size * x).tolist(), strict=True))
    eq = Equations(x=dict.fromkeys(names, 0.0), f=f)
    return Case(f"sizes {', '.join(f'{s:.1g}' for s in size)}", plant(how, eq, 10.0), near(truth))


def _scaled_runaway(rng: np.random.Generator, how: str) -> Case:
    size, rate = 10.0 ** rng.uniform(-9, 9), 10.0 ** rng.uniform(-1, 1)
    eq = Equations(x={"x": 0.0}, f=lambda v: [size * rate * math.exp(-v["x"] / size)])
    return Case(f"e^-x of size {size:.1g}", plant(how, eq, rate), None)


def _stiff(rng: np.random.Generator, how: str) -> Case:
    fast, end = 10.0 ** rng.uniform(2, 5), float(rng.uniform(0.5, 2.0))
    eq = Equations(
        x={"x": 0.0, "y": 1.0},
        f=lambda v: [fast * (v["y"] - v["x"]), fast * (v["x"] - v["y"]) + end - v["y"]],
    )
    return Case(f"stiff {fast:.2g}", plant(how, eq, 2 * fast), near({"x": end, "y": end}))


def _stiff_drift(rng: np.random.Generator, how: str) -> Case:
    fast, drift = 10.0 ** rng.uniform(2, 8), float(rng.uniform(0.1, 2.0))
    eq = Equations(x={"x": 0.0, "y": 1.0}, f=lambda v: [fast * (v["y"] - v["x"]), fast * (v["x"] - v["y"]) + drift])
    return Case(f"drift under stiff {fast:.2g}", plant(how, eq), None)


KINDS: dict[str, Callable[[np.random.Generator, str], Case]] = {
    "runaway": _runaway,
    "no root": _no_root,
    "saturated": _saturated,
    "out of bounds": _out_of_bounds,
    "one": _one,
    "several": _several,
    "bounded": _bounded,
    "degenerate": _degenerate,
    "dead zone": _dead_zone,
    "family": _family,
    "circle": _circle,
    "scaled": _scaled,
    "scaled runaway": _scaled_runaway,
    "stiff": _stiff,
    "stiff drift": _stiff_drift,
}
