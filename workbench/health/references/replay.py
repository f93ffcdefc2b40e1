"""Run a reference experiment of an FMU again, at the exporter's own step, and compare."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.errors import EndedError, InputError, WorkbenchError, shortened
from workbench.health.references.declared import ReferenceResult
from workbench.health.references.fixed_step import euler
from workbench.health.references.table import Series, read_series
from workbench.model.load import FmuModel
from workbench.model.names import declared_units, forced_inputs
from workbench.session.base import Recorded
from workbench.session.fmu import FmuSession
from workbench.session.readings import find
from workbench.signals.kinds import Signal, Table
from workbench.system.files.ssp_parameters import values_in
from workbench.system.files.ssp_values import values_for
from workbench.system.files.ssp_xml import parse
from workbench.system.fmu_facts import facts_of

__all__ = ["WRONG", "ReplayedReference", "replay"]

WRONG = 0.01  # of a signal's range: a difference that is no matter of tolerances
_AGREE = 1e-5  # likewise: what error control leaves where no looser tolerance is named
_ACCURATE = 1e-8  # relative tolerance of a model exchange run that is compared
_TIMES = 2.0  # the error of first order that is allowed for, over its estimate
_QUARTER = 4  # shorter steps, to see what the step matters where none is stated
_NOISE = 1e-12  # of the nominal value: rounding about zero
_SAME = 1e-6  # of a step
_NAMED = 4


@dataclass(frozen=True, kw_only=True)
class ReplayedReference(RecordPart):
    """A reference result beside a run of the FMU under the same conditions.

    Attributes:
        name: of the experiment, or of the file of its results.
        interface: "me" or "cs".
        step: communication step of the run; with "me" the step that the reference is taken to be made with [s].
        worst: largest difference, over the range of the variable in the reference; None: nothing was compared.
        variable, time: where it is [s].
        explained: part of it that the error of the reference's own integration may be, likewise.
        passed: whether all of the reference was reproduced; None: it cannot be told, see `problem`.
        problem: what is wrong with the reference, or what it cannot show; empty: nothing.
    """

    name: str
    interface: str
    step: float | None = None
    worst: float | None = None
    variable: str = ""
    time: float | None = None
    explained: float = 0.0
    passed: bool | None = None
    problem: str = ""

    @property
    def told(self) -> str:
        """What came of it, in a line."""
        far = ""
        if self.worst is not None:
            far = f"{self.variable} is {_percent(self.worst)} of its range off at t = {self.time:.6g} s"
        if self.passed:
            how = "" if self.interface == "me" else f" at step {self.step:.4g} s"
            far = f"reproduced{how}, {'bit by bit' if self.worst == 0.0 else far}"
        return shortened(f"{self.name}: {'; '.join(filter(None, (far, self.problem)))}")


def replay(model: FmuModel, reference: ReferenceResult) -> ReplayedReference:
    """Run one reference experiment again.

    Co-simulation is stepped as the experiment states; inputs are held over a step, as simple masters do. Differences
    within the experiment's tolerance, 1e-5 of the range, or the digits of the file pass. Where no step is stated, the
    distance of the rows is taken, and what a quarter of it changes is allowed for. Model exchange is integrated
    accurately: twice the error that Euler's method has at the step, up to that time, is allowed for, as the reference
    may have been made with it; within that nothing can be told.

    Args:
        model: the FMU, opened with one interface.
        reference: one of its experiments.
    """
    blank = ReplayedReference(name=reference.name, interface=model.interface, problem=reference.problem)
    if reference.problem:
        return blank
    try:
        experiment = _ReferenceRun.of(model, reference)
    except WorkbenchError as error:
        return replace(blank, problem=str(error))
    try:
        return experiment.replayed(blank)
    except WorkbenchError as error:
        return replace(blank, step=experiment.step, passed=False, problem=f"the run fails: {error}")


@dataclass(frozen=True)
class _ReferenceRun:
    """What is run, and what it is compared with.

    Attributes:
        stated: whether the exporter has stated the step.
        allowed: relative difference that always passes.
    """

    model: FmuModel
    series: Series
    start: float
    stop: float | None
    step: float
    stated: bool
    allowed: float
    signals: Mapping[str, Signal]
    parameters: Mapping[str, float | int | bool | str]
    tolerance: float | None

    @classmethod
    def of(cls, model: FmuModel, reference: ReferenceResult) -> _ReferenceRun:
        """Read the files of a reference."""
        folder, default = Path(model.recipe.folder), model.description.experiment
        series = read_series(folder / reference.results, reference.results, model)
        inputs = {v.name for v in model.inputs}
        compared = {n: v for n, v in series.values.items() if n not in inputs}
        if not compared:
            raise InputError(
                f"{reference.results}: none of its columns is a number that the FMU computes{_listed(series)}"
            )
        start = model.start_time if reference.start_time is None else reference.start_time
        if series.time[0] < start:
            raise InputError(f"{reference.results}: begins at {series.time[0]:g} s, before the run does at {start:g} s")
        stated, rows = reference.step or default.step, series.distance
        fits = stated is not None and (rows is None or stated <= rows * (1.0 + _SAME))
        step = stated if fits else rows
        if step is None:
            raise InputError(f"{reference.results}: neither a step is stated nor are its rows equally far apart")
        tolerance = reference.tolerance or default.tolerance
        return cls(
            model=model,
            series=replace(series, values=compared),
            start=start,
            stop=default.stop_time if reference.stop_time is None else reference.stop_time,
            step=step,
            stated=fits,
            allowed=max(_AGREE, tolerance or 0.0),
            signals=_signals(model, folder, reference.stimuli),
            parameters=_parameters(model, folder, reference.parameters),
            tolerance=tolerance,
        )

    # -- runs -------------------------------------------------------------------------------

    def _opened(self, step: float) -> FmuModel:
        recipe = self.model.recipe
        values = {**recipe.start_values, **self.parameters}
        if self.model.interface == "cs":
            own = replace(recipe, step=step, hold_inputs=True, tolerance=self.tolerance, start_values=values)
        else:
            own = replace(recipe, tolerance=_ACCURATE, start_values=values)
        return own.open()

    def _session(self, model: FmuModel) -> FmuSession:
        return model.open_session(start_time=self.start, signals=self.signals)

    def _run(self, step: float) -> tuple[Floats, Floats, float | None]:
        """Return the left and right limits at the rows, shape (n, k), NaN behind where the FMU ended its run [s]."""
        times, names = self.series.time, list(self.series.values)
        points = times[times > self.start]
        with self._opened(step) as model, self._session(model) as session:
            ended = None
            try:
                until = float(points[-1]) if points.size else self.start
                record = session.advance(until, signals=self.signals, record=names, points=points)
            except EndedError as error:
                if not isinstance(error.before, Recorded) or not len(error.before.time):
                    raise
                record, ended = error.before, error.time
            if ended is None:
                record, ended = _with_end(session, record)
        columns = np.column_stack([record.values[n] for n in names])
        right = columns[np.searchsorted(record.time, times, side="right") - 1]
        left = columns[np.minimum(np.searchsorted(record.time, times, side="left"), len(columns) - 1)]
        if ended is not None:
            late = times > ended + _NOISE * abs(ended)
            left[late] = right[late] = math.nan
        return left, right, ended

    def _explained(self, values: Floats, scale: Floats) -> Floats:
        """Return which relative difference the reference's own integration may have, up to each row, shape (n, k)."""
        if self.model.interface == "cs":
            other = np.zeros_like(values) if self.stated else self._run(self.step / _QUARTER)[1] - values
        else:
            with self._opened(self.step) as model:
                other = euler(model, self.signals, list(self.series.values), self._from_start(), self.step)
            other = other[-len(values) :] - values
        sure = np.where(np.isfinite(other), np.abs(other) / scale, math.inf)
        return _TIMES * np.maximum.accumulate(sure, axis=0)

    def _from_start(self) -> Floats:
        times = self.series.time
        return times if times[0] == self.start else np.concatenate([[self.start], times])

    # -- comparison -------------------------------------------------------------------------

    def replayed(self, blank: ReplayedReference) -> ReplayedReference:
        """Run, and compare with the reference."""
        wanted = np.column_stack(list(self.series.values.values()))
        left, values, ended = self._run(self.step)
        scale = self._scale(wanted, values)
        # What is written at an event, or of an output that follows an input at once, may be either limit.
        gaps = np.minimum(np.abs(left - wanted), np.abs(values - wanted)) / scale
        seen = np.isfinite(gaps)
        rounding = np.array([self.series.rounding[n] for n in self.series.values]) / scale
        excess = np.where(seen, gaps - self.allowed - rounding, -math.inf)
        explained = np.zeros_like(gaps)
        if (excess > 0.0).any():
            explained = self._explained(values, scale)
        beyond = excess - explained
        wrong = bool((beyond > 0.0).any())
        row, column = np.unravel_index(int((beyond if wrong else np.where(seen, gaps, -1.0)).argmax()), gaps.shape)
        found = replace(
            blank,
            step=self.step,
            worst=float(gaps[row, column]),
            variable=list(self.series.values)[column],
            time=float(self.series.time[row]),
            explained=float(min(explained[row, column], gaps[row, column])),
        )
        if wrong:
            return replace(found, passed=False)
        if problem := self._incomplete(ended):
            return replace(found, problem=problem, passed=None if seen.all() else False)
        if (excess > 0.0).any():
            return replace(found, problem=self._untold(float(explained[row, column]) / _TIMES))
        return replace(found, passed=True)

    def _scale(self, wanted: Floats, values: Floats) -> Floats:
        """Return what differences are compared with: the range in the reference, or the size of what does not move."""
        size = np.abs(wanted).max(axis=0)
        moved = np.ptp(wanted, axis=0)
        size = np.where(moved > _NOISE * size, moved, size)
        size = np.where(size > 0.0, size, np.nanmax(np.abs(values), axis=0, initial=0.0))
        known = {v.name: v for v in self.model.description.variables}
        nominal = np.array([(known[n].nominal if n in known else None) or 1.0 for n in self.series.values])
        result: Floats = np.maximum(size, _NOISE * np.abs(nominal))
        return result

    def _untold(self, estimate: float) -> str:
        if self.model.interface == "cs":
            return f"no step is stated, and which one was taken matters by {_percent(estimate)}: not judged"
        if not math.isfinite(estimate):
            return f"Euler's method fails with steps of {self.step:.4g} s, so that the reference's error is not known"
        return (
            f"a reference by Euler's method with steps of {self.step:.4g} s is {_percent(estimate)} off itself: this "
            "says nothing against the FMU"
        )

    def _incomplete(self, ended: float | None) -> str:
        """Return what is missing in the reference; empty: nothing."""
        series, last = self.series, float(self.series.time[-1])
        room = max(self.step, series.distance or 0.0) * (1.0 + _SAME)
        if ended is not None and last - ended > room:
            return f"the FMU ends its run at {ended:g} s, the reference goes on to {last:g} s"
        if series.gap is not None:
            return "rows are missing between t = {:g} s and {:g} s".format(*series.gap)
        if self.stop is not None and ended is None and self.stop - last > room and not self._ends_after(last, room):
            return f"it ends at {last:g} s, and the experiment at {self.stop:g} s: it was cut off"
        if series.unknown:
            return f"not variables of this FMU{_listed(series)}"
        return ""

    def _ends_after(self, last: float, room: float) -> bool:
        """Return whether the FMU ends its run just where the reference does."""
        with (
            self._opened(self.step) as model,
            model.open_session(start_time=self.start, signals=self.signals) as session,
        ):
            try:
                session.advance(last + room, signals=self.signals)
            except EndedError:
                return True
        return False


