"""Which frequency responses a result holds: one reader for each command."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from workbench.errors import InputError, suggest
from workbench.study.kinds.base import NotMeasured, Result
from workbench.study.kinds.curve import Curve, unwrap

__all__ = ["READERS", "curves", "poles"]

_DENSE = 60  # points per decade at which a linear model is evaluated


def curves(
    result: Result,
    *,
    band: tuple[float, float] | None = None,
    amplitude: float | None = None,
    source: str | None = None,
    input: str | None = None,
    output: str | None = None,
) -> list[Curve]:
    """Return the frequency responses of a result.

    Args:
        result: of a command in `READERS`.
        band: where a linear model is evaluated [Hz]; None: around its poles.
        amplitude: only the curve of this amplitude; None: all.
        source: "linear" or "measured", of a result that holds both; None: the measured ones where there are any.
        input: of a model with several.
        output: likewise.

    Raises:
        InputError: no such amplitude, input or output.
        NotMeasured: the result holds none.
    """
    read = READERS[str(result["command"])]
    found = read(result, {"band": band, "source": source, "input": input, "output": output})
    if amplitude is None:
        return found
    chosen = [c for c in found if c.amplitude is not None and math.isclose(c.amplitude, amplitude, rel_tol=1e-9)]
    if not chosen:
        had = ", ".join(f"{c.amplitude:g}" for c in found if c.amplitude is not None) or "none"
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
        label=f"amplitude {amplitude:g}" if told else "",
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
    """Evaluate C (pI − A)⁻¹ B + D at p = jω, or at p = exp(jω·dt)."""
    import numpy as np  # noqa: PLC0415 - most requirements do without

    A, B, C, D = (np.array(result[name], dtype=np.float64) for name in "ABCD")
    column = _index("input", options["input"], result["input_names"])
    row = _index("output", options["output"], result["output_names"])
    dt = float(result["dt"])
    frequency = _frequencies(result, options["band"])
    if not frequency:
        raise NotMeasured("the band lies above half the sampling rate of the model")
    points = [2j * math.pi * f for f in frequency]
    if dt > 0.0:
        points = [np.exp(s * dt) for s in points]
    eye, b, c, d = np.eye(len(A)), B[:, column], C[row], D[row, column]
    response = [complex(c @ np.linalg.solve(p * eye - A, b) + d) if len(A) else complex(d) for p in points]
    return [
        Curve(
            frequency=frequency,
            gain=[20.0 * math.log10(max(abs(r), 1e-300)) for r in response],
            phase=unwrap([math.degrees(math.atan2(r.imag, r.real)) for r in response]),
        )
    ]


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None:
        if len(names) != 1:
            raise InputError(
                f'the model has several {what}s; name one: {what} = "{names[0]}"' if names else f"no {what}"
            )
        return 0
    if name not in names:
        raise InputError(f"{what} '{name}' is unknown; {suggest(name, names)}")
    return list(names).index(name)


def _frequencies(result: Result, band: tuple[float, float] | None) -> list[float]:
    """Return frequencies of a band [Hz], rising, below half the sampling rate."""
    dt = float(result["dt"])
    low, high = band if band is not None else _around(result)
    if dt > 0.0:
        high = min(high, 0.5 / dt * (1.0 - 1e-9))
    if low > high:
        return []
    count = max(2, math.ceil(_DENSE * math.log10(high / low)) + 1) if high > low else 1
    return [low * (high / low) ** (k / max(count - 1, 1)) for k in range(count)]


def _around(result: Result) -> tuple[float, float]:
    rates = [abs(p) / (2.0 * math.pi) for p in poles(result)]
    rates = [r for r in rates if r > 1e-9 * max(rates)]
    return (min(rates) / 100.0, max(rates) * 10.0) if rates else (0.01, 100.0)


def poles(result: Result) -> list[complex]:
    """Return the poles of a linear model as those of a continuous one [rad/s]; a pole at z = 0 is left out."""
    dt = float(result["dt"])
    found = [complex(*p) for p in result["poles"]]
    return [cmath.log(z) / dt for z in found if z != 0.0] if dt > 0.0 else found


# -- loop --------------------------------------------------------------------------------------


def _of_loop(result: Result, options: Mapping[str, Any]) -> list[Curve]:
    source = options["source"] or ("measured" if result["measured"] else "linear")
    if source == "linear":
        return [_linear_loop(result)]
    if not result["measured"]:
        raise InputError('the loop was not measured; give the analysis an amplitude, or take source = "linear"')
    told = len(result["measured"]) > 1
    return [_measured_loop(m, told=told) for m in result["measured"]]


def _linear_loop(result: Result) -> Curve:
    linear = result["linear"]
    if linear is None:
        raise NotMeasured("the loop could not be linearised")
    gain = [20.0 * math.log10(max(g, 1e-300)) for g in linear["gain"]]
    return Curve(frequency=linear["frequency_hz"], gain=gain, phase=unwrap(linear["phase_deg"]))


def _measured_loop(measured: Result, *, told: bool) -> Curve:
    points = sorted((p for p in measured["points"] if p["gain"] is not None), key=lambda p: float(p["frequency_hz"]))
    return Curve(
        label=f"amplitude {measured['amplitude']:g}, {measured['how']}" if told else "",
        amplitude=measured["amplitude"],
        frequency=[p["frequency_hz"] for p in points],
        gain=[20.0 * math.log10(max(p["gain"], 1e-300)) for p in points],
        phase=unwrap([p["phase_deg"] for p in points]),
        averaged=[p["frequency_hz"] for p in points if p["status"] == "averaged"],
        failed={p["frequency_hz"]: p["reason"] or "no value" for p in measured["points"] if p["gain"] is None},
    )


READERS: Mapping[str, Callable[[Result, Mapping[str, Any]], list[Curve]]] = {
    "nfr": _of_nfr,
    "lin": _of_model,
    "identify": _of_model,
    "loop": _of_loop,
}
