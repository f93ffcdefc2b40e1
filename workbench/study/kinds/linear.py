"""Frequency responses and poles of linear models, as `lin` and `identify` write them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.poles import continuous, natural_frequency_hz, vanished
from workbench.errors import InputError, suggest
from workbench.study.kinds.base import NotMeasured, Result
from workbench.study.kinds.curve import Curve, unwrap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Matrices = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

__all__ = ["PLANTS", "linear_curve", "poles"]

PLANTS = ("continuous", "sampled", "held")

_DENSE = 60  # points per decade
_SMALLEST = 1e-300

_Response = Callable[[float], complex]


def poles(result: Result) -> list[complex]:
    """Return the poles of a linear model as those of a continuous one [1/s]; delays, near z = 0, are left out."""
    dt = float(result["dt"])
    found = np.array([complex(*p) for p in result["poles"]], dtype=np.complex128)
    seen: list[complex] = continuous(found[~vanished(found, dt)], dt).tolist()
    return seen


def linear_curve(result: Result, *, at: Sequence[float], input: str | None, output: str | None, plant: str) -> Curve:
    """Return the frequency response of a linear model, as sines would show it.

    Args:
        result: of `lin` or `identify`.
        at: frequencies at which it is evaluated [Hz], besides those around its poles; a discrete model ends below half
            its sampling rate.
        input: its name; None: the model has one.
        output: likewise.
        plant: what an identified model stands for, as in `workbench.analysis.validate.overlay`: "continuous" takes the
            hold of the record out, "sampled" adds that of the plant, "held" leaves the model as it is.

    Raises:
        InputError: no such input or output.
        NotMeasured: there is no frequency below half the sampling rate.
    """
    column = _index("input", input, result["input_names"])
    row = _index("output", output, result["output_names"])
    frequency = _frequencies(result, at)
    if not frequency:
        raise NotMeasured("the frequencies lie above half the sampling rate of the model")
    respond = _maker(result, plant)(result, row, column)
    response = [respond(f) for f in frequency]
    return Curve(
        frequency=frequency,
        gain=[20.0 * math.log10(max(abs(r), _SMALLEST)) for r in response],
        phase=unwrap([math.degrees(math.atan2(r.imag, r.real)) for r in response]),
    )


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None and len(names) == 1:
        return 0
    if name is None:
        raise InputError(f'the model has {len(names)} {what}s; name one, as in {what} = "{next(iter(names), "")}"')
    if name not in names:
        raise InputError(f"{what} '{name}' is unknown; {suggest(name, names)}")
    return list(names).index(name)


def _frequencies(result: Result, at: Sequence[float]) -> list[float]:
    """Return frequencies around the poles as far as those asked for, and these exactly [Hz]; rising."""
    dt = float(result["dt"])
    low, high = _around(result)
    low, high = min([low, *at]), max([high, *at])
    last = 0.5 / dt * (1.0 - 1e-6) if dt > 0.0 else math.inf
    high = min(high, last)
    count = max(2, math.ceil(_DENSE * math.log10(high / low)) + 1) if high > low else 0
    every = {low * (high / low) ** (k / (count - 1)) for k in range(count)} | set(at)
    return sorted(f for f in every if f <= last)


def _around(result: Result) -> tuple[float, float]:
    rates = [float(natural_frequency_hz(p)) for p in poles(result)]
    rates = [r for r in rates if r > 1e-9 * max(rates)]
    return (min(rates) / 100.0, max(rates) * 10.0) if rates else (0.01, 100.0)


# -- how a response is computed ----------------------------------------------------------------


def _maker(result: Result, plant: str) -> Callable[[Result, int, int], _Response]:
    dt = float(result["dt"])
    if result["command"] == "identify" and dt > 0.0:
        return _PLANTS[plant]
    return _fundamental if dt > 0.0 else _plain


def _matrices(result: Result) -> Matrices:
    import numpy as np  # noqa: PLC0415 - most requirements do without

    shapes = (len(result["state_names"]), len(result["input_names"]), len(result["output_names"]))
    n, m, p = shapes
    A, B, C, D = (np.array(result[name], dtype=np.float64) for name in "ABCD")
    return A.reshape(n, n), B.reshape(n, m), C.reshape(p, n), D.reshape(p, m)


def _transfer(matrices: Matrices, row: int, column: int) -> Callable[[complex], complex]:
    """Return C (pI − A)⁻¹ B + D as a function of p."""
    import numpy as np  # noqa: PLC0415

    A, B, C, D = matrices
    eye, b, c, d = np.eye(len(A)), B[:, column], C[row], complex(D[row, column])
    return lambda p: complex(c @ np.linalg.solve(p * eye - A, b)) + d


def _plain(result: Result, row: int, column: int) -> _Response:
    """Evaluate a continuous model at s = jω."""
    transfer = _transfer(_matrices(result), row, column)
    return lambda f: transfer(2j * math.pi * f)


def _held(result: Result, row: int, column: int) -> _Response:
    """Evaluate a discrete model at z = exp(jω·dt)."""
    transfer, dt = _transfer(_matrices(result), row, column), float(result["dt"])
    return lambda f: transfer(cmath.exp(2j * math.pi * f * dt))


def _hold(frequency: float, dt: float) -> complex:
    """Return (1 − e^(−s·dt))/(s·dt) at s = jω."""
    s = 2j * math.pi * frequency * dt
    return (1.0 - cmath.exp(-s)) / s


def _sampled(result: Result, row: int, column: int) -> _Response:
    held, dt = _held(result, row, column), float(result["dt"])
    return lambda f: held(f) * _hold(f, dt)


def _continuous(result: Result, row: int, column: int) -> _Response:
    """Evaluate the continuous model with the same samples; where there is none, divide by the hold."""
    from workbench.core.matrices import unheld  # noqa: PLC0415 - only identified models need it

    A, B, C, D = _matrices(result)
    dt = float(result["dt"])
    try:
        smooth = unheld(A, B, dt)
    except InputError:
        held = _held(result, row, column)
        return lambda f: held(f) / _hold(f, dt)
    transfer = _transfer((*smooth, C, D), row, column)
    return lambda f: transfer(2j * math.pi * f)


def _fundamental(result: Result, row: int, column: int) -> _Response:
    """Evaluate a linearised sampled model, the output between its samples taken into account."""
    import numpy as np  # noqa: PLC0415

    from workbench.analysis.lin.result import LinResult  # noqa: PLC0415

    found = LinResult.from_dict(result)
    return lambda f: complex(found.fundamental(np.array([f]))[0, row, column])


_PLANTS: Mapping[str, Callable[[Result, int, int], _Response]] = {
    "continuous": _continuous,
    "sampled": _sampled,
    "held": _held,
}
