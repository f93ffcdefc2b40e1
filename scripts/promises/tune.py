"""Tune loops whose best is known: published static feedbacks, brute force over grids.

Static output feedback of five models of COMPleib (F. Leibfritz, 2003): the H∞ norm beside that of HIFOO or hinfstruct
as published. Random loops with a PI or PID controller, one in four with an unstable plant: the larger of two
requirements, peak of |S| and H∞ norm from a disturbance at the plant's input, beside the least over grids that are
drawn closer around their best point. Conflicts: see `conflicts`.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import workbench as wb
from workbench.core.values.arrays import Complex, Floats
from workbench.jobs.options import Workers

__all__ = ["PUBLISHED", "RandomLoop", "best_of_grid", "published", "random_loop", "run", "tuned_loop"]

_HUNG = {  # the aircraft of AC1 and AC2
    "A": [[0, 0, 1.132, 0, -1], [0, -0.0538, -0.1712, 0, 0.0705], [0, 0, 0, 1, 0], [0, 0.0485, 0, -0.8556, -1.013],
          [0, -0.2909, 0, 1.0532, -0.6859]],
    "B": [[0, 0, 0], [-0.12, 1, 0], [0, 0, 0], [4.419, 0, -1.665], [1.575, 0, -0.0732]],
    "C": [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0]],
    "B1": [[3.593e-2, 0, 1.672e-2], [0, 9.89e-3, 0], [0, -7.548e-2, 0], [0, 0, 5.635e-2], [1.45e-3, 0, 6.743e-2]],
}  # fmt: skip
_HALF = 0.5**0.5
# Name → matrices, and the published norm; AC1's tends to 0 as its gains grow, which no other norm is beside.
PUBLISHED: Mapping[str, tuple[Mapping[str, Any], float]] = {
    "AC1": ({**_HUNG, "C1": _HALF * np.eye(5)[1:3], "D12": _HALF * np.eye(3)[:2]}, 0.0),
    "AC2": ({**_HUNG, "C1": _HALF * np.vstack([np.eye(5)[1:3], np.zeros((3, 5))]),
             "D12": _HALF * np.vstack([np.zeros((2, 3)), np.eye(3)])}, 0.1115),
    "AC3": ({"A": [[0, 0, 1, 0, 0], [0, -0.154, -0.0042, 1.54, 0], [0, 0.249, -1, -5.2, 0],
                   [0.0386, -0.996, -0.0003, -0.117, 0], [0, 0.5, 0, 0, -0.5]],
             "B": [[0, 0], [-0.744, -0.032], [0.337, -1.12], [0.02, 0], [0, 0]],
             "C": [[0, 1, 0, 0, -1], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [1, 0, 0, 0, 0]],
             "B1": np.eye(5), "C1": np.eye(5), "D12": np.eye(5)[:, 3:]}, 3.64),
    "AC4": ({"A": [[-0.876, 1, -0.1209, 0], [8.9117, 0, -130.75, 0], [0, 0, -150, 0], [-1, 0, 0, -0.05]],
             "B": [[0], [0], [150], [0]], "C": [[-1, 0, 0, 0], [0, -1, 0, 0]],
             "B1": [[0, 0], [0, 0], [0, 0], [0, 1]], "C1": [[-0.25, 0, 0, 3.487], [0, 0, -3, 0]],
             "D12": [[0], [3]], "D11": [[0, 0.25], [0, 0]], "D21": [[0, 1], [0.01, 0]]}, 0.9355),
    "HE1": ({"A": [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208],
                   [0.1002, 0.3681, -0.707, 1.42], [0, 0, 1, 0]],
             "B": [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]], "C": [[0, 1, 0, 0]],
             "B1": [[4.678e-2, 0], [4.572e-2, 9.88e-3], [4.369e-2, 1.11e-3], [-2.179e-2, 0]],
             "C1": _HALF * np.array([[2, 0, 0, 0], [0, 1, 0, 0]]), "D12": _HALF * np.eye(2)}, 0.1538),
}  # fmt: skip


def published(name: str, starts: int = 8) -> float:
    """Return the H∞ norm that is found for one of `PUBLISHED`.

    Args:
        name: of it.
        starts: further searches.
    """
    p = {key: np.array(value, dtype=float) for key, value in PUBLISHED[name][0].items()}
    (nu, ny), nw, nz = (p["B"].shape[1], len(p["C"])), p["B1"].shape[1], len(p["C1"])
    d11, d21 = p.get("D11", np.zeros((nz, nw))), p.get("D21", np.zeros((ny, nw)))
    w, u, z, y = ([f"{c}{k + 1}" for k in range(n)] for c, n in (("w", nw), ("u", nu), ("z", nz), ("y", ny)))
    plant = {
        "A": p["A"].tolist(), "B": np.hstack([p["B1"], p["B"]]).tolist(), "C": np.vstack([p["C1"], p["C"]]).tolist(),
        "D": np.block([[d11, p["D12"]], [d21, np.zeros((ny, nu))]]).tolist(), "dt": 0.0,
        "input_names": [*w, *u], "output_names": [*z, *y],
    }  # fmt: skip
    gains = [f"k{i + 1}{j + 1}" for i in range(nu) for j in range(ny)]
    lines = ["[components]", 'plant = {linear = "plant.json"}', *(f"{k} = {{gain = 0.0}}" for k in gains)]
    lines += [f'sum{i + 1} = {{sum = "{"+" * ny}"}}' for i in range(nu)] + ["[connections]"]
    for i in range(nu):
        lines += [f'"plant.u{i + 1}" = "sum{i + 1}.y"']
        for j in range(ny):
            lines += [f'"k{i + 1}{j + 1}.u" = "plant.y{j + 1}"', f'"sum{i + 1}.u{j + 1}" = "k{i + 1}{j + 1}.y"']
    lines += ["[inputs]", *(f'{n} = "plant.{n}"' for n in w), "[outputs]", *(f'{n} = "plant.{n}"' for n in z)]
    study = _study({"norm": {"analysis": "linear", "kind": "h-infinity norm", "max": 1.0}})
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        Path("plant.json").write_text(json.dumps(plant), encoding="utf-8")
        Path("system.toml").write_text("\n".join(lines), encoding="utf-8")
        Path("wanted.toml").write_text(study, encoding="utf-8")
        found = wb.tune(
            "system.toml", free={f"{k}.gain": None for k in gains}, study="wanted.toml", keep=False, starts=starts,
            workers=Workers(in_process=True), max_steps=600,
        )  # fmt: skip
    value = found.requirements[0].after
    return float(value) if isinstance(value, float) else np.inf


def _study(requirements: Mapping[str, Mapping[str, Any]]) -> str:
    lines = ["[analyses]", 'linear = {command = "lin", model = "system.toml"}']
    if any(r["analysis"] == "loop" for r in requirements.values()):
        lines += ['loop = {command = "loop", model = "system.toml", open = "plant.y"}']
    for name, given in requirements.items():
        lines += ["[[requirements]]", f'name = "{name}"', *(f"{key} = {json.dumps(x)}" for key, x in given.items())]
    return "\n".join(lines)


# -- loops with one controller ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RandomLoop:
    """A plant and its controller.

    Attributes:
        numerator, denominator: of the plant.
        pid: whether the controller has a derivative, else it is a PI.
        low, high: limits of its gains.
    """

    numerator: Floats
    denominator: Floats
    pid: bool
    low: Floats
    high: Floats

    @property
    def names(self) -> list[str]:
        """Names of the gains."""
        return ["proportional", "integral", "derivative"][: 3 if self.pid else 2]

    @property
    def filter(self) -> float:
        """Time constant of the derivative's filter [s]."""
        return 0.02

    def system(self) -> str:
        """The system file: input d at the plant's input, r before the controller; outputs y and u."""
        start = ", ".join(
            f"{n} = {x!r}" for n, x in zip(self.names, np.sqrt(self.low * self.high).tolist(), strict=True)
        )
        block = f'{{block = "pid", {start}, filter = {self.filter}}}' if self.pid else f'{{block = "pi", {start}}}'
        plant = f"numerator = {self.numerator.tolist()}, denominator = {self.denominator.tolist()}"
        return f"""
        [components]
        error = {{sum = "+-"}}
        controller = {block}
        input = {{sum = "++"}}
        plant = {{block = "transfer_function", {plant}}}
        [connections]
        "controller.u" = "error.y"
        "input.u1" = "controller.y"
        "plant.u" = "input.y"
        "error.u2" = "plant.y"
        [inputs]
        r = "error.u1"
        d = "input.u2"
        [outputs]
        y = "plant.y"
        u = "controller.y"
        """

    def polynomials(self, gains: Floats) -> tuple[Floats, Floats]:
        """Return numerators, shape (k, 3), and denominator of the controller.

        Args:
            gains: shape (k, n).
        """
        p, i = gains[:, 0], gains[:, 1]
        d, f = (gains[:, 2], self.filter) if self.pid else (np.zeros(len(gains)), 0.0)
        return np.column_stack([p * f + d, p + i * f, i]), np.array([f, 1.0, 0.0])


