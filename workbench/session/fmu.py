"""What sessions on FMUs share: start-up, recording, snapshots by FMU state or by replay."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import check_countable
from workbench.errors import EndedError, InputError, SimulationError, WorkbenchError
from workbench.fmi.instance import NO_EVENT, EventInfo, Instance
from workbench.fmi.structure import STRUCTURAL
from workbench.fmi.variable import Value, Variable
from workbench.session.base import Recorded, Session, Snapshot
from workbench.session.forcing import Forcing
from workbench.session.readings import find, read_finite
from workbench.session.setup import Setup
from workbench.session.start_values import Miss, NotReachedError, StartPoint, in_words, misses
from workbench.signals.kinds import Signal

__all__ = ["Call", "FmuSession"]


_FORGETS = "the FMU forgets parameters that are set before fmi2SetupExperiment: they are set again afterwards"
_OTHER_ORDER = {
    "me": "the FMU needs the time set again before its first event iteration",
    "cs": "the FMU declares event mode but rejects it; it runs without",
}


class _RefusedError(Exception):
    """The FMU refuses the first event iteration."""

    def __init__(self, error: SimulationError) -> None:
        super().__init__(str(error))
        self.error = error


class _ForgottenError(Exception):
    """The FMU has lost parameters on the way to the end of its initialisation."""


@dataclass(frozen=True, eq=False)
class Call:
    """One `advance`, kept for replay; a `restore` is kept as a call without signals, a `jump` with its states."""

    until: float
    signals: Mapping[str, Signal]
    points: Floats | None
    restored: bool = False
    x: Floats | None = None


@dataclass(frozen=True, eq=False)
class FmuSnapshot(Snapshot):
    """A snapshot of an FMU session: the FMU's state, or the calls that led here."""

    owner: Any
    instance: Instance
    state: Any
    calls: tuple[Call, ...]
    memory: object
    written: tuple[float, ...]
    seen: Mapping[str, float]


