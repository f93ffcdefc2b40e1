"""An identified model beside the linearisation and the measured frequency response."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.conversion import known_unit, named_conversion
from workbench.core.values.decibels import decibels, degrees, difference
from workbench.errors import InputError, suggest
from workbench.identification.identified.model import IdentifiedModel
from workbench.point.lin.result import LinResult
from workbench.requests.decorator import with_origin
from workbench.response.nfr.result import NfrResult
from workbench.show.result import Result
from workbench.show.tables import behind

if TYPE_CHECKING:
    from workbench.point.lin.state_space import LinearModel

__all__ = ["Overlay", "overlay", "sine_response"]


IDENTIFIED, LINEAR = "identified", "linearised"
_POINTS = 400


@dataclass(frozen=True, eq=False)
class Difference:
    """One curve less the reference.

    Attributes:
        curve: name of the curve.
        frequency_hz: shape (k,) [Hz].
        gain_db: shape (k,) [dB]; NaN where one of both has no value.
        phase_deg: shape (k,), within ±180 [deg].
    """

    curve: str
    frequency_hz: Floats
    gain_db: Floats
    phase_deg: Floats

    def worst(self, up_to_hz: float = np.inf) -> tuple[float, float]:
        """Return the largest magnitudes of gain [dB] and phase difference [deg]; NaN where nothing is compared.

        Args:
            up_to_hz: frequencies above are left out [Hz].
        """
        chosen = (self.frequency_hz <= up_to_hz) & np.isfinite(self.gain_db)
        if not chosen.any():
            return float("nan"), float("nan")
        return float(np.max(np.abs(self.gain_db[chosen]))), float(np.max(np.abs(self.phase_deg[chosen])))

    def within(self, gain_db: float, phase_deg: float, up_to_hz: float = np.inf) -> bool:
        """Return whether both differences stay within limits; False where nothing is compared.

        Args:
            gain_db: limit [dB].
            phase_deg: limit [deg].
            up_to_hz: frequencies above are left out [Hz].
        """
        gain, phase = self.worst(up_to_hz)
        return gain <= gain_db and phase <= phase_deg


@dataclass(frozen=True, eq=False, kw_only=True)
class Overlay(Result):
    """Frequency responses from one input to one output, as sines would show them.

    Attributes:
        name: name of the model or file.
        input, output: names.
        frequency_hz: shape (k,), of the curves [Hz].
        curves: name → response, shape (k,); NaN where the curve says nothing (above its Nyquist frequency).
        measured: frequency response with sines, all amplitudes; None where there is none.
        amplitude: of the measured response that is the reference [unit of the input]; NaN where there is none.
        reference: name of what the others are compared with.
        differences: differences of the other curves, at the measured frequencies or at those of the curves.
        nyquist_hz: half the sampling rate of the identified model [Hz].
        notes: what else should be known, one line each.
    """

    _page = "workbench.identification.validate.page:overlay_page"
    _picture = "workbench.identification.validate.picture:plot_overlay"

    name: str
    input: str
    output: str
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    curves: Mapping[str, Complex] = field(metadata=entry(kept=False, dims=("frequency_hz",)))
    measured: NfrResult | None
    amplitude: float
    reference: str
    differences: tuple[Difference, ...]
    nyquist_hz: float
    notes: tuple[str, ...]

    def difference(self, curve: str = IDENTIFIED) -> Difference:
        """Return the difference between a curve and the reference.

        Args:
            curve: name of the curve.

        Raises:
            InputError: there is no such curve, or it is the reference.
        """
        known = {d.curve: d for d in self.differences}
        if curve not in known:
            raise InputError(f"curve '{curve}' is not compared; {suggest(curve, known)}")
        return known[curve]

    @property
    def words(self) -> tuple[str, ...]:
        """The comparison in sentences."""
        lines = []
        for d in self.differences:
            gain, phase = d.worst()
            high = float(d.frequency_hz[np.isfinite(d.gain_db)].max(initial=0.0))
            if high > 0.0:
                far = f"{gain:.2g} dB and {phase:.2g}°"
                lines.append(f"{d.curve}: within {far} of {self.reference} up to {high:.4g} Hz")
        return (*lines, *self.notes)

    def derived(self) -> dict[str, Any]:
        """Return the curves by gain and phase, and the comparison in sentences."""
        curves = {
            name: {"gain_db": decibels(curve), "phase_deg": degrees(curve)} for name, curve in self.curves.items()
        }
        return {"curves": curves, "words": self.words}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the complex responses."""
        return {**data, "curves": {name: _response(**curve) for name, curve in data["curves"].items()}}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency of each difference."""
        yield ("curve", "frequency_hz", "difference_db", "difference_deg")
        for d in self.differences:
            yield from ((d.curve, *row) for row in zip(d.frequency_hz, d.gain_db, d.phase_deg, strict=True))


@with_origin()
def overlay(
    model: IdentifiedModel,
    *,
    lin: LinResult | LinearModel | None = None,
    nfr: NfrResult | None = None,
    input: str | None = None,
    output: str | None = None,
    amplitude: float | None = None,
    frequencies: Sequence[float] | Floats | None = None,
    plant: str | None = None,
) -> Overlay:
    """Lay an identified model over the linearisation and the measured frequency response.

    All are shown as sines would show them, in the units of the measured response, else of the identified model; those
    in other units are converted, which a note says. The identified model maps held inputs to samples; at 60 % of the
    Nyquist frequency the hold alone turns the phase by 54°. What a sine shows of the same plant depends on where the
    hold is: see `plant`. The measured response is the reference where there is one, else the linearisation.

    Args:
        model: discrete, identified.
        lin: linearisation.
        nfr: measured with sines.
        input: name; may be left out where the model has one.
        output: name; likewise.
        amplitude: amplitude of `nfr`, that is the reference; may be left out where there is one.
        frequencies: of the curves [Hz]; None: those of `nfr`, else three decades up to the Nyquist frequency.
        plant: "continuous": the record's input was held, that of a sine is not; the hold is taken out. "sampled": the
            plant samples its input and holds its output, as a sampled control law does; the hold is added. "held": the
            discrete response as it is. None: "sampled" where `lin` says that the plant is, else "continuous".

    Raises:
        InputError: unknown name, amplitude or plant; units that do not measure the same; nothing to compare with.

    Examples:
        The model identified from data without noise has the frequency response of the linearised one.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     data = wb.excite(lag, "u", "y", dt=0.1, samples=300).identification
        ...     linear = wb.lin(lag)
        >>> found = wb.overlay(wb.identify(data, order=1).model, lin=linear)
        >>> print(abs(found.curves["identified"] - found.curves["linearised"]).max() < 1e-4)
        True
    """
    source, target = _channel("input", model.input_names, input), _channel("output", model.output_names, output)
    linear = lin if lin is None or isinstance(lin, LinResult) else lin.result
    if linear is None and nfr is None:
        raise InputError("overlay: give a linearisation, a measured frequency response or both")
    kind = plant or ("sampled" if _is_sampled(linear) else "continuous")
    identified, notes = sine_response(model, kind, source, target)
    own = _CurveUnits(IDENTIFIED, model.units.get(source), model.units.get(target))
    wanted = own if nfr is None else _CurveUnits("measured", nfr.input_unit, nfr.output_unit)
    factor, told = own.factor(wanted)
    shapes: dict[str, Callable[[Floats], Complex]] = {IDENTIFIED: _times(identified, factor)}
    if linear is not None:
        i, j = _places(linear, source, target)
        factor, more = _CurveUnits(
            LINEAR, linear.units.get(linear.input_names[j]), linear.units.get(linear.output_names[i])
        ).factor(wanted)
        shapes[LINEAR], told = _times(_linear(linear, i, j), factor), (*told, *more)
    grid = _grid(model, nfr, frequencies)
    level = float("nan") if nfr is None else _amplitude(nfr, amplitude)
    reference = LINEAR if nfr is None else f"the response measured at amplitude {level:g}{behind(nfr.input_unit)}"
    return Overlay(
        name=model.name, input=source, output=target, frequency_hz=grid,
        curves={name: shape(grid) for name, shape in shapes.items()}, measured=nfr, amplitude=level,
        reference=reference, differences=_differences(shapes, reference, _truth(shapes, nfr, level, grid)),
        nyquist_hz=0.5 / model.dt, notes=(*notes, *told),
    )  # fmt: skip


@dataclass(frozen=True)
class _CurveUnits:
    """Units of a curve's input and output, None where not known."""

    curve: str
    input: str | None
    output: str | None

    def factor(self, wanted: _CurveUnits) -> tuple[float, tuple[str, ...]]:
        """Return what a response is multiplied by to be in other units, and a note where it is not one.

        Args:
            wanted: units of the curve that it is compared with.

        Raises:
            InputError: a unit that is not known, or not comparable.
        """
        (above, up), (below, down) = (
            _scale(self.curve, side, getattr(self, side), getattr(wanted, side)) for side in ("output", "input")
        )
        return above / below, tuple(notes for notes in (up, down) if notes)


