"""The branches of periodic responses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.names_in_text import unit_of_ratio
from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result

__all__ = ["BranchesResult", "Fold", "Onset", "ResponseAt", "ResponseBranch"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseBranch(RecordPart):
    """A family of periodic responses, in the order of the branch.

    Attributes:
        amplitude: of the forcing [unit of the input]; None where it is varied.
        frequency_hz: of the forcing, shape (k,) [Hz].
        varied: what is varied along the branch, shape (k,): the frequency [Hz], the amplitude or the parameter.
        gain: of the fundamental, shape (k,), [unit of the output / unit of the input].
        phase_deg: of the fundamental, followed along the branch, shape (k,) [deg].
        offset: mean of the output, shape (k,).
        stable: whether the response is stable, shape (k,).
        multipliers: Floquet multipliers of each, at most six, largest first.
        order: after how many periods of the forcing it repeats.
        closed: whether the branch comes back to where it begins.
        ends: why it ends, at its begin and at its end.
    """

    amplitude: float | None
    frequency_hz: Floats
    varied: Floats
    gain: Floats
    phase_deg: Floats
    offset: Floats
    stable: NDArray[np.bool_]
    multipliers: tuple[tuple[complex, ...], ...]
    order: int = 1
    closed: bool = False
    ends: tuple[str, ...] = ()

    def places_at(self, value: float) -> list[int]:
        """Return the numbers of the places at a value of what is varied.

        Args:
            value: one of those that were asked for.
        """
        return np.flatnonzero(np.isclose(self.varied, value, rtol=1e-9, atol=0.0)).tolist()


@dataclass(frozen=True, kw_only=True)
class ResponseAt(RecordPart):
    """One of the responses at a frequency that was asked for.

    Attributes:
        frequency_hz: of the forcing [Hz].
        amplitude: of the forcing [unit of the input].
        gain: of the fundamental.
        phase_deg: of the fundamental [deg].
        stable: whether it is stable.
        order: after how many periods of the forcing it repeats.
        branch: number of the branch, from 0.
    """

    frequency_hz: float
    amplitude: float
    gain: float
    phase_deg: float
    stable: bool
    order: int
    branch: int


@dataclass(frozen=True, kw_only=True)
class Fold(RecordPart):
    """Where a branch folds back, or loses its stability in another way.

    Attributes:
        frequency_hz: of the forcing [Hz].
        amplitude: of the forcing [unit of the input].
        varied: value of what is varied.
        gain: of the fundamental.
        phase_deg: of the fundamental [deg].
        kind: "fold", "period doubling", "Neimark-Sacker", "branch point".
        branch: number of the branch, from 0.
    """

    frequency_hz: float
    amplitude: float
    varied: float
    gain: float
    phase_deg: float
    kind: str
    branch: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Onset(RecordPart):
    """From where on the response jumps: where two folds meet (a cusp).

    Attributes:
        amplitude: [unit of the input].
        frequency_hz: [Hz].
        curve_amplitude: amplitudes at which the folds were found, shape (k,).
        curve_hz: frequencies of both folds at each, shape (k, 2) [Hz].
    """

    amplitude: float
    frequency_hz: float
    curve_amplitude: Floats
    curve_hz: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class BranchesResult(Result):
    """All periodic responses that were found.

    Attributes:
        model: name of the model.
        interface, solver: how it was run.
        input, output: names.
        input_unit, output_unit: units; None where the model names none.
        vary: what is varied: "frequency", "amplitude", or a parameter.
        branches: the responses.
        folds: folds and bifurcations.
        onset: where it begins to jump; None: not asked for, or it does not jump.
        asked_hz: frequencies at which all responses are listed, see `at` [Hz].
        vary_unit: unit of what is varied; None where the model names none.
        periods: number of periods run.
        warnings: remarks, one line each.
        operating_point: where the model starts.
    """

    _page = "workbench.response.branches.page:branches_page"
    _picture = "workbench.response.branches.picture:plot_branches"

    model: str
    interface: str
    solver: str
    input: str
    output: str
    input_unit: str | None
    output_unit: str | None
    vary: str
    branches: tuple[ResponseBranch, ...]
    folds: tuple[Fold, ...]
    onset: Onset | None = None
    asked_hz: tuple[float, ...] = ()
    vary_unit: str | None = None
    periods: int = 0
    warnings: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = field(default=None, metadata=entry())

    _WHAT, _COMMAND = "a set of branches", "branches"

    def at(self, frequency_hz: float) -> tuple[ResponseAt, ...]:
        """Return all responses at one of the frequencies that were asked for, by amplitude, the largest gain first.

        Args:
            frequency_hz: [Hz].
        """
        result = [
            ResponseAt(
                frequency_hz=frequency_hz,
                amplitude=b.amplitude,
                gain=float(b.gain[i]),
                phase_deg=float(b.phase_deg[i]),
                stable=bool(b.stable[i]),
                order=b.order,
                branch=number,
            )
            for number, b in enumerate(self.branches)
            if b.amplitude is not None and self.vary == "frequency"
            for i in b.places_at(frequency_hz)
        ]
        return tuple(sorted(result, key=lambda r: (r.amplitude, -r.gain)))

    def derived(self) -> dict[str, Any]:
        """Return the responses at the frequencies that were asked for.

        Keys:
            responses: all responses at each frequency of `--freq`: `frequency_hz`, `amplitude`,
                `gain`, `phase_deg`, `stable`, `order`, `branch`.
        """
        return {"responses": [r for f in self.asked_hz for r in self.at(f)]}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {
            "amplitude": self.input_unit,
            "varied": self.vary_unit,
            "gain": unit_of_ratio(self.output_unit, self.input_unit),
            "offset": self.output_unit,
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each place: the branch's number, where it is, gain, phase, stability."""
        yield (
            "branch", "order", "frequency_hz", "amplitude", "varied", "gain", "gain_db", "phase_deg", "offset",
            "stable", "largest_multiplier",
        )  # fmt: skip
        for number, b in enumerate(self.branches, 1):
            for i, f in enumerate(b.frequency_hz.tolist()):
                amplitude = float(b.varied[i]) if b.amplitude is None else b.amplitude
                db = 20.0 * math.log10(b.gain[i]) if b.gain[i] > 0.0 else -math.inf
                largest = max(map(abs, b.multipliers[i]), default=math.nan)
                yield (
                    number, b.order, f, amplitude, b.varied[i], b.gain[i], db, b.phase_deg[i], b.offset[i],
                    int(b.stable[i]), largest,
                )  # fmt: skip
