"""Trim: find an operating point at which a model is in equilibrium."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import PeriodsError
from workbench.core.values.operating_point import OperatingPoint, told
from workbench.errors import EndedError, InputError, SimulationError
from workbench.jobs.job import SLOW, Job
from workbench.model import DescribedModel, Model, Variable
from workbench.model.operating_point import named, start_at
from workbench.model.sample_rates import Rates, rates_of
from workbench.point.scales import INTEGRATION
from workbench.point.trim.balance import Balance, ContinuousBalance
from workbench.point.trim.map import MapBalance
from workbench.point.trim.messages import (
    carried_along,
    degenerate,
    directions,
    in_words,
    residual_table,
    without_influence,
)
from workbench.point.trim.problem import TrimProblem, TrimSets, pose
from workbench.point.trim.request import Trim
from workbench.point.trim.result import Residual, TrimResult
from workbench.point.trim.running import RunBalance
from workbench.point.trim.scales import sized
from workbench.point.trim.search import exact_agrees, search
from workbench.point.trim.solve import Solution
from workbench.session.point import ModelPoint
from workbench.session.settle import STEP, STEP_PARTS, Settled
from workbench.session.start_values import NotReachedError

__all__ = ["run"]

WATCH_PERIODS = 20
PARTS = 12  # that are left, for all that is known before the end: steps of a search, stretches of a run
STAYS = 1e-5  # nominal values that a variable may move in so many periods


def run(model: Model, request: Trim, job: Job) -> TrimResult:
    """Find an operating point; see `Trim`."""
    model, remarks = start_at(model, request.at)
    begin_x: Mapping[str, float] = {} if model.at is None else model.at.x
    begin_u: Mapping[str, float] = {} if model.at is None else model.at.u
    sets = TrimSets(
        free=tuple(request.free),
        fix=dict(request.fix or {}),
        bound=dict(request.bound or {}),
        floating=tuple(request.floating),
        x0={**begin_x, **(request.x0 or {})},
        u0={**begin_u, **(request.u0 or {})},
    )
    begins = model.start_time if request.time is None else request.time
    with one_thread():
        result = _TrimRun(model, sets, begins, request, job).run()
    return replace(result, notes=(*remarks, *result.notes))


@dataclass
class _TrimRun:
    """One trim under way."""

    model: Model
    sets: TrimSets
    time: float
    request: Trim
    job: Job
    notes: list[str] = field(default_factory=list)
    parts: int = 0

    @property
    def slowest(self) -> bool:
        return self.request.family == "slowest"

    def run(self) -> TrimResult:
        result = self._co_simulation() if self.model.interface == "cs" else self._model_exchange()
        way: tuple[str, ...] = ()
        if self.model.interface == "cs" and not result.converged:
            way = (f"co-simulation shows no derivatives that could be solved for; {self.model.way_out()}",)
        result = replace(result, operating_point=named(self.model, result.operating_point))
        way += () if result.converged else self._without_fixed()
        notes = (
            *result.notes,
            *way,
            *self._why_no_start(result),
            *self.model.remarks({*self.sets.guess, *self.sets.fix}),
        )
        return replace(result, notes=notes)

    def _without_fixed(self) -> tuple[str, ...]:
        """Say where the model rests without the values that it was to have."""
        if not self.sets.fix:
            return ()
        try:
            other = _TrimRun(self.model, replace(self.sets, fix={}), self.time, self.request, self.job).run()
        except SimulationError:
            return ()
        point = other.operating_point
        values = {**point.values, **point.y}
        rests = ", ".join(f"{name} = {told(values[name]):.6g}" for name in self.sets.fix if name in values)
        return (f"without the fixed values there is an equilibrium, with {rests}",) if other.converged else ()

    def _why_no_start(self, result: TrimResult) -> tuple[str, ...]:
        """Say why nothing can start at a point with discrete states, which are set before initialisation only."""
        if not isinstance(self.model, DescribedModel) or self.model.interface != "me":
            return ()  # no FMU, which alone has such states
        if not (result.converged and result.operating_point.discrete):
            return ()
        self.job.found(lambda: result, "starting at the point")
        try:
            self.model.starting_at(result.operating_point).open_session().close()
        except NotReachedError as error:
            return (f"`at` cannot use this point: {error}",)
        return ()

    def _inputs(self) -> dict[str, float]:
        """Return the inputs as the user wants them, else as the model starts, bias included."""
        names = [v.name for v in self.model.inputs if v.is_number]
        with self.model.open_session(start_time=self.time) as session:
            starts = session.values(names)
        return {name: self._value_of(name, start) for name, start in starts.items()}

    def _value_of(self, name: str, start: float) -> float:
        return self.sets.fix.get(name, self.sets.guess.get(name, start))

    # -- model exchange -------------------------------------------------------------------

    def _model_exchange(self) -> TrimResult:
        inputs = self._inputs()
        rates = self._rates(inputs)
        if rates.periods:
            self._begin(rates)
        with self.model.open_point(time=self.time, values=inputs) as point:
            if not rates.periods:
                return self._equations(point)
            states, memory = point.states, point.memory
            values = {v.name: self._value_of(v.name, x) for v, x in zip(states, point.x0.tolist(), strict=True)}
        # Discrete states before the first instant, not after it.
        values.update({v.name: self._value_of(v.name, _start_of(self.model, v)) for v in memory})
        if all(v.start is not None for v in states):
            return self._period_map(rates.period, states, memory, {**values, **inputs})
        self.notes.append("a state has no start value to change; the model is run until nothing moves")
        shown = {v.name for v in self.model.states}  # those of FMI 1.0 may be no variables: the outputs tell
        try:
            return self._running([v for v in states if v.name in shown], {**values, **inputs}, [rates.period])
        except SimulationError as error:
            self.notes.append(f"discrete states are held: {error}")
        with self.model.open_point(time=self.time, values=inputs) as point:
            return self._equations(point)

    def _begin(self, rates: Rates) -> None:
        """Move the point to where a basic period begins."""
        start = rates.start(self.time)
        if start != self.time:
            self.notes.append(
                f"the point is at {start:.9g} s, where a basic period of {rates.period:.6g} s begins, "
                f"not at {self.time:.9g} s"
            )
        self.time = start

    def _rates(self, inputs: Mapping[str, float]) -> Rates:
        """Return when the model samples; where that follows no rate, its discrete states are held."""
        if self.request.period is not None:
            return Rates((self.request.period,), self.request.period)
        try:
            result = rates_of(self.model, time=self.time, values=inputs)
        except PeriodsError:
            raise
        except InputError as error:
            self.notes.append(f"discrete states are held: {error}")
            return Rates()
        self.notes += result.notes
        return result

    def _equations(self, point: ModelPoint) -> TrimResult:
        balance = ContinuousBalance(point)
        problem = sized(pose(balance, self.sets))
        exact = not balance.why_not_exact and self._probe(problem)
        result = self._search("equations", problem, tolerance=self.request.tolerance, exact=exact)
        problem, solution, note = self._floated(problem, result, tolerance=self.request.tolerance, exact=exact)
        restless = carried_along(problem, solution) if solution.converged else ""
        if restless and self.slowest:
            solution = solution.refuted()
        return self._result("equations", problem, solution, [note, restless])

    def _floated(
        self, problem: TrimProblem, result: tuple[Solution, str], *, tolerance: float, exact: bool
    ) -> tuple[TrimProblem, Solution, str]:
        """Let states move that nothing depends on, as the angle of a shaft that turns, where the others rest."""
        solution, note = result
        if solution.converged or self.sets.floating:
            return problem, solution, note
        names, shown = without_influence(problem, solution)
        if shown:
            verb = "moves where `floating` names it" if len(shown) == 1 else "move where `floating` names them"
            self.notes.append(f"{', '.join(shown)}, on which only outputs depend, {verb}")
        if not names or len(names) == len(problem.balance.states):
            return problem, solution, note
        sets = replace(self.sets, floating=names)
        freer = sized(pose(problem.balance, sets))
        resting, remark = search(self.model, freer, tolerance=tolerance, slowest=self.slowest, exact=exact)
        if not resting.converged:
            return problem, solution, note
        self.sets = sets
        verb = "moves, since nothing depends on it" if len(names) == 1 else "move, since nothing depends on them"
        self.notes.append(f"{', '.join(names)} {verb}, as `floating` asks for")
        return freer, resting, remark

    def _probe(self, problem: TrimProblem) -> bool:
        if not problem.unknowns or exact_agrees(problem):
            return True
        self.notes.append(
            "the FMU's directional derivatives disagree with differences at the start; differences are used"
        )
        return False

    def _period_map(
        self, period: float, states: Sequence[Variable], memory: Sequence[Variable], values: Mapping[str, float]
    ) -> TrimResult:
        balance = MapBalance(
            self.model,
            [*states, *memory],
            period=period,
            time=self.time,
            values=values,
            discrete=[v.name for v in memory],
            tolerance=INTEGRATION,
        )
        return self._fixed_point("period map", balance)

    def _fixed_point(self, method: str, balance: MapBalance) -> TrimResult:
        posed = pose(balance, self.sets)
        balance.begin(*posed.at(np.array([k.start for k in posed.unknowns])))
        problem = sized(posed)
        loosest = max(self.request.tolerance, 1e-6 if balance.precision > 1e-12 else 0.0)
        result = self._search(method, problem, tolerance=loosest, exact=False)
        problem, solution, note = self._floated(problem, result, tolerance=loosest, exact=False)
        restless = self._restless(balance, problem, solution) if solution.converged else ""
        if restless:
            solution = solution.refuted()
        return self._result(method, problem, solution, [note, restless])

    def _restless(self, balance: MapBalance, problem: TrimProblem, solution: Solution) -> str:
        """Return what moves in the periods after the first although the states came back; "": nothing does."""
        floating = set(self.sets.floating)
        try:
            moved = balance.drift(*problem.at(solution.values), periods=WATCH_PERIODS)
        except EndedError as error:
            return f"a run cannot show whether the model stays there: {error}"
        except SimulationError as error:
            return f"the model fails when it continues from there: {error}"
        if floating:
            return ""
        sizes = _sizes(balance, problem, solution)
        bad = [n for n, (d, value) in moved.items() if d > STAYS * sizes.get(n, max(1.0, abs(value)))]
        return (
            f"after {WATCH_PERIODS} periods {', '.join(bad[:4])} moved although the states had returned" if bad else ""
        )

    # -- co-simulation --------------------------------------------------------------------

    def _co_simulation(self) -> TrimResult:
        states = list(self.model.states)
        values = {**self._starts(states), **self._inputs()}
        steps = [(self.request.period or self.request.step or _own_step(self.model)) * part for part in STEP_PARTS]
        if states and self._settable(states, values):
            balance = MapBalance(self.model, states, period=steps[0], time=self.time, values=values)
            if self.request.step is None and isinstance(self.model, DescribedModel):
                self.notes += self.model.derived_step(steps[0])
            return self._fixed_point("step map", balance)
        why = "the states cannot be set" if states else "the model provides no states"
        watched = states or [v for v in self.model.outputs if v.is_number]
        how = "it is run until nothing moves" if watched else "nor outputs: there is nothing to bring to rest"
        self.notes.append(f"{why}; {how}")
        return self._running(states, values, steps if self.request.step is None else steps[:1])

    def _starts(self, states: Sequence[Variable]) -> dict[str, float]:
        with self.model.open_session(start_time=self.time) as session:
            result = session.values([v.name for v in states])
        return {name: self._value_of(name, start) for name, start in result.items()}

    def _settable(self, states: Sequence[Variable], values: Mapping[str, float]) -> bool:
        """Whether states take the start values that they are given."""
        wanted = {v.name: values[v.name] + 0.125 * (v.nominal or abs(values[v.name]) or 1.0) for v in states}
        try:
            with self.model.open_at(time=self.time, values={**values, **wanted}, approach=False) as session:
                result = session.values(list(wanted))
        except (InputError, SimulationError):
            return False
        return all(math.isclose(result[n], w, rel_tol=1e-9) for n, w in wanted.items())

    def _running(self, states: Sequence[Variable], values: Mapping[str, float], steps: Sequence[float]) -> TrimResult:
        result, failed = None, ""
        for step in steps:
            balance = RunBalance(
                self.model,
                states,
                time=self.time,
                values=values,
                step=step,
                longest=self.request.longest,
                least=_usual_length(self.model),
                tolerance=max(self.request.tolerance, 1e-12),
                report=self._on_the_way,
            )
            problem = pose(balance, self.sets)
            solution, _ = search(
                self.model, problem, tolerance=max(self.request.tolerance, 1e-6), slowest=self.slowest, exact=False
            )
            end = balance.end(problem.at(solution.values)[1])
            if isinstance(end, str):
                failed = end
                continue
            if not end.settled:
                solution = solution.refuted()
            why = f"watched up to {end.time:g} s, communication step {step:g} s"
            result = self._result("running", problem, solution, [why])
            if end.settled:
                return result
        if result is None:
            raise SimulationError(
                f"{self.model.name}: no equilibrium found by running: {failed}; {self.model.way_out()}"
            )
        return result

    # -- on the way -----------------------------------------------------------------------

    def _search(self, method: str, problem: TrimProblem, *, tolerance: float, exact: bool) -> tuple[Solution, str]:
        """Search, and tell after each step where that is."""
        balance, begun = problem.balance, time.monotonic()

        def report(values: Floats, left: float) -> None:
            spent = time.monotonic() - begun
            if not self.parts and PARTS * spent > SLOW:
                runs = balance.evaluations
                self.job.say(f"a step of the search takes {spent:.2g} s ({runs} runs); five to ten steps are usual")
            point = balance.where(*problem.at(values))
            words = f"the search has come to a largest residual of {left:.2g}, relative"
            self._tell(words, lambda: self._so_far(method, balance, point, words, ()))

        return search(self.model, problem, tolerance=tolerance, slowest=self.slowest, exact=exact, report=report)

    def _on_the_way(self, balance: RunBalance, inputs: Floats, end: Settled, cost: float) -> None:
        """Tell where a run is that has not come to rest yet, of which a second takes `cost` [s]."""
        if balance.evaluations == 1 and not self.parts and cost * balance.least > SLOW:
            self.job.say(
                f"a second of this model takes {cost:.2g} s: a run, to be watched for {balance.least:.3g} s at least, "
                f"takes {cost * balance.least:.2g} s, or {cost * balance.longest:.2g} s where it does not come to rest "
                f"within {balance.longest:.3g} s (`longest`); each free input takes several runs"
            )
        scales = np.maximum(np.abs(end.values), [s.nominal for s in balance.states])
        moves = tuple(
            Residual(name=balance.derivative.format(s.name), value=by, unit=s.unit, scaled=by / scale)
            for s, by, scale in zip(balance.states, end.ranges.tolist(), scales.tolist(), strict=True)
        )
        worst = max(moves, key=lambda r: r.scaled)
        words = f"run {balance.evaluations} is at {end.time:.4g} s: {worst.name} by {worst.value:.3g}"
        point = balance.standing(end, inputs)
        self._tell(words, lambda: self._so_far("running", balance, point, words, moves))

    def _tell(self, words: str, so_far: Callable[[], TrimResult]) -> None:
        self.parts += 1
        self.job.partial = so_far
        self.job.done(words, self.parts, self.parts + PARTS)

    def _so_far(
        self, method: str, balance: Balance, point: OperatingPoint, words: str, residuals: Sequence[Residual]
    ) -> TrimResult:
        """Return the best point before the end."""
        message = f"ended before an equilibrium was found: {words}"
        result = self._record(method, balance, named(self.model, point), residuals, message)
        return replace(result, iterations=self.parts, notes=tuple(self.notes))

    def _record(
        self, method: str, balance: Balance, point: OperatingPoint, residuals: Sequence[Residual], message: str
    ) -> TrimResult:
        """Return what is known at a point that is not known to be an equilibrium."""
        return TrimResult(
            model=self.model.name,
            interface=self.model.interface,
            solver=self.model.solver,
            method=method,
            operating_point=point,
            residuals=tuple(residuals),
            null_directions=(),
            converged=False,
            message=message,
            unknowns=(),
            iterations=0,
            evaluations=balance.evaluations,
        )

    # -- end ------------------------------------------------------------------------------

    def _result(self, method: str, problem: TrimProblem, solution: Solution, notes: Sequence[str]) -> TrimResult:
        residuals = residual_table(problem, solution)
        nulls = directions(problem, solution)
        chosen = self._chosen(problem, solution)
        balance: Balance = problem.balance
        point = balance.point(*problem.at(solution.values))
        message = in_words(problem, solution, residuals, nulls, chosen=chosen)
        if solution.converged and not np.isfinite([*(r.value for r in residuals), *point.dx.values()]).all():
            solution = solution.refuted()  # an FMU need not give the same values again
            message = "no equilibrium found: at the point where the search ended, the model cannot be evaluated again"
        degrees = problem.degrees(left_open=len(nulls) if solution.converged else None)
        return replace(
            self._record(method, balance, point, residuals, message),
            null_directions=nulls,
            converged=solution.converged,
            unknowns=tuple(k.slot.name for k in problem.unknowns),
            iterations=solution.iterations,
            notes=tuple(n for n in (*self.notes, degrees, degenerate(problem, solution), *notes) if n),
        )

    def _chosen(self, problem: TrimProblem, solution: Solution) -> str:
        if not solution.chosen:
            return "is the one that the search found"
        slow = self.slowest and problem.floating
        return (
            "has the smallest floating derivatives, and then is nearest to the start"
            if slow
            else "is nearest to the start"
        )


def _own_step(model: Model) -> float:
    """Return the communication step that a model brings [s]."""
    if isinstance(model, DescribedModel):
        return model.recipe.step or model.description.experiment.step or STEP
    return STEP


def _sizes(balance: MapBalance, problem: TrimProblem, solution: Solution) -> dict[str, float]:
    """Return the sizes of states and outputs by which a movement is measured, of those whose sizes are known.

    An undeclared size of a state is what the search took for it, or by how much the state changes when the unknowns do.
    """
    result = {s.name: s.nominal for s in (*balance.states, *balance.outputs) if s.declared}
    searched = {k.slot.name: n for k, n in zip(problem.unknowns, solution.nominal.tolist(), strict=True)}
    changes = {e.row: float(c) for e, c in zip(problem.equations, solution.verdict.scales, strict=False)}
    for row, state in enumerate(balance.states):
        if not state.declared:
            result[state.name] = max(searched.get(state.name, 0.0), changes.get(row, 0.0)) or state.nominal
    return result


def _usual_length(model: Model) -> float:
    """Return how long the model is meant to run [s]; 0 if it does not say."""
    if not isinstance(model, DescribedModel):
        return 0.0
    experiment = model.description.experiment
    return max(0.0, (experiment.stop_time or 0.0) - (experiment.start_time or 0.0))


def _start_of(model: Model, variable: Variable) -> float:
    """Return a discrete state's start value, the one that the user loaded the model with if there is one."""
    return float(model.start_values.get(variable.name, variable.start or 0.0))
