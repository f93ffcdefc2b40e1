"""What a measured point can be trusted for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.core.records.record import RecordPart
from workbench.response.nfr.settling import PointResponse, Settling
from workbench.response.periodic.fourier import distortion

__all__ = ["Certificate", "certify"]


@dataclass(frozen=True, kw_only=True)
class Certificate(RecordPart):
    """The evidence behind one point of a frequency response. None: not known, or not applicable.

    Attributes:
        errcrit: error criterion it was measured with.
        max_periods: most periods it was allowed.
        delta_phase_deg: change of the phase from the last period but one to the last, magnitude [deg].
        delta_gain: change of the gain likewise, relative to the gain.
        defect: by how much the reported response fails to repeat itself in a period, relative to its
            fundamental, after the transient was removed; the scatter of the periods where they were averaged.
        drift: change of the output's mean from the last period but one to the last, relative to the
            amplitude of its fundamental.
        harmonics: amplitudes of the harmonics 2 … 10 of the output, relative to the fundamental; of the
            reported response, its transient removed, and known about as well as `defect` says.
        thd: total harmonic distortion, root of the sum of their squares.
        check: what was changed to verify the point: "step" (co-simulation: half the communication
            step), "tolerance" (model exchange: a hundredth of it).
        check_gain: how much the gain changed by that, relative.
        check_phase_deg: how much the phase changed by that [deg].
        why: why it has not settled; None where it has, or failed.
        method: "solved": Newton's method on the period map; "settled": periods were run until it settled.
        multipliers: Floquet multipliers of the periodic motion, at most six, largest first: what a small deviation is
            multiplied by in a period; none where they are not known.
        fold_distance: distance of the nearest one from 1, where the response folds back; None where not known.
        reached: how it is known that the model comes to this motion when the sine is switched on: "run": it was run
            from there until it did; "contracts": it has no events, and its derivatives along that run are those of a
            linear model, whose transients decay; None: it is not known.
        other_gain: gain of another periodic response, which was solved for and which that run has not come to; None:
            there was none.
        other_phase_deg: its phase [deg].
    """

    errcrit: float
    max_periods: int
    delta_phase_deg: float | None = None
    delta_gain: float | None = None
    defect: float | None = None
    drift: float | None = None
    harmonics: tuple[float | None, ...] = (None,) * 9
    thd: float | None = None
    check: str | None = None
    check_gain: float | None = None
    check_phase_deg: float | None = None
    why: str | None = None
    method: str = "settled"
    multipliers: tuple[complex, ...] = ()
    fold_distance: float | None = None
    reached: str | None = None
    other_gain: float | None = None
    other_phase_deg: float | None = None


def certify(settling: Settling, response: PointResponse | None) -> Certificate:
    """Return the certificate of a point.

    Args:
        settling: its periods.
        response: its response; None if the run broke off.
    """
    phase_deg, gain, drift = settling.residual() or (None, None, None)
    harmonics = distortion(response.harmonics) if response is not None else (None,) * 9
    known = [h for h in harmonics if h is not None]
    return Certificate(
        errcrit=settling.errcrit,
        max_periods=settling.most,
        delta_phase_deg=finite(phase_deg),
        delta_gain=finite(gain),
        defect=finite(None if response is None else response.defect),
        drift=finite(drift),
        harmonics=tuple(finite(h) for h in harmonics),
        thd=finite(math.hypot(*known)) if known else None,
        why=None if response is None else response.why,
        reached=None if response is None else "run",
    )


def finite(value: float | None) -> float | None:
    """Return `value` if it is a finite number, else None."""
    return value if value is not None and math.isfinite(value) else None
