"""The result of a nonlinear frequency response."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.names_in_text import unit_of_ratio
from workbench.core.records.quantity import number, shortest
from workbench.core.records.record import entry, numbers
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels, follow_phase
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.response import Response
from workbench.errors import InputError
from workbench.model import Model, Variable
from workbench.response.branches.result import Fold, ResponseBranch
from workbench.response.nfr.beats import BEAT
from workbench.response.nfr.certificate import Certificate
from workbench.response.nfr.features import AmplitudeLimit, CurveFeatures
from workbench.response.nfr.point import NfrPoint
from workbench.response.nfr.settling import NO_EFFECT
from workbench.response.nfr.zero_input import ZeroInput
from workbench.show.result import Result, drawn

if TYPE_CHECKING:
    from control import FrequencyResponseData
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["MISSING", "FailedPoint", "NfrResult", "assemble", "percent"]

MISSING = "not measured: the sweep was interrupted"

# Fields of the certificate that are columns of the CSV; the harmonics follow.
_CSV_FIELDS = (
    "thd", "delta_phase_deg", "delta_gain", "defect", "drift", "check", "check_gain", "check_phase_deg", "why"
)  # fmt: skip
# Columns of the CSV before these.
_COLUMNS = (
    "amplitude", "frequency_hz", "gain", "gain_db", "phase_deg", "offset", "error", "stable", "averaged", "periods"
)  # fmt: skip
_SIGNAL = {"": "name", "_unit": "unit"}
_POINTS = entry(dims=("amplitude", "frequency_hz"))
_NOTHING_KNOWN = Certificate(errcrit=math.nan, max_periods=0)


@dataclass(frozen=True)
class FailedPoint:
    """A point without a value.

    Attributes:
        frequency_hz: [Hz].
        amplitude: [unit of the input].
        reason: why, in one line.
        kind: what went wrong, see `WorkbenchError.kind`; None: it was not measured.
    """

    frequency_hz: float
    amplitude: float
    reason: str
    kind: str | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class NfrResult(Result):
    """Nonlinear frequency response: gain, phase and offset over frequency and amplitude.

    Arrays have the shape (n_a, n_f), [amplitude][frequency], both rising; NaN where a point failed.

    Attributes:
        model: name of the model.
        interface: "me" or "cs".
        solver: integration method.
        input: forced input.
        output: output measured.
        input_unit: unit of the input, None where the model names none.
        output_unit: unit of the output, None where the model names none.
        frequency_hz: shape (n_f,), [Hz].
        amplitude: shape (n_a,), [unit of the input].
        response: complex, output over input, [unit of the output / unit of the input].
        phase_deg: [deg], followed along rising frequency (source report, chapter 4.4.2); NaN also where the gain is 0.
        offset: mean of the output, [unit of the output]; about any where it is integrated (a multiplier of 1).
        averaged: bool; not settled: the mean of the last half of the periods, or what they tend to.
        error: of the response, relative to the true one, as a complex number's magnitude, with 95 % confidence; NaN
            where it is not known.
        stable: 1 where the periodic motion is stable, 0 where it is not, NaN where that is not known.
        periods: int, periods run; where the response was solved for, also those of differences: they may be more than
            `max_periods`, which limits how long a run waits.
        step: communication step of the run that is reported [s]; NaN for model exchange.
        failed: the points without a value, each with its reason.
        warnings: remarks on single points and on the model, one line each.
        certificates: [amplitude][frequency]: what each point can be trusted for; None where
            nothing is known, as after a crash.
        zero_input: how the output moves while the input is zero; None where that was not watched.
        branches: all periodic responses, where they were asked for; see `branches`.
        folds: where these fold back or lose their stability.
        operating_point: where the sine begins, and about which value of the input it moves; None where it is not known,
            as after a crash.
        features: bandwidth, lag of 90° and resonance at each amplitude, where `bandwidth` asked for them.
        amplitude_limit: the amplitude at which the bandwidth falls below `least_bandwidth`, where one was given.
    """

    _page = "workbench.response.nfr.page:nfr_page"
    _picture = "workbench.response.nfr.picture:plot_nfr"

    model: str
    interface: str
    solver: str
    input: str = field(metadata=entry(kept=False))
    output: str = field(metadata=entry(kept=False))
    input_unit: str | None = field(metadata=entry(kept=False))
    output_unit: str | None = field(metadata=entry(kept=False))
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    amplitude: Floats = field(metadata=entry(dims=("amplitude",)))
    response: NDArray[np.complex128] = field(metadata=entry(dims=("amplitude", "frequency_hz"), kept=False))
    phase_deg: Floats = field(metadata=entry(dims=("amplitude", "frequency_hz"), unit="deg"))
    offset: Floats = field(metadata=_POINTS)
    averaged: NDArray[np.bool_] = field(metadata=_POINTS)
    error: Floats = field(metadata=_POINTS)
    stable: Floats = field(metadata=entry(dims=("amplitude", "frequency_hz"), kept=False))
    periods: NDArray[np.int64] = field(metadata=_POINTS)
    step: Floats = field(metadata=entry(dims=("amplitude", "frequency_hz"), unit="s"))
    failed: tuple[FailedPoint, ...]
    warnings: tuple[str, ...]
    certificates: tuple[tuple[Certificate | None, ...], ...] = field(metadata=entry(kept=False))
    zero_input: ZeroInput | None = None
    branches: tuple[ResponseBranch, ...] = ()
    folds: tuple[Fold, ...] = ()
    operating_point: OperatingPoint | None = None
    features: tuple[CurveFeatures, ...] = ()
    amplitude_limit: AmplitudeLimit | None = None

    _WHAT, _COMMAND = "a frequency response", "nfr"

    @property
    def status(self) -> tuple[tuple[str, ...], ...]:
        """How each point ended, [amplitude][frequency]: "settled", "averaged" or "failed"."""
        failed = np.isnan(self.response)
        return tuple(
            tuple("failed" if f else "averaged" if a else "settled" for f, a in zip(*row, strict=True))
            for row in zip(failed.tolist(), self.averaged.tolist(), strict=True)
        )

    @property
    def thd(self) -> Floats:
        """Total harmonic distortion of the output, shape (n_a, n_f), relative to its fundamental; NaN where unknown."""
        return np.array([[_number(None if c is None else c.thd) for c in row] for row in self.certificates])

    @property
    def no_effect(self) -> NDArray[np.bool_]:
        """Whether the input does not move the output, but for rounding, shape (n_a, n_f): the gain is then 0."""
        return np.array([[c is not None and c.why == NO_EFFECT for c in row] for row in self.certificates])

    @property
    def gain(self) -> Floats:
        """Magnitude of the response, shape (n_a, n_f), [unit of the output / unit of the input]."""
        return np.abs(self.response)

    @property
    def gain_db(self) -> Floats:
        """20·log10 of the gain, shape (n_a, n_f), [dB]; −inf where the gain is 0."""
        return decibels(self.response)

    def derived(self) -> dict[str, Any]:
        """Return gain, what the points are worth, and the signals with their units.

        Keys:
            input, output: `name` and `unit`.
            gain, gain_db: `[amplitude][frequency]`.
            stable: `[amplitude][frequency]`: whether the periodic motion is stable; `null`: not
                known.
            certificate: `[amplitude][frequency]`: `status`, `errcrit`, `max_periods`,
                `delta_phase_deg`, `delta_gain`, `defect`, `drift`, `harmonics` (2 … 10) and `thd`
                (known to about `error`), `check`, `check_gain`, `check_phase_deg`, `why` (it has not
                settled), `method` (`solved` or `settled`), `multipliers` (Floquet, at most six, pairs
                of real and imaginary part), `fold_distance` (of the nearest one from 1), `reached`
                (`run`: it is what the run from the operating point comes to; `contracts`: that run is
                known to end there; null: not known), `other_gain` and `other_phase_deg` (of a
                periodic response that was solved for and that this run has not come to).
        """
        stable = [[None if np.isnan(x) else bool(x) for x in row] for row in self.stable.tolist()]
        names = [f.name for f in fields(Certificate)]
        certificate = {n: [[getattr(c, n, None) for c in row] for row in self.certificates] for n in names}
        return {
            "input": {"name": self.input, "unit": self.input_unit},
            "output": {"name": self.output, "unit": self.output_unit},
            "gain": self.gain,
            "gain_db": self.gain_db,
            "stable": stable,
            "certificate": {"status": self.status, **certificate},
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the response of gain and phase, the certificates point by point; versions before 0.2 had neither."""
        shape = (len(numbers(data, "amplitude")), len(numbers(data, "frequency_hz")))
        unknown = np.full(shape, np.nan)
        gain, phase = (numbers(data, key, shape) for key in ("gain", "phase_deg"))
        # A gain of 0 has no phase.
        angle = np.radians(np.where(gain == 0.0, 0.0, phase))
        if np.isinf(angle).any():
            raise ValueError("phase_deg is infinite")
        names = {f"{side}{what}": data[side][key] for side in ("input", "output") for what, key in _SIGNAL.items()}
        return {
            "error": unknown,
            "stable": unknown,
            **data,
            **names,
            "response": np.asarray(gain * np.exp(1j * angle), dtype=np.complex128),
            "certificates": _certificates(data.get("certificate", {}), shape),
        }

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {
            "amplitude": self.input_unit,
            "gain": unit_of_ratio(self.output_unit, self.input_unit),
            "offset": self.output_unit,
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each point: what the table shows, the reason of a failure, and the certificate."""
        reasons = {(f.amplitude, f.frequency_hz): f.reason for f in self.failed}
        yield (*_COLUMNS, "failed", "status", *_CSV_FIELDS, *(f"h{n}" for n in range(2, 11)))
        for i, a in enumerate(self.amplitude.tolist()):
            for j, f in enumerate(self.frequency_hz.tolist()):
                values = [getattr(self, name)[i, j] for name in _COLUMNS[2:8]]
                values += [int(self.averaged[i, j]), self.periods[i, j]]
                known = self.certificates[i][j] or _NOTHING_KNOWN
                result = [getattr(known, name) for name in _CSV_FIELDS]
                if np.isnan(self.error[i, j]) and self.gain[i, j] > 0.0:
                    result[-1] = f"error unknown: {result[-1]}" if result[-1] else "error unknown"
                yield (a, f, *values, reasons.get((a, f), ""), self.status[i][j], *result, *known.harmonics)

    def to_frd(self, amplitude: float | None = None) -> FrequencyResponseData:
        """Return the response at one amplitude as python-control's frequency response data.

        Failed points are left out. A describing-function-like object: for a nonlinear model it
        holds for this amplitude only.

        Args:
            amplitude: [unit of the input]; may be left out where there is only one.

        Raises:
            InputError: this amplitude was not measured, or no point of it has a value.
        """
        return self.curve(amplitude).to_frd(name=_identifier(self.model))

    def curve(self, amplitude: float | None = None) -> Response:
        """Return the response at one amplitude: gain, phase, errors, margins, differences.

        Args:
            amplitude: [unit of the input]; may be left out where there is only one.

        Raises:
            InputError: this amplitude was not measured.

        Example:
        >>> import workbench as wb
        >>> found = wb.nfr(wb.load("fmu:Rudder"), "delC", "del", [1.0, 2.0], [1.0])
        >>> found.curve(amplitude=1.0).gain_db.round(1).tolist()
        [-0.3, -1.0]
        """
        row = self._row(amplitude)
        return Response(
            self.frequency_hz, self.response[row], self.error[row], input=self.input, output=self.output,
            input_unit=self.input_unit, output_unit=self.output_unit, amplitude=float(self.amplitude[row]),
        )  # fmt: skip

    def _row(self, amplitude: float | None) -> int:
        known = ", ".join(f"{a:g}" for a in self.amplitude)
        if amplitude is None:
            if self.amplitude.size != 1:
                raise InputError(f"amplitude: several were measured ({known}); say which")
            return 0
        try:
            amplitude = number(amplitude)
        except ValueError as error:
            raise InputError(f"amplitude: {error}; known: {known}") from None
        hits = np.flatnonzero(np.isclose(self.amplitude, amplitude, rtol=1e-9, atol=0.0))
        if hits.size == 0:
            raise InputError(f"amplitude {shortest(amplitude)} was not measured; known: {known}")
        return int(hits[0])

    def plot(
        self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None, offset: bool = False
    ) -> Figure:
        """Draw gain [dB] and phase [deg] over frequency [Hz], one curve per amplitude.

        Circles: settled; triangles: averaged (take them with care); on the lower edge crosses: failed, triangles
        downwards: no effect, the gain is 0.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
            offset: add the mean of the output as a third picture.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        return drawn("workbench.response.nfr.picture:plot_nfr", path, self, axes=axes, offset=offset)


def assemble(
    model: Model,
    *,
    input: str,
    output: str,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    points: Sequence[NfrPoint],
    warnings: Sequence[str] = (),
    zero_input: ZeroInput | None = None,
    branches: tuple[ResponseBranch, ...] = (),
    folds: tuple[Fold, ...] = (),
    operating_point: OperatingPoint | None = None,
    features: tuple[CurveFeatures, ...] = (),
    amplitude_limit: AmplitudeLimit | None = None,
) -> NfrResult:
    """Make a result of measured points; what is missing fails.

    Args:
        model: what was measured.
        input: name of the forced input.
        output: name of the output.
        frequencies: [Hz], any order.
        amplitudes: [unit of the input], any order.
        points: in any order.
        warnings: passed on, after those of the points.
        zero_input: passed on.
        branches: passed on.
        folds: passed on.
        operating_point: passed on.
        features: passed on.
        amplitude_limit: passed on.
    """
    f, a = sorted(frequencies), sorted(amplitudes)
    result = {(p.amplitude, p.frequency): p for p in points}
    grid = [[result.get((ai, fj)) or NfrPoint(frequency=fj, amplitude=ai, reason=MISSING) for fj in f] for ai in a]
    response = np.array([[complex("nan") if p.response is None else p.response for p in row] for row in grid])
    return NfrResult(
        model=model.name,
        interface=model.interface,
        solver=model.solver,
        input=input,
        output=output,
        input_unit=_unit(model.inputs, input),
        output_unit=_unit((*model.outputs, *model.states), output),
        frequency_hz=np.array(f),
        amplitude=np.array(a),
        response=response,
        phase_deg=np.array([follow_phase(row) for row in response]),
        offset=np.array([[np.nan if p.offset is None else p.offset for p in row] for row in grid]),
        averaged=np.array([[p.averaged for p in row] for row in grid]),
        error=np.array([[_number(p.error) for p in row] for row in grid]),
        stable=np.array([[_number(p.stable) for p in row] for row in grid], dtype=np.float64),
        periods=np.array([[p.periods for p in row] for row in grid]),
        step=np.array([[np.nan if p.step is None else p.step for p in row] for row in grid]),
        failed=tuple(FailedPoint(p.frequency, p.amplitude, p.reason, p.kind) for row in grid for p in row if p.reason),
        warnings=(
            *_unsettled(grid, f"{input} on {output}"),
            *dict.fromkeys(p.warning for row in grid for p in row if p.warning),
            *warnings,
        ),
        certificates=tuple(tuple(p.certificate for p in row) for row in grid),
        zero_input=zero_input,
        branches=branches,
        folds=folds,
        operating_point=operating_point,
        features=features,
        amplitude_limit=amplitude_limit,
    )


def _unsettled(grid: Sequence[Sequence[NfrPoint]], path: str) -> list[str]:
    """Return one line for each reason why points have not settled."""
    # A reason may end with figures of its point: those of one kind are told once, with the figures of the first.
    groups: dict[tuple[str, bool], list[tuple[NfrPoint, str]]] = {}
    for point in (p for row in grid for p in row):
        if point.averaged and point.certificate is not None and point.certificate.why is not None:
            why = point.certificate.why
            measured = why.startswith(BEAT)
            kind = (why.partition(":")[0], point.error is not None) if measured else (why, True)
            groups.setdefault(kind, []).append((point, why))
    return [_unsettled_line(_of_all([w for _, w in g]), [p for p, _ in g], path) for g in groups.values()]


def _of_all(reasons: Sequence[str]) -> str:
    same = all(why == reasons[0] for why in reasons)
    return reasons[0] if same else f"{reasons[0]}, at the first of them"


def _unsettled_line(why: str, points: Sequence[NfrPoint], path: str) -> str:
    first = points[0]
    others = f" and {len(points) - 1} more" if len(points) > 1 else ""
    known = [p.error for p in points if p.error is not None]
    errors = [f"{'errors up to' if len(known) > 1 else 'error'} {percent(max(known))} %"] if known else []
    errors += ["the error is not known" if not known else f"the error of {len(points) - len(known)} is not known"] * (
        len(known) < len(points)
    )
    where = f"{first.frequency:.6g} Hz, amplitude {first.amplitude:g}{others}"
    if why == NO_EFFECT:
        return f"{where}: no effect of {path} at this amplitude, or none that is more than rounding; the gain is 0"
    return f"{where}: not settled ({', '.join(errors)}): {why}"


def percent(error: float) -> str:
    """Return a relative error as a number of percent, two digits of it: 0.0123 is "1.2", 2.6 is "260"."""
    return f"{float(f'{100.0 * error:.2g}'):g}"


def _unit(variables: Sequence[Variable], name: str) -> str | None:
    return next((v.unit for v in variables if v.name == name), None)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _certificates(arrays: Mapping[str, Any], shape: tuple[int, int]) -> tuple[tuple[Certificate | None, ...], ...]:
    """Return the certificates of one array for each field; None where nothing is known."""
    known = [f.name for f in fields(Certificate) if f.name in arrays]
    rows = [[{n: arrays[n][i][j] for n in known} for j in range(shape[1])] for i in range(shape[0])]
    return tuple(tuple(None if v.get("errcrit") is None else Certificate.from_dict(v) for v in row) for row in rows)


def _identifier(name: str) -> str:
    # python-control allows no dots and blanks in the names of systems.
    return "".join(c if c.isalnum() or c == "_" else "_" for c in name)
