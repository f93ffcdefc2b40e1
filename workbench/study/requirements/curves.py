"""Frequency responses as requirements read them: one reader for each command that measures or computes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels
from workbench.core.values.large import is_large
from workbench.core.values.linear import Linear
from workbench.core.values.poles import continuous, natural_frequency_hz, vanished
from workbench.core.values.sine_curve import SineCurve
from workbench.errors import InputError, SimulationError, suggest
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.overlay import sine_response
from workbench.loops.loop.result import LinearLoop, LoopResult
from workbench.point.lin.result import LinResult
from workbench.show.tables import behind
from workbench.study.requirements.base import NotMeasured, Result

__all__ = [
    "READERS", "Curve", "amplitude_words", "around_poles", "curves", "interpolate", "moving_poles", "sines", "unwrap",
]  # fmt: skip

_SAME = 1e-9  # frequencies that differ by less are the same
_DENSE = 60  # points per decade


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One frequency response.

    Attributes:
        label: which one, such as "amplitude 4 deg"; empty: there is only one.
        amplitude: of the sine; None: it is a linear model's.
        frequency: rising [Hz].
        gain: [dB].
        phase: [deg], without jumps.
        offset: mean of the output [its unit]; empty: not known.
        averaged: frequencies at which the response never settled [Hz].
        failed: frequency [Hz] → why there is no value.
        unit: of the offset.
        exact: of a linear model: its response at any frequency; None: nothing is known between the points.
        doubt: about the turn that the phase is in; empty: there is none.
    """

    label: str = ""
    amplitude: float | None = None
    frequency: Sequence[float]
    gain: Sequence[float]
    phase: Sequence[float]
    offset: Sequence[float] = ()
    averaged: Sequence[float] = ()
    failed: Mapping[float, str] = field(default_factory=dict)
    unit: str | None = None
    exact: SineCurve | None = None
    doubt: str = ""

    def values(self, quantity: str) -> Sequence[float]:
        """Return gain [dB], phase [deg] or offset, one for each frequency.

        Args:
            quantity: "gain", "phase" or "offset".

        Raises:
            NotMeasured: there is none.
        """
        result: Sequence[float] = getattr(self, quantity)
        if not self.frequency:
            raise NotMeasured(next(iter(self.failed.values()), "no point was measured"))
        if not result:
            raise NotMeasured(f"the result has no {quantity}")
        return result

    def at(self, quantity: str, frequency: float) -> float:
        """Return a value at a frequency, measured ones interpolated linearly over log frequency (gain in dB).

        Args:
            quantity: as of `values`.
            frequency: [Hz].

        Raises:
            NotMeasured: outside of the measured frequencies, or the point failed.
        """
        values = self.values(quantity)
        self.check_failed(frequency, frequency)
        low, high = self.frequency[0], self.frequency[-1]
        if not self.reaches(frequency):
            raise NotMeasured(f"{frequency:g} Hz is outside of the measured {low:g} to {high:g} Hz{self.told}")
        if self.exact is not None:
            return float(self.evaluated(quantity, np.array([frequency]))[0])
        return interpolate(frequency, self.frequency, values)

    def around(self, frequency: float) -> tuple[int, int] | None:
        """Return the points that a frequency [Hz] lies between; None: it is one of them, or the model is known."""
        if self.exact is not None or any(math.isclose(f, frequency, rel_tol=_SAME) for f in self.frequency):
            return None
        above = int(np.searchsorted(self.frequency, frequency))
        return above - 1, above

    def evaluated(self, quantity: str, frequency_hz: Floats) -> Floats:
        """Return gain [dB] or phase [deg] of a linear model at any frequencies, shape (k,).

        Args:
            quantity: "gain" or "phase".
            frequency_hz: shape (k,), below half the sampling rate.
        """
        assert self.exact is not None  # noqa: S101 - of a linear model
        return self.exact.gain(frequency_hz) if quantity == "gain" else self.exact.phase(frequency_hz)

    def finest(
        self, quantity: str, band: tuple[float, float], sign: float, level: Callable[[Floats], Floats]
    ) -> list[float]:
        """Return the points inside a band, and where a linear model is nearest to a level [Hz].

        Args:
            quantity: "gain" or "phase".
            band: two frequencies [Hz].
            sign: +1 where the curve is to be above the level, −1 where below.
            level: frequencies → level.
        """
        low, high = band
        inside = [f for f in self.frequency if low < f < high]
        if self.exact is None or not low < high or not self.reaches(high):
            return inside
        f = self.exact.refined(
            np.array([low, *inside, high]), lambda x: sign * (self.evaluated(quantity, x) - level(x))
        )
        result: list[float] = f[1:-1].tolist()
        return result

    def reaches(self, frequency: float) -> bool:
        """Whether a frequency [Hz] lies between the first and the last one."""
        return self.frequency[0] * (1.0 - _SAME) <= frequency <= self.frequency[-1] * (1.0 + _SAME)

    def only(self, frequencies: Sequence[float]) -> Curve:
        """Return the curve at some of its frequencies [Hz]."""
        kept = [k for k, f in enumerate(self.frequency) if f in set(frequencies)]
        return replace(
            self,
            frequency=[self.frequency[k] for k in kept],
            gain=[self.gain[k] for k in kept],
            phase=[self.phase[k] for k in kept],
        )

    def check_failed(self, low: float, high: float) -> None:
        """Raise where a point between two frequencies [Hz] failed.

        Raises:
            NotMeasured: which one, and why.
        """
        for frequency, reason in self.failed.items():
            if low * (1.0 - _SAME) <= frequency <= high * (1.0 + _SAME):
                raise NotMeasured(f"the point at {frequency:.4g} Hz{self.told} failed: {reason}")

    @property
    def told(self) -> str:
        """The label after a comma, for messages."""
        return f", {self.label}" if self.label else ""

    def where(self, frequency: float) -> str:
        """Return a place for people: "4.2 Hz, amplitude 4 deg (averaged)"."""
        averaged = any(math.isclose(frequency, f, rel_tol=_SAME) for f in self.averaged)
        return f"{frequency:.4g} Hz{self.told}{' (averaged)' if averaged else ''}"

    def where_phase(self, frequency: float) -> str:
        """Return the same, with the doubt about the turn that the phase is in."""
        return "; ".join(filter(None, [self.where(frequency), self.doubt]))


