"""What a linear loop is, for the browser: margins, poles, root locus, step response."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import plain
from workbench.core.values.arrays import Floats
from workbench.core.values.response import Response
from workbench.ui.curves import of_response
from workbench.ui.marks import margin_marks
from workbench.ui.page import tables_told, verdicts_told

# As in `curves`: the page is there before python-control is.
if TYPE_CHECKING:
    from workbench.core.values.linear import Linear, LinearPart
    from workbench.core.values.margins import Margins
    from workbench.loops.loop.result import LinearLoop
    from workbench.point.lin.result import DelayFreePart

__all__ = ["loop_told", "margins_at"]

_MANY = 400  # frequencies, and instants of a step response
_GAINS = 240  # of a root locus
_AROUND = 1.5  # decades on both sides of the crossovers are shown
_DECADES = 3.0  # around the gain 1 of a root locus
_FINE = 4000  # instants at which an unstable step response is looked for where it leaves
_LEFT = 10.0  # times the step: so far from it nobody looks at an unstable one any more
_GROWN = 1e9  # times: what has not left by then is an unstable motion that the step does not excite


def loop_told(transfer: LinearPart, margins: Margins, *, label: str = "L", locus: bool = False) -> dict[str, Any]:
    """Return what a linear loop is, ready for JSON: margins, poles, curves, step response.

    `margins` with their `verdict`, `tables` and `marks`; `poles` of the closed loop, `zeros` and `open_poles`; `open`
    and `closed` over frequency; `step` of T, see `_step`; `locus`: poles of the closed loop at many gains.

    Args:
        transfer: L for negative feedback.
        margins: of it.
        label: what its curve is called.
        locus: whether to add the poles at many gains.

    Raises:
        InputError: the closed loop has no solution.
    """
    from workbench.loops.loop.page import margin_tables, margin_verdict  # noqa: PLC0415 - as above

    band = _band(transfer, margins)
    open_loop = Response(band, transfer.response(band))
    closed = transfer.complementary()
    result: dict[str, Any] = plain(
        {
            "margins": margins.to_dict(),
            "verdict": verdicts_told([margin_verdict(label, margins)])[0],
            "tables": tables_told(margin_tables(margins)),
            "poles": _poles(closed),
            "open_poles": _poles(transfer),
            **({"locus": _locus(transfer)} if locus else {}),
            "open": of_response(open_loop, label, "linear", marks=margin_marks(margins)),
            "closed": of_response(Response(band, closed.response(band)), "T", "linear"),
            "step": _step(closed),
        }
    )
    return result


def _band(transfer: LinearPart, margins: Margins) -> Floats:
    """Return frequencies that show a loop: around its crossovers, or its poles where there are none [Hz]."""
    seen = [f for f in margins.crossovers_hz if 0.0 < f < math.inf]
    if not seen:
        seen = [f for f in (np.abs(transfer.continuous_poles) / (2.0 * math.pi)).tolist() if 1e-6 < f < 1e6] or [1.0]
    high = min(max(seen) * 10.0**_AROUND, transfer.highest_hz)
    return np.geomspace(min(min(seen) / 10.0**_AROUND, high / 10.0), high, _MANY)


def margins_at(loop: LinearLoop, gain: float) -> Margins:
    """Return the margins at another gain without the peaks, which would take longer than a slider waits.

    What was withheld at the gain 1, as the sampled loop has other poles than L closed again, is withheld here.
    """
    from workbench.core.values.margins import GainCrossover  # noqa: PLC0415 - as above
    from workbench.loops.loop.margins import withheld  # noqa: PLC0415
    from workbench.loops.loop.stability import stability_of, unknown  # noqa: PLC0415
    from workbench.loops.nyquist.level_crossings import gain_crossings  # noqa: PLC0415

    if loop.lin.delayed is not None:
        return _margins_with_delays(loop.lin.delayed.negated().scaled(gain), loop.transfer.scaled(gain))
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


def _margins_with_delays(exact: DelayFreePart, transfer: LinearPart) -> Margins:
    from workbench.loops.loop.delayed_loop import delayed_margins, delayed_stability  # noqa: PLC0415 - as above

    return replace(delayed_margins(exact, delayed_stability(exact, transfer)), disk=None)


def _poles(model: Linear) -> dict[str, Any]:
    """Return poles [1/s], of a discrete model those of the continuous motion that its samples show."""
    poles = model.continuous_poles
    return {"re": poles.real, "im": poles.imag}


def _locus(transfer: LinearPart) -> dict[str, Any]:
    """Return the poles of the closed loop at gains around one: `re`, `im` and `gain`, each as long."""
    from workbench.core.values.poles import continuous  # noqa: PLC0415 - as above

    gains = np.geomspace(10.0**-_DECADES, 10.0**_DECADES, _GAINS)
    gains = gains[np.abs(1.0 + gains * transfer.d) > 1e-9]
    factor = gains / (1.0 + gains * transfer.d)
    poles = np.linalg.eigvals(transfer.A - factor[:, None, None] * np.outer(transfer.b, transfer.c))
    at = continuous(poles.astype(np.complex128), transfer.dt)
    return {"re": at.real.ravel(), "im": at.imag.ravel(), "gain": np.repeat(gains, len(transfer.A))}


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


def _response(closed: Linear, longest: float, many: int) -> tuple[Floats, Floats]:
    """Return instants, at most so many, and the step response there: exact between instants, by one exponential."""
    from scipy.linalg import expm  # noqa: PLC0415 - takes a while

    n = len(closed.A)
    points = np.linspace(0.0, longest, many)
    advance = np.block([[closed.A, closed.B], [np.zeros((1, n + 1))]])
    if closed.dt > 0.0:
        count = min(math.floor(longest / closed.dt * (1.0 + 1e-12)) + 1, _FINE)
        points = np.arange(count, dtype=np.float64) * closed.dt
        advance[n, n] = 1.0
    else:
        advance = expm(advance * points[1])
    state, values = np.append(np.zeros(n), 1.0), np.empty(len(points))
    shown = np.append(closed.C[0], closed.D[0, 0])
    for k in range(len(points)):
        values[k] = shown @ state
        state = advance @ state
    return points, values