def random_loop(number: int, order: int | None = None) -> RandomLoop:
    """Return a loop, every fourth with an unstable plant, every second with a PID controller.

    Args:
        number: of it.
        order: of the plant; None: 2 to 5.
    """
    random = np.random.default_rng(number)
    poles: list[complex] = []
    order = 2 + number % 4 if order is None else order
    while len(poles) < order:
        size = float(np.exp(random.uniform(np.log(0.3), np.log(5.0))))
        if random.random() < 0.4 and len(poles) < order - 1:
            turned = size * np.exp(1j * np.pi * (0.5 + 0.45 * random.random()))
            poles += [turned, turned.conjugate()]
        else:
            poles.append(-size)
    if number % 4 == 3:
        poles[0] = complex(0.3, poles[0].imag) if poles[0].imag else complex(0.3)
        poles[1] = poles[0].conjugate() if poles[0].imag else poles[1]
    below = np.real(np.poly(poles))
    gain = abs(below[-1]) or 1.0
    low, high = np.array([0.1, 0.05, 0.01]), np.array([50.0, 50.0, 20.0])
    n = 3 if number % 2 else 2
    return RandomLoop(np.array([gain]), below, n == 3, low[:n], high[:n])


def disturbance_limit(loop: RandomLoop) -> float:
    """Return a limit for the norm from the disturbance to the output: a fifth of the plant's largest gain."""
    f = np.geomspace(1e-3, 1e2, 2000)
    return 0.2 * float(np.abs(_response(loop, f)).max())


