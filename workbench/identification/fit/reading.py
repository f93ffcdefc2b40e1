"""Where the responses to fit come from: results, tables, python-control, MATLAB."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import read_json
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.response import Response
from workbench.data.bla.result import BlaResult
from workbench.data.experiment.formats import read_columns
from workbench.errors import InputError
from workbench.identification.fit.request import Fit
from workbench.response.nfr.result import NfrResult

if TYPE_CHECKING:
    from control import FrequencyResponseData

__all__ = ["Measured", "is_response", "measured", "response_file"]


_HERTZ = {"hz": 1.0, "rad/s": 0.5 / math.pi, "khz": 1e3, "rpm": 1.0 / 60.0}
_ANGLES = {"deg": 1.0, "rad": 180.0 / math.pi, "°": 1.0}
# Name of a column with frequencies → its unit where the file says none.
_FREQUENCIES = {"frequency": "hz", "frequency_hz": "hz", "f": "hz", "freq": "hz", "omega": "rad/s", "w": "rad/s"}
_FRD = "responsedata"  # a property of MATLAB's frd; its Frequency is in rad/s, unless FrequencyUnit says otherwise
_RESPONSES = (_FRD, "response", "resp", "frdata", "h", "g")


# A column of a table: what it holds, and of several channels which one.
_COLUMN = re.compile(r"(gain_db|gain|phase_deg|phase|real|imag|error)(?: (.+)/(.+))?", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Measured:
    """Responses to fit, each of another channel of the same system.

    Attributes:
        curves: frequency, values, errors, names; of several all have names.
        model: name of what was measured.
        dt: of the sampled model [s]; 0: continuous.
    """

    curves: tuple[Response, ...]
    model: str
    dt: float

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order in which they come."""
        return tuple(dict.fromkeys(curve.input or "u" for curve in self.curves))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(dict.fromkeys(curve.output or "y" for curve in self.curves))

    @property
    def units(self) -> dict[str, str | None]:
        """Units of both."""
        sides = [(c.input or "u", c.input_unit) for c in self.curves] + [
            (c.output or "y", c.output_unit) for c in self.curves
        ]
        return {name: next((u for n, u in sides if n == name and u), None) for name, _ in sides}


def is_response(path: str | Path) -> bool:
    """Return whether a file holds a frequency response, and not a record of time.

    Args:
        path: of a file that need not be there.
    """
    if Path(path).suffix.lower() == ".json":
        return True
    try:
        response_file(path)
    except InputError:
        return False
    return True


def measured(response: Response | NfrResult | BlaResult | FrequencyResponseData | str | Path, request: Fit) -> Measured:
    """Return the responses to fit, those of `also` with them.

    Args:
        response: a result, python-control's, or a file.
        request: with further ones, and the amplitude.

    Raises:
        InputError: no such file, no response in it, several amplitudes, channels that are missing or come twice.
    """
    first = _one(response, request)
    others = [_one(given, request) for given in request.also or ()]
    for other in others:
        if abs(other.dt - first.dt) > 1e-9 * max(other.dt, first.dt):
            kinds = [f"{m.model} is {f'sampled every {m.dt:g} s' if m.dt else 'continuous'}" for m in (first, other)]
            raise InputError(f"{' and '.join(kinds)}: one model cannot follow both")
    every = Measured(tuple(curve for one in (first, *others) for curve in one.curves), first.model, first.dt)
    if len(every.curves) > 1:
        _check_channels(every)
    return every


def _check_channels(every: Measured) -> None:
    """Refuse channels without names, twice, in several units, or not measured."""
    named = [(curve.output, curve.input) for curve in every.curves]
    if any("" in pair for pair in named):
        raise InputError(
            f"{every.model}: several responses, and one does not say its input and output; in a table name them in its "
            "columns, gain OUTPUT/INPUT and phase OUTPUT/INPUT"
        )
    for y, u in named:
        if named.count((y, u)) > 1:
            raise InputError(f"{every.model}: the response from {u} to {y} is given more than once")
    for y in every.outputs:
        for u in every.inputs:
            if (y, u) not in named:
                raise InputError(
                    f"{every.model}: the response from {u} to {y} is missing; measure it, or leave one out"
                )
    for curve in every.curves:
        for name, unit in ((curve.input, curve.input_unit), (curve.output, curve.output_unit)):
            if unit and unit != every.units[name]:
                raise InputError(f"{every.model}: {name} is in {every.units[name]} and in {unit}; convert one")


