"""Estimate a model's parameters from measured data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from scipy.special import chdtrc

from workbench.core.machine.files import file_to_write
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, SimulationError
from workbench.identification.calibrate.copies import copies
from workbench.identification.calibrate.data import check_named, measured, played
from workbench.identification.calibrate.information import (
    LIKELY,
    Information,
    Profile,
    bent,
    bootstrap,
    information,
    profile,
)
from workbench.identification.calibrate.integration import integration_shift, note_of_integration
from workbench.identification.calibrate.next_experiment import next_experiment
from workbench.identification.calibrate.noise import LOSSES, ColouredNoise, Segments
from workbench.identification.calibrate.problem import CalibrationProblem, Flags
from workbench.identification.calibrate.quantities import FreeValues, quantities_of
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.responses import ResponseData
from workbench.identification.calibrate.result import (
    CalibratedParameter,
    CalibrateResult,
    ChiSquared,
    DataFit,
    OutputNoise,
    ParameterProfile,
)
from workbench.identification.calibrate.runs import ModelRuns, RunPlace, sampled
from workbench.identification.calibrate.search import Estimate, search
from workbench.identification.validate.residuals import autocorrelation, cross_correlation, fit_of
from workbench.jobs.job import Job
from workbench.jobs.runner_choice import at_work
from workbench.jobs.store import Store
from workbench.jobs.version import stamp
from workbench.model import DescribedModel, Model
from workbench.model.operating_point import start_at
from workbench.system.as_system import write_system_of

__all__ = ["CalibrationWork", "place_of", "run"]

_Given = Sequence[Experiment | str | Path]

_ALGORITHM = 1  # to be raised when what a run gives changes: stored runs of both are not mixed
_MOST_STATES = 200  # of all copies together: a dense Newton matrix of more is slower than each by itself
_LAGS = 25  # of the tests [samples]
_PER_LAG = 5  # samples that each lag needs
_SURE = 20.0  # odds: one in twenty is wrong, as of a region of 95 %
_MOTIONS = {"hold": "held", "linear": "straight lines"}  # of inputs between samples
_HUGE = 700.0  # logarithm of the largest number


def run(model: Model, request: Calibrate, job: Job) -> CalibrateResult:
    """Calibrate; see `Calibrate`."""
    model, remarks = start_at(model, request.at)
    data = measured(model, cast("_Given", request.data), request)
    others = measured(model, cast("_Given", request.validation or ()), request)
    quantities = quantities_of(model, data, request)
    check_named(data, request)
    if request.out is not None:
        file_to_write(request.out, option="out")
        if not isinstance(model, DescribedModel):
            raise InputError(f"out: {model.name} is not a file; a system file cannot name it")
    notes = [*remarks, *(note for one in (*data, *others) for note in one.notes), *_doubts(data)]
    with ExitStack() as stack:
        place = place_of(model, request, job, len(quantities), stack)
        auto = request.interpolate == "auto"
        work = CalibrationWork(model, replace(request, interpolate="hold") if auto else request, place)
        found, found_out = work.estimate(data, quantities, notes)
        other = _other_motion(found, information(found), work)
        if auto and other.odds > _SURE:
            told = f"between samples the inputs are taken as {_MOTIONS[other.to]}: that explains the data better"
            taken = work.taking(other.to)
            with suppress(SimulationError):  # what was found stays, and its doubt is told
                found, found_out = taken.estimate(data, quantities, [*notes, told])
                work, notes, other = taken, [*notes, told], _other_motion(found, information(found), taken)
        left = integration_shift(found, information(found), request.place, lambda m, s: _kept(m, request, s))
        known = replace(information(found), shift=left)
        outputs = found.problem.runs.outputs([quantities.start, found.z])
        result = _record(
            work,
            found,
            known,
            outputs,
            [*notes, *found_out, *found.notes, *filter(None, [note_of_integration(found, known)])],
        )
        job.partial = lambda: result
        result = _looked_at(result, found, known, work)
        if other.moved and other.odds > (1.0 / _SURE if auto else _SURE):
            rival = None
            with suppress(SimulationError):
                rival = (
                    work.taking(other.to).estimate(data, quantities, None)[0] if auto and other.odds <= _SURE else None
                )
            result = _doubted(result, other, rival)
        if request.next_inputs:
            result = replace(result, next_experiment=next_experiment(found, known, request, work.posed(found)))
        compared = work.compared(others, found) if others else ()
    if request.out is not None and isinstance(model, DescribedModel):
        write_system_of(model, result.values, Path(request.out))
    return replace(result, validation=compared, runs=place.count, failed_runs=place.failed.total())


def place_of(model: Model, request: Calibrate, job: Job, count: int, stack: ExitStack) -> RunPlace:
    """Return what runs the model, and copies of it: one for each of so many coordinates, and one more."""
    runner = stack.enter_context(at_work(model, request.place, job))
    small = (count + 1) * len(model.states) <= _MOST_STATES
    together = copies(model, count + 1) if small and request.initial != "rest" else None
    joint = None
    if together is not None:
        joint = stack.enter_context(at_work(stack.enter_context(together), request.place, job))
    store = _kept(model, request, stack)
    return RunPlace(
        model=model, runner=runner, joint=joint, copies=count + 1, job=job, rest=request.initial == "rest", store=store
    )


def _kept(model: Model, request: Calibrate, stack: ExitStack) -> Store | None:
    """Return where runs of a model are kept, open until the stack ends; None: nowhere."""
    return None if request.store is None else stack.enter_context(_store(model, request, request.store))


def _store(model: Model, request: Calibrate, folder: str | Path) -> Store:
    if model.recipe is None:
        raise InputError(f"store: {model.name} is not a file; its results cannot be distinguished from another model's")
    subject = {
        "analysis": "calibrate", "algorithm": _ALGORITHM, **stamp().in_store, "model": model.recipe.identity(),
        "interface": model.interface, "initial": request.initial,
    }  # fmt: skip
    return Store(folder, subject=subject, effort={})


@dataclass(frozen=True, eq=False)
class CalibrationWork:
    """What runs what."""

    model: Model
    request: Calibrate
    place: RunPlace

    def problem(
        self, data: Sequence[Experiment], quantities: FreeValues, noise: ColouredNoise
    ) -> tuple[CalibrationProblem, Sequence[str]]:
        """Return the problem, and notes on how the model samples."""
        request, model = self.request, self.model
        records = [one for one in data if not isinstance(one, ResponseData)]
        grids = sampled(self.place.runner, [one.dt for one in records])
        laid = iter([played(model, one, grid, request, step) for one, (grid, step) in zip(records, grids, strict=True)])
        play = [one.played if isinstance(one, ResponseData) else next(laid) for one in data]
        made = CalibrationProblem(
            data=tuple(data), segments=Segments(data), quantities=quantities, noise=noise, rtol=model.rtol,
            runs=ModelRuns(self.place, play, quantities), loss=LOSSES[request.loss],
        )  # fmt: skip
        return made, [note for grid, _ in grids for note in grid.notes]

    def taking(self, motion: str) -> CalibrationWork:
        """Return the same with inputs that do this between samples."""
        return replace(self, request=replace(self.request, interpolate=motion))

    def estimate(
        self, data: Sequence[Experiment], quantities: FreeValues, notes: Sequence[str] | None
    ) -> tuple[Estimate, Sequence[str]]:
        """Return where the search ended, and notes on how the model samples.

        `notes` are those of what the job has meanwhile; None: nothing of this search is for it.
        """
        problem, found_out = self.problem(data, quantities, _guessed(data, self.request))

        def reached(found: Estimate) -> None:
            if notes is None:
                return
            outputs = problem.runs.outputs([quantities.start, found.z])
            words = [*notes, *found_out, *found.notes]
            self.place.job.partial = lambda: _record(self, found, information(found), outputs, words)

        return search(problem, self.request, reached), found_out

    def posed(self, found: Estimate) -> Callable[[Experiment, FreeValues], CalibrationProblem]:
        """Return the function that makes a problem of further data, with the noise that was found."""
        return lambda data, quantities: self.problem([data], quantities, found.problem.noise)[0]

    def compared(self, others: Sequence[Experiment], found: Estimate) -> tuple[DataFit, ...]:
        """Return other data beside the estimate; what is free for each data set is as the model has it."""
        shared = [k for k, q in enumerate(found.problem.quantities) if q.data is None]
        quantities = FreeValues(tuple(found.problem.quantities[k] for k in shared))
        problem, _ = self.problem(others, quantities, found.problem.noise)
        before, after = (problem.runs.outputs([z])[0] for z in (quantities.start, found.z[shared]))
        return tuple(_fit(problem, i, before[i], after[i]) for i in range(len(others)))


def _doubts(data: Sequence[Experiment]) -> Iterator[str]:
    """Yield notes on inputs and outputs that do not move, in any of the data."""
    names = dict.fromkeys(n for one in data for n in one.input_names)
    for name in names:
        columns = [one.u[:, one.input_names.index(name)] for one in data if name in one.input_names]
        if not any(np.ptp(column) > 0.0 for column in columns):
            yield f"input '{name}' does not move in the data: what acts by its changes alone cannot be seen"
    if not names and not any(isinstance(one, ResponseData) for one in data):
        yield (
            "no input was measured: all stay at their start values; `inputs` says which input is in which column, as "
            "u=column"
        )
    for name in dict.fromkeys(n for one in data for n in one.output_names):
        columns = [one.y[:, one.output_names.index(name)] for one in data if name in one.output_names]
        if not any(np.ptp(column[np.isfinite(column)]) > 0.0 for column in columns):
            yield f"output '{name}' does not move in the data: it tells little"


@dataclass(frozen=True)
class OtherMotion:
    """What another motion of the inputs between samples gives.

    Attributes:
        to: "hold" or "linear".
        odds: likelihood of the data with it over that without; 0: not known.
        moved: value → by how many standard errors it then moves, where that is one or more.
    """

    to: str
    odds: float
    moved: Mapping[str, float]


def _other_motion(found: Estimate, known: Information, work: CalibrationWork) -> OtherMotion:
    """Return what the other motion of the inputs gives, from one Gauss-Newton step."""
    problem, to = found.problem, "linear" if work.request.interpolate == "hold" else "hold"
    nothing = OtherMotion(to, 0.0, {})
    if not any(np.ptp(one.u) > 0.0 for one in problem.data if one.u.size and not isinstance(one, ResponseData)):
        return nothing
    e = work.taking(to).problem(problem.data, problem.quantities, problem.noise)[0].residuals(found.z)
    J = problem.whitened(found.gradient)[0][:, known.free]
    if not np.all(np.isfinite(e)) or not J.size:
        return nothing
    step = np.linalg.lstsq(J, e, rcond=None)[0]
    moved = np.where(known.open[known.free], 0.0, np.abs(step) / known.errors[known.free])
    worse = float(np.sum((e - J @ step) ** 2) - np.sum(problem.residuals(found.z) ** 2))
    names = [q.name for q, free in zip(problem.quantities, known.free, strict=True) if free]
    moves = {name: float(much) for name, much in zip(names, moved, strict=True) if much >= 1.0}
    return OtherMotion(to, float(np.exp(np.clip(-worse / 2.0, -_HUGE, _HUGE))), moves)


def _doubted(result: CalibrateResult, other: OtherMotion, rival: Estimate | None) -> CalibrateResult:
    """Return the record with the doubt of the other motion; regions hold what a rival estimate with it gives, too."""
    ways = ", ".join(f"{name} by {much:.2g}" for name, much in other.moved.items())
    now, then = _MOTIONS[result.between_samples], _MOTIONS[other.to]
    told = (
        f"between samples the inputs are taken as {now}; taken as {then} the model fits "
        f"{'better' if other.odds > _SURE else 'as well'}, and values move, in standard errors: {ways}"
    )
    if rival is None:
        return replace(result, doubt=f"{told}; regions may not hold the values")
    known, parameters = information(rival), list(result.parameters)
    for k, p in enumerate(parameters):
        its = _parameter(rival, known, k)
        if p.low is not None and p.high is not None and its.low is not None and its.high is not None:
            parameters[k] = replace(p, low=min(p.low, its.low), high=max(p.high, its.high))
    words = f"{told}; regions hold both: say which it is with `interpolate`, and they become narrower"
    return replace(result, doubt=words, parameters=tuple(parameters))


def _guessed(data: Sequence[Experiment], request: Calibrate) -> ColouredNoise:
    """Return the noise that the search begins with: as large as the outputs move, so that all count alike."""
    names = list(dict.fromkeys(n for one in data for n in one.output_names))
    sigma = {}
    for name in names:
        columns = [one.y[:, one.output_names.index(name)] for one in data if name in one.output_names]
        sigma[name] = float(np.nanstd(np.concatenate(columns))) or 1.0
    return ColouredNoise({**sigma, **(request.weights or {})}, {name: np.zeros(0) for name in names})


def _record(
    work: CalibrationWork, found: Estimate, known: Information, outputs: Sequence[Sequence[Floats | None]],
    notes: Sequence[str],
) -> CalibrateResult:  # fmt: skip
    """Return the record of an estimate, with the outputs at the start values and there."""
    model, problem, (before, after) = work.model, found.problem, outputs
    place, failed = problem.runs.place, problem.runs.place.failed
    words = [f"{failed.total()} of {place.count} runs failed; the most frequent reason: {reason}"
             for reason, _ in failed.most_common(1)]  # fmt: skip
    if any(q.data is not None for q in problem.quantities):
        words.append("initial values were estimated for the data; other data (`validation`) start as the model does")
    held = [
        f"{q.name} is held by its limit: the regions of the others take it as known"
        for q, free in zip(problem.quantities, known.free, strict=True)
        if not free
    ]
    return CalibrateResult(
        model=model.name, interface=model.interface, solver=model.solver,
        parameters=tuple(_parameter(found, known, k) for k in range(len(found.z))),
        correlation=known.correlation, not_identifiable=known.directions,
        data=tuple(_fit(problem, i, before[i], after[i], _band(found, known, i)) for i in range(len(problem.data))),
        validation=(),
        noise=tuple(
            OutputNoise(output=n, sigma=s, colour=tuple(problem.noise.colour[n].tolist()), given=problem.noise.given)
            for n, s in problem.noise.sigma.items()
        ),
        chi_squared=_chi_squared(found, known), loss=problem.loss.name, runs=place.count,
        failed_runs=failed.total(), reason=found.reason, converged=found.converged,
        between_samples=work.request.interpolate, operating_point=place.start,
        notes=tuple(dict.fromkeys([*notes, *words, *held])),
    )  # fmt: skip


def _parameter(found: Estimate, known: Information, k: int) -> CalibratedParameter:
    q, z, error = found.problem.quantities[k], float(found.z[k]), float(known.errors[k])
    sure, left = bool(known.free[k]) and np.isfinite(error), abs(float(known.shift[k]))
    half = known.quantile * error + left
    ends = [min(z + s * half, _HUGE) if q.log else z + s * half for s in (-1, 1)]
    return CalibratedParameter(
        name=q.name, kind=q.kind, unit=q.unit, start=q.start, value=q.value(z),
        std_error=q.slope(z) * math.hypot(error, left) if sure else None,
        low=q.value(ends[0]) if sure else None, high=q.value(ends[1]) if sure else None,
        at_bound=not known.free[k], identifiable=bool(known.free[k] and not known.open[k]),
    )  # fmt: skip


def _chi_squared(found: Estimate, known: Information) -> ChiSquared | None:
    problem = found.problem
    if not problem.noise.given:
        return None
    degrees = problem.samples - int(known.free.sum())
    value = problem.cost(found.z)
    return ChiSquared(value=value, degrees=degrees, p_value=float(chdtrc(degrees, value)))


def _band(found: Estimate, known: Information, i: int) -> Floats:
    """Return half the region of the outputs, shape (n, p), that the regions of the parameters make."""
    J = found.gradient.y[i]
    covariance = np.nan_to_num(known.covariance, nan=0.0, posinf=0.0)
    variance = np.einsum("npa,ab,npb->np", J, covariance, J)
    return np.asarray(known.quantile * np.sqrt(np.maximum(variance, 0.0)))


def _fit(
    problem: CalibrationProblem, i: int, before: Floats | None, computed: Floats | None, band: Floats | None = None
) -> DataFit:
    """Return one data set beside the model."""
    one = problem.data[i]
    of_response = isinstance(one, ResponseData)
    size = one.played.sizes if isinstance(one, ResponseData) else np.ones((1, 1))
    nothing = np.full(one.y.shape, np.nan)
    y = nothing if computed is None else size * computed
    fits = []
    for name, wanted, given in zip(one.output_names, (size * one.y).T, y.T, strict=True):
        there = np.isfinite(wanted)
        fits.append(fit_of(name, wanted[there], given[there]))
    made = DataFit(
        name=one.name, time=one.time,
        input_names=one.input_names, output_names=one.output_names, output_units=one.output_units,
        measured=size * one.y,
        before=nothing if before is None else size * before, computed=y,
        fits=tuple(fits),
        band=nothing if band is None else size * band, of_response=of_response,
    )  # fmt: skip
    return made if of_response else _tested(made, problem, i)


def _tested(made: DataFit, problem: CalibrationProblem, i: int) -> DataFit:
    """Return the fit with the tests of its residuals, over the longest stretch in which no sample is missing."""
    one = problem.data[i]
    gone: Flags = np.asarray(~np.isfinite(one.y).all(axis=1), dtype=np.bool_)
    whole = Segments([replace(one, y=np.where(gone[:, None], np.nan, one.y))])
    pieces = whole.of[0][0]
    longest = max(pieces, key=lambda s: s.stop - s.start, default=slice(0, 0))
    count = longest.stop - longest.start
    if unknown := [name for name in one.output_names if name not in problem.noise.sigma]:
        return replace(made, remark=f"the noise of {unknown[0]} is not known: the residuals are not tested")
    lags = min(_LAGS, count // _PER_LAG)
    rest = (made.measured - made.computed)[longest]
    if lags < 1 or not np.all(np.isfinite(rest)):
        return replace(made, remark="the residuals are not tested: too few samples without a gap")
    if np.any(np.sqrt(np.mean(rest**2, axis=0)) <= 1e-6 * np.sqrt(np.mean(made.measured[longest] ** 2, axis=0))):
        return replace(made, remark="the residuals are what the integration leaves: there is nothing to test")
    part = replace(one, time=one.time[longest], u=one.u[longest], y=one.y[longest])
    e = problem.noise.whitened([rest], Segments([part])).reshape(len(one.output_names), count).T
    moves = np.asarray(np.ptp(part.u, axis=0) > 0.0)
    cross = cross_correlation(e, part.u[:, moves], lags) if moves.any() else None
    return replace(made, autocorrelation=autocorrelation(e, lags), cross=cross)


def _looked_at(result: CalibrateResult, found: Estimate, known: Information, work: CalibrationWork) -> CalibrateResult:
    """Return the record with what runs at the ends of the regions show, and with profiles where they are asked for."""
    off = bent(found, known)
    parameters, notes = list(result.parameters), list(result.notes)
    for k, p in enumerate(parameters):
        if p.identifiable:
            parameters[k] = replace(p, curved=k in off)
        if work.request.profile and known.free[k]:
            parameters[k] = _profiled(parameters[k], found, known, profile(found, known, k), k)
    if work.request.bootstrap:
        z = bootstrap(found, work.request, work.request.bootstrap)
        parameters = [_drawn(p, found, known, k, z[:, k]) if known.free[k] else p for k, p in enumerate(parameters)]
        notes.append(f"regions and standard errors are those of {len(z)} records drawn anew")
    bent_ones = [p.name for p in parameters if p.curved and p.profile is None]
    if bent_ones:
        notes.append(
            f"{', '.join(bent_ones)}: the region is not an ellipse, and its ends are not sure; `profile` finds them"
        )
    return replace(result, parameters=tuple(parameters), notes=tuple(notes))


def _drawn(p: CalibratedParameter, found: Estimate, known: Information, k: int, z: Floats) -> CalibratedParameter:
    q, left = found.problem.quantities[k], abs(float(known.shift[k]))
    values = np.array([q.value(x) for x in z.tolist()])
    low, high = np.quantile(z, [0.5 - 0.5 * LIKELY, 0.5 + 0.5 * LIKELY]).tolist()
    error = math.hypot(float(np.std(values, ddof=1)), q.slope(float(found.z[k])) * left)
    return replace(p, low=q.value(low - left), high=q.value(high + left), std_error=error, curved=None)


def _profiled(
    p: CalibratedParameter, found: Estimate, known: Information, seen: Profile, k: int
) -> CalibratedParameter:
    q, left = found.problem.quantities[k], abs(float(known.shift[k]))
    low, high = (q.value(x) if np.isfinite(x) else None for x in (seen.low - left, seen.high + left))
    values = np.array([q.value(x) for x in seen.z])
    return replace(p, low=low, high=high, profile=ParameterProfile(values=values, cost=seen.cost))
