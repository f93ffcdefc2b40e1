"""Open a system's loop at a connection and tell its margins."""

from __future__ import annotations

from dataclasses import replace

from workbench.core.records.forms import Widths, several
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.loops.loop.cut import CutLoop, cut_loop
from workbench.loops.loop.linear import linear_loop
from workbench.loops.loop.measure import choose_measurement, measure
from workbench.loops.loop.measured import LoopCurve
from workbench.loops.loop.request import Loop, Open, openings
from workbench.loops.loop.result import LinearLoop, LoopResult
from workbench.loops.loop.several import all_places, disk_margins
from workbench.model import Model
from workbench.model.operating_point import find_point, named, standing
from workbench.point.trim.request import trim
from workbench.response.nfr.frequency_grid import frequency_grid

__all__ = ["run"]

_BESIDE = 3.0  # a band that is not given reaches so far beyond the linear crossovers
_SAMPLED = 0.5  # and to this part of the Nyquist frequency: near it periods do not repeat


def run(system: Model, request: Loop, job: Job) -> LoopResult:
    """Open a loop, or several one after the other; see `Loop`."""
    point, remarks = find_point(system, _trimmed(system) if request.trim else request.at)
    places = all_places(system) if request.open == "all" else openings(request.open)
    results = list[LoopResult]()
    for number, where in enumerate(places, 1):
        job.stage(number, len(places))
        results.append(_opened(system, where, point, remarks, request=request, job=job))
    if len(results) == 1:
        return results[0]
    disks, notes = disk_margins(system, places, point=point, method=request.method)
    first = results[0]
    every = tuple(dict.fromkeys((*first.notes, *notes)))
    return replace(first, others=tuple(results[1:]), disk_margins=disks, notes=every)


def _opened(
    system: Model, where: Open, point: OperatingPoint | None, remarks: tuple[str, ...], *, request: Loop, job: Job
) -> LoopResult:
    wanted = request.amplitudes is not None
    amplitudes = tuple(sorted(several(request.amplitudes or ())))
    cut = cut_loop(system, where, point=point)
    linear, doubts = _linear(cut, request.method, request.dx, request.du, needed=not wanted)
    curves: list[LoopCurve] = []
    why = ""
    if wanted:
        with job.ended_by(lambda: None):  # it ends after the points under way
            curves, why = _measured(cut, linear, amplitudes, request, job)
    if wanted and linear is not None and linear.transfer.dt > 0.0:
        doubts.append(
            "the loop is sampled: what is measured holds the fundamentals of continuous signals, L(z) samples"
        )
    return LoopResult(
        system=system.name,
        place=cut.place,
        value=cut.value,
        linear=linear,
        curves=tuple(curves),
        why=why,
        notes=(*remarks, *doubts),
        operating_point=named(system, cut.point) if cut.point is not None else standing(system),
    )


def _trimmed(system: Model) -> OperatingPoint:
    result = trim(system)
    if not result.converged:
        raise InputError(f"trim: {result.message}")
    return result.operating_point


def _measured(
    cut: CutLoop, linear: LinearLoop | None, amplitudes: tuple[float, ...], request: Loop, job: Job
) -> tuple[list[LoopCurve], str]:
    """Return the curves, one for each way and amplitude, and why it was measured so."""
    names, why = choose_measurement(request.how, linear)
    band = _own_band(linear) if request.frequencies is None and request.band is None else request.band
    grid = frequency_grid(request.frequencies, band, request.ratio, falling=False)
    curves: list[LoopCurve] = []
    for number, name in enumerate(names, 1):
        job.stage(number, len(names))
        curves += measure(cut, name, request, frequencies=grid, amplitudes=amplitudes, linear=linear, job=job)
    return curves, why


def _linear(
    cut: CutLoop, method: str, dx: Widths | None, du: float | None, *, needed: bool
) -> tuple[LinearLoop | None, list[str]]:
    try:
        result = linear_loop(cut, method=method, dx=dx, du=du)
    except (InputError, SimulationError) as error:
        if needed:
            raise
        return None, [*cut.notes, f"there is no linear loop: {error}"]
    return result, list(result.notes)


def _own_band(linear: LinearLoop | None) -> tuple[float, float]:
    inner = () if linear is None else linear.margins.crossovers_hz
    if not inner:
        raise InputError("band: none given, and the linear loop has no crossover to choose one around; give LO:HI [Hz]")
    top = max(inner) * _BESIDE if linear is None else min(max(inner) * _BESIDE, _SAMPLED * linear.transfer.highest_hz)
    return min(min(inner) / _BESIDE, top), top
