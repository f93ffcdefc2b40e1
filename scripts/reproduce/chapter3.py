"""Linearised blocks: chapter 3.3 of the source report. Points and widths stand in chapter3.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.drawings import draw_loop, draw_secants, draw_steps, titled
from scripts.reproduce.measurement import Measured, Measurement, Picture, Reproduction
from workbench.core.values.arrays import Floats
from workbench.point.lin.picture import plot_curves
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant, Sine, Table
from workbench.system.load import load

__all__ = ["EXPERIMENTS", "Example", "examples", "linearised", "slopes"]

_FILE = Path(__file__).with_suffix(".toml")
_BLOCK_INPUT = "v"
_RAMP = 100.0  # [s]; slow against nothing: the blocks have no memory
_STEP = 25.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Example:
    """One linearisation.

    Attributes:
        name: its number in the source report.
        block: in words.
        model: bundled model.
        parameters: that are set.
        x0, u0: operating point.
        dx, du: total widths.
    """

    name: str
    block: str
    model: str
    x0: tuple[float, ...]
    u0: float
    dx: tuple[float, ...]
    du: float
    parameters: Mapping[str, float]


def examples() -> dict[str, Example]:
    """Return the examples by name."""
    with _FILE.open("rb") as file:
        tables = tomllib.load(file)
    return {
        name: Example(
            name=name,
            block=t["block"],
            model=t["model"],
            x0=tuple(t["x0"]),
            u0=t["u0"],
            dx=tuple(t["dx"]),
            du=t["du"],
            parameters=t.get("parameters", {}),
        )
        for name, t in tables.items()
    }


def linearised(example: Example, *, method: str = "difference") -> LinResult:
    """Return the linear model of the bundled FMU at the example's point, with its widths where they matter.

    Args:
        example: which one.
        method: of linearisation.
    """
    with load(f"fmu:{example.model}", "me", start_values=dict(example.parameters)) as model:
        x0 = dict(zip((v.name for v in model.states), example.x0, strict=True))
        dx, du = (list(example.dx), example.du) if method == "difference" else (None, None)
        return lin(model, x0=x0, u0={"u": example.u0}, dx=dx, du=du, method=method, outputs=["y"]).result


def slopes(result: LinResult) -> Floats:
    """Return the slopes of the block by each state and the input: output's row over that of the block's input."""
    quotient: Floats = _output_row(result) / _front()
    return quotient


def _output_row(result: LinResult) -> Floats:
    return np.append(result.C[0], result.D[0])


@cache
def _front() -> Floats:
    """Return C and D of the dynamics in front of the blocks, through the linear part of a saturation."""
    return _output_row(linearised(examples()["2-1b"]))


def _working_point(example: Example) -> float:
    """Return the input of the block at the point."""
    with load(f"fmu:{example.model}", "me") as model:
        states = zip((v.name for v in model.states), example.x0, strict=True)
        with model.open_at(time=0.0, values={**dict(states), "u": example.u0}) as session:
            return session.values([_BLOCK_INPUT])[_BLOCK_INPUT]


def _block(name: str) -> Measurement:
    """Measure one of the examples with a block on the output."""
    example = examples()[name]
    result = linearised(example)
    v = _working_point(example)
    found: dict[str, Measured] = {
        "c": result.C[0],
        "d": float(result.D[0, 0]),
        "slopes": slopes(result),
        "working-point": v,
    }
    if name == "2-2":
        slope = float(slopes(linearised(example, method="exact"))[-1])
        found |= {"true-slope": slope, "offset": slope * v - result.operating_point.y["y"]}
    pictures = _PICTURES.get(name)
    return Measurement(
        {f"example-{name}-{key}": value for key, value in found.items()},
        pictures=pictures(example, result) if pictures else (),
    )


def _hysteresis() -> Measurement:
    r = linearised(examples()["3.3.6"])
    a, b, c, d = (float(m.item()) for m in (r.A, r.B, r.C, r.D))
    words = "The block under a slow sine, and the gain of its linear model at rest, the slope k."
    return Measurement({"hysteresis": [a, b, c, d]}, pictures=[Picture((12, 13), words, lambda: _loop(d - c * b / a))])


def _small_system() -> Measurement:
    r = linearised(examples()["3.3.7"])
    return Measurement({"small-system": np.concatenate([m.ravel() for m in (r.A, r.B, r.C, r.D)])})


# ── Pictures ─────────────────────────────────────────────────────────────────────────────────────────────────────


def _characteristic(example: Example, low: float, high: float) -> tuple[Floats, Floats]:
    """Return input and output of the block from `low` to `high`, moved by a ramp of the input."""
    with load(f"fmu:{example.model}", "me") as model:
        ramp = Table([0.0, _RAMP], [low, high])
        done = simulate(model, stop=_RAMP, inputs={"u": ramp}, outputs=["y", _BLOCK_INPUT], interval=_RAMP / 8000)
    v, y = done.signals[_BLOCK_INPUT], done.signals["y"]
    shown = (v >= low) & (v <= high)
    return v[shown], y[shown]


def _secants(figures: tuple[int, ...], span: tuple[float, float], example: Example, result: LinResult) -> Picture:
    """Draw the block's characteristic with the pieces over which the slopes were taken."""

    def draw() -> Figure:
        v, y = _characteristic(example, *span)
        widths = np.abs(_front() * (*example.dx, example.du))
        return draw_secants(
            v,
            y,
            at=(_working_point(example), result.operating_point.y["y"]),
            pieces=[
                (f"by {name}", float(w), float(s))
                for name, w, s in zip(("x1", "x2", "u"), widths, slopes(result), strict=True)
            ],
            title=f"Figure {figures[-1]}: {example.block}, what the perturbations see",
            line=slopes(result)[-1] if example.name == "2-2" else None,
        )

    return Picture(figures, f"The block of example {example.name} and the slopes taken across the widths.", draw)


