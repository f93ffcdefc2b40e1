"""Every applicable method on one model, beside a measured frequency response of small amplitude."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import numpy as np

from workbench.core.records.forms import several
from workbench.core.records.option import recast
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import difference
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import FmuError, InputError, SimulationError
from workbench.jobs.job import Job
from workbench.model import DescribedModel, Model
from workbench.point.lin.linearise import METHODS, run
from workbench.point.lin.pulses import communication_step
from workbench.point.lin.request import Lin
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import LinTask, make_task, open_base
from workbench.response.compare_linear.interfaces import InterfaceDifference, compare_interfaces
from workbench.response.compare_linear.request import Compare
from workbench.response.compare_linear.result import LinComparison, MethodAgreement
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult

__all__ = ["run_all"]

GAIN_DB, PHASE_DEG = 0.5, 5.0  # what counts as agreement
FREQUENCIES = 9
OF_NYQUIST = 0.4
RELATIVE_AMPLITUDE = 1e-3
PER_PERIOD = 20.0  # periods of `response` per period of the highest frequency compared
_PERIODS = 60  # most periods of a measured point: a sampled model may beat with the sine for this long
FAINT = 1e-2  # of the largest gain: what lies below is not compared unless asked for


def run_all(model: Model, request: Compare, _job: Job) -> LinComparison:
    """Linearise by every method and measure; see `Compare`."""
    task = make_task(model, recast(Lin, request, inputs=[request.input], outputs=[request.output]))
    results, failed = _every(task)
    if not results:
        raise InputError(f"no method applies: {'; '.join(f'{k}: {v}' for k, v in failed.items())}")
    given = request.frequencies
    grid = _frequencies(list(results.values())) if given is None else np.asarray(several(given), dtype=np.float64)
    point = next(iter(results.values())).operating_point
    amplitude = None if request.amplitude is None else float(request.amplitude)
    measured, words = _measure(task, point, grid, amplitude) if request.measure else (None, [])
    verdicts = tuple(v for name, result in results.items() for v in _verdicts(name, result, grid, measured))
    interfaces = _interfaces(task, results, grid)
    spoken = [*([interfaces.words] if interfaces else []), *words, *_summary(results, verdicts), *_remarks(results)]
    return LinComparison(
        model=model.name,
        interface=model.interface,
        solver=model.solver,
        input=request.input,
        output=request.output,
        results=results,
        failed=failed,
        measured=measured,
        verdicts=verdicts,
        interfaces=interfaces,
        words=tuple(spoken),
        operating_point=point,
    )


# -- linear models ----------------------------------------------------------------------------


def _every(task: LinTask) -> tuple[dict[str, LinResult], dict[str, str]]:
    """Return all linear models, and why the other methods do not apply."""
    results, failed = dict[str, LinResult](), dict[str, str]()
    interfaces = sorted(_offered(task.model), reverse=True)  # what the equations say comes first
    for interface in interfaces:
        other = interface != task.model.interface
        with _on(task.model, interface) if other else nullcontext(task.model) as model:
            _methods(replace(task, model=model, period=_period(task, results)), results, failed)
    return results, failed


def _period(task: LinTask, results: Mapping[str, LinResult]) -> float | None:
    """Return the period over which `response` holds its input [s]; None: the model's own step, if it names one."""
    if task.period is not None or not results or (isinstance(task.model, DescribedModel) and task.model.recipe.step):
        return task.period
    known = next(iter(results.values()))
    return known.dt if known.dt > 0.0 else 1.0 / (PER_PERIOD * float(_frequencies([known])[-1]))


def _offered(model: Model) -> list[str]:
    if not isinstance(model, DescribedModel):
        return [model.interface]
    return [model.interface, *(i for i in ("me", "cs") if i in model.description.interfaces and i != model.interface)]


def _on(model: Model, interface: str) -> Model:
    """Return the same FMU on its other interface."""
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name} has one interface")
    return replace(model.recipe, interface=interface, solver="auto").open()


def _methods(task: LinTask, results: dict[str, LinResult], failed: dict[str, str]) -> None:
    for name in METHODS:  # response comes last, it needs a period
        label = f"{name} ({task.model.interface})"
        task = replace(task, period=_period(task, results))
        try:
            why = _why_not(task, name)
            if why:
                failed[label] = why
            else:
                results[label] = run(_suited(task, name), name)
        except (InputError, SimulationError, FmuError) as error:
            failed[label] = str(error)


def _why_not(task: LinTask, method: str) -> str:
    """Return why a method would answer another question; empty if it applies as far as one can tell before."""
    if task.model.interface == "cs":
        return "" if method == "response" else "a co-simulation interface provides neither states nor derivatives"
    with open_base(task) as point:
        sampled = len(point.ticks(1, np.inf)) > 0 and bool(point.memory)
    if sampled and method in ("exact", "difference"):
        return "the model is sampled: this would hold its discrete states"
    return ""


def _suited(task: LinTask, method: str) -> LinTask:
    """Leave out the widths that a method does not take."""
    if method == "exact":
        return replace(task, dx=None, du=None)
    return replace(task, dx=None) if method == "response" else task


# -- measurement ------------------------------------------------------------------------------


def _frequencies(results: Sequence[LinResult]) -> Floats:
    """Return frequencies around the poles, as far as the response is worth looking at [Hz]."""
    corners = np.concatenate([_corners(r) for r in results])
    rates = [OF_NYQUIST * 0.5 / r.dt for r in results if r.dt > 0.0]
    high = min([3.0 * float(corners.max()) if len(corners) else 10.0, *rates])
    low = min(0.3 * float(corners.min()) if len(corners) else 0.1, 0.1 * high)
    gain = np.abs(results[0].fundamental(dense := np.geomspace(low, high, 400))[:, 0, 0])
    loud = dense[gain > FAINT * np.nanmax(gain)]
    high = float(loud[-1]) if len(loud) else high
    band: Floats = np.geomspace(max(low, high / 1e3), high, FREQUENCIES)
    return band


