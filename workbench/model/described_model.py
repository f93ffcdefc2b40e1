"""A model with a description in FMI's words, whose sessions run on instances: one FMU, or a system of several."""

from __future__ import annotations

import copy
import dataclasses
import weakref
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, field, fields
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from workbench.core.records.forms import several
from workbench.core.records.option import values_of
from workbench.core.values.calendar import Sampler, check_periods, exact
from workbench.core.values.operating_point import At, OperatingPoint
from workbench.errors import InputError, SimulationError
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.structure import STRUCTURAL
from workbench.fmi.ticking import periodic
from workbench.fmi.variable import Value, Variable
from workbench.kernel.library import kernel
from workbench.model.base import DeclaredRates, Model, Recipe
from workbench.model.loading import DEFAULT_TOLERANCE, Loading
from workbench.model.operating_point import start_at
from workbench.model.starts import check_starts
from workbench.session.compiled import CompiledCsSession, CompiledMeSession
from workbench.session.fmu import FmuSession
from workbench.session.point import FmuPoint
from workbench.session.probe import begins_at_zero, slopes_act, why_state_fails
from workbench.session.settle import FIRST_STEPS, LEAST_STEPS, MAX_STEPS, STEP, STEP_PARTS, Settled, settle
from workbench.session.setup import Lead, Setup
from workbench.session.start_values import RELATIVE, NotReachedError, check_values, starts_of, unkept_in_words
from workbench.signals.kinds import Signal

__all__ = ["DescribedModel", "LoadRecipe"]

_PARAMETERS = ("parameter", STRUCTURAL)
_SHOWN = 4  # names in a message
_REST = 1e-12  # relative: what moves less is at rest
_TIGHTEST = 1e-12  # relative tolerance below which rounding takes over
_NO_SLOPES = (
    "the FMU claims to interpolate its inputs, but a probe sees no effect of their slopes: inputs are held over a "
    "communication step at their value in its middle"
)


class LoadRecipe(Loading, Recipe):
    """What `load` was told, and the file.

    Attributes:
        source: what the user named, for messages.
        at: where its sessions start; None: at the model's own start. See `Model.starting_at`.
    """

    if TYPE_CHECKING:
        start_values: Mapping[str, Value] = field(default_factory=dict)  # whole arrays are texts by now

    _: KW_ONLY
    source: str
    at: OperatingPoint | None = None

    def __eq__(self, other: object) -> bool:
        """Whether both make the same model."""
        if type(self) is not type(other):
            return NotImplemented
        return all(getattr(self, f.name) == getattr(other, f.name) for f in fields(self))

    __hash__ = None  # type: ignore[assignment]  # it holds mappings

    @abstractmethod
    def open(self) -> DescribedModel:
        """Return the model; see `Recipe.open`."""

    def settings(self) -> dict[str, Any]:
        """Return all of these but the file, ready for JSON."""
        known = values_of(self)
        return {
            **{name: value for name, value in known.items() if name != "periods" or value is not None},
            **({} if self.at is None else {"at": {**self.at.values, "time": self.at.time}}),
        }

    def tighter(self, factor: float) -> Self:
        return dataclasses.replace(self, tolerance=max(_TIGHTEST, factor * (self.tolerance or DEFAULT_TOLERANCE)))


