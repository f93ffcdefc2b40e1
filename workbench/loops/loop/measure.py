"""Measure loop transfers at amplitudes, and come closer to their crossovers round by round."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager

import numpy as np

from workbench.core.values.margins import Margins
from workbench.jobs.job import Job
from workbench.loops.loop.cut import PASSED, RETURNED, CutLoop
from workbench.loops.loop.injecting import injected
from workbench.loops.loop.margins import curve_margins
from workbench.loops.loop.measured import LoopCurve, LoopPoint
from workbench.loops.loop.points import Bench
from workbench.loops.loop.request import Loop
from workbench.loops.loop.result import LinearLoop
from workbench.model.described_model import DescribedModel
from workbench.response.nfr.point import NfrPoint

__all__ = ["MEASUREMENTS", "broken", "choose_measurement", "measure"]

_SAME = 1e-4  # relative: a frequency so near to one that was measured is not measured again
_HANDFUL = 4

Points = dict[tuple[float, float], LoopPoint]


def choose_measurement(how: str, linear: LinearLoop | None) -> tuple[tuple[str, ...], str]:
    """Return the names of the measurements to do, and why.

    Args:
        how: "break", "inject", "both", or "auto".
        linear: the linear loop, if there is one.
    """
    if how == "both":
        return tuple(MEASUREMENTS), "both were asked for"
    if how in MEASUREMENTS:
        return (how,), f"{how} was asked for"
    if linear is None:
        return ("inject",), "auto: nothing is known about the open loop"
    poles = linear.transfer.poles
    edge = np.abs(poles) - 1.0 if linear.transfer.dt > 0.0 else poles.real
    if np.any(edge > -1e-9):
        return ("inject",), "auto: the open loop has a pole at or beyond the border of stability and would run away"
    return ("break",), "auto: the open loop is stable"


def measure(
    cut: CutLoop,
    name: str,
    request: Loop,
    *,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    linear: LinearLoop | None,
    job: Job,
) -> list[LoopCurve]:
    """Return a curve for each amplitude.

    Args:
        cut: the loop.
        name: of the measurement.
        request: where points are measured, how long to wait for each, and how many rounds of more points there are, at
            the crossovers that the points so far show; what may end it between handfuls of points.
        frequencies: [Hz], rising.
        amplitudes: of the signal passed on, rising.
        linear: the linear loop, for the verdict on stability.
        job: is told each new point, the number done and the number in all that is known of.
    """
    (changed, run), points = MEASUREMENTS[name], Points()
    loop = None if linear is None else linear.transfer

    def stopped() -> bool:
        return job.stopped or (request.stopped is not None and request.stopped())

    with changed(cut) as model, Bench(model, request, job, value=cut.value, loop=loop) as bench:
        wanted = [(f, a) for a in amplitudes for f in frequencies]
        for _ in range(1 + request.refine):
            for part in _parts(wanted):
                if stopped():
                    break
                for key, point in zip(part, run(bench, part), strict=True):
                    points[key] = point
                    job.done(point, len(points), len({*points, *wanted}))
            wanted = [] if stopped() else _closer(points, amplitudes)
            if not wanted:
                break
        notes = (*bench.notes, *(("interrupted: points are missing",) if stopped() else ()))
    curves = []
    for amplitude in amplitudes:
        result = _known(points, amplitude)
        doubts = _doubts(result, amplitude, cut.value)
        curves.append(
            LoopCurve(
                how=name,
                amplitude=amplitude,
                points=tuple(result),
                margins=_margins(result, linear),
                notes=(*notes, *doubts),
            )
        )
    return curves


def _parts(wanted: Sequence[tuple[float, float]]) -> Iterable[Sequence[tuple[float, float]]]:
    """Return handfuls, so that progress can be told and the measurement ended."""
    return (wanted[i : i + _HANDFUL] for i in range(0, len(wanted), _HANDFUL))


def _known(points: Points, amplitude: float) -> list[LoopPoint]:
    return [points[key] for key in sorted(points) if key[1] == amplitude]


def _margins(result: Sequence[LoopPoint], linear: LinearLoop | None) -> Margins:
    good, known = [p for p in result if p.value is not None], linear if linear is not None and linear.closes else None
    return curve_margins(
        np.array([p.frequency_hz for p in good]),
        np.array([p.value for p in good], dtype=np.complex128),
        linear=None if known is None else known.margins,
        stability=None if known is None else known.stability,
        doubt=_hidden(good),
    )


def _hidden(points: Sequence[LoopPoint]) -> str:
    """Return why these points do not tell on which side of -1 the curve passes; empty: they do."""
    hidden = [
        p for p in points
        if p.status == "averaged" and p.value is not None
        and (p.error is None or p.error * abs(p.value) >= abs(1.0 + p.value))
    ]  # fmt: skip
    if not hidden:
        return ""
    return f"{len(hidden)} points have not settled, and their errors, or what is not known of them, may reach -1"


def _closer(points: Points, amplitudes: Sequence[float]) -> list[tuple[float, float]]:
    """Return where the crossovers seem to be, if nothing was measured there."""
    seen = [(f, a) for a in amplitudes for f in _margins(_known(points, a), None).crossovers_hz]
    return [(f, a) for f, a in seen if all(abs(f / p.frequency_hz - 1.0) > _SAME for p in _known(points, a))]


def _doubts(result: Sequence[LoopPoint], amplitude: float, value: float) -> list[str]:
    doubts = [
        _worst(
            [(p.thd_passed or 0.0, p) for p in result],
            0.05,
            "the signal passed on is not a sine at {n} points (distortion up to {worst:.3g} % at {hz:.4g} Hz): a "
            "describing function is not reliable there",
        ),
        _worst(
            [(abs((value if p.mean is None else p.mean) - value) / amplitude, p) for p in result],
            0.05,
            "the sine moves the mean of the signal passed on at {n} points (by up to {worst:.3g} % of the amplitude at "
            "{hz:.4g} Hz): L is that of another operating point there",
        ),
        _worst(
            [(p.balance or 0.0, p) for p in result],
            0.01,
            "what was passed on, returned and injected does not add up at {n} points (by up to {worst:.3g} % at "
            "{hz:.4g} Hz): not settled",
        ),
    ]
    averaged, failed = (sum(p.status == s for p in result) for s in ("averaged", "failed"))
    if averaged:
        doubts.append(f"{averaged} points did not settle and are averages")
    if failed:
        first = next(p for p in result if p.value is None)
        doubts.append(f"{failed} points failed, the first at {first.frequency_hz:.4g} Hz: {first.reason}")
    return [d for d in doubts if d]


def _worst(sizes: Sequence[tuple[float, LoopPoint]], limit: float, words: str) -> str:
    """Return what is to be said where sizes exceed a limit; nothing where none does."""
    beyond = [(size, p) for size, p in sizes if size > limit]
    if not beyond:
        return ""
    size, point = max(beyond, key=lambda x: x[0])
    return words.format(n=len(beyond), worst=100.0 * size, hz=point.frequency_hz)


# -- measure the loop transfer with the loop broken: a sine is passed on, what returns is measured --


def broken(bench: Bench, wanted: Sequence[tuple[float, float]]) -> list[LoopPoint]:
    """Measure points of the broken loop.

    The signal passed on is a pure sine around its value at the operating point: L is the describing function of the
    loop, exactly. Not for loops that run away when they are open (an unstable part, an integrator on a mean that
    is not quite zero): inject there.

    Args:
        bench: on the opened system.
        wanted: frequency [Hz] and amplitude of the signal passed on.
    """
    return [_point(p, bench.value) for p in bench.measure(PASSED, RETURNED, wanted)]


def _point(result: NfrPoint, mean: float) -> LoopPoint:
    known = result.certificate
    return LoopPoint(
        frequency_hz=result.frequency,
        amplitude=math.nan if result.response is None else result.amplitude,
        value=None if result.response is None else -result.response,
        mean=None if result.response is None else mean,
        thd_passed=None if result.response is None else 0.0,
        thd_returned=None if known is None else known.thd,
        harmonics=() if known is None else known.harmonics,
        status=result.status,
        error=result.error,
        periods=result.periods,
        reason=result.reason,
        kind=result.kind,
    )


# Name → how the system is prepared, and what measures (frequency [Hz], amplitude) pairs.
MEASUREMENTS: Mapping[
    str,
    tuple[
        Callable[[CutLoop], AbstractContextManager[DescribedModel]],
        Callable[[Bench, Sequence[tuple[float, float]]], list[LoopPoint]],
    ],
] = {"break": (CutLoop.opened, broken), "inject": (CutLoop.injected, injected)}
