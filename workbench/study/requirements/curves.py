"""Frequency responses as requirements read them: one reader for each command that measures or computes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels, unwrapped
from workbench.core.values.poles import continuous, natural_frequency_hz, vanished
from workbench.errors import InputError, suggest
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.overlay import sine_response
from workbench.point.lin.result import LinResult
from workbench.show.tables import behind
from workbench.study.requirements.base import NotMeasured, Result

__all__ = ["READERS", "Curve", "amplitude_words", "around_poles", "curves", "interpolate", "poles", "sines", "unwrap"]

_SAME = 1e-9  # frequencies that differ by less are the same
_DENSE = 60  # points per decade
_SMALLEST = 1e-300


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
        """Return a value at a frequency, interpolated linearly over log frequency (gain in dB).

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
        return interpolate(frequency, self.frequency, values)

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
        offset=[result["offset"][i][j] for j in kept],
        averaged=[frequency[j] for j in kept if result["averaged"][i][j]],
        failed=reasons,
        unit=result["output"].get("unit"),
    )


def _reasons(result: Result, amplitude: float) -> dict[float, str]:
    return {f["frequency_hz"]: f["reason"] for f in result["failed"] if f["amplitude"] == amplitude}


# -- linear models -----------------------------------------------------------------------------


def _of_model(result: Result, options: Mapping[str, Any]) -> list[Curve]:
    wanted = {name: options[name] for name in ("at", "input", "output", "plant")}
    return [linear_curve(result, **wanted)]


def poles(result: Result) -> list[complex]:
    """Return the poles of a linear model as those of a continuous one [1/s]; delays, near z = 0, are left out."""
    dt = float(result["dt"])
    every = np.array([complex(*p) for p in result["poles"]], dtype=np.complex128)
    seen: list[complex] = continuous(every[~vanished(every, dt)], dt).tolist()
    return seen


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
    frequency = around_poles(result, at)
    if not frequency:
        raise NotMeasured("the frequencies lie above half the sampling rate of the model")
    respond = sines(result, plant, str(result["input_names"][column]), str(result["output_names"][row]))
    value = respond(np.array(frequency))
    value = np.where(np.abs(value) < _SMALLEST, _SMALLEST, value)
    return Curve(frequency=frequency, gain=decibels(value).tolist(), phase=unwrapped(value).tolist())


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
    rates = [float(natural_frequency_hz(p)) for p in poles(result)]
    rates = [r for r in rates if r > 1e-9 * max(rates)]
    return (min(rates) / 100.0, max(rates) * 10.0) if rates else (0.01, 100.0)


# -- loop --------------------------------------------------------------------------------------


def _of_loop(result: Result, options: Mapping[str, Any]) -> list[Curve]:
    source = options["source"] or ("measured" if result["measured"] else "linear")
    if source == "linear":
        return [_linear_loop(result)]
    if not result["measured"]:
        raise InputError('the loop was not measured; give the analysis an amplitude, or take source = "linear"')
    several = len(result["measured"]) > 1
    return [_measured_loop(m, result["unit"], told=several) for m in result["measured"]]


def _linear_loop(result: Result) -> Curve:
    linear = result["linear"]
    if linear is None:
        raise NotMeasured("the loop could not be linearised")
    return Curve(frequency=linear["frequency_hz"], gain=_db(linear["gain"]), phase=unwrap(linear["phase_deg"]))


def _measured_loop(measured: Result, unit: str | None, *, told: bool) -> Curve:
    points = sorted((p for p in measured["points"] if p["gain"] is not None), key=lambda p: float(p["frequency_hz"]))
    return Curve(
        label=f"{amplitude_words(measured['amplitude'], unit)}, {measured['how']}" if told else "",
        amplitude=measured["amplitude"],
        frequency=[p["frequency_hz"] for p in points],
        gain=_db([p["gain"] for p in points]),
        phase=unwrap([p["phase_deg"] for p in points]),
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
