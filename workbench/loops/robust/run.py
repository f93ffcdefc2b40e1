"""Tell what holds for all parameters in their ranges."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.machine.files import file_to_write
from workbench.core.records.forms import several
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels
from workbench.core.values.linear import Linear
from workbench.core.values.margins import disk_of
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.loops.loop.cut import INJECTED, PASSED, RETURNED, injected_at
from workbench.loops.mu.lower import lower_bound
from workbench.loops.mu.peak import continued, level_at, response_at
from workbench.loops.robust.family import UncertainFamily, UncertainParameter
from workbench.loops.robust.gain import worst_gain
from workbench.loops.robust.prove import ProvedMargin, ProvedParts, divided, proved_margin
from workbench.loops.robust.request import Robust
from workbench.loops.robust.result import (
    MuPoint,
    Neglected,
    RobustMargin,
    RobustResult,
    WorstDisk,
    WorstGain,
    WorstPlace,
)
from workbench.loops.robust.uncertain import UncertainModel
from workbench.loops.robust.worst import destabilising, is_stable, promising, slowest, worst_place
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.model.operating_point import find_point
from workbench.point.lin.delay_roots import count_right_of
from workbench.point.lin.request import Lin
from workbench.point.lin.result import LinResult
from workbench.point.lin.sweep import check_varied
from workbench.point.lin.task import point_in_full
from workbench.requests.model_facts import facts_of
from workbench.system.as_system import write_system_of

__all__ = ["run"]

_CURVE = 20  # frequencies of the bounds of µ
_POINT = "worst.json"  # in the command that is shown


@dataclass(frozen=True, eq=False)
class _OpenedLoops:
    """What is linearised, and how its gain is measured.

    Attributes:
        model: with the loops that are opened.
        where: the places, in words.
        inputs, outputs: of the linear model.
        performance: sizes of the blocks that the gain is measured with.
        notes: one line each.
    """

    model: DescribedModel
    where: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    performance: tuple[int, ...]
    notes: tuple[str, ...]

    def changed(self, linear: LinResult) -> Linear:
        """Return S - T of the loops that are opened, z + y by what is injected; without such the model as it is."""
        k = len(self.where)
        if not k:
            return linear
        c, d = linear.C[:k] + linear.C[k:], linear.D[:k] + linear.D[k:]
        return Linear(linear.A, linear.B, c, d, dt=linear.dt)


def run(model: Model, request: Robust, job: Job) -> RobustResult:
    """Tell what holds for all parameters in their ranges; see `Robust`."""
    if not isinstance(model, DescribedModel):
        raise InputError(f"robust: {model.name} is not a file; its parameters cannot be varied")
    if model.interface != "me" or request.method == "response":
        why = "method response identifies" if model.interface == "me" else "co-simulation shows"
        raise InputError(f"robust: {model.name}: {why} no states of which stability could be proved; {model.way_out()}")
    check_varied(model, {name: several(ends) for name, ends in request.uncertain.items()}, what="uncertain")
    _check_out(model, request)
    units = {v.name: v.unit for v in (*model.description.variables, *model.states)}
    parameters = [
        UncertainParameter(name=name, low=low, high=high, unit=units.get(name))
        for name, (low, high) in request.uncertain.items()
    ]
    with _opened(model, request) as opened:
        begin, remarks = point_in_full(opened.model, replace(request, at=None))
        common = Lin(**begin, method=request.method, inputs=opened.inputs, outputs=opened.outputs)
        family = UncertainFamily(
            opened.model, parameters, common, request.place.apart, job, trimmed=not request.hold,
            changed=opened.changed,
        )  # fmt: skip
        with one_thread():
            return _analysed(model, request, opened, family, remarks)


def _analysed(
    model: DescribedModel, request: Robust, opened: _OpenedLoops, family: UncertainFamily, remarks: Sequence[str]
) -> RobustResult:
    (middle,) = family.at([(0.0,) * len(family.parameters)])
    if middle is None or not is_stable(middle):
        words = worst_place(family, (0.0,) * len(family.parameters)).pole
        raise InputError(
            f"robust: {model.name} is not stable in the middle of the ranges (pole {words:.4g}); choose ranges around "
            "a stable point, or hold what drifts, as by a loop around it"
        )
    centre = family.centre
    exact = None if centre.delayed is None else count_right_of(centre.delayed)
    if exact is not None and exact.number != 0.0:
        reason = exact.why or f"{exact.number:g} poles in the right half-plane"
        raise InputError(
            f"robust: {model.name} is not known to be stable in the middle of the ranges, its transport delays as they "
            f"are: {reason}; choose ranges around a stable point"
        )
    most, ended = _most(request, family.parameters, model)
    margin = proved_margin(family, most)
    stability, parts, whole = _stability(family, margin, request)
    gain = None
    if opened.performance:
        gain = worst_gain(family, whole, parts.proved, opened.performance, request.band)
    if request.out is not None:
        write_system_of(model, stability.worst.parameters, Path(request.out))
    far = (ended,) if ended and math.isinf(stability.upper) else ()
    notes = (*opened.notes, *remarks, *margin.notes, *far, *_told(family, whole))
    return RobustResult(
        model=model.name,
        interface=model.interface,
        parameters=family.parameters,
        stability=stability,
        mu=_curve(whole, stability, margin.peaks[1.0]),
        worst_gain=gain,
        disk_margins=_disks(opened, gain),
        neglected=Neglected(
            relative=whole.neglected, models=family.count, accuracy=family.accuracy, ranks=whole.fraction.ranks
        ),
        nominal_poles=middle.poles,
        dt=middle.dt,
        trimmed=not request.hold,
        command_line=_command(model, stability.worst, request),
        notes=tuple(dict.fromkeys(notes)),
        operating_point=family.centre.operating_point,
    )


@contextmanager
def _opened(model: DescribedModel, request: Robust) -> Iterator[_OpenedLoops]:
    """Give the model that is linearised."""
    point, remarks = find_point(model, request.at)
    if not request.open:
        started = model if point is None or request.at is None else model.starting_at(point, remarks)
        inputs, outputs = tuple(request.inputs or ()), tuple(request.outputs or ())
        performance = (max(len(inputs), len(outputs)),) if inputs else ()
        yield _OpenedLoops(started, (), inputs, outputs, performance, remarks)
        return
    with injected_at(model, request.open, point=point) as (opened, places, notes):
        numbers = range(1, len(places) + 1)
        yield _OpenedLoops(
            opened, tuple(p.label for p in places), tuple(f"{INJECTED}.{k}" for k in numbers),
            tuple(f"{name}.{k}" for name in (RETURNED, PASSED) for k in numbers), (1,) * len(places),
            (*remarks, *notes),
        )  # fmt: skip


def _most(request: Robust, parameters: Sequence[UncertainParameter], model: DescribedModel) -> tuple[float, str]:
    """Return the largest multiple of the ranges, and what ends it before the one that was asked for.

    None in which a parameter changes its sign or leaves its limits.
    """
    limits = {v.name: (v.minimum, v.maximum) for v in model.description.variables}
    ends = [(max(request.up_to, 1.0), "")]
    for p in parameters:
        middle, half = p.value(0.0), 0.5 * (p.high - p.low)
        if p.low > 0.0 or p.high < 0.0:
            ends.append((max(1.0, 0.98 * abs(middle) / half), f"{p.name} changes its sign"))
        low, high = limits.get(p.name, (None, None))
        for end, sign in ((low, -1.0), (high, 1.0)):
            if end is not None and sign * (end - middle) > 0.0:
                ends.append((max(1.0, sign * (end - middle) / half), f"{p.name} leaves the limits of the FMU"))
    most, why = min(ends)
    return most, f"wider ranges than {most:.3g} times were not looked at: there {why}" if why else ""


def _stability(
    family: UncertainFamily, margin: ProvedMargin, request: Robust
) -> tuple[RobustMargin, ProvedParts, UncertainModel]:
    """Return the margin, what is proved of the ranges, and the uncertain model over them."""
    whole = margin.models[1.0]
    most = max(margin.models)
    widest, n = margin.models[most], whole.states

    def badness(matrix: Floats) -> float:
        return slowest(matrix, n, whole.dt)

    inside, beyond = promising(whole, badness), promising(widest, badness)
    lower, parts = margin.size, ProvedParts((whole,)) if margin.size >= 1.0 else ProvedParts(())
    found = destabilising(family, [*inside, *beyond], lower, margin.most)
    size = math.inf if found is None else max(map(abs, found))
    count = 1
    if lower < 1.0 < size and whole.bounded:
        parts = divided(family, whole, request.boxes)
        if parts.proved:
            lower, count = 1.0, len(parts.proved)
        elif parts.unstable is not None:
            found, size = parts.unstable, max(map(abs, parts.unstable))
    if found is None:
        places = [whole.box.place(share.tolist()) for share in inside]
        known = [p for p, linear in zip(places, family.at(places), strict=True) if linear is not None]
        every = [worst_place(family, p) for p in (*known, (0.0,) * len(family.parameters))]
        worst = max(every, key=lambda w: _growth(w, whole.dt))
    else:
        worst = worst_place(family, found)
    up_to = margin.most
    approximate = family.centre.delayed is not None
    result = RobustMargin(lower=lower, upper=size, up_to=up_to, boxes=count, worst=worst, approximate=approximate)
    return result, parts, whole


def _growth(place: WorstPlace, dt: float) -> float:
    return abs(place.pole) if dt > 0.0 else place.pole.real


def _curve(whole: UncertainModel, stability: RobustMargin, highest: float) -> tuple[MuPoint, ...]:
    """Return bounds of µ over frequency, where it is highest, which a grid would miss, and at the worst set."""
    system, blocks = whole.stability()
    if not blocks or not whole.bounded:
        return ()
    twin, peak_level = continued(system), 1.0 / max(stability.lower, 0.1)
    natural = np.abs(system.continuous_poles) / (2.0 * math.pi)
    natural = natural[np.isfinite(natural) & (natural > 1e-9 * natural.max(initial=0.0))]
    low, high = (natural.min() / 10.0, natural.max() * 10.0) if len(natural) else (0.1, 10.0)
    high = min(high, system.highest_hz * (1.0 - 1e-6))
    worst = stability.worst
    seen = [highest] if 0.0 < highest < high else []
    shown = np.unique([*np.geomspace(max(low, 1e-6 * high), high, _CURVE), *natural[natural < high], *seen])
    vary = [b for b in blocks if b.varies]
    width = sum(b.size for b in vary)
    result = []
    for f in shown.tolist():
        omega = 2.0 * math.pi * f if system.dt == 0.0 else math.tan(math.pi * f * system.dt)
        matrix = response_at(twin, omega)
        upper = level_at(matrix, blocks, start=peak_level, rounds=1, full=False)
        lower = lower_bound(matrix[:width, :width], vary).bound
        result.append(MuPoint(frequency_hz=f, lower=min(lower, upper), upper=upper))
    if worst.unstable and worst.size > 0.0:
        matrix = response_at(twin, 2.0 * math.pi * worst.frequency_hz if system.dt == 0.0
                             else math.tan(math.pi * worst.frequency_hz * system.dt))  # fmt: skip
        upper = max(level_at(matrix, blocks), 1.0 / worst.size)
        result.append(MuPoint(frequency_hz=worst.frequency_hz, lower=1.0 / worst.size, upper=upper))
    return tuple(sorted(result, key=lambda p: p.frequency_hz))


def _disks(opened: _OpenedLoops, gain: WorstGain | None) -> tuple[WorstDisk, ...]:
    """Return the disk margins that are left: 2 over the gain of S - T."""
    if gain is None or not opened.where:
        return ()
    sure = disk_of(gain.upper, gain.frequency_hz) if math.isfinite(gain.upper) else disk_of(math.inf, math.nan)
    return (
        WorstDisk(
            where="; ".join(opened.where),
            alpha=sure.alpha,
            found=disk_of(gain.lower, gain.frequency_hz).alpha,
            nominal=disk_of(gain.nominal, gain.frequency_hz).alpha,
            gain_db=float(decibels(sure.high)) if math.isfinite(sure.high) else math.inf,
            phase_deg=sure.phase_deg,
            frequency_hz=gain.frequency_hz,
        ),
    )


def _told(family: UncertainFamily, whole: UncertainModel) -> list[str]:
    centre = family.centre
    notes = list(centre.notes)
    if centre.delayed is not None:
        notes.append(
            "transport delays are Padé approximations here: the bounds are of these, and decide nothing of the delays "
            "as they are, with which the model is stable in the middle of the ranges"
        )
    if whole.neglected > 0.3:
        notes.append(
            f"{whole.neglected:.0%} of what the parameters do over their ranges is no fraction of low rank: the "
            "bounds are wide for that; narrower ranges, or more parts, make them narrower"
        )
    return notes


def _check_out(model: DescribedModel, request: Robust) -> None:
    """Refuse a system file that could not be written, before anything is computed."""
    if request.out is None:
        return
    file_to_write(request.out, option="out")
    others = [n for n in request.uncertain if n not in {v.name for v in model.parameters}]
    if others:
        raise InputError(f"out: {others[0]} is not a parameter, and a system file has no place for it")


def _command(model: DescribedModel, worst: WorstPlace, request: Robust) -> str:
    """Return the line that linearises the model at the worst parameter set, trimmed there where it was."""
    source = facts_of(model).source
    if not source:
        return ""
    inputs, states = {v.name for v in model.inputs}, {v.name for v in model.states}
    held = "--x0" if request.hold else "--fix"
    flags = {name: "--u0" if name in inputs else held if name in states else "--set" for name in worst.parameters}
    sets = [word for name, value in worst.parameters.items() for word in (flags[name], f"{name}={value!r}")]
    at = ["--at", str(request.at)] if isinstance(request.at, str | Path) else []
    if request.hold:
        return shlex.join(["workbench", "lin", str(source), *at, *sets])
    parameters = [word for name in worst.parameters if flags[name] == "--set"
                  for word in ("--set", f"{name}={worst.parameters[name]!r}")]  # fmt: skip
    trimmed = shlex.join(["workbench", "trim", str(source), *at, *sets, "--json", _POINT])
    return f"{trimmed} && {shlex.join(['workbench', 'lin', str(source), *parameters, '--at', _POINT])}"