def _scale(curve: str, side: str, own: str | None, wanted: str | None) -> tuple[float, str]:
    if own is None or wanted is None or own == wanted:
        missing = own is None and wanted is not None
        return 1.0, f"{curve}: the {side} has no unit; it is taken to be in {wanted}" if missing else ""
    result = named_conversion(own, wanted)
    if result is None:
        unknown = [unit for unit in (own, wanted) if known_unit(unit) is None]
        why = f"the unit '{unknown[0]}' is not known" if unknown else "they do not measure the same"
        raise InputError(
            f"overlay: the {side} of the {curve} model is in '{own}', and what it is compared with in '{wanted}': {why}"
            "; convert the data"
        )
    return result[0], f"{curve}: the {side} is converted from {own} to {wanted}"


def _times(shape: Callable[[Floats], Complex], factor: float) -> Callable[[Floats], Complex]:
    return shape if factor == 1.0 else lambda frequency: np.asarray(factor * shape(frequency))


def _differences(
    shapes: dict[str, Callable[[Floats], Complex]], reference: str, truth: tuple[Floats, Complex]
) -> tuple[Difference, ...]:
    """Return how far each curve is from the reference, at the frequencies where that is known."""
    at, true = truth
    return tuple(Difference(n, at, *difference(shape(at), true)) for n, shape in shapes.items() if n != reference)


