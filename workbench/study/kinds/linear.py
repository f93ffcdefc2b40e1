"""Frequency responses and poles of linear models, as `lin` and `identify` write them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from workbench.analysis.identified.model import IdentifiedModel
from workbench.analysis.lin.result import LinResult
from workbench.analysis.validate.overlay import sine_response
from workbench.core.matrices import Complex, Floats
from workbench.core.poles import continuous, natural_frequency_hz, vanished
from workbench.core.response import decibels, unwrapped
from workbench.errors import InputError, suggest
from workbench.study.kinds.base import NotMeasured, Result
from workbench.study.kinds.curve import Curve

__all__ = ["linear_curve", "poles"]

_DENSE = 60  # points per decade
_SMALLEST = 1e-300


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
    respond = _sines(result, plant, str(result["input_names"][column]), str(result["output_names"][row]))
    value = respond(np.array(frequency))
    value = np.where(np.abs(value) < _SMALLEST, _SMALLEST, value)
    return Curve(frequency=frequency, gain=decibels(value).tolist(), phase=unwrapped(value).tolist())


def _sines(result: Result, plant: str, input: str, output: str) -> Callable[[Floats], Complex]:
    """Return the response of the model to sines as a function of frequency [Hz]."""
    if result["command"] == "identify" and float(result["dt"]) > 0.0:
        return sine_response(IdentifiedModel.from_dict(result), plant, input, output)[0]
    found = LinResult.from_dict(result)
    row, column = found.output_names.index(output), found.input_names.index(input)
    return lambda f: found.fundamental(f)[:, row, column]


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
