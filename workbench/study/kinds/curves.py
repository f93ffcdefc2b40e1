"""Which frequency responses a result holds: one reader for each command."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from workbench.core.response import decibels
from workbench.errors import InputError
from workbench.study.kinds.base import NotMeasured, Result
from workbench.study.kinds.curve import Curve, unwrap
from workbench.study.kinds.linear import linear_curve

__all__ = ["READERS", "curves"]


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
    found = read(result, {"at": at, "source": source, "input": input, "output": output, "plant": plant})
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
    wanted = {name: options[name] for name in ("at", "input", "output", "plant")}
    return [linear_curve(result, **wanted)]


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
    return Curve(frequency=linear["frequency_hz"], gain=_db(linear["gain"]), phase=unwrap(linear["phase_deg"]))


def _measured_loop(measured: Result, *, told: bool) -> Curve:
    points = sorted((p for p in measured["points"] if p["gain"] is not None), key=lambda p: float(p["frequency_hz"]))
    return Curve(
        label=f"amplitude {measured['amplitude']:g}, {measured['how']}" if told else "",
        amplitude=measured["amplitude"],
        frequency=[p["frequency_hz"] for p in points],
        gain=_db([p["gain"] for p in points]),
        phase=unwrap([p["phase_deg"] for p in points]),
        averaged=[p["frequency_hz"] for p in points if p["status"] == "averaged"],
        failed={p["frequency_hz"]: p["reason"] or "no value" for p in measured["points"] if p["gain"] is None},
    )


def _db(gains: Sequence[float]) -> list[float]:
    found: list[float] = decibels(np.maximum(gains, 1e-300)).tolist()
    return found


READERS: Mapping[str, Callable[[Result, Mapping[str, Any]], list[Curve]]] = {
    "nfr": _of_nfr,
    "lin": _of_model,
    "identify": _of_model,
    "loop": _of_loop,
}
