"""What becomes of a linear loop when its gain is multiplied: margins, poles, root locus, step response."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import plain
from workbench.core.values.response import Response
from workbench.errors import InputError
from workbench.ui.curves import of_response
from workbench.ui.page import tables_told, verdicts_told

# As in `curves`: the page is there before python-control is.
if TYPE_CHECKING:
    from workbench.core.values.linear import Linear, LinearPart
    from workbench.core.values.margins import Margins
    from workbench.loops.loop.result import LinearLoop

__all__ = ["loop_at"]

_MANY = 400  # frequencies, and instants of a step response
_GAINS = 240  # of a root locus
_DECADES = 3.0  # around the gain 1 of a root locus
_FINE = 4000  # instants at which an unstable step response is looked for where it leaves
_LEFT = 10.0  # times the step: so far from it nobody looks at an unstable one any more
_GROWN = 1e9  # times: what has not left by then is an unstable motion that the step does not excite


def loop_at(record: object, gain: float, *, locus: bool = False) -> dict[str, Any] | None:
    """Return what becomes of a linear loop when its gain is multiplied, ready for JSON; None: the record has no loop.

    Args:
        record: any.
        gain: by which the loop transfer is multiplied.
        locus: whether to add the poles of the closed loop at many gains.

    Raises:
        InputError: the gain is not a positive number, or the closed loop has no solution there.
    """
    from workbench.loops.loop.page import margin_tables, margin_verdict  # noqa: PLC0415 - as above
    from workbench.loops.loop.result import LoopResult  # noqa: PLC0415

    if not isinstance(record, LoopResult) or record.linear is None:
        return None
    if not 0.0 < gain < math.inf:
        raise InputError(f"the factor of the loop gain, {gain:g}, is not a positive number")
    transfer = record.linear.transfer.scaled(gain)
    band = record.frequencies(_MANY)
    open_loop = Response(band, transfer.response(band))
    margins = _margins_at(record.linear, gain)
    closed = transfer.complementary()
    result: dict[str, Any] = plain(
        {
            "gain": gain,
            "margins": margins.to_dict(),
            "verdict": verdicts_told([margin_verdict(f"loop × {gain:.4g}", margins)])[0],
            "tables": tables_told(margin_tables(margins)),
            "poles": _poles(closed),
            "open_poles": _poles(transfer),
            **({"locus": _locus(record.linear.transfer)} if locus else {}),
            "open": of_response(open_loop, f"loop × {gain:.4g}", "linear"),
            "closed": of_response(Response(band, closed.response(band)), f"closed loop × {gain:.4g}", "linear"),
            "step": _step(closed),
        }
    )
    return result


def _margins_at(loop: LinearLoop, gain: float) -> Margins:
    """Return the margins at another gain without the peaks, which would take longer than a slider waits.

    What was withheld at the gain 1, as the sampled loop has other poles than L closed again, is withheld here.
    """
    from workbench.core.values.margins import GainCrossover  # noqa: PLC0415 - as above
    from workbench.loops.loop.margins import withheld  # noqa: PLC0415
    from workbench.loops.loop.stability import stability_of, unknown  # noqa: PLC0415
    from workbench.loops.nyquist.level_crossings import gain_crossings  # noqa: PLC0415

    own, transfer = loop.margins, loop.transfer.scaled(gain)
    stability = stability_of(transfer)
    several = any(math.isnan(c.delay_s) for c in own.gain_crossovers)  # the signal acts several times in a period
    if several or not own.everywhere or own.words != stability_of(loop.transfer).words:
        return withheld(unknown(stability, "the margins of this loop at its own gain are not those of L alone"))
    return replace(
        own, verdict=stability.verdict, words=stability.words, disk=None,
        phase_crossovers=tuple(replace(c, factor=c.factor / gain) for c in own.phase_crossovers),
        gain_crossovers=tuple(GainCrossover.of(f, transfer.at(f)) for f in gain_crossings(transfer)),
        peak_sensitivity=math.nan, peak_sensitivity_hz=math.nan, peak_complementary=math.nan,
        peak_complementary_hz=math.nan,
    )  # fmt: skip


def _poles(model: Linear) -> dict[str, Any]:
    """Return poles [1/s], of a discrete model those of the continuous motion that its samples show."""
    poles = model.continuous_poles
    return {"re": poles.real, "im": poles.imag}


def _locus(transfer: LinearPart) -> dict[str, Any]:
    """Return the poles of the closed loop at gains around one."""
    gains = np.geomspace(10.0**-_DECADES, 10.0**_DECADES, _GAINS).tolist()
    loops = [_poles(transfer.scaled(gain).complementary()) for gain in gains if transfer.solvable(-gain)]
    return {part: np.concatenate([poles[part] for poles in loops]) for part in ("re", "im")}


def _step(closed: Linear) -> dict[str, Any]:
    """Return the step response of a closed loop over about five of its slowest time constants.

    Of an unstable one until it is ten times the step away: `left_s` is when [s], None where it does not leave.
    """
    rates = closed.continuous_poles.real
    fastest = float(rates.max(initial=0.0))
    slow = np.abs(rates[np.abs(rates) > 1e-9])
    if fastest <= 1e-9:
        time, value = _response(closed, 5.0 / float(slow.min()) if slow.size else 1.0, _MANY)
        return {"time": time, "value": value, "left_s": None}
    time, value = _response(closed, math.log(_GROWN) / fastest, _FINE)
    beyond = np.flatnonzero(np.abs(value - 1.0) > _LEFT)
    if not beyond.size:
        return {"time": time, "value": value, "left_s": None}
    left = float(time[max(1, beyond[0])])
    time, value = _response(closed, left, _MANY)
    return {"time": time, "value": value, "left_s": left}


def _response(closed: Linear, longest: float, many: int) -> tuple[Any, Any]:
    """Return instants, at most so many, and the step response there."""
    import control  # noqa: PLC0415 - takes a second

    points = np.linspace(0.0, longest, many)
    if closed.dt > 0.0:
        count = min(math.floor(longest / closed.dt * (1.0 + 1e-12)) + 1, _FINE)
        points = np.arange(count, dtype=np.float64) * closed.dt
    result = control.step_response(closed.to_state_space(), points)
    return result.time, np.squeeze(result.outputs)