def _one(response: Any, request: Fit) -> Measured:  # noqa: ANN401 - as `measured`
    result: Any = response_file(response) if isinstance(response, str | Path) else response
    if isinstance(result, NfrResult):
        return Measured((result.curve(request.amplitude),), result.model, 0.0)
    if isinstance(result, BlaResult):
        return Measured((result.curve(_power(result, request.amplitude)),), result.model, result.dt)
    if request.amplitude is not None:
        raise InputError("amplitude: the response has one only")
    if hasattr(result, "omega") and hasattr(result, "frdata"):
        return _of_control(result)
    curves = (result,) if isinstance(result, Response) else result
    name = Path(response).name if isinstance(response, str | Path) else curves[0].output or "response"
    return Measured(curves, name, 0.0)


def _power(result: BlaResult, rms: float | None) -> int:
    if rms is None and len(result.rms) == 1:
        return 0
    near = [k for k, value in enumerate(result.rms) if rms is not None and abs(value - rms) <= 1e-9 * abs(value)]
    if not near:
        known = ", ".join(f"{value:g}" for value in result.rms)
        raise InputError(
            f"amplitude: {'none is given' if rms is None else f'{rms:g} was not measured'}; there are {known}"
        )
    return near[0]


def _of_control(result: Any) -> Measured:  # noqa: ANN401 - control.FrequencyResponseData
    """Return what python-control has."""
    if result.dt is True:
        raise InputError("the response is sampled, and does not say how often: give its dt")
    frequency = np.asarray(result.omega, dtype=np.float64) / (2.0 * np.pi)
    curves = _channels(frequency, np.asarray(result.frdata), result.input_labels, result.output_labels, "the response")
    return Measured(curves, "response", float(result.dt or 0.0))


def _channels(
    frequency: Floats, values: Complex, inputs: Sequence[str], outputs: Sequence[str], what: object
) -> tuple[Response, ...]:
    """Return the channels of values of shape (p, m, k); a single one has no names."""
    if values.shape[:2] == (1, 1):
        return (_rising(frequency, values[0, 0], what),)
    return tuple(
        replace(_rising(frequency, values[i, j], what), input=inputs[j], output=outputs[i])
        for i, j in np.ndindex(values.shape[:2])
    )


def _rising(frequency: Floats, value: Complex, what: object, error: Floats | None = None) -> Response:
    """Return the response, its frequencies rising."""
    order = np.argsort(frequency)
    if np.any(np.diff(frequency[order]) <= 0.0):
        raise InputError(f"{what}: a frequency is given more than once; fit one amplitude at a time")
    return Response(
        frequency[order], np.asarray(value[order], dtype=np.complex128), None if error is None else error[order]
    )