def _response(loop: RandomLoop, f: Floats) -> Complex:
    s = 2j * np.pi * f
    return np.asarray(np.polyval(loop.numerator, s) / np.polyval(loop.denominator, s))


def tuned_loop(loop: RandomLoop, requirements: Mapping[str, Mapping[str, Any]], **asked: Any) -> wb.TuneResult:
    """Return what `tune` finds.

    Args:
        loop: whose controller.
        requirements: of the study.
        asked: further options.
    """
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        Path("system.toml").write_text(loop.system(), encoding="utf-8")
        Path("wanted.toml").write_text(_study(requirements), encoding="utf-8")
        limits = zip(loop.names, loop.low.tolist(), loop.high.tolist(), strict=True)
        return wb.tune(
            "system.toml", free={f"controller.{n}": (a, b) for n, a, b in limits}, study="wanted.toml", keep=False,
            workers=Workers(in_process=True), **asked,
        )  # fmt: skip


def two_requirements(loop: RandomLoop) -> dict[str, dict[str, Any]]:
    """Return the two requirements: at 0 are |S| ≤ 1 everywhere, and the disturbance's limit."""
    return {
        "robust": {"analysis": "loop", "kind": "peak sensitivity", "max": 1.0},
        "disturbance": {
            "analysis": "linear", "kind": "h-infinity norm", "inputs": ["d"], "outputs": ["y"],
            "max": disturbance_limit(loop),
        },
    }  # fmt: skip