def _corners(result: LinResult) -> Floats:
    """Return the frequencies of the poles that a sampled response can show [Hz]."""
    sizes = natural_frequency_hz(result.continuous_poles)
    return np.asarray(sizes[sizes > 1e-6], dtype=np.float64)


def _measure(
    task: LinTask, point: OperatingPoint, grid: Floats, amplitude: float | None
) -> tuple[NfrResult | None, list[str]]:
    """Return the measured response, and what to say about it."""
    model = task.model
    if not isinstance(model, DescribedModel):
        return None, ["nothing was measured: this kind of model cannot be started at the point"]
    (source,), (target,) = task.inputs, task.outputs
    variable = next(v for v in model.inputs if v.name == source)
    size = max(abs(point.u[source]), variable.nominal or 0.0) or 1.0
    small = RELATIVE_AMPLITUDE * size if amplitude is None else amplitude
    recipe = replace(model.recipe, tolerance=min(model.recipe.tolerance or 1e-8, 1e-8))
    step = task.period if model.interface == "cs" else None
    try:
        with recipe.open() as exact:
            measured = nfr(exact, source, target, grid, [small], step=step, at=point, max_periods=_PERIODS)
    except (InputError, SimulationError, FmuError) as error:
        return None, [f"nothing was measured: {error}"]
    if not np.any(np.where(np.isnan(measured.response), 1.0, measured.response)):
        why = f"a sine of amplitude {small:.3g} at {source} does not move {target}; use a larger amplitude"
        return measured, [f"nothing to compare with: {why}"]
    unsettled = int(measured.averaged.sum()) + len(measured.failed)
    reason = (
        measured.failed[0].reason if measured.failed else "undamped, not at rest at the point, or a tolerance too wide"
    )
    words = [f"{unsettled} of {len(grid)} measured points did not settle or failed ({reason})"]
    return measured, words if unsettled else []


def _verdicts(name: str, result: LinResult, grid: Floats, measured: NfrResult | None) -> list[MethodAgreement]:
    response = result.fundamental(grid)[:, 0, 0]
    real = np.full(len(grid), np.nan, dtype=np.complex128)
    if measured is not None:  # what did not settle is not compared with, unless nothing moved at all
        real = np.where(measured.averaged[0] & (measured.response[0] != 0.0), np.nan, measured.response[0])
    triples = zip(grid.tolist(), response.tolist(), real.tolist(), strict=True)
    return [_verdict(name, frequency, model, truth) for frequency, model, truth in triples]


def _verdict(name: str, frequency: float, model: complex, truth: complex) -> MethodAgreement:
    size = abs(truth)
    if not math.isfinite(size) or not math.isfinite(abs(model)) or model == truth == 0.0:
        return MethodAgreement(name, frequency, math.nan, math.nan, None, size)
    if model == 0.0 or truth == 0.0:
        return MethodAgreement(name, frequency, math.inf if model else -math.inf, math.nan, False, size)
    gain, phase = (float(d) for d in difference(model, truth))
    return MethodAgreement(name, frequency, gain, phase, abs(gain) <= GAIN_DB and abs(phase) <= PHASE_DEG, size)


def _summary(results: Mapping[str, LinResult], verdicts: Sequence[MethodAgreement]) -> list[str]:
    words = []
    for name in results:
        mine = [v for v in verdicts if v.method == name and v.agrees is not None]
        if not mine:
            continue
        if all(v.gain_db == -math.inf for v in mine):
            gains = [v.measured_gain for v in mine]
            words.append(f"{name}: no linear effect; the measured gain is {min(gains):.3g} to {max(gains):.3g}")
            continue
        worst = max(mine, key=_off)
        good = sum(bool(v.agrees) for v in mine)
        most = f"{worst.gain_db:+.3g} dB and {worst.phase_deg:+.3g}° at {worst.frequency_hz:.4g} Hz"
        limits = f"{GAIN_DB:g} dB and {PHASE_DEG:g}°"
        words.append(f"{name}: within {limits} of the measurement at {good} of {len(mine)} frequencies, at most {most}")
    return words


def _off(verdict: MethodAgreement) -> float:
    if not math.isfinite(verdict.gain_db):
        return math.inf
    return abs(verdict.gain_db) / GAIN_DB + abs(verdict.phase_deg) / PHASE_DEG


def _remarks(results: Mapping[str, LinResult]) -> list[str]:
    """Return what each method says of its own model: a verdict without it would be trusted too far."""
    words = []
    for name, result in results.items():
        words += [f"{name}: {note}" for note in result.notes]
        if result.doubts:
            first, more = result.doubts[0], len(result.doubts) - 1
            others = f", and {more} more" if more else ""
            words.append(f"{name}: doubtful: {first.row} by {first.column} = {first.value:.6g}: {first.reason}{others}")
    return words


def _interfaces(task: LinTask, results: Mapping[str, LinResult], grid: Floats) -> InterfaceDifference | None:
    """Compare co-simulation with the equations, where both are known."""
    equations = [r for n, r in results.items() if n in ("exact (me)", "difference (me)")]
    stepped = results.get("response (cs)")
    if not equations or stepped is None:
        return None
    with _stepping(task) as model:
        step = communication_step(model, stepped.dt) or stepped.dt
    return compare_interfaces(equations[0], stepped, step=step, frequencies=grid)


def _stepping(task: LinTask) -> AbstractContextManager[Model]:
    """Return the model on its co-simulation interface."""
    return nullcontext(task.model) if task.model.interface == "cs" else _on(task.model, "cs")