def response_file(path: str | Path) -> tuple[Response, ...] | NfrResult | BlaResult:
    """Return the responses in a file.

    Args:
        path: .json of a result, .mat, or a table.

    Raises:
        InputError: no such file, or no response in it.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".mat":
        return _matlab(Path(path))
    if suffix != ".json":
        return _table(path)
    data = read_json(path)
    kind = BlaResult if "rms" in data else NfrResult
    try:
        return kind.from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _in_unit(path: str | Path, name: str, unit: str | None, known: Mapping[str, float], usual: str) -> float:
    """Return the factor of a column."""
    factor = known.get((unit or usual).casefold())
    if factor is None:
        raise InputError(f"{path}: {name} is in '{unit}'; known: {', '.join(known)}")
    return factor


def _table(path: str | Path) -> tuple[Response, ...]:
    """Return the responses in a table: frequency, and of each channel gain (or gain_db) and phase, or real and imag."""
    table = read_columns(path)
    names = [name.casefold() for name in table.names]
    place = next((k for k, name in enumerate(names) if name in _FREQUENCIES), None)
    channels: dict[tuple[str, str], dict[str, tuple[Floats, str | None]]] = {}
    for name, values, unit in zip(table.names, table.values.T, table.units, strict=True):
        matched = _COLUMN.fullmatch(name)
        if matched:
            kind, y, u = matched[1].casefold(), matched[2] or "", matched[3] or ""
            channels.setdefault((y, u), {})[kind] = values, unit
    if place is None or not channels:
        raise InputError(f"{path}: {_NEEDED}")
    axis = names[place]
    frequency = _in_unit(path, axis, table.units[place], _HERTZ, _FREQUENCIES[axis]) * table.values[:, place]
    return tuple(
        replace(_rising(frequency, _value(path, held), path, held.get("error", (None, None))[0]), input=u, output=y)
        for (y, u), held in channels.items()
    )


_NEEDED = (
    "columns frequency [Hz], gain or gain_db, and phase [deg] are needed, or frequency, real and imag; of several "
    "channels gain OUTPUT/INPUT and so on"
)


def _value(path: str | Path, held: Mapping[str, tuple[Floats, str | None]]) -> Complex:
    """Return the complex values of a channel from its columns."""
    if "real" in held and "imag" in held:
        return np.asarray(held["real"][0] + 1j * held["imag"][0], dtype=np.complex128)
    name = next((name for name in ("phase", "phase_deg") if name in held), None)
    if name is None or not ("gain" in held or "gain_db" in held):
        raise InputError(f"{path}: {_NEEDED}")
    phase, unit = held[name]
    gain = held["gain"][0] if "gain" in held else 10.0 ** (held["gain_db"][0] / 20.0)
    return np.asarray(gain * np.exp(1j * np.radians(_in_unit(path, name, unit, _ANGLES, "deg") * phase)))


def _matlab(path: Path) -> tuple[Response, ...]:
    """Return the response in a file of MATLAB: frequencies and complex values, as variables or in one structure."""
    from scipy.io import loadmat  # noqa: PLC0415 - slow to import, and seldom needed

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        held = loadmat(str(path), struct_as_record=False)
    except (NotImplementedError, ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: cannot be read as MATLAB's (save with -v7): {error}") from None
    alone = [np.ravel(v)[0] for v in held.values() if isinstance(v, np.ndarray) and v.size == 1]
    places = [held, *(vars(v) for v in alone if hasattr(v, "_fieldnames"))]
    for place in places:
        own = {str(name).casefold(): value for name, value in place.items()}
        axis = next((name for name in _FREQUENCIES if name in own), None)
        values = next((np.asarray(own[name]) for name in _RESPONSES if name in own), None)
        if axis is None or values is None:
            continue
        frequency = np.ravel(np.asarray(own[axis], dtype=np.float64))
        if values.ndim < 3 and values.size == len(frequency):  # one channel, as a row or a column
            values = values.reshape(1, 1, -1)
        if values.ndim != 3 or values.shape[2:] != frequency.shape:
            raise InputError(
                f"{path}: one response is needed, of shape {frequency.shape}, or outputs × inputs × frequencies, not "
                f"{values.shape}"
            )
        unit = "".join(np.ravel(own.get("frequencyunit", "")).tolist()).replace("TimeUnit", "s") or None
        usual = "rad/s" if _FRD in own else _FREQUENCIES[axis]
        p, m = values.shape[:2]
        labels = [f"u{k + 1}" for k in range(m)], [f"y{k + 1}" for k in range(p)]
        return _channels(_in_unit(path, axis, unit, _HERTZ, usual) * frequency, values, *labels, path)
    raise InputError(
        f"{path}: holds no response: ResponseData and Frequency [rad/s] of an frd are needed, saved as variables or as "
        "a structure (an frd itself cannot be read), or h and f [Hz]"
    )