def _loop(gain: float) -> Figure:
    """Draw the hysteresis' output over its input."""
    example = examples()["3.3.6"]
    with load(f"fmu:{example.model}", "me", start_values=dict(example.parameters)) as model:
        sine = Sine(amplitude=2.0, frequency=1.0 / _RAMP)
        done = simulate(model, stop=2.0 * _RAMP, inputs={"u": sine}, outputs=["u", "y"], interval=_RAMP / 500)
    u, y = done.signals["u"], done.signals["y"]
    return draw_loop(u, y, gain=gain, title="Figure 13: hysteresis, and the slope of its linear model")


def _steps(figure: int, example: Example, result: LinResult) -> Picture:
    """Draw the response to a unit step, the linear model without the block's offset as in the source report."""

    def draw() -> Figure:
        with load(f"fmu:{example.model}", "me") as model:
            done = simulate(model, stop=_STEP, inputs={"u": Constant(1.0)}, outputs=["y"], interval=_STEP / 500)
        linear = _unit_step(result, done.time)
        title = f"Figure {figure}: unit step, block and its linear model of slope {slopes(result)[-1]:.4f}"
        curves = [("nonlinear", done.signals["y"]), ("linear, C x + D u", linear)]
        return draw_steps(done.time, curves, title=title, ylabel="y")

    return Picture((figure,), f"Example {example.name}: C x + D u of the linear model beside the block's output.", draw)


def _unit_step(result: LinResult, time: Floats) -> Floats:
    import control  # noqa: PLC0415 - slow, and for pictures only

    system = control.StateSpace(result.A, result.B, result.C[:1], result.D[:1])
    return np.asarray(control.forced_response(system, time, np.ones_like(time)).outputs, dtype=np.float64)


def _bode(result: LinResult) -> Picture:
    def draw() -> Figure:
        exact = linearised(examples()["2-1b"])
        figure = plot_curves([("narrow widths: exact", exact), ("example 2-1", result)])
        return titled(figure, "Figure 3: saturation, linear models by two sets of widths")

    return Picture(
        (3,), "Example 2-1: widths that leave the linear part of the block give a gain that is too low.", draw
    )


def _of_saturation(example: Example, result: LinResult) -> list[Picture]:
    return [_secants((1, 2), (-2.0, 4.0), example, result), _bode(result)]


def _of_expression(example: Example, result: LinResult) -> list[Picture]:
    return [_steps(4, example, result), _secants((5,), (-0.5, 3.0), example, result)]


_PICTURES: Mapping[str, Callable[[Example, LinResult], list[Picture]]] = {
    "2-1": _of_saturation,
    "2-2": _of_expression,
    "2-2b": lambda example, result: [_steps(6, example, result)],
    "2-3": lambda example, result: [_secants((7, 8), (-1.6, 0.8), example, result)],
    "2-4": lambda example, result: [_secants((9,), (-2.5, 2.5), example, result)],
    "2-5": lambda example, result: [_secants((10, 11), (-3.0, 5.0), example, result)],
}


def _experiment(name: str, *keys: str) -> Reproduction:
    return Reproduction(f"example {name}", tuple(f"example-{name}-{key}" for key in keys), partial(_block, name))


EXPERIMENTS = (
    _experiment("2-1", "c", "d", "slopes", "working-point"),
    _experiment("2-1b", "c", "d"),
    _experiment("2-2", "slopes", "true-slope", "offset"),
    _experiment("2-2b", "slopes", "working-point"),
    _experiment("2-3", "c", "d", "working-point", "slopes"),
    _experiment("2-4", "c", "d", "slopes"),
    _experiment("2-5", "c", "d"),
    Reproduction("hysteresis", ("hysteresis",), _hysteresis),
    Reproduction("small system", ("small-system",), _small_system),
)