def sine_response(
    model: IdentifiedModel, plant: str, input: str, output: str
) -> tuple[Callable[[Floats], Complex], tuple[str, ...]]:
    """Return the response that a sine would show as a function of frequency [Hz], NaN above Nyquist, and notes.

    The hold is taken out by the continuous model with the same samples; where there is none (poles on the negative
    real axis) by division by (1 − e^(−sT))/(sT), which leaves what aliasing adds.

    Args:
        model: discrete.
        plant: name in `PLANTS`.
        input: one of its inputs.
        output: one of its outputs.

    Raises:
        InputError: unknown plant.
    """
    if plant not in PLANTS:
        raise InputError(f"plant '{plant}' is unknown; {suggest(plant, PLANTS)}")
    shape, notes = PLANTS[plant](model)
    i, j = model.output_names.index(output), model.input_names.index(input)

    def response(frequency: Floats) -> Complex:
        result = np.full(len(frequency), np.nan, dtype=np.complex128)
        below = frequency < 0.5 / model.dt
        result[below] = shape(frequency[below])[:, i, j]
        return result

    return response, notes


_Shape = tuple[Callable[[Floats], Complex], tuple[str, ...]]


def _hold(frequency: Floats, dt: float) -> Complex:
    """Return (1 − e^(−sT))/(sT), shape (k, 1, 1)."""
    x = frequency[:, None, None] * dt
    return np.asarray(np.sinc(x) * np.exp(-1j * np.pi * x), dtype=np.complex128)


