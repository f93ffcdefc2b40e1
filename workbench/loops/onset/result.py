"""Where a rate limiter begins to act, and what follows for the loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result

__all__ = ["Attitude", "Jump", "OnsetPoint", "OnsetResult"]


@dataclass(frozen=True, kw_only=True)
class Jump(RecordPart):
    """A fold of the periodic responses.

    Attributes:
        frequency_hz: where it lies [Hz].
        rate_ratio: highest rate that the linear loop would ask for there, in units of the limit.
        kind: which end of the unstable part.
    """

    frequency_hz: float
    rate_ratio: float
    kind: str


@dataclass(frozen=True, kw_only=True)
class OnsetPoint(RecordPart):
    """One amplitude.

    Attributes:
        amplitude: of the sine at the input.
        highest_ratio: highest rate of the linear loop over the band, in units of the limit.
        highest_hz: where that is [Hz].
        rises: whether that is the end of the band, where the rate still rises: it then tells how far the band goes.
        frequency_hz: onset frequency [Hz]; None: the limit is not reached in the band.
        phase_deg, gain_db: of the open loop there, the phase from -360° to 0 [deg, dB].
        boundary_db: gain of the boundary at that phase [dB]; None: it is not published there.
        jumps: folds of the model's periodic responses; None: they were not looked for.
        jumps_told: why there are none, or what to know of them.
    """

    amplitude: float
    highest_ratio: float
    highest_hz: float
    rises: bool
    frequency_hz: float | None = None
    phase_deg: float | None = None
    gain_db: float | None = None
    boundary_db: float | None = None
    jumps: tuple[Jump, ...] | None = None
    jumps_told: str = ""

    def derived(self) -> dict[str, Any]:
        """Return how far above the boundary it lies [dB], the verdict, the least amplitude that reaches the limit."""
        return {"above_db": self.above_db, "verdict": self.verdict, "least_amplitude": self.least_amplitude}

    @property
    def least_amplitude(self) -> float | None:
        """Smallest amplitude that reaches the limit in the band; None: the input does not move what is limited."""
        return self.amplitude / self.highest_ratio if self.highest_ratio > 0.0 else None

    @property
    def above_db(self) -> float | None:
        """How far above the boundary the onset point lies [dB]; negative: below; None: not known."""
        if self.gain_db is None or self.boundary_db is None:
            return None
        return self.gain_db - self.boundary_db

    @property
    def verdict(self) -> str:
        """One of "not reached", "below the boundary", "above the boundary", "outside of the boundary's phases"."""
        if self.frequency_hz is None:
            return "not reached"
        if self.above_db is None:
            return "outside of the boundary's phases"
        return "above the boundary" if self.above_db > 0.0 else "below the boundary"


@dataclass(frozen=True, kw_only=True)
class Attitude(RecordPart):
    """Bandwidth and phase delay of an attitude's response to the input.

    Attributes:
        output: the attitude.
        phase_bandwidth_hz: where the phase is 45° before −180° [Hz]; None: not in the band.
        gain_bandwidth_hz: where the gain is 6 dB above that at −180° [Hz]; None: not in the band.
        phase_delay_s: slope of the phase beyond −180° [s]; None: −180° or twice its frequency is not in the band.
    """

    output: str
    phase_bandwidth_hz: float | None
    gain_bandwidth_hz: float | None
    phase_delay_s: float | None

    @property
    def bandwidth_hz(self) -> float | None:
        """The lower of both [Hz]; that by phase where the gain never reaches its own; None: not known."""
        if self.phase_bandwidth_hz is None:
            return None
        return min(self.phase_bandwidth_hz, self.gain_bandwidth_hz or self.phase_bandwidth_hz)


@dataclass(frozen=True, eq=False, kw_only=True)
class OnsetResult(Result):
    """Onset of a rate limiter, for each amplitude.

    Attributes:
        model, interface, solver: what was analysed.
        input, input_unit: where the command enters.
        limiter: component of the limiter.
        limited: full name of its output.
        limited_unit: its unit.
        rate: limit of its rate [its unit/s].
        points: one for each amplitude.
        frequency_hz: shape (k,), of the curves [Hz].
        closed_gain_db: shape (k,), F from the input to the limiter's output [dB].
        open_gain_db, open_phase_deg: shape (k,), L cut at the limiter's output [dB, deg].
        attitude: bandwidth and phase delay; None: no attitude was named.
        notes: what should be known, one line each.
        operating_point: where it was linearised; None: not known.
    """

    _page = "workbench.loops.onset.page:onset_page"
    _picture = "workbench.loops.onset.picture:plot_onset"

    model: str
    interface: str
    solver: str
    input: str
    input_unit: str | None
    limiter: str
    limited: str
    limited_unit: str | None
    rate: float
    points: tuple[OnsetPoint, ...]
    frequency_hz: Floats
    closed_gain_db: Floats
    open_gain_db: Floats
    open_phase_deg: Floats
    attitude: Attitude | None = None
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "an onset of rate limiting", "onset"

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {"amplitude": self.input_unit}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each amplitude."""
        yield (
            "amplitude", "onset [Hz]", "phase [deg]", "gain [dB]", "boundary [dB]", "above [dB]", "highest rate ratio",
            "verdict",
        )  # fmt: skip
        for p in self.points:
            yield (
                p.amplitude, p.frequency_hz, p.phase_deg, p.gain_db, p.boundary_db, p.above_db, p.highest_ratio,
                p.verdict,
            )  # fmt: skip