def interpolate(frequency: float, frequencies: Sequence[float], values: Sequence[float]) -> float:
    """Return the value at a frequency inside of `frequencies` (rising), linear over log frequency."""
    return float(np.interp(math.log(frequency), np.log(frequencies), values))


def amplitude_words(amplitude: float, unit: str | None) -> str:
    """Return an amplitude for people: "amplitude 4 deg"."""
    return f"amplitude {amplitude:g}{behind(unit)}"


def unwrap(phases: Sequence[float]) -> list[float]:
    """Return phases [deg] with jumps of more than half a turn taken out."""
    result: list[float] = np.unwrap(phases, period=360.0).tolist()
    return result


def curves(
    result: Result,
    *,
    at: Sequence[float] = (),
    amplitude: float | None = None,
    source: str | None = None,
    input: str | None = None,
    output: str | None = None,
    plant: str = "continuous",
) -> list[Curve]:
    """Return the frequency responses of a result.

    Args:
        result: of a command in `READERS`.
        at: frequencies at which a linear model is evaluated [Hz], besides those around its poles.
        amplitude: only the curve of this amplitude; None: all.
        source: "linear" or "measured", of a result that holds both; None: the measured ones where there are any.
        input: of a model with several.
        output: likewise.
        plant: what an identified model stands for, see `linear_curve`.

    Raises:
        InputError: no such amplitude, input or output.
        NotMeasured: the result holds none.
    """
    read = READERS[str(result["command"])]
    every = read(result, {"at": at, "source": source, "input": input, "output": output, "plant": plant})
    if amplitude is None:
        return every
    chosen = [c for c in every if c.amplitude is not None and math.isclose(c.amplitude, amplitude, rel_tol=1e-9)]
    if not chosen:
        had = ", ".join(f"{c.amplitude:g}" for c in every if c.amplitude is not None) or "none"
        raise InputError(f"amplitude {amplitude:g} was not measured; measured: {had}")
    return chosen


# -- nfr ---------------------------------------------------------------------------------------


def _of_nfr(result: Result, _options: Mapping[str, Any]) -> list[Curve]:
    amplitudes = result["amplitude"]
    return [_of_amplitude(result, i, a, told=len(amplitudes) > 1) for i, a in enumerate(amplitudes)]


def _of_amplitude(result: Result, i: int, amplitude: float, *, told: bool) -> Curve:
    frequency, reasons = result["frequency_hz"], _reasons(result, amplitude)
    kept = [j for j, gain in enumerate(result["gain_db"][i]) if gain is not None and frequency[j] not in reasons]
    kept.sort(key=lambda j: frequency[j])
    return Curve(
        label=amplitude_words(amplitude, result["input"].get("unit")) if told else "",
        amplitude=amplitude,
        frequency=[frequency[j] for j in kept],
        gain=[result["gain_db"][i][j] for j in kept],
        phase=unwrap([result["phase_deg"][i][j] for j in kept]),
        doubt=_doubt(
            [frequency[j] for j in kept],
            [result["gain_db"][i][j] for j in kept],
            [result["phase_deg"][i][j] for j in kept],
        ),
        offset=[result["offset"][i][j] for j in kept],
        averaged=[frequency[j] for j in kept if result["averaged"][i][j]],
        failed=reasons,
        unit=result["output"].get("unit"),
    )