class FmuSession(Session):
    """A session on one instance of an FMU."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.inputs = {n: v for n, v in setup.variables.items() if v.causality == "input"}
        self._calls: list[Call] = []
        self._states: list[Any] = []
        self._open()

    # -- start ----------------------------------------------------------------------------

    def _open(self) -> None:
        try:
            self._begin()
        except _RefusedError as refused:
            self._begin_otherwise(refused.error)

    def _begin(self) -> None:
        self.instance = self.setup.open_instance()
        if self.instance.remark:
            self.setup.manners.note = self.instance.remark
        try:
            self._initialise()
            self._started(self._placed(self._first_event()))
            self._arrived()
            self._look_at_inputs()
        except _ForgottenError:
            self.close()
            self.setup.manners.forgets = _FORGETS
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin_otherwise(self, error: SimulationError) -> None:
        """Begin anew in the other order that FMI allows, and keep to it if the FMU takes it."""
        manners, is_me = self.setup.manners, self.instance.interface == "me"
        if manners.other_order or manners.time_first is not None:
            raise error
        before = vars(manners).copy()
        if is_me:
            manners.time_first = not self._tells_time()
        else:
            manners.other_order = True
        try:
            self._begin()
        except NotReachedError:  # it starts, but elsewhere
            raise
        except (_RefusedError, WorkbenchError):
            vars(manners).update(before)
            raise error from None
        if manners.time_first is not False:  # not to be told it again is what the standard's figure has
            manners.note = f"{_OTHER_ORDER[self.instance.interface]} ({error})"

    def _tells_time(self) -> bool:
        """Whether the FMU is told the time once more before its first event iteration."""
        first = self.setup.manners.time_first
        return self.time != 0.0 if first is None else first

    def _initialise(self) -> None:
        instance, setup = self.instance, self.setup
        self.time = setup.start_time if setup.lead is None else setup.start_time - setup.lead.duration
        instance.clock = 0.0 if setup.lead is None else setup.lead.clock
        self._seen = self._first_seen()
        self.forcing = Forcing(instance, self.inputs, setup.bias, setup.signals)
        starts = self._starts()
        sizes = {n: starts.pop(n) for n in list(starts) if setup.variables[n].causality == STRUCTURAL}
        if sizes:
            instance.configure([setup.variables[n] for n in sizes], list(sizes.values()))
        self._write({n: v for n, v in starts.items() if n not in self.inputs})
        instance.stop = setup.manners.stop
        instance.enter_initialisation(self.time, setup.tolerance)
        self._write({n: v for n, v in starts.items() if n in self.inputs})  # FMI 2.0.4, 3.2.3: not before
        if setup.manners.forgets:
            self._write({n: v for n, v in starts.items() if setup.variables[n].causality == "parameter"})
        if setup.signals:
            self.forcing.write_all(self.forcing.at(self.time))
        instance.exit_initialisation()
        self._check_starts()
        self._target = self._aim()
        self._astray = self._target is not None and bool(self._target.missed_states())

    def _first_event(self) -> EventInfo:
        """Iterate the first event, where there is event mode, and leave that mode.

        FMI 2.0 (3.2.3) and 3.0 (2.3.6) go straight from initialisation to the event iteration: the time is that of the
        initialisation, and an FMU may refuse to be told it in event mode.
        """
        instance = self.instance
        if not instance.event_mode:
            return NO_EVENT
        is_me = instance.interface == "me"
        try:
            if is_me and self._tells_time():
                instance.set_time(self.time)
            info = instance.iterate_events()
            if info.terminate:
                raise self._ended()
            (instance.enter_continuous_mode if is_me else instance.enter_step_mode)()
        except EndedError:
            raise
        except SimulationError as error:
            raise _RefusedError(error) from error
        return info

    def _starts(self) -> dict[str, Value]:
        """Return the start values that are asked for, biases added."""
        values = {**self.setup.start_values, **self.setup.guesses}
        for name, bias in self.setup.bias.items():
            start = values.get(name, self.setup.variables[name].start)
            values[name] = float(start or 0.0) + bias
        return values

    def _write(self, values: Mapping[str, Value]) -> None:
        if values:
            self.instance.access([self.setup.variables[n] for n in values]).write(list(values.values()))

    def _check_starts(self) -> None:
        """Refuse start values that the FMU has not taken; guesses it may change, which is noted."""
        setup = self.setup
        known = [setup.variables[n] for n in setup.start_values if n not in setup.guesses and n not in setup.signals]
        kept = [v for v in known if not self.instance.fed(v)]
        biased = {v.name: _plus(setup.start_values[v.name], setup.bias.get(v.name, 0.0)) for v in kept}
        if guessed := misses(self.instance, [v for v in kept if v.initial == "approx"], biased):
            setup.manners.guessed = f"the FMU uses a start value only as a guess (initial approx): {in_words(guessed)}"
        if result := misses(self.instance, [v for v in kept if v.initial != "approx"], biased):
            lost = [setup.variables[miss.name] for miss in result]
            if (
                not setup.manners.forgets
                and self.instance.version == 2
                and all(v.causality == "parameter" for v in lost)
            ):
                raise _ForgottenError
            setup.manners.forgets = ""
            name = self.instance.description.model_name
            raise NotReachedError(
                f"{name}: the FMU does not accept a start value: {in_words(result)}; {_remedy(result, setup)}"
            )

    def _aim(self) -> StartPoint | None:
        """Return the operating point to start at; None: there is none. Discrete states must have taken by now."""
        setup = self.setup
        if not (setup.point or setup.outputs):
            return None
        target = StartPoint(self.instance, setup.variables, setup.point, setup.outputs)
        if self.instance.event_mode and self.instance.version > 1:  # FMI 1.0 has handled the first event already
            settable = [v for v in target.others if v.start is not None]
            target.refuse(target.missed(settable), "its initial equations determine it, and FMI cannot set it later")
        return target

    def _placed(self, first: EventInfo) -> float:
        """Go to the operating point, where states can be set now; return when the next event is due [s].

        Args:
            first: what the first event iteration ended with.
        """
        return first.next_time

    @abstractmethod
    def _started(self, due: float) -> None:
        """Go on after the first event iteration until the FMU can be advanced; the next event is `due` [s]."""

    def _arrived(self) -> None:
        """Make sure that the session stands where it was asked to."""
        if self._target is not None:
            self._target.refuse(
                self._target.missed_outputs(),
                "states and inputs are as asked for; do the parameters differ from those of the point?",
            )

    def _look_at_inputs(self) -> None:
        """Find out, once for each, whether inputs that nobody sets have their declared start values (FMI 2.0.4, 2.2.7).

        That is no error here: whose value an input has that is not set, the user decides, and is told of it.
        """
        setup, known, clocked = self.setup, self.setup.manners.unkept, self.instance.description.clocked
        given = {**setup.start_values, **setup.bias, **setup.signals, **setup.point, **clocked, **known}
        left = [v for n, v in self.inputs.items() if n not in given and v.start is not None and v.is_number]
        left = [v for v in left if not self.instance.fed(v)]
        starts = {v.name: v.start for v in left if v.start is not None}
        missed = {miss.name: miss for miss in misses(self.instance, left, starts)}
        known.update({v.name: missed.get(v.name) for v in left})

    # -- advance --------------------------------------------------------------------------

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        until = float(until)
        targets, variables, new = self._set_out(until, signals, record, points)
        try:
            return self._advance(until, targets, variables, new=new)
        except EndedError as error:
            self._add_end(error, variables)
            raise

    def _set_out(
        self, until: float, signals: Mapping[str, Signal], record: Sequence[str], points: Floats | None
    ) -> tuple[Floats, list[Variable], bool]:
        """Put `signals` in force, and keep the call for a replay; return what `_advance` is given besides `until`."""
        targets = self._targets(until, points)
        check_countable(self.setup.samplers, self.time, until)
        variables = find(record, self.setup.variables)
        self._calls.append(Call(until, dict(signals), points))
        new = signals != self.forcing.signals
        if new:
            before = self.forcing
            self.forcing = Forcing(self.instance, self.inputs, self.setup.bias, signals)
            self._forcing_changed(before)
        return targets, variables, new

    def _forcing_changed(self, before: Forcing) -> None:
        """Carry over what the FMU sees from the previous signals to the present ones."""
        self._seen.update(zip(before.names, before.written, strict=True))
        self.forcing.written = [self._seen[n] for n in self.forcing.names]

    def _first_seen(self) -> dict[str, float]:
        """Return what the FMU sees at its inputs before they are forced."""
        setup = self.setup
        starts = {n: setup.start_values.get(n, v.start) for n, v in self.inputs.items() if v.is_number}
        seen = {n: math.nan if s is None else float(s) + setup.bias.get(n, 0.0) for n, s in starts.items()}
        return seen | {n: value for n, value in setup.point.items() if n in seen}

    @abstractmethod
    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        """Advance to `until`; `targets` are the points, rising, the last is `until`. `new`: other signals."""

    def _targets(self, until: float, points: Floats | None) -> Floats:
        if not math.isfinite(until) or until < self.time:
            raise InputError(f"cannot advance to {until:g} s: the session is at {self.time:.9g} s")
        if points is None or len(points) == 0:
            return np.array([until])
        values: Floats = np.asarray(points, dtype=np.float64)
        rising = bool((values[1:] > values[:-1]).all())
        if not rising or not values[0] > self.time or not values[-1] <= until:
            said = f"{values[0]:g}" if len(values) == 1 else f"{len(values)} from {values[0]:g} to {values[-1]:g}"
            raise InputError(
                f"points: times to record must rise and lie in ({self.time:.9g}, {until:.9g}] s, not {said}"
            )
        return values if values[-1] == until else np.append(values, until)

    def values(self, names: Sequence[str]) -> dict[str, float]:
        variables = find(names, self.setup.variables)
        if not variables:
            return {}
        values = read_finite(self.instance.access(variables), variables, self.time)
        return {name: float(value) for name, value in zip(names, values, strict=True)}

    def _add_end(self, error: EndedError, variables: Sequence[Variable]) -> None:
        """Add the row with which the FMU ended its run to those before: it may still be read then."""
        rows = error.before
        if not isinstance(rows, Recorded) or not len(rows.time) or error.time is None or error.time < rows.time[-1]:
            return
        values = read_finite(self.instance.access(variables), variables, error.time) if variables else []
        last = dict(zip([v.name for v in variables], values, strict=True))
        if error.time == rows.time[-1] and all(rows.values[n][-1] == value for n, value in last.items()):
            return
        error.before = Recorded(
            time=np.append(rows.time, error.time),
            values={n: np.append(column, last[n]) for n, column in rows.values.items()},
            inputs={n: np.append(column, column[-1:]) for n, column in rows.inputs.items()},
        )

    def _ended(self) -> EndedError:
        return EndedError(f"the FMU ended its run{self.instance.log.tail()}", time=self.time)

    def jump(self, x: Floats) -> None:
        """Go on from other states at the same time; events are iterated there, discrete states follow by these alone.

        Args:
            x: shape (n,).

        Raises:
            InputError: co-simulation, whose states cannot be set.
            NotReachedError: a state did not take its value.
            EndedError: the FMU ended its run there.
        """
        way = self.instance.description.way_out()
        raise InputError(f"co-simulation: states cannot be set while the model runs; {way}")

    # -- snapshots ------------------------------------------------------------------------

    @abstractmethod
    def _memory(self) -> object:
        """Return what a restore needs besides the FMU's state."""

    @abstractmethod
    def _resume(self, memory: object) -> None:
        """Go on from a restored FMU state with what `_memory` returned."""

    @abstractmethod
    def _forget(self) -> None:
        """Reset the solver's memory, as every restore does."""

    def snapshot(self) -> Snapshot:
        state = None
        if self.setup.state_works():
            state = self.instance.get_state()
            self._states.append(state)
        return FmuSnapshot(
            time=self.time,
            owner=self,
            instance=self.instance,
            state=state,
            calls=tuple(self._calls),
            memory=self._memory(),
            written=tuple(self.forcing.written),
            seen=dict(self._seen),
        )

    def restore(self, snapshot: Snapshot) -> None:
        if not isinstance(snapshot, FmuSnapshot) or snapshot.owner is not self:
            raise InputError("this snapshot belongs to another session")
        if snapshot.state is not None and snapshot.instance is self.instance and self.instance.healthy:
            self._restore_state(snapshot)
        else:
            self._replay(snapshot.calls)
        self._calls = [*snapshot.calls, Call(self.time, {}, None, restored=True)]

    def _restore_state(self, snapshot: FmuSnapshot) -> None:
        self.instance.set_state(snapshot.state)
        self.time = self.instance.time = snapshot.time
        signals = _last_signals(snapshot.calls, self.setup.signals)
        self.forcing = Forcing(self.instance, self.inputs, self.setup.bias, signals)
        self.forcing.written = list(snapshot.written)
        self._seen = dict(snapshot.seen)
        self._resume(snapshot.memory)

    def _replay(self, calls: Sequence[Call]) -> None:
        """Do again, in a new instance, what led to the snapshot."""
        self.close()
        self._calls = []
        self._open()
        for call in calls:
            if call.restored:
                self._forget()
            elif call.x is not None:
                self.jump(call.x)
            else:
                self.advance(call.until, signals=call.signals, points=call.points)
        self._forget()

    def close(self) -> None:
        instance: Instance | None = getattr(self, "instance", None)
        if instance is None:
            return
        for state in self._states:
            instance.free_state(state)
        self._states = []
        self._close_solver()
        instance.close()

    def _close_solver(self) -> None:
        """Free the solver, if there is one."""


def _plus(value: Value, bias: float) -> Value:
    return value if isinstance(value, str) or not bias else float(value) + bias


def _remedy(result: Sequence[Miss], setup: Setup) -> str:
    variable = setup.variables[result[0].name]
    if variable.causality in ("parameter", "structuralParameter"):
        return "the FMU keeps its own value of this parameter; leave it out"
    if variable.causality == "input":
        return "the FMU keeps its own value of this input; force it by a signal"
    return "its initial equations determine it; set a state by an operating point instead (`at`)"


def _last_signals(calls: Sequence[Call], initial: Mapping[str, Signal]) -> Mapping[str, Signal]:
    for call in reversed(calls):
        if not call.restored:
            return call.signals
    return initial
