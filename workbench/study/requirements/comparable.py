"""What records hold that can be compared with another record: one reader for each analysis."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.records.names_in_text import unit_of_ratio
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.margins import Margins
from workbench.data.bla.result import BlaResult
from workbench.identification.identified.model import IdentifiedModel
from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from workbench.loops.loop.measured import LoopCurve
from workbench.loops.loop.result import LinearLoop, LoopResult
from workbench.point.lin.result import LinResult
from workbench.point.trim.result import TrimResult
from workbench.response.nfr.result import NfrResult
from workbench.response.simulate.result import SimulationResult
from workbench.show.tables import behind
from workbench.study.requirements.base import NotMeasured, Result
from workbench.study.requirements.curves import around_poles, sines

__all__ = ["READERS", "Comparable", "single"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparable:
    """One curve or number of a record.

    Attributes:
        name: one of a kind in the record.
        unit: of the values; None: they have none.
        along: unit of the places, "s" or "Hz"; "": a single number.
        at: shape (n,), places; of time histories never falling.
        value: shape (n,), real or complex; NaN: not known.
        error: shape (n,), that the record states [unit]; NaN: it states none.
        rounding: shape (n,), or the same for all: how far off a value without a stated error may be by rounding [unit].
        failed: place → why there is no value.
    """

    name: str
    unit: str | None = None
    along: str = ""
    at: Floats = field(default_factory=lambda: np.zeros(1))
    value: Floats | Complex
    error: Floats
    rounding: Floats | float = 0.0
    failed: Mapping[float, str] = field(default_factory=dict)


def single(name: str, value: float, unit: str | None = None, why: str = "") -> Comparable:
    """Return a single number, whose error is not stated.

    Args:
        name: of the number.
        value: of it; NaN: there is none.
        unit: of the value.
        why: there is none.
    """
    failed = {0.0: why} if math.isnan(value) else {}
    return Comparable(name=name, unit=unit, value=np.array([value]), error=np.array([math.nan]), failed=failed)


def _unstated(values: ArrayLike) -> Floats:
    return np.full(np.shape(values), np.nan)


def _simulate(result: Result, _at: Floats | None) -> Iterator[Comparable]:
    record = SimulationResult.from_dict(result)
    for name, values in record.signals.items():
        unit = record.units.get(name)
        yield Comparable(name=name, unit=unit, along="s", at=record.time, value=values, error=_unstated(values))


def _nfr(result: Result, _at: Floats | None) -> Iterator[Comparable]:
    record = NfrResult.from_dict(result)
    for k, amplitude in enumerate(record.amplitude.tolist()):
        value, share = record.response[k], record.error[k]
        # Relative to the true response, which is at most |value|/(1 - share); from 1 on that is no bound.
        error = np.where(share < 1.0, share, np.nan) * np.abs(value)
        yield Comparable(
            name=f"{record.output}/{record.input}, amplitude {amplitude:g}{behind(record.input_unit)}",
            unit=unit_of_ratio(record.output_unit, record.input_unit),
            along="Hz",
            at=record.frequency_hz,
            value=value,
            error=error / (1.0 - np.where(share < 1.0, share, np.nan)),
            failed={f.frequency_hz: f.reason for f in record.failed if f.amplitude == amplitude},
        )


def _bla(result: Result, _at: Floats | None) -> Iterator[Comparable]:
    record = BlaResult.from_dict(result)
    for k, rms in enumerate(record.rms.tolist()):
        yield Comparable(
            name=f"{record.output}/{record.input}, rms {rms:g}{behind(record.input_unit)}",
            unit=unit_of_ratio(record.output_unit, record.input_unit),
            along="Hz",
            at=record.frequency_hz,
            value=record.response[k],
            error=record.error[k],
        )


def _model(result: Result, at: Floats | None) -> Iterator[Comparable]:
    """Yield the responses of a linear model, computed where they are wanted."""
    f = np.array(around_poles(result, ())) if at is None else at
    dt = float(result["dt"])
    if dt > 0.0 and f.max(initial=0.0) >= 0.5 / dt:
        raise NotMeasured(f"the model samples every {dt:g} s now; the baseline's response reaches up to {f.max():g} Hz")
    model = (LinResult if result["command"] == "lin" else IdentifiedModel).from_dict(result)
    units, bound = (model.units if isinstance(model, LinResult) else {}), model.rounding(f)
    for i, output in enumerate(result["output_names"]):
        for j, input in enumerate(result["input_names"]):
            value = sines(result, "continuous", input, output)(f)
            unit = unit_of_ratio(units.get(output), units.get(input))
            yield Comparable(
                name=f"{output}/{input}", unit=unit, along="Hz", at=f,
                value=value, error=_unstated(value), rounding=_rounding(value, bound[:, i, j]),
            )  # fmt: skip


def _rounding(value: Complex, bound: Floats) -> Floats:
    """Return how far off a response may be by rounding: its bound at each frequency, and an ε of its largest value.

    That of a pole on the imaginary axis does not count as the largest: rounding leaves less than half of its digits.

    Args:
        value: of the response, shape (k,).
        bound: see `Linear.rounding`, shape (k,).
    """
    size, eps = np.abs(value), float(np.finfo(np.float64).eps)
    return bound + eps * float(size[bound < math.sqrt(eps) * size].max(initial=0.0))


def _loop(result: Result, at: Floats | None) -> Iterator[Comparable]:
    record = LoopResult.from_dict(result)
    if record.linear is not None:
        yield _loop_transfer(record.linear, at)
        yield from _margins(record.linear.margins, "")
    for curve in record.curves:
        label = f", amplitude {curve.amplitude:g}{behind(record.place.unit)}, {curve.how}"
        yield _measured(curve, label)
        yield from _margins(curve.margins, label)


def _loop_transfer(loop: LinearLoop, at: Floats | None) -> Comparable:
    f = loop.frequencies() if at is None else at
    value = loop.response(f)
    rounding = _rounding(value, loop.transfer.rounding(f)[:, 0, 0])
    return Comparable(name="L", along="Hz", at=f, value=value, error=_unstated(value), rounding=rounding)


def _measured(curve: LoopCurve, label: str) -> Comparable:
    value = np.array([complex("nan") if p.value is None else p.value for p in curve.points])
    return Comparable(
        name=f"L{label}",
        along="Hz",
        at=np.array([p.frequency_hz for p in curve.points]),
        value=value,
        error=_unstated(value),
        failed={p.frequency_hz: p.reason or "no value" for p in curve.failed},
    )


def _margins(margins: Margins, label: str) -> Iterator[Comparable]:
    disk = math.nan if margins.disk is None else margins.disk.alpha
    numbers: tuple[tuple[str, float, str | None], ...] = (
        ("gain margin", margins.gain_margin_db, "dB"),
        ("phase margin", margins.phase_margin_deg, "deg"),
        ("delay margin", margins.delay_margin_s, "s"),
        ("disk margin", disk, None),
        ("peak sensitivity", margins.peak_sensitivity, None),
    )
    for name, value, unit in numbers:
        yield single(f"{name}{label}", value, unit, margins.words)


def _trim(result: Result, _at: Floats | None) -> Iterator[Comparable]:
    point = TrimResult.from_dict(result).operating_point
    for name, value in {**point.x, **point.discrete, **point.u, **point.y}.items():
        yield single(name, float(value), point.units.get(name))


def _limit_cycle(result: Result, _at: Floats | None) -> Iterator[Comparable]:
    record = LimitCycleResult.from_dict(result)
    for cycle in record.limit_cycles:
        label = f"{cycle.method}{f' {cycle.number}' if cycle.number else ''}"
        yield single(f"frequency, {label}", cycle.frequency_hz, "Hz")
        yield single(f"amplitude, {label}", cycle.amplitude, record.input_unit)
    if record.simulated is not None:
        yield single("frequency at the end", record.simulated.frequency_hz, "Hz")
        for name, amplitude in record.simulated.amplitude.items():
            yield single(f"amplitude of {name} at the end", amplitude, record.simulated.units.get(name))


# Name of an analysis → its reader; the second argument: frequencies at which a linear model is evaluated [Hz].
READERS: Mapping[str, Callable[[Result, Floats | None], Iterator[Comparable]]] = {
    "simulate": _simulate,
    "nfr": _nfr,
    "bla": _bla,
    "lin": _model,
    "identify": _model,
    "loop": _loop,
    "trim": _trim,
    "limit-cycle": _limit_cycle,
}