def _with_end(session: FmuSession, record: Recorded) -> tuple[Recorded, float | None]:
    """Return a record with the right limit at its end, and when the FMU ended its run there [s]; None: it did not."""
    names, ended = list(record.values), None
    try:
        last = session.advance(session.time, signals=session.forcing.signals, record=names).values
    except EndedError as error:  # its values may still be read
        access, ended = session.instance.access(find(names, session.setup.variables)), error.time
        last = {n: np.array([v], dtype=np.float64) for n, v in zip(names, access.read(), strict=True)}
    time = np.append(record.time, record.time[-1])
    return Recorded(time, {n: np.append(v, last[n][-1]) for n, v in record.values.items()}, {}), ended


def _listed(series: Series) -> str:
    some = ", ".join(series.unknown[:_NAMED]) + (", …" if len(series.unknown) > _NAMED else "")
    return f": {some}" if some else ""


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _signals(model: FmuModel, folder: Path, file: str) -> dict[str, Signal]:
    """Return what forces the inputs, from a file of stimuli."""
    if not file:
        return {}
    series = read_series(folder / file, file, model)
    inputs = {v.name for v in model.inputs}
    others = [*series.unknown, *series.texts, *(n for n in series.values if n not in inputs)]
    if others:
        raise InputError(f"{file}: not inputs that a signal can force: {', '.join(others[:_NAMED])}")
    return forced_inputs(model, {n: Table(series.time.tolist(), v.tolist()) for n, v in series.values.items()})


def _parameters(model: FmuModel, folder: Path, file: str) -> dict[str, float | int | bool | str]:
    """Return the values of a parameter set (.ssv)."""
    if not file:
        return {}
    root, facts = parse(folder / file, "ParameterSet"), facts_of(model.description)
    result: dict[str, float | int | bool | str] = {}
    for name, parameter in values_in(root, file, root):
        unit = declared_units(model, [name])[name]
        values = values_for(name, parameter, facts, unit)
        if not values:
            raise InputError(f"{file}: '{name}' is not a parameter of this FMU")
        result |= values
    return result
