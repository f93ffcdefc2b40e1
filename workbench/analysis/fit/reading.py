"""Where a response to fit comes from: results, tables, python-control, MATLAB."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workbench.analysis.bla.result import BlaResult
from workbench.analysis.experiment.formats import read_columns
from workbench.analysis.fit.request import Fit
from workbench.analysis.nfr.result import NfrResult
from workbench.core.record import read_json
from workbench.core.response import Response
from workbench.errors import InputError
from workbench.session.base import Floats

if TYPE_CHECKING:
    from control import FrequencyResponseData

__all__ = ["Measured", "measured"]

Complex = NDArray[np.complex128]

_HERTZ = {"hz": 1.0, "rad/s": 0.5 / math.pi, "khz": 1e3, "rpm": 1.0 / 60.0}
_ANGLES = {"deg": 1.0, "rad": 180.0 / math.pi, "°": 1.0}
# Name of a column with frequencies → its unit where the file says none.
_FREQUENCIES = {"frequency": "hz", "frequency_hz": "hz", "f": "hz", "freq": "hz", "omega": "rad/s", "w": "rad/s"}
_FRD = "responsedata"  # a property of MATLAB's frd; its Frequency is in rad/s, unless FrequencyUnit says otherwise
_RESPONSES = (_FRD, "response", "resp", "frdata", "h", "g")


@dataclass(frozen=True, eq=False)
class Measured:
    """A response to fit.

    Attributes:
        curve: frequency, values, errors, names.
        model: name of what was measured.
        dt: of the sampled model [s]; 0: continuous.
    """

    curve: Response
    model: str
    dt: float


def measured(response: Response | NfrResult | BlaResult | FrequencyResponseData | str | Path, asked: Fit) -> Measured:
    """Return the response to fit.

    Args:
        response: a result, python-control's, or a file.
        asked: with the amplitude.

    Raises:
        InputError: no such file, no response in it, or several.
    """
    found: Any = _file(response) if isinstance(response, str | Path) else response
    if isinstance(found, NfrResult):
        return Measured(found.curve(asked.amplitude), found.model, 0.0)
    if isinstance(found, BlaResult):
        return Measured(found.curve(_power(found, asked.amplitude)), found.model, found.dt)
    if asked.amplitude is not None:
        raise InputError("amplitude: the response has one only")
    if hasattr(found, "omega") and hasattr(found, "frdata"):
        return _of_control(found)
    name = Path(response).name if isinstance(response, str | Path) else found.output or "response"
    return Measured(found, name, 0.0)


def _power(found: BlaResult, rms: float | None) -> int:
    if rms is None and len(found.rms) == 1:
        return 0
    near = [k for k, value in enumerate(found.rms) if rms is not None and abs(value - rms) <= 1e-9 * abs(value)]
    if not near:
        known = ", ".join(f"{value:g}" for value in found.rms)
        raise InputError(
            f"amplitude: {'none is given' if rms is None else f'{rms:g} was not measured'}; there are {known}"
        )
    return near[0]


def _of_control(found: Any) -> Measured:  # noqa: ANN401 - control.FrequencyResponseData
    """Return what python-control has."""
    values = np.asarray(found.frdata)
    if values.shape[:2] != (1, 1):
        raise InputError(
            f"the response has {values.shape[1]} inputs and {values.shape[0]} outputs; take one: frd[0, 0]"
        )
    dt = found.dt
    if dt is True:
        raise InputError("the response is sampled, and does not say how often: give its dt")
    curve = _rising(np.asarray(found.omega, dtype=np.float64) / (2.0 * np.pi), values[0, 0], "the response")
    return Measured(curve, "response", float(dt or 0.0))


def _rising(frequency: Floats, value: Complex, what: object) -> Response:
    """Return the response, its frequencies rising."""
    order = np.argsort(frequency)
    if np.any(np.diff(frequency[order]) <= 0.0):
        raise InputError(f"{what}: a frequency is given more than once; fit one amplitude at a time")
    return Response(frequency[order], np.asarray(value[order], dtype=np.complex128))


def _file(path: str | Path) -> Response | NfrResult | BlaResult:
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


def _table(path: str | Path) -> Response:
    """Return the response in a table: frequency, and gain (or gain_db) and phase, or real and imag."""
    table = read_columns(path)
    names = [name.casefold() for name in table.names]
    columns = dict(zip(names, table.values.T, strict=True))
    units = dict(zip(names, table.units, strict=True))
    axis = next((name for name in names if name in _FREQUENCIES), None)
    phase = next((name for name in ("phase", "phase_deg") if name in columns), None)
    gain = columns.get("gain")
    if gain is None and "gain_db" in columns:
        gain = 10.0 ** (columns["gain_db"] / 20.0)
    if axis is not None and "real" in columns and "imag" in columns:
        value = columns["real"] + 1j * columns["imag"]
    elif axis is not None and phase is not None and gain is not None:
        turn = _in_unit(path, phase, units[phase], _ANGLES, "deg") * columns[phase]
        value = gain * np.exp(1j * np.radians(turn))
    else:
        raise InputError(
            f"{path}: columns frequency [Hz], gain or gain_db, and phase [deg] are needed, or frequency, real and imag"
        )
    return _rising(_in_unit(path, axis, units[axis], _HERTZ, _FREQUENCIES[axis]) * columns[axis], value, path)


def _matlab(path: Path) -> Response:
    """Return the response in a file of MATLAB: frequencies and complex values, as variables or in one structure."""
    from scipy.io import loadmat  # noqa: PLC0415 - slow to import, and seldom needed

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        held = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    except (NotImplementedError, ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: cannot be read as MATLAB's (save with -v7): {error}") from None
    places = [held, *(vars(v) for v in held.values() if hasattr(v, "_fieldnames"))]
    for place in places:
        own = {str(name).casefold(): value for name, value in place.items()}
        axis = next((name for name in _FREQUENCIES if name in own), None)
        values = next((np.asarray(own[name]) for name in _RESPONSES if name in own), None)
        if axis is None or values is None:
            continue
        frequency = np.asarray(own[axis], dtype=np.float64)
        if values.ndim != 1 or values.shape != frequency.shape:
            raise InputError(f"{path}: one response is needed, of shape {frequency.shape}, not {values.shape}")
        unit = str(own.get("frequencyunit", "")).replace("TimeUnit", "s") or None
        usual = "rad/s" if _FRD in own else _FREQUENCIES[axis]
        return _rising(_in_unit(path, axis, unit, _HERTZ, usual) * frequency, values, path)
    raise InputError(
        f"{path}: holds no response: ResponseData and Frequency [rad/s] of an frd are needed, saved as variables or as "
        "a structure (an frd itself cannot be read), or h and f [Hz]"
    )
