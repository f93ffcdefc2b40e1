"""Modes over a parameter, and where they become unstable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from workbench.core.records.forms import several, varied
from workbench.core.records.quantity import number
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import damped_frequency_hz
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import Value
from workbench.jobs.job import Job
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.names import check_variables
from workbench.model.varied import with_parameters
from workbench.point.lin.request import Lin
from workbench.point.lin.task import NOT_AT_REST, point_in_full
from workbench.point.modes.match import match
from workbench.point.modes.mode import Critical, Mode
from workbench.point.modes.ranges import USUAL_TOLERANCE, unstable_ranges
from workbench.point.modes.request import Modes
from workbench.point.modes.result import ModeSet, ModesResult
from workbench.point.modes.source import ModelSource
from workbench.point.modes.track import Frame, ModeTracks, track

__all__ = ["critical_values", "find_root", "run", "sign_of"]

_NAMED = 3  # states

Settings = Mapping[str, Value]


def run(model: Model, request: Modes, job: Job) -> ModesResult:
    """Follow modes over a parameter; see `Modes`."""
    if not isinstance(model, DescribedModel):
        raise InputError(f"modes: {model.name} is not a file; its parts cannot be varied")
    if model.interface != "me" or request.method == "response":
        why = "method response identifies" if model.interface == "me" else "co-simulation shows"
        raise InputError(f"modes: {model.name}: {why} no states by which modes are followed; {_instead(model)}")
    vary, limits = varied(request.vary)
    against = list(request.against)
    grid = _values(request, limits)
    check_variables(model, [vary], "parameter", "input", "state", what="vary", number=True)
    begin, remarks = point_in_full(model, request)
    how = Lin(**begin, method=request.method, inputs=(), outputs=())
    width = USUAL_TOLERANCE * (grid[-1] - grid[0]) if request.tolerance is None else request.tolerance
    sets, common, moving = list[ModeSet](), dict(request.set or {}), list[str]()
    first: list[OperatingPoint] = []
    unit = next((v.unit for v in model.description.variables if v.name == vary), None)

    def result() -> ModesResult:
        return ModesResult(
            model=model.name,
            interface=model.interface,
            parameter=vary,
            unit=unit,
            sets=tuple(sets),
            tolerance=width,
            notes=(*remarks, *moving, *_which(sets, request), *_notes(sets, vary)),
            operating_point=first[0] if first else None,
            followed=request.count,
        )

    job.partial = lambda: result() if sets else None
    configured = [with_parameters(model, {**common, **settings}) for settings in ({}, *against)]
    for place, (settings, opened) in enumerate(zip(({}, *against), configured, strict=True), 1):
        job.stage(place, len(configured))
        label = _label(settings or _own(model, common, against))
        source = ModelSource(opened, vary, how, trimmed=request.trimmed, count=request.count, about=request.about)
        source.prepare(grid, request.place.apart, job, label=label or vary)
        _check_enough(source, grid, vary)
        sets.append(_one_set(source, grid, label, dict(settings), request, width=width))
        moving += [*_moving(source, label), *_doubtful(source, label)]
        first += [source.results[float(v)].operating_point for v in grid if v in source.results]
    return result()


def _own(model: DescribedModel, common: Settings, against: Sequence[Settings]) -> Settings:
    """Return what the model has where further configurations have something else."""
    starts = {v.name: v.start for v in model.description.variables}
    known = {**starts, **model.start_values, **common}
    result = {name: known.get(name) for settings in against for name in settings}
    return {name: value for name, value in result.items() if value is not None}


def _label(settings: Settings) -> str:
    return ", ".join(f"{n} = {_word(v)}" for n, v in settings.items())


def _word(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _check_enough(source: ModelSource, grid: Sequence[float], vary: str) -> None:
    failed = [value for value in grid if value in source.failed]
    if failed and len(grid) - len(failed) < 2:
        first = failed[0]
        raise SimulationError(
            f"modes: no linear model at {len(failed)} of {len(grid)} values, first at {vary} = {first:g}: "
            f"{source.failed[first]}"
        )


def _instead(model: Model) -> str:
    if model.interface == "me":
        return "use another method"
    return model.way_out()


def _values(request: Modes, limits: str) -> list[float]:
    """Return the values, as `vary` says or as they are given besides."""
    band, values = request.band, None if request.values is None else several(request.values)
    if limits:
        given = tuple(map(number, limits.split(":" if ":" in limits else ",")))
        band, values = ((given[0], given[1]), values) if ":" in limits else (band, given)
    if (values is None) == (band is None):
        raise InputError("modes: give either values or a band")
    result = np.linspace(*band, request.points).tolist() if band is not None else list(values or ())
    if len(result) < 2 or not np.isfinite(result).all() or np.any(np.diff(result) <= 0.0):
        raise InputError("modes: two or more rising values are needed")
    return result


def _one_set(
    source: ModelSource, grid: list[float], label: str, settings: Settings, request: Modes, *, width: float
) -> ModeSet:
    result = track(source, grid, count=request.count, about=request.about)
    poles, uncertain = result.table()
    names = next(iter(source.results.values())).state_names
    lines = [
        Mode(number=b + 1, pole=poles[:, b], uncertain=uncertain[:, b], states=_states(result, b, names))
        for b in range(result.count)
    ]
    found = (c for line in lines for c in critical_values(source, result, line, width))
    critical = tuple(sorted(found, key=lambda c: c.value))
    return ModeSet(
        label=label,
        settings=settings,
        value=result.values,
        modes=tuple(lines),
        critical=critical,
        unstable_ranges=unstable_ranges(result.values, lines, critical, tolerance=width),
        meetings=result.meetings,
        failed=dict(source.failed),
    )


def _states(tracks: ModeTracks, branch: int, names: Sequence[str]) -> tuple[str, ...]:
    """Return the states that take most part in a mode where it first exists."""
    for frame in tracks.frames:
        place = frame.place(branch)
        if place is not None:
            share = frame.poles.participation()[:, place]
            most = np.argsort(-share, kind="stable")[:_NAMED]
            return tuple(names[i] for i in most.tolist() if share[i] > 0.05)
    return ()


def critical_values(source: ModelSource, tracks: ModeTracks, line: Mode, tolerance: float) -> list[Critical]:
    """Return where a mode's real part changes its sign, each refined between two frames; not where it only touches 0.

    Args:
        source: of the models between.
        tracks: all modes.
        line: the mode.
        tolerance: of the values.
    """
    known = ~np.isnan(line.pole)
    signs = [
        sign_of(p, u) if exists else None
        for p, u, exists in zip(line.pole.tolist(), line.uncertain.tolist(), known.tolist(), strict=True)
    ]
    criticals, last = list[Critical](), 0
    for k in range(len(signs) - 1):
        here, there = signs[k], signs[k + 1]
        if here is None or there is None:
            last = 0
            if (here is None) != (there is None):
                criticals += _on_real_axis(source, tracks, k, line.number, tolerance)
            continue
        last = here or last
        if here == there or not (here > 0 or there > 0):
            continue
        if here == 0 and there > 0 and last > 0:  # it only grazed zero
            continue
        if here > 0 and there == 0 and next((s for s in signs[k + 1 :] if s != 0), 0) == 1:
            continue
        frames = tracks.frames[k], tracks.frames[k + 1]
        criticals.append(_refined(source, frames, line.number, tolerance, rising=there > here))
    return criticals


def _on_real_axis(source: ModelSource, tracks: ModeTracks, step: int, number: int, tolerance: float) -> list[Critical]:
    """Return where a real pole changes its stability within the step in which its pair has split (or the reverse).

    Half of a pair has no pole of its own on the other side of the step: the number of unstable poles is followed, as
    far as it changes by more than the modes that exist on both sides account for.
    """
    ends = tracks.frames[step : step + 2]
    low, high = (_unstable(source, f.value) for f in ends)
    if low is None or high is None or low == high:
        return []
    rising, fewest = high > low, min(low, high)
    left = high - low - _accounted_for(tracks, step)
    if left == 0 or rising != (left > 0):
        return []
    stable, unstable = (f.value for f in (ends if rising else ends[::-1]))
    first, last = _bisected(stable, unstable, lambda v: (_unstable(source, v) or 0) <= fewest, tolerance)
    becomes = "unstable" if rising else "stable"
    return [Critical(mode=number, value=0.5 * (first + last), frequency_hz=0.0, becomes=becomes, real=0.0)]


def _accounted_for(tracks: ModeTracks, step: int) -> int:
    """Return by how many unstable poles a step changes through modes that exist on both sides and change their sign."""
    poles, uncertain = (x[step : step + 2] for x in tracks.table())
    both = ~np.isnan(poles).any(axis=0)
    growing = np.where(np.isnan(poles), 0.0, poles.real) > uncertain
    weight = np.where(poles.imag == 0.0, 1, 2)
    change = np.where(growing[1], weight[1], 0) - np.where(growing[0], weight[0], 0)
    return int(np.sum(change[both & (growing[0] != growing[1])]))


def _unstable(source: ModelSource, value: float) -> int | None:
    """Return how many poles are unstable, those of a pair as two; None: there is no linear model."""
    poles = source(value)
    if poles is None:
        return None
    growing = [sign_of(p, u) > 0 for p, u in zip(poles.value.tolist(), poles.uncertain.tolist(), strict=True)]
    return int(np.sum(np.where(poles.real, 1, 2)[growing]))


def _refined(
    source: ModelSource, ends: tuple[Frame, Frame], number: int, tolerance: float, *, rising: bool
) -> Critical:
    known: dict[float, Frame] = {f.value: f for f in ends}

    def pole(value: float) -> tuple[complex, float]:
        frame = known.get(value) or _between(source, ends, value)
        place = frame.place(number - 1)
        if place is None:
            return complex(np.nan), np.inf
        return complex(frame.poles.value[place]), float(frame.poles.uncertain[place])

    value, root = find_root(pole, ends[0].value, ends[1].value, tolerance=tolerance)
    return Critical(
        mode=number,
        value=value,
        frequency_hz=float(damped_frequency_hz(root)),
        becomes="unstable" if rising else "stable",
        real=root.real,
    )


def _between(source: ModelSource, ends: tuple[Frame, Frame], value: float) -> Frame:
    """Return the modes at a value between two frames, numbered as those of the nearer one."""
    near = min(ends, key=lambda f: abs(f.value - value))
    poles = source(value)
    if poles is None:
        raise InputError(f"modes: there is no linear model at {value:g}, where a critical value was looked for")
    branch = {j: near.branch[i] for i, j in match(near.poles, poles).pairs}
    return Frame(value, poles, tuple(branch.get(j, -1) for j in range(len(poles))))


def _moving(source: ModelSource, label: str) -> Iterator[str]:
    """Yield a remark where modes are those of small deviations from a motion, not from an equilibrium."""
    notes = (n for value in sorted(source.results) for n in source.results[value].notes if n.startswith(NOT_AT_REST))
    moving = [note.split(";")[0] for note in notes]
    if moving:
        where = f"{label}: " if label else ""
        yield (
            f"{where}{moving[0]} (at {len(moving)} of {len(source.results)} values): modes and stability are those of "
            "small deviations from that motion; `trimmed` linearises at the equilibrium of each value"
        )


def _doubtful(source: ModelSource, label: str) -> Iterator[str]:
    """Yield a remark where entries of the linear models are doubtful, and so their poles."""
    found = [(value, source.results[value].doubts) for value in sorted(source.results)]
    some = [(value, d) for value, doubts in found for d in doubts if d.row in source.results[value].state_names]
    if some:
        where, (value, first) = f"{label}: " if label else "", some[0]
        count = len({v for v, _ in some})
        yield (
            f"{where}doubtful at {count} of {len(found)} values, first at {value:g}: {first.row} by {first.column}: "
            f"{first.reason}"
        )


def _which(sets: Sequence[ModeSet], request: Modes) -> tuple[str, ...]:
    if request.count is None:
        return ()
    where = f"those nearest to {request.about:g} Hz at the first value"
    return (f"only {len(sets[0].modes)} modes are followed, {where}; whether another one is unstable is not known",)


def _notes(sets: Sequence[ModeSet], parameter: str) -> tuple[str, ...]:
    notes = []
    for s in sets:
        who = f"{s.label}: " if s.label else ""
        for m in s.meetings:
            if m.kind == "unclear":
                numbers = ", ".join(map(str, m.modes))
                notes.append(
                    f"{who}modes {numbers} meet at {parameter} = {m.value:.6g} (step {m.width:.2g}); which is which "
                    "is uncertain from there on"
                )
        if s.failed:
            first, why = next(iter(s.failed.items()))
            notes.append(f"{who}no linear model at {len(s.failed)} values, first at {first:g}: {why}")
    return tuple(notes)


# -- where a mode becomes unstable: root of its real part over the parameter -----------------------

Pole = Callable[[float], tuple[complex, float]]


def sign_of(pole: complex, uncertain: float) -> int:
    """Return the sign of a pole's real part; 0 where rounding decides it.

    Args:
        pole: [1/s].
        uncertain: how far rounding may have moved it [1/s].
    """
    return 0 if abs(pole.real) <= uncertain else 1 if pole.real > 0.0 else -1


def find_root(pole: Pole, low: float, high: float, *, tolerance: float) -> tuple[float, complex]:
    """Return the value between two at which the mode's real part passes zero, or leaves it, and the pole there [1/s].

    Brent's method where the real part has both signs. A mode that is neutral on one side, such as those of an undamped
    structure before they coalesce, has no sign there: bisection, for the last value at which it is neutral.

    Args:
        pole: parameter → pole of this mode and its uncertainty [1/s].
        low: at one end of the bracket.
        high: at the other.
        tolerance: of the value.

    Source: Brent, Algorithms for Minimization without Derivatives, chapter 4.
    """
    ends = [sign_of(*pole(v)) for v in (low, high)]
    if ends[0] * ends[1] < 0:
        value = float(brentq(lambda v: pole(v)[0].real, low, high, xtol=tolerance, rtol=1e-15, disp=False))
        return value, pole(value)[0]
    neutral, moving = (low, high) if ends[0] == 0 else (high, low)
    neutral, moving = _bisected(neutral, moving, lambda v: sign_of(*pole(v)) == 0, tolerance)
    beyond = pole(moving)[0]
    # Real: an undamped pair that slows down to a standstill and parts diverges, without flutter.
    return 0.5 * (neutral + moving), beyond if beyond.imag == 0.0 else pole(neutral)[0]


def _bisected(first: float, last: float, like_first: Callable[[float], bool], tolerance: float) -> tuple[float, float]:
    """Return the ends, in the same order, of an interval as wide as the tolerance in which `like_first` changes."""
    while abs(last - first) > tolerance and (middle := 0.5 * (first + last)) not in (first, last):
        first, last = (middle, last) if like_first(middle) else (first, middle)
    return first, last