def _continuous(model: IdentifiedModel) -> _Shape:
    try:
        smooth = model.continuous()
    except InputError as error:
        note = f"the hold is removed by division, aliasing remains: {error}"
        return lambda f: np.asarray(model.response(f) / _hold(f, model.dt)), (note,)
    delay = model.dt * np.array(model.delay or (0,) * len(model.input_names), dtype=np.float64)
    return lambda f: np.asarray(smooth.response(f) * np.exp(-2j * np.pi * f[:, None, None] * delay)), ()


# Name → response (k, p, m) over frequency [Hz], and notes.
PLANTS: Mapping[str, Callable[[IdentifiedModel], _Shape]] = {
    "continuous": _continuous,
    "sampled": lambda model: (lambda f: np.asarray(model.response(f) * _hold(f, model.dt)), ()),
    "held": lambda model: (model.response, ()),
}


def _is_sampled(linear: LinResult | None) -> bool:
    return linear is not None and linear.intersample is not None and linear.intersample.sampled


def _channel(kind: str, names: Sequence[str], chosen: str | None) -> str:
    if chosen is None and len(names) == 1:
        return names[0]
    if chosen not in names:
        wanted = f"{kind} '{chosen}' is not in the model" if chosen else f"the model has several {kind}s, name one"
        raise InputError(f"{wanted}; {suggest(chosen or '', names)}")
    return str(chosen)


def _places(linear: LinResult, source: str, target: str) -> tuple[int, int]:
    """Return the row and column of these names in the linearisation, or those of its one output and input."""
    i, j = (
        names.index(name) if name in names else _only(kind, names, name)
        for kind, names, name in (("output", linear.output_names, target), ("input", linear.input_names, source))
    )
    return i, j


def _linear(linear: LinResult, i: int, j: int) -> Callable[[Floats], Complex]:
    def response(frequency: Floats) -> Complex:
        result = linear.fundamental(frequency)[:, i, j].copy()
        if linear.dt > 0.0:
            result[frequency >= 0.5 / linear.dt] = np.nan
        return np.asarray(result, dtype=np.complex128)

    return response


def _only(kind: str, names: Sequence[str], wanted: str) -> int:
    if len(names) != 1:
        raise InputError(f"the linearisation has no {kind} '{wanted}'; {suggest(wanted, names)}")
    return 0


def _amplitude(nfr: NfrResult, amplitude: float | None) -> float:
    nfr.to_frd(amplitude)  # refuses what was not measured, with the known ones
    return float(nfr.amplitude[0] if amplitude is None else amplitude)


def _grid(model: IdentifiedModel, nfr: NfrResult | None, frequencies: Sequence[float] | Floats | None) -> Floats:
    if frequencies is not None:
        return np.sort(np.asarray(frequencies, dtype=np.float64))
    high = 0.5 / model.dt
    low, top = (1e-3 * high, high) if nfr is None else (float(nfr.frequency_hz[0]), float(nfr.frequency_hz[-1]))
    grid: Floats = np.geomspace(low, max(top, low * 1.01) * (1.0 - 1e-9), _POINTS)
    return grid


def _truth(
    shapes: Mapping[str, Callable[[Floats], Complex]], nfr: NfrResult | None, level: float, grid: Floats
) -> tuple[Floats, Complex]:
    """Return the frequencies and values of the reference."""
    if nfr is None:
        return grid, shapes[LINEAR](grid)
    row = int(np.argmin(np.abs(nfr.amplitude - level)))
    return nfr.frequency_hz, nfr.response[row]


def _response(gain_db: Sequence[float | None], phase_deg: Sequence[float | None]) -> Complex:
    gain, phase = (np.array(values, dtype=np.float64) for values in (gain_db, phase_deg))
    return np.asarray(10.0 ** (gain / 20.0) * np.exp(1j * np.radians(phase)), dtype=np.complex128)
