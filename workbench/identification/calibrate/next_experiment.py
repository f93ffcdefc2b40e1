"""The experiment that would tell most: signals that `excite` plays, judged by the information that they would add."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import FilterDesign
from workbench.data.excite.signals import MultisineDesign, PrbsDesign
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, SimulationError
from workbench.identification.calibrate.information import Information
from workbench.identification.calibrate.problem import CalibrationProblem
from workbench.identification.calibrate.quantities import FreeValues
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.responses import ResponseData
from workbench.identification.calibrate.result import NextExperiment, TriedSignal
from workbench.identification.calibrate.search import Estimate

__all__ = ["next_experiment"]

_BITS = 8  # of a binary sequence at least, in an experiment
_OCTAVE = 2.0  # ratio of the clocks and bands that are tried


def next_experiment(
    found: Estimate,
    known: Information,
    request: Calibrate,
    posed: Callable[[Experiment, FreeValues], CalibrationProblem],
) -> NextExperiment:
    """Return the best of binary sequences and multisines over all octaves of clock and band.

    The information Mᵢ = JᵢᵀJᵢ of each, for the noise that was found, is added to that of the data, M, and to that of a
    value that is known to its own size, the unit matrix. D: the largest det(I + M + Mᵢ); A: the least trace of its
    inverse. E. Walter & L. Pronzato, chapter 6.

    Args:
        found: the estimate.
        known: its information.
        request: inputs with amplitudes, their rates, duration, criterion.
        posed: data, quantities → the problem with these data.

    Raises:
        InputError: no record over time, or no signal within the limits.
    """
    amplitudes: Mapping[str, float] = request.next_inputs or {}
    problem = found.problem
    first = next((one for one in problem.data if not isinstance(one, ResponseData)), None)
    if first is None:
        raise InputError("next: needs a record over time among the data")
    shared = np.array([k for k, q in enumerate(problem.quantities) if q.data is None and known.free[k]])
    quantities = FreeValues(tuple(problem.quantities[int(k)] for k in shared))
    J = problem.whitened(found.gradient)[0]
    own = _marginal(J, shared, [k for k, q in enumerate(problem.quantities) if q.data is not None])
    samples = request.next_samples or len(first.time)
    tried: list[TriedSignal] = []
    best: tuple[float, FilterDesign, Floats] | None = None
    for design, u in _signals(amplitudes, first, samples, request.next_rate or {}):
        asked = posed(_played(first, amplitudes, u), quantities)
        try:
            gradient = asked.gradient(found.z[shared], central=False)
        except SimulationError:
            gradient = None
        if gradient is None or gradient.failed:
            tried.append(TriedSignal(signal=_named(design), criterion=None))
            continue
        added = asked.whitened(gradient)[0]
        total = own + added.T @ added
        value = _judged(total, request.next_criterion)
        tried.append(TriedSignal(signal=_named(design), criterion=value))
        if best is None or value > best[0]:
            best = value, design, total
    if best is None:
        raise InputError("next: no signal fits these limits; allow more samples, or a higher rate")
    before, after = (_errors(m) for m in (own, best[2]))
    return NextExperiment(
        inputs=tuple(amplitudes), signal=_named(best[1]), dt=first.dt, samples=samples,
        criterion=request.next_criterion,
        narrower={q.name: float(b / a) for q, a, b in zip(quantities, before, after, strict=True)}, tried=tuple(tried),
    )  # fmt: skip


def _marginal(J: Floats, shared: Floats, others: Sequence[int]) -> Floats:
    """Return the information of some coordinates where others are estimated besides."""
    kept, rest = J[:, shared.astype(int)], J[:, list(others)]
    if not rest.shape[1]:
        return np.asarray(kept.T @ kept)
    left = kept - rest @ np.linalg.lstsq(rest, kept, rcond=None)[0]
    return np.asarray(left.T @ left)


def _with_size(information: Floats) -> Floats:
    return np.asarray(information + np.eye(len(information)))


def _judged(information: Floats, criterion: str) -> float:
    """Return what is to be large."""
    if criterion == "D":
        return float(np.linalg.slogdet(_with_size(information))[1])
    return -float(np.trace(np.linalg.inv(_with_size(information))))


def _errors(information: Floats) -> Floats:
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(_with_size(information)))))


def _signals(
    amplitudes: Mapping[str, float], data: Experiment, samples: int, rates: Mapping[str, float]
) -> Iterator[tuple[FilterDesign, Floats]]:
    """Yield designs with their values about the mean, shape (samples, m), those that keep the limits of rate."""
    dt, duration = data.dt, data.dt * samples
    sizes = tuple(amplitudes.values())
    every: list[FilterDesign] = []
    hold = dt
    while _BITS * hold <= duration:
        every.append(PrbsDesign(amplitude=sizes, rate=1.0 / hold))
        high = 0.4 / hold
        if high * duration > _BITS:
            every.append(MultisineDesign(amplitude=sizes, band=(1.0 / duration, high), periods=1))
        hold *= _OCTAVE
    limits = np.array([rates.get(name, np.inf) for name in amplitudes])
    for design in every:
        try:
            u = design.sequences(len(sizes), dt=dt, samples=samples, validation=0).identification.values[:samples]
        except InputError:  # it does not fit into so many samples
            continue
        if len(u) == samples and np.all(np.abs(np.diff(u, axis=0)).max(axis=0) <= limits * dt):
            yield design, u


def _played(first: Experiment, amplitudes: Mapping[str, float], u: Floats) -> Experiment:
    """Return data with these inputs, about the means of those measured, and outputs that are not there yet."""
    inputs = np.tile(first.u.mean(axis=0), (len(u), 1))
    for column, name in enumerate(amplitudes):
        inputs[:, first.input_names.index(name)] += u[:, column]
    time = first.time[0] + first.dt * np.arange(len(u))
    return replace(first, name="next", time=time, u=inputs, y=np.zeros((len(u), len(first.output_names))))


def _named(design: FilterDesign) -> str:
    """Return a design as `excite` takes it."""
    sizes = ":".join(f"{x:g}" for x in np.atleast_1d(design.amplitude))  # type: ignore[attr-defined]
    if isinstance(design, MultisineDesign):
        return f"multisine band={design.band[0]:.4g}:{design.band[1]:.4g},amplitude={sizes},periods={design.periods}"
    rate = f",rate={design.rate:.6g}" if isinstance(design, PrbsDesign) and design.rate is not None else ""
    return f"prbs amplitude={sizes}{rate}"