def _doubt(frequency: Sequence[float], gain: Sequence[float], phase: Sequence[float]) -> str:
    """Return why the first phase may be whole turns off, told by the slope of the gain there; empty: it is not.

    A gain that falls by 20 dB a decade turns by −90° where nothing is unstable (H. Bode, Network Analysis, 1945).
    """
    if len(frequency) < 2:
        return ""
    slope = (gain[1] - gain[0]) / (20.0 * math.log10(frequency[1] / frequency[0]))
    turns = round((90.0 * slope - phase[0]) / 360.0)
    if not turns:
        return ""
    return (
        f"the turn of the phase is not known: it begins at {phase[0]:.4g} deg, or at "
        f"{phase[0] + 360.0 * turns:.4g} deg, which fits the gain's slope of {20.0 * slope:.3g} dB a decade"
    )


def _reasons(result: Result, amplitude: float) -> dict[float, str]:
    return {f["frequency_hz"]: f["reason"] for f in result["failed"] if f["amplitude"] == amplitude}


# -- linear models -----------------------------------------------------------------------------


def _of_model(result: Result, options: Mapping[str, Any]) -> list[Curve]:
    wanted = {name: options[name] for name in ("at", "input", "output", "plant")}
    return [linear_curve(result, **wanted)]


def moving_poles(result: Result) -> list[complex]:
    """Return the poles of a linear model as those of a continuous one [1/s].

    Delays, near z = 0, and integrators are left out: poles that are 0 as far as rounding lets one know.
    """
    from workbench.core.values.modal import at_rest  # noqa: PLC0415 - slow to import

    dt = float(result["dt"])
    every = np.array([complex(*p) for p in result["poles"]], dtype=np.complex128)
    seen = continuous(every[~vanished(every, dt)], dt)
    A = np.asarray(result["A"], dtype=np.float64).reshape(len(result["A"]), -1)
    moving: list[complex] = seen[~at_rest(A, seen, dt=dt)].tolist()
    return moving


def linear_curve(result: Result, *, at: Sequence[float], input: str | None, output: str | None, plant: str) -> Curve:
    """Return the frequency response of a linear model, as sines would show it.

    Args:
        result: of `lin` or `identify`.
        at: frequencies at which it is evaluated [Hz], besides those around its poles; a discrete model ends below half
            its sampling rate.
        input: its name; None: the model has one.
        output: likewise.
        plant: what an identified model stands for, as in `workbench.identification.validate.overlay`: "continuous"
            takes the hold of the record out, "sampled" adds that of the plant, "held" leaves the model as it is.

    Raises:
        InputError: no such input or output.
        NotMeasured: there is no frequency below half the sampling rate.
    """
    column = _index("input", input, result["input_names"])
    row = _index("output", output, result["output_names"])
    respond = sines(result, plant, str(result["input_names"][column]), str(result["output_names"][row]))
    model = LinResult.from_dict(result) if result["command"] == "lin" else IdentifiedModel.from_dict(result)
    delayed = model.delayed if isinstance(model, LinResult) else None
    curve = sine_curve(
        model, respond, row=row, column=column, delays=np.zeros(0) if delayed is None else delayed.times,
        poles=moving_poles(result),
    )  # fmt: skip
    return _of_sines(curve, at)


def sine_curve(
    model: Linear, respond: Callable[[Floats], Complex], *, poles: Sequence[complex], row: int = 0, column: int = 0,
    delays: Floats | None = None,
) -> SineCurve:  # fmt: skip
    """Return the response of one entry of a linear model, with what turns it.

    Args:
        model: its poles and zeros.
        respond: frequencies [Hz], shape (k,) → response to sines, shape (k,).
        poles: without integrators, as those of a continuous model [1/s].
        row: number of the output.
        column: number of the input.
        delays: transport delays in it [s]; None: none.
    """
    times = np.zeros(0) if delays is None else delays
    known, zeros = not is_large(model.A, model.dt), np.zeros(0, dtype=np.complex128)
    if known:
        try:
            zeros = model.part(column, row).invariant_zeros
        except SimulationError:
            known = False
    zeros = continuous(zeros[~vanished(zeros, model.dt)], model.dt)
    rational = known and model.dt == 0.0 and not len(times)
    return SineCurve(respond, np.array(poles, dtype=np.complex128), zeros, model.highest_hz, times, rational)