class DescribedModel(Model):
    """What one FMU and a system of several have in common.

    Args:
        description: what the model says about itself.
        source: what the user named.
        interface: "me" or "cs", one of those offered.
        setup: how sessions begin; who opens instances is put in here.
        notes: remarks for the user.
        recipe: how to load it again.

    Attributes:
        description: all that the model says about itself.
        source: what the user named.
        recipe: how to load it again.
        slopes: co-simulation that takes slopes of its inputs: whether they have an effect; None: not probed yet.
        start_note: co-simulation that begins at 0 whatever start time it is told: says so, once it was seen.

    Raises:
        KernelMissingError: the compiled kernel, which advances sessions, is not installed or is of another version.
    """

    recipe: LoadRecipe

    def __init__(
        self,
        description: ModelDescription,
        *,
        source: str,
        interface: str,
        setup: Setup,
        notes: tuple[str, ...],
        recipe: LoadRecipe,
    ) -> None:
        kernel()  # without it no session could be advanced: better told now
        self.description = description
        self.source = source
        self.name = description.model_name
        self.interface = interface
        self.solver = setup.solver
        self.start_time = setup.start_time if recipe.at is None or recipe.start is not None else recipe.at.time
        self.stop_time = description.experiment.stop_time
        self.rtol = setup.rtol if interface == "me" and setup.solver != "none" else 0.0
        self.notes = notes
        if not description.interfaces[interface].variable_step:
            self.grid = setup.step or description.experiment.step
        self.inputs = self._with("input")
        self.outputs = self._with("output")
        self.parameters = self._with(*_PARAMETERS)
        self.states = description.states
        own = self._own_rates()
        if recipe.periods is not None:
            check_periods(several(recipe.periods), (float(s.period) for s in (*own.samplers, *own.clocks)), self.name)
        self._setup = dataclasses.replace(
            setup,
            open_instance=self.new_instance,
            state_works=self._state_works,
            slopes_act=self.slopes_act,
            samplers=(*own.samplers, *own.clocks),
        )
        self._sessions: weakref.WeakSet[FmuSession] = weakref.WeakSet()
        self.recipe, self.at = recipe, recipe.at
        self._why_replay: str | None = None
        self._kept_state = set[bool]()  # shared with the same model at other values; True: one of them keeps its state
        self.start_note = ""
        self._start_probed = False
        self.slopes: bool | None = None
        self.closed = False

    def _with(self, *causalities: str) -> tuple[Variable, ...]:
        return tuple(v for v in self.description.variables if v.causality in causalities)

    @property
    def start_values(self) -> Mapping[str, Value]:
        return self._setup.start_values

    @property
    def bias(self) -> Mapping[str, float]:
        return self._setup.bias

    @abstractmethod
    def new_instance(self) -> Instance:
        """Return a new instance; whoever asks for it closes it."""

    def open_session(
        self,
        *,
        start_time: float | None = None,
        step: float | None = None,
        signals: Mapping[str, Signal] | None = None,
        at: At | None = None,
    ) -> FmuSession:
        """Return a session as `Model.open_session` does.

        Args:
            start_time: [s]; None: that of the model, or of `at`.
            step: communication step of co-simulation [s]; None: the model's own.
            signals: what forces the inputs during initialisation.
            at: operating point to start at, short for `placed(at)`; None: where the model starts.

        Raises:
            InputError, FmuError, SimulationError: see `Model.open_session`.
        """
        if at is not None:
            return self.placed(at).open_session(start_time=start_time, step=step, signals=signals)
        if self.at is not None:
            return self.open_at(time=None if start_time == self.at.time else start_time, step=step)
        if step is not None and not step > 0.0:
            raise InputError(f"step must be positive, not {step:g}")
        setup = dataclasses.replace(
            self._setup,
            step=step or self._setup.step,
            start_time=self.start_time if start_time is None else float(start_time),
            signals=dict(signals or {}),
        )
        return self._start(setup)

    def placed(self, at: At | None) -> Self:
        """Return the model that starts at an operating point; see `starting_at`.

        Args:
            at: a point, a result that has one, or the file of either; None: this model.

        Raises:
            InputError: see `operating_point.find_point`.
        """
        return start_at(self, at)[0]

    def starting_at(self, point: OperatingPoint | None, notes: Sequence[str] = ()) -> Self:
        twin = super().starting_at(point, notes)
        twin.recipe = dataclasses.replace(self.recipe, at=twin.at)
        if self.recipe.start is not None:
            twin.start_time = self.start_time
        return twin

    def with_values(self, values: Mapping[str, Value]) -> DescribedModel:
        """Return the model with other parameters or start values, closed with this one; see `varied.set_to`.

        Args:
            values: name → value.

        Raises:
            InputError: no such variable, it cannot be set, or the value is not of its type.
        """
        described = self.description
        variables = {v.name: v for v in described.variables}
        return self.starting_with(check_starts(values, variables, described.enumerations, described.units))

    def reopened(self, values: Mapping[str, Value]) -> DescribedModel:
        """Return what `load` returns with other start values, its files as they are open; it is closed with this one.

        Args:
            values: name → value, as `load` takes them.

        Raises:
            InputError: see `with_values`; or it has to be opened anew for them.
        """
        if sizes := [v.name for v in self.parameters if v.causality == STRUCTURAL and v.name in values]:
            raise InputError(f"{sizes[0]}: a structural parameter, for which the FMU is opened anew")
        twin = self.with_values(values)
        same = getattr(twin.recipe, "system", None) is getattr(self.recipe, "system", None)
        if same:  # else they are partly in the system
            twin.recipe = dataclasses.replace(twin.recipe, start_values=dict(values))
        return twin

    def starting_with(self, values: Mapping[str, Value]) -> Self:
        """Return the model with other start values, here and in every worker; it is closed with this one.

        Args:
            values: in their variables' types; `with_values` checks them.
        """
        twin = copy.copy(self)
        twin.recipe = dataclasses.replace(self.recipe, start_values={**self.recipe.start_values, **values})
        twin._setup = dataclasses.replace(  # noqa: SLF001 - its own
            self._setup, start_values={**self._setup.start_values, **values}
        )
        return twin

    def open_on(self, instance: Instance, *, start_time: float, step: float | None = None) -> FmuSession:
        """Return a session on an instance that stands before its initialisation, say after a reset.

        Args:
            instance: instance of this model; closed with the session.
            start_time: session time at which it is initialised [s].
            step: communication step [s] in place of the model's.

        Raises:
            SimulationError: it cannot be initialised.
        """
        setup = dataclasses.replace(
            self._setup, open_instance=lambda: instance, start_time=float(start_time), step=step or self._setup.step
        )
        session = self._open(setup)
        self._sessions.add(session)
        return session

    def open_at(
        self,
        *,
        time: float | None = None,
        values: Mapping[str, float] | None = None,
        outputs: Mapping[str, float] | None = None,
        step: float | None = None,
        tolerance: float | None = None,
        approach: bool = True,
    ) -> FmuSession:
        given = self._setup
        if outputs is None and values is None and time is None and self.interface == "cs" and self.at is not None:
            outputs = self.at.y  # they tell where states are hidden
        values = {**(self.at.values if self.at else {}), **(values or {})}
        check_values({**values, **(outputs or {})}, given.variables)
        setup = dataclasses.replace(
            given,
            start_time=self.start_time if time is None else float(time),
            guesses=starts_of(given.variables, values),
            point=dict(values),
            outputs=dict(outputs or {}),
            bias={name: bias for name, bias in given.bias.items() if name not in values},
            step=step or given.step,
            rtol=tolerance or given.rtol,
        )
        try:
            return self._start(setup)
        except NotReachedError as error:
            if self.interface != "cs":
                words = "leave the point out, and give start values that lead there (`start_values`)"
                raise NotReachedError(f"{error}; {words}") from None
            if not approach:
                raise
            return self._approach(setup, error)

    def _approach(self, setup: Setup, direct: NotReachedError) -> FmuSession:
        """Return a co-simulation session that has run under the inputs of its point until it rests there.

        Args:
            setup: with the point.
            direct: why it does not start there.

        Raises:
            NotReachedError: it does not come to rest there.
        """
        free = {v.name for v in self.inputs}
        watched = [n for n in (*setup.point, *setup.outputs) if n not in free and n in setup.variables]
        names = watched or [v.name for v in self.outputs if v.is_number]
        # The FMU's own time begins as it is meant to: some begin there whatever start time they are told.
        result, begin = direct, self.description.experiment.start_time or 0.0
        for step in self._lead_steps(setup):
            end = self._rest(dataclasses.replace(setup, start_time=begin, step=step), names)
            if end is None:
                continue
            duration, sizes = end.time - begin, dict(zip(names, end.largest.tolist(), strict=True))
            clock = begin - (setup.start_time - duration)
            lead = Lead(duration=duration, step=step, clock=clock, sizes=sizes)
            try:
                return self._start(dataclasses.replace(setup, lead=lead))
            except NotReachedError as error:
                result = NotReachedError(
                    f"{error} (with the inputs of the point it comes to rest there after {duration:g} s)"
                )
                break
            except SimulationError as error:
                result = NotReachedError(f"{direct}; a run does not lead there either: {error}")
        if result is direct:
            result = NotReachedError(f"{direct}; with the inputs of the point it does not come to rest either")
        raise result

    def derived_step(self, *steps: float | None) -> tuple[str, ...]:
        """Return in words the communication steps of runs of an FMU, where neither the user nor the FMU names one.

        Args:
            steps: that were made [s]; None: not by co-simulation.
        """
        named = self._setup.step or self.description.experiment.step or self.description.components
        known = sorted(s for s in steps if s)
        if self.interface != "cs" or named or not known:
            return ()
        span = dict.fromkeys(f"{s:.4g}" for s in (known[0], known[-1]))
        return (f"communication step: {' to '.join(span)} s was derived; `step` changes it",)

    @property
    def shortest_step(self) -> float | None:
        """Shortest step of a co-simulation that is known before it runs, communication or inside [s]; None: none is."""
        if self.interface != "cs":
            return None
        given = self._setup.step or self.description.experiment.step
        own = self.description.interfaces["cs"].internal_step
        return min(filter(None, (given, own)), default=None)

    def _lead_steps(self, setup: Setup) -> list[float]:
        """Return communication steps to lead the model with, one after the other."""
        usual = self.description.experiment.step or STEP
        if self.grid is not None:
            return [setup.step or usual]
        return list(dict.fromkeys([*filter(None, [setup.step]), *(usual * part for part in STEP_PARTS)]))

    def _rest(self, setup: Setup, names: Sequence[str]) -> Settled | None:
        """Return where a co-simulation run under the inputs of a point comes to rest; None: it does not, or fails."""
        held = {v.name: setup.point[v.name] for v in self.inputs if v.name in setup.point}
        step, nominal = setup.step or STEP, np.array([setup.variables[n].nominal or 0.0 for n in names])
        try:
            with self._start(dataclasses.replace(setup, point=held, outputs={})) as session:
                end = settle(
                    session,
                    names,
                    nominal,
                    first=FIRST_STEPS * step,
                    longest=MAX_STEPS * step,
                    least=LEAST_STEPS * step,
                    tolerance=_REST,
                )
        except SimulationError:
            return None
        return end if end.settled or bool((end.ranges <= RELATIVE * end.largest).all()) else None

    def way_out(self, *others: str) -> str:
        return self.description.way_out(*others)

    def declared_rates(self) -> DeclaredRates:
        periods = self.recipe.periods
        if periods is not None:
            return DeclaredRates(tuple(Sampler(exact(period)) for period in several(periods)))
        return self._own_rates()

    def _own_rates(self) -> DeclaredRates:
        """Return what is declared where nobody was told better."""
        return DeclaredRates(clocks=periodic(self.description.clocks), others=(self,))

    def open_point(
        self,
        *,
        time: float | None = None,
        values: Mapping[str, float] | None = None,
    ) -> FmuPoint:
        if self.interface != "me":
            raise InputError(f"{self.source}: interface {self.interface} provides no derivatives; {self.way_out()}")
        return FmuPoint(self.open_at(time=time, values=values))

    def _start(self, setup: Setup) -> FmuSession:
        """Open a session that is closed with the model."""
        if self.closed:
            raise InputError(f"{self.source}: the model is closed")
        self._probe_start(setup)
        try:
            session = self._open(setup)
        except SimulationError as error:
            if setup.start_values:
                shown = ", ".join(
                    f"{name} = {value:g}" if isinstance(value, float) else f"{name} = {value}"
                    for name, value in list(setup.start_values.items())[:_SHOWN]
                )
                more = ", …" if len(setup.start_values) > _SHOWN else ""
                error.args = (f"{error}; set were: {shown}{more}",)
            raise
        self._sessions.add(session)
        return session

    def _open(self, setup: Setup) -> FmuSession:
        return CompiledMeSession(setup) if self.interface == "me" else CompiledCsSession(setup)

    def _probe_start(self, setup: Setup) -> None:
        """Find out once whether a co-simulation that is to begin later than at 0 does so."""
        claims = self.description.interfaces[self.interface]
        late = self.interface == "cs" and setup.start_time > 0.0 and setup.lead is None
        if not late or self._start_probed or not claims.variable_step:
            return
        self._start_probed = True
        step = setup.step or self.description.experiment.step or STEP
        free = dataclasses.replace(setup, guesses={}, point={}, outputs={})
        if begins_at_zero(self._open, free, step, states=bool(self.states)):
            self.start_note = (
                f"the FMU ignores the start time {setup.start_time:g} s and begins at 0: its first step goes from 0 to "
                f"{setup.start_time + step:g} s; {self.way_out('begin at 0 s')}"
            )

    def slopes_act(self) -> bool:
        """Find out once whether a co-simulation that takes slopes of its inputs makes anything of them."""
        if self.slopes is None:
            claims = self.description.interfaces[self.interface]
            step = self._setup.step or self.description.experiment.step or STEP
            self.slopes = not claims.variable_step or slopes_act(self._open, self._setup, step)
        return self.slopes

    def _state_works(self) -> bool:
        return not self.why_replay()

    def why_replay(self) -> str:
        """Return why snapshots are taken by replay; empty where the FMU's own state is used. Probed once."""
        if self._why_replay is None:
            claims = self.description.interfaces[self.interface]
            if not claims.state:
                self._why_replay = self._without_state()
            else:
                self._why_replay = "" if self._kept_state else why_state_fails(self._open, self._setup)
                if not self._why_replay:
                    self._kept_state.add(True)
        return self._why_replay

    def _without_state(self) -> str:
        """Return the words for a model that does not claim to save its state."""
        return "the FMU does not claim to save its state"

    def snapshot_method(self) -> str:
        """Return how snapshots are taken: "state" (the FMU's, probed) or "replay"."""
        return "state" if self._state_works() else "replay"

    def replay_note(self) -> str:
        """Return a remark if snapshots had to fall back to replay though the FMU claims to save its state, else ""."""
        if not self._why_replay or not self.description.interfaces[self.interface].state:
            return ""
        why = self._why_replay
        return f"snapshots fall back to replay, which is slower: the FMU claims to save its state, but {why}"

    def remarks(self, given: Collection[str] = ()) -> tuple[str, ...]:
        slopes = _NO_SLOPES if self.slopes is False else ""
        manners = self._setup.manners
        placed = {*given, *self.start_values, *(() if self.at is None else self.at.u)}
        lost = [miss for name, miss in manners.unkept.items() if miss is not None and name not in placed]
        unkept = f"{unkept_in_words(lost)}; `start_values` sets it" if lost else ""
        of_start = (manners.note, manners.guessed, manners.forgets, manners.stops, self.start_note, unkept)
        return tuple(filter(None, (*of_start, slopes, self.replay_note())))

    def end_sessions(self) -> None:
        """Close all sessions, also of models made of this one."""
        for session in list(self._sessions):
            session.close()

    def close(self) -> None:
        self.closed = True
        self.end_sessions()
