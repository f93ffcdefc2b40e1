"""Curves of a record, for the pictures that the browser draws itself: responses over frequency, signals over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import plain
from workbench.core.values.decibels import decibels
from workbench.core.values.response import Response
from workbench.jobs.store import contents
from workbench.ui.marks import margin_marks, nfr_marks, response_marks

# The server names what a record is, and imports no analysis for it: the page is there before python-control is.
if TYPE_CHECKING:
    from workbench.core.values.linear import Linear
    from workbench.identification.fit.result import FitResult
    from workbench.identification.identify.result import IdentifyResult
    from workbench.identification.structures.result import StructureResult
    from workbench.limit_cycles.feedback.result import FeedbackResult
    from workbench.loops.loop.result import LoopResult
    from workbench.point.lin.grid import LinGrid
    from workbench.response.branches.result import BranchesResult, ResponseBranch
    from workbench.response.nfr.result import NfrResult

__all__ = ["curves_of", "of_response", "signals_of", "stored_curves", "with_unit"]

_MANY = 400  # frequencies of a linear model's curve
_CURVES = 24  # of a linear model: inputs times outputs
_DECADES = 3.0  # below the highest frequency that is shown, at least


def curves_of(record: object) -> list[dict[str, Any]]:
    """Return the frequency responses that a record holds, ready for JSON.

    Each has a `label`, what it is (`kind`: "measured", "linear", "branch"), `frequency_hz`, `re` and `im` of output
    over input, and lists as long as these where they are known: `error` (relative), `status`, `stable`, `offset`
    (the mean of the output, in words); and `marks` of its resonance and the like, see `response_marks`.

    Args:
        record: any.
    """
    curves = _CURVES_OF.get(type(record).__name__)
    return [] if curves is None else [plain(curve) for curve in curves(record)]


def with_unit(value: float, unit: str | None) -> str:
    """Return a number with its unit as a label shows it; the unit 1 is left out."""
    return f"{value:g} {unit}" if unit and unit != "1" else f"{value:g}"


def of_response(curve: Response, label: str, kind: str, **more: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return a frequency response as `curves_of` does, with further keys."""
    return {
        "label": label,
        "kind": kind,
        "input": curve.input,
        "output": curve.output,
        "input_unit": curve.input_unit,
        "output_unit": curve.output_unit,
        "frequency_hz": curve.frequency_hz,
        "re": curve.value.real,
        "im": curve.value.imag,
        **({} if curve.error is None else {"error": curve.error}),
        **more,
    }


def _nfr(record: NfrResult) -> Iterator[dict[str, Any]]:
    from workbench.response.nfr.page import offset_words  # noqa: PLC0415 - as above

    for i, amplitude in enumerate(record.amplitude.tolist()):
        curve = record.curve(amplitude)
        yield of_response(
            curve, with_unit(amplitude, record.input_unit), "measured", amplitude=amplitude, status=record.status[i],
            stable=record.stable[i], offset=[offset_words(record, i, j) for j in range(len(curve.frequency_hz))],
            marks=nfr_marks(record, i),
        )  # fmt: skip
    yield from (_branch(b, i, record) for i, b in enumerate(record.branches))


def _branches(record: BranchesResult) -> Iterator[dict[str, Any]]:
    if record.vary == "frequency":
        yield from (_branch(b, i, record) for i, b in enumerate(record.branches))


def _branch(branch: ResponseBranch, number: int, record: NfrResult | BranchesResult) -> dict[str, Any]:
    value = np.asarray(branch.gain * np.exp(1j * np.radians(branch.phase_deg)), dtype=np.complex128)
    at = "" if branch.amplitude is None else f", {with_unit(branch.amplitude, record.input_unit)}"
    response = Response(
        branch.frequency_hz, value, input=record.input, output=record.output,
        input_unit=record.input_unit, output_unit=record.output_unit, amplitude=branch.amplitude,
    )  # fmt: skip
    folds = [
        {"hz": f.frequency_hz, "db": float(decibels(f.gain)), "text": f"{f.kind} at {f.frequency_hz:.4g} Hz"}
        for f in record.folds
        if f.branch == number and f.amplitude == (branch.amplitude if branch.amplitude is not None else f.amplitude)
    ]
    return of_response(
        response, f"branch {number + 1}{at}", "branch", stable=branch.stable, amplitude=branch.amplitude, marks=folds
    )


def _lin(record: Linear, label: str = "") -> Iterator[dict[str, Any]]:
    pairs = [(u, y) for u in record.input_names for y in record.output_names][:_CURVES]
    for u, y in pairs:
        curve = record.curve(u, y, _band(record))
        marks = response_marks(curve.frequency_hz, curve.value) if len(pairs) == 1 else []
        yield of_response(curve, ", ".join(filter(None, [f"lin: {y} by {u}", label])), "linear", marks=marks)


def _grid(record: LinGrid) -> Iterator[dict[str, Any]]:
    for point in record.points:
        if point.result is not None:
            yield from list(_lin(point.result, str(point)))[:1]