def _of_sines(exact: SineCurve, at: Sequence[float]) -> Curve:
    """Return a curve with a point at each of its extremes.

    Raises:
        NotMeasured: there is no frequency below half the sampling rate.
    """
    f = exact.grid(at)
    if not len(f):
        raise NotMeasured("the frequencies lie above half the sampling rate of the model")
    f = np.union1d(exact.refined(f, exact.gain), exact.refined(f, lambda x: -exact.gain(x)))
    return Curve(frequency=f.tolist(), gain=exact.gain(f).tolist(), phase=exact.phase(f).tolist(), exact=exact)


def sines(result: Result, plant: str, input: str, output: str) -> Callable[[Floats], Complex]:
    """Return the response of the model to sines as a function of frequency [Hz]."""
    if result["command"] == "identify" and float(result["dt"]) > 0.0:
        return sine_response(IdentifiedModel.from_dict(result), plant, input, output)[0]
    linear = LinResult.from_dict(result)
    row, column = linear.output_names.index(output), linear.input_names.index(input)
    return lambda f: linear.fundamental(f)[:, row, column]


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None and len(names) == 1:
        return 0
    if name is None:
        raise InputError(f'the model has {len(names)} {what}s; name one, as in {what} = "{next(iter(names), "")}"')
    if name not in names:
        raise InputError(f"{what} '{name}' is unknown; {suggest(name, names)}")
    return list(names).index(name)


def around_poles(result: Result, at: Sequence[float]) -> list[float]:
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
    rates = [float(natural_frequency_hz(p)) for p in moving_poles(result)]
    return (min(rates) / 100.0, max(rates) * 10.0) if rates else (0.01, 100.0)


# -- loop --------------------------------------------------------------------------------------


def _of_loop(result: Result, options: Mapping[str, Any]) -> list[Curve]:
    source = options["source"] or ("measured" if result["measured"] else "linear")
    if source == "linear":
        return [_linear_loop(result, options["at"])]
    if not result["measured"]:
        raise InputError('the loop was not measured; give the analysis an amplitude, or take source = "linear"')
    several = len(result["measured"]) > 1
    known = None if result["linear"] is None else _exact_loop(result)
    return [_measured_loop(m, result["unit"], known, told=several) for m in result["measured"]]


def _linear_loop(result: Result, at: Sequence[float]) -> Curve:
    if result["linear"] is None:
        raise NotMeasured("the loop could not be linearised")
    return _of_sines(_exact_loop(result), at)


def _exact_loop(result: Result) -> SineCurve:
    from workbench.core.values.modal import at_rest  # noqa: PLC0415 - slow to import

    linear: LinearLoop | None = LoopResult.from_dict(result).linear
    assert linear is not None  # noqa: S101 - whoever calls has looked
    poles = linear.transfer.continuous_poles
    moving = poles[~at_rest(linear.transfer.A, poles, dt=linear.transfer.dt)]
    delays = None if linear.lin.delayed is None else linear.lin.delayed.times
    return sine_curve(linear.transfer, linear.response, poles=moving.tolist(), delays=delays)


def _measured_loop(measured: Result, unit: str | None, linear: SineCurve | None, *, told: bool) -> Curve:
    """Return a measured curve; the linear loop tells in which turn its phase begins."""
    points = sorted((p for p in measured["points"] if p["gain"] is not None), key=lambda p: float(p["frequency_hz"]))
    frequency, gain = [p["frequency_hz"] for p in points], _db([p["gain"] for p in points])
    phase, doubt = unwrap([p["phase_deg"] for p in points]), ""
    if linear is None:
        doubt = _doubt(frequency, gain, phase)
    elif points:
        turns = round((float(linear.phase(np.array(frequency[:1]))[0]) - phase[0]) / 360.0)
        phase = [p + 360.0 * turns for p in phase]
    return Curve(
        label=f"{amplitude_words(measured['amplitude'], unit)}, {measured['how']}" if told else "",
        amplitude=measured["amplitude"],
        frequency=frequency,
        gain=gain,
        phase=phase,
        doubt=doubt,
        averaged=[p["frequency_hz"] for p in points if p["status"] == "averaged"],
        failed={p["frequency_hz"]: p["reason"] or "no value" for p in measured["points"] if p["gain"] is None},
    )


def _db(gains: Sequence[float]) -> list[float]:
    result: list[float] = decibels(np.maximum(gains, 1e-300)).tolist()
    return result


READERS: Mapping[str, Callable[[Result, Mapping[str, Any]], list[Curve]]] = {
    "nfr": _of_nfr,
    "lin": _of_model,
    "identify": _of_model,
    "loop": _of_loop,
}