def worst_of(loop: RandomLoop, gains: Floats, limit: float) -> Floats:
    """Return the larger of both requirements over their scales, infinite where the loop is unstable, shape (k,).

    Args:
        loop: which.
        gains: shape (k, n).
        limit: of the disturbance's norm.
    """
    above, below = loop.polynomials(gains)
    f = np.geomspace(1e-4, 1e2, 1500)
    s = 2j * np.pi * f
    plant = _response(loop, f)
    powers = np.stack([s**2, s, np.ones_like(s)])
    result = np.full(len(gains), np.inf)
    for part in np.array_split(np.arange(len(gains)), max(1, len(gains) // 500)):
        controller = above[part] @ powers / np.polyval(below, s)
        sensitivity = 1.0 / (1.0 + controller * plant)
        peak = np.maximum(np.abs(sensitivity).max(axis=1), 1.0) - 1.0
        size = np.maximum(peak, np.abs(plant * sensitivity).max(axis=1) / limit - 1.0)
        stable = [_is_stable(loop, above[k], below) for k in part]
        result[part] = np.where(stable, size, np.inf)
    return result


def _is_stable(loop: RandomLoop, above: Floats, below: Floats) -> bool:
    whole = np.polyadd(np.polymul(below, loop.denominator), np.polymul(above, loop.numerator))
    return bool(np.all(np.roots(whole).real < 0.0))


def best_of_grid(loop: RandomLoop, value: Callable[[Floats], Floats], levels: int = 4) -> tuple[float, Floats]:
    """Return the least value over a grid of the gains' logarithms that is drawn closer around its best point.

    Args:
        loop: which.
        value: of gains, shape (k, n).
        levels: grids.
    """
    low, high = np.log(loop.low), np.log(loop.high)
    best, place = np.inf, 0.5 * (low + high)
    for _ in range(levels):
        axes = [np.linspace(a, b, 13 if loop.pid else 41) for a, b in zip(low, high, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        found = value(np.exp(points))
        if found.min() < best:
            best, place = float(found.min()), points[np.argmin(found)]
        width = np.array([2.0 * (a[1] - a[0]) for a in axes])
        low, high = np.maximum(np.log(loop.low), place - width), np.minimum(np.log(loop.high), place + width)
    return best, np.exp(place)


def _objective(loop: RandomLoop) -> float:
    try:
        found = tuned_loop(loop, two_requirements(loop)).objective
    except wb.SimulationError:  # no gains were found with which it is stable
        found = None
    return np.inf if found is None else found


def run(*, cases: int = 100, seed: int = 0, names: str = "AC1,AC2,AC3,AC4,HE1") -> int:
    """Measure all of it, and return 1 if a promise is not kept.

    Args:
        cases: random loops.
        seed: number of the first one.
        names: published models, by commas.
    """
    broken = 0
    for name in filter(None, names.split(",")):
        begin, known = time.process_time(), PUBLISHED[name][1]
        norm = published(name)
        kept = norm <= 1.05 * known if known else norm < 1e-3
        broken += not kept
        print(f"{name}: {norm:.4g}, published {known or '→ 0'}; {time.process_time() - begin:.1f} s CPU")
    excess = []
    for number in range(seed, seed + cases):
        loop = random_loop(number)
        limit = disturbance_limit(loop)
        grid, _ = best_of_grid(loop, partial(worst_of, loop, limit=limit))
        objective = _objective(loop)
        excess.append((1.0 + objective) / (1.0 + grid) - 1.0 if np.isfinite(objective) or np.isfinite(grid) else 0.0)
        if excess[-1] > 0.02:
            print(f"loop {number}: {objective}, on the grid {grid:.4g}")
    if excess:
        bad = sum(x > 0.02 for x in excess)
        broken += bad
        print(f"{cases} random loops: within 2 % of the grid {cases - bad}; worst {100.0 * max(excess):.2f} %, "
              f"best {100.0 * min(excess):.2f} %")  # fmt: skip
    return int(broken > 0)