def _band(model: Linear) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return frequencies that show a linear model [Hz]."""
    sizes = np.abs(model.continuous_poles) / (2.0 * np.pi)
    seen = sizes[(sizes > 1e-6) & (sizes < 1e6)]
    low, high = (seen.min(), seen.max()) if seen.size else (1.0, 1.0)
    high = min(10.0 * high, model.highest_hz)
    return np.geomspace(min(low / 10.0, high / 10.0**_DECADES), high, _MANY)


def _loop(record: LoopResult) -> Iterator[dict[str, Any]]:
    if record.linear is not None:
        transfer = record.linear.transfer
        band = record.frequencies(_MANY)
        marks = margin_marks(record.linear.margins)
        yield of_response(Response(band, transfer.response(band)), "loop, linear", "linear", marks=marks)
    for curve in record.curves:
        status = [p.status for p in curve.points]
        response = Response(curve.frequency_hz, curve.value, amplitude=curve.amplitude)
        label = f"loop, {curve.how} {with_unit(curve.amplitude, record.place.unit)}"
        yield of_response(response, label, "measured", status=status)


def _feedback(record: FeedbackResult) -> Iterator[dict[str, Any]]:
    response = Response(record.frequency_hz, record.response, input=record.target, output=record.source)
    yield of_response(response, f"plant: {record.source} by {record.target}", "linear")


def _identified(record: IdentifyResult) -> Iterator[dict[str, Any]]:
    model, spread = record.model, record.uncertainty
    pairs = [(u, y) for u in model.input_names for y in model.output_names][:_CURVES]
    for u, y in pairs:
        curve = model.curve(u, y, _band(model))
        if spread is not None:  # with the 95 % region of each point
            i, j = spread.output_names.index(y), spread.input_names.index(u)
            value, error = spread.response[:, i, j], spread.gain_error[:, i, j]
            curve = replace(curve, frequency_hz=spread.frequency_hz, value=value, error=error)
        yield of_response(curve, f"identified: {y} by {u}", "linear")


def _blocks(record: StructureResult) -> Iterator[dict[str, Any]]:
    model = record.linear
    curve = model.curve(0, 0, _band(model))
    yield of_response(curve, f"linear block: {curve.output} by {curve.input}", "linear")


def _fit(record: FitResult) -> Iterator[dict[str, Any]]:
    for (i, j), own in record.channels.items():
        order = np.argsort(record.frequency_hz[own], kind="stable")
        measured = Response(
            record.frequency_hz[own][order], record.measured[own][order], input=record.input_names[j],
            output=record.output_names[i],
        )  # fmt: skip
        channel, status = record.channel_name(i, j), ["settled"] * len(order)
        yield of_response(measured, f"measured: {channel}", "measured", status=status)
        yield of_response(replace(measured, value=record.fitted[own][order]), f"fitted: {channel}", "linear")


_CURVES_OF: Mapping[str, Callable[[Any], Iterator[dict[str, Any]]]] = {
    "NfrResult": _nfr, "BranchesResult": _branches, "LinResult": _lin, "LinGrid": _grid, "LoopResult": _loop,
    "FeedbackResult": _feedback, "IdentifyResult": _identified, "StructureResult": _blocks, "FitResult": _fit,
}  # fmt: skip


def stored_curves(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the frequency responses that a store holds, each with its settings, and remarks on what is damaged.

    Args:
        folder: of the store.

    Raises:
        InputError: it is not a store, or damaged.
    """
    from workbench.response.nfr.point import NfrPoint  # noqa: PLC0415 - as above

    result = []
    every, remarks = contents(folder)
    for number, stored in enumerate(every, 1):
        rows = [value["point"] for value in stored.values.values() if isinstance(value, dict) and "point" in value]
        points = sorted((NfrPoint.from_dict(row) for row in rows), key=lambda p: (p.amplitude, p.frequency))
        names = {name: str(stored.subject.get(name, "")) for name in ("input", "output")}
        for amplitude, group in groupby(points, key=lambda p: p.amplitude):
            own = list(group)
            value = np.array([np.nan if p.response is None else p.response for p in own], dtype=np.complex128)
            error = np.array([np.nan if p.error is None else p.error for p in own])
            response = Response(
                np.array([p.frequency for p in own]), value, error, input=names["input"], output=names["output"]
            )
            label = f"set {number}: {names['output']} by {names['input']}, amplitude {amplitude:g}"
            more = {"amplitude": amplitude, "status": [p.status for p in own], "stable": [p.stable for p in own]}
            curve = of_response(response, label, "measured", points=[p.to_dict() for p in own], **more)
            result.append({**curve, "settings": {**stored.subject, **stored.effort}})
    return [plain(curve) for curve in result], remarks


def signals_of(record: object) -> dict[str, Any] | None:
    """Return the time histories of a record, ready for JSON; None: it has none."""
    from workbench.response.simulate.result import SimulationResult  # noqa: PLC0415 - as above

    if not isinstance(record, SimulationResult):
        return None
    result: dict[str, Any] = plain({"time": record.time, "signals": record.signals, "units": record.units})
    return result
