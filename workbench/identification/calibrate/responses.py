"""Measured frequency responses as data: the model shows its own at the same frequencies and amplitude."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats, as_reals
from workbench.core.values.response import Response
from workbench.data.bla.result import BlaResult
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, SimulationError
from workbench.identification.fit.reading import is_response, response_file
from workbench.identification.fit.reading import measured as read_responses
from workbench.identification.fit.request import Fit
from workbench.model import Model
from workbench.model.names import check_variables
from workbench.point.lin.request import lin
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult

__all__ = ["PlayedResponse", "ResponseData", "is_measured_response", "responses"]

_SIGMA = 1.73  # a 95 % error of a complex number over the standard deviation of its parts: √(−2 ln 0.05)/√2


@dataclass(frozen=True, eq=False)
class PlayedResponse:
    """A response that the model is to show.

    Attributes:
        name: of the data.
        outputs: names of its real and imaginary part.
        input, output: names.
        frequency: shape (n,) [Hz].
        amplitude: of the sine [unit of the input]; None: of the linear model.
        sizes: what both parts are divided by, shape (n, 1).
    """

    name: str
    outputs: tuple[str, ...]
    input: str
    output: str
    frequency: Floats
    amplitude: float | None
    sizes: Floats

    def computed(self, model: Model) -> Floats:
        """Return real and imaginary part over the sizes, shape (n, 2).

        Args:
            model: with the parameters, where it starts.

        Raises:
            SimulationError: the model has no such response.
        """
        f = self.frequency
        if self.amplitude is None:
            linear = lin(model, inputs=[self.input], outputs=[self.output], in_process=True)
            value = linear.result.response(f)[:, 0, 0]
        else:
            value = (
                nfr(model, self.input, self.output, f, [self.amplitude], drift_check=False, in_process=True)
                .curve()
                .value
            )
        if not np.all(np.isfinite(value)):
            raise SimulationError(f"no response at {f[int(np.argmin(np.isfinite(value)))]:g} Hz")
        return as_reals(value).reshape(2, -1).T / self.sizes


@dataclass(frozen=True, eq=False)
class ResponseData(Experiment):
    """A measured response as an experiment whose time is the frequency [Hz], and whose outputs are its two parts.

    Attributes:
        played: what the model is to show.
    """

    played: PlayedResponse = field(kw_only=True)


def is_measured_response(given: object) -> bool:
    """Return whether data are a frequency response: a result, one of python-control, or a file with one."""
    if isinstance(given, str | Path):
        return is_response(given)
    return isinstance(given, NfrResult | BlaResult) or hasattr(given, "omega")


def responses(model: Model, given: Any, name: str) -> Iterator[ResponseData]:  # noqa: ANN401 - any of these
    """Yield the responses in a result or file, each of one channel.

    Args:
        model: whose inputs and outputs they are between.
        given: see `is_measured_response`.
        name: of the data, for messages.

    Raises:
        InputError: no response in it, no names, variables that the model does not have.
    """
    found = response_file(given) if isinstance(given, str | Path) else given
    levels = found.amplitude.tolist() if isinstance(found, NfrResult) else [None]
    for level in levels:
        yield from _channels(
            model, found if level is not None or not isinstance(given, str | Path) else given, level, name
        )


def _channels(model: Model, given: Any, level: float | None, name: str) -> Iterator[ResponseData]:  # noqa: ANN401
    for curve in read_responses(given, Fit(amplitude=level)).curves:
        if not curve.input or not curve.output:
            raise InputError(f"{name}: the response does not say its input and output; name them, as gain OUTPUT/INPUT")
        check_variables(model, [curve.input], "input", what=name)
        check_variables(model, [curve.output], "variable", what=name)
        yield _data(curve, name, None if isinstance(given, BlaResult) else curve.amplitude)


def _data(curve: Response, name: str, amplitude: float | None) -> ResponseData:
    there = np.isfinite(curve.value)
    f, value = curve.frequency_hz[there], curve.value[there]
    size = np.abs(value)
    if curve.error is not None and np.all(np.isfinite(curve.error[there])):
        size = size * np.maximum(curve.error[there], np.finfo(float).eps) / _SIGMA
    channel = f"{curve.output}/{curve.input}" + ("" if amplitude is None else f" at {amplitude:g}")
    outputs = (f"real part of {channel}", f"imaginary part of {channel}")
    played = PlayedResponse(name, outputs, curve.input, curve.output, f, amplitude, size[:, None])
    return ResponseData(
        time=f, u=np.empty((len(f), 0)), y=as_reals(value).reshape(2, -1).T / played.sizes, input_names=(),
        output_names=outputs, input_units=(), output_units=(None, None), name=name, played=played,
    )  # fmt: skip
