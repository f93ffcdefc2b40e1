"""What the kernel notes when it cannot continue, as exceptions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from workbench.errors import EndedError, SimulationError
from workbench.fmi.instance import DISCARD, MAX_EVENT_ITERATIONS, Instance, no_event_time
from workbench.fmi.ticking import no_interval
from workbench.fmi.variable import Variable
from workbench.kernel.structs import Failure
from workbench.session.algebraic_error import too_early, unsolved
from workbench.session.cs import MAX_EARLY_RETURNS, off_grid

__all__ = ["PAUSED", "Situation", "chattering", "exception_of", "gone_through", "too_many_steps", "zeno"]

MAX_STEPS = 20_000  # between two recorded points or events; as in me.c


@dataclass(frozen=True)
class Situation:
    """The kernel's note, and what the message needs besides it.

    Attributes:
        failure: the note.
        whole: the FMU, or the system of several.
        recorded: the variables that are recorded.
        solver: its name.
        fixed: constant communication step [s]; NaN: none.
        names: of the components that a master steps; empty: there is no master.
        unit: what the master's unit of a number has noted, as an exception.
    """

    failure: Failure
    whole: Instance
    recorded: Sequence[Variable] = ()
    solver: str = ""
    fixed: float = float("nan")
    names: Sequence[str] = ()
    unit: Callable[[int], Exception] | None = None

    @property
    def of_whole(self) -> bool:
        """Whether a system of several failed as such."""
        return self.failure.component < 0

    @property
    def subject(self) -> str:
        """How messages call the FMU that failed."""
        return self.names[self.failure.component] if self.names and not self.of_whole else "the FMU"

    @property
    def function(self) -> str:
        """Name of the FMI function that failed."""
        return (self.failure.name or b"").decode()

    @property
    def instance(self) -> Instance:
        """The FMU that failed, told when."""
        instance = self.whole if self.of_whole else self.whole.parts[self.failure.component]
        instance.time = self.failure.time
        return instance

    def error(self, words: str) -> SimulationError:
        """Return the error with the time of the failure."""
        return SimulationError(words, time=self.failure.time)


def _status(now: Situation) -> Exception:
    instance = now.instance
    discarded = now.failure.status == DISCARD and now.function == instance.CALLS.get("do_step")
    end = instance.ended_at() if discarded else None
    if end is not None:
        return EndedError(f"{now.subject} ended its run{instance.log.tail()}", time=end)
    try:
        instance.fail(now.function, now.failure.status)
    except SimulationError as error:
        return error


def _missing(now: Situation) -> Exception:
    try:
        now.instance.library[now.function]()
    except Exception as error:  # noqa: BLE001  it is returned
        return error
    return now.error(f"{now.function} is missing in the FMU's binary")


def _ended(now: Situation) -> Exception:
    return EndedError(f"{now.subject} ended its run{now.instance.log.tail()}", time=now.failure.time)


def _iteration(now: Situation) -> Exception:
    name = (now.instance if now.names else now.whole).description.model_name
    return now.error(f"{name}: event iteration does not settle after {MAX_EVENT_ITERATIONS} rounds")


def _value(now: Situation) -> Exception:
    return now.error(f"{now.recorded[now.failure.index].name} is {now.failure.value:g}, not a finite number")


def _bound(now: Situation) -> Exception:
    return now.error(f"{now.recorded[now.failure.index].name} is {now.failure.value:g}, beyond the bound set for it")


def _state(now: Situation) -> Exception:
    names = [s.name for s in _states(now.whole)]
    return now.error(f"state {names[now.failure.index]} is not a finite number")


def _states(instance: Instance) -> list[Variable]:
    """Return one variable for each state that the FMU has at run time."""
    known = list(instance.description.states[: instance.nx])
    return known + [Variable(f"state[{i + 1}]") for i in range(len(known), instance.nx)]


def _solver(now: Situation) -> Exception:
    words = now.failure.message.decode("utf-8", "replace") or "cannot continue"
    return now.error(words if words.startswith(f"{now.solver}:") else f"{now.solver}: {words}")


def _steps(now: Situation) -> Exception:
    return too_many_steps(now.solver, now.failure.time)


def _zeno(now: Situation) -> Exception:
    return zeno(now.failure.time)


def _chatter(now: Situation) -> Exception:
    return chattering(now.failure.time)


def _through(now: Situation) -> Exception:
    return gone_through(now.failure.time)


def _early(now: Situation) -> Exception:
    return now.error(f"{now.subject} returned early from doStep {MAX_EARLY_RETURNS} times in one step")


def _event_mode(now: Situation) -> Exception:
    return now.error("the FMU requests event mode, which it does not offer")


def _grid(now: Situation) -> Exception:
    return off_grid(now.fixed, now.failure.value)


def _memory(now: Situation) -> Exception:
    return now.error("out of memory for the solver or the recorded points; record fewer points")


def _label(now: Situation, index: int) -> str:
    wiring = now.whole.wiring
    return wiring.connections[index].label if wiring is not None else f"connection {index}"


def _loop(now: Situation) -> Exception:
    wiring, worst = now.whole.wiring, int(now.failure.index)
    loops = [] if wiring is None else [g.members for g in wiring.loops() if worst in g.members]
    names = [_label(now, i) for i in (loops[0] if loops else (worst,))]
    value = now.failure.message.decode("utf-8", "replace")
    return unsolved(names, _label(now, worst), value, now.failure.value, now.failure.time)


def _wire(now: Situation) -> Exception:
    return now.error(f"{_label(now, now.failure.index)} passes {now.failure.value:g}, not a finite number")


def _event_time(now: Situation) -> Exception:
    return no_event_time(now.instance)


def _unit(now: Situation) -> Exception:
    number = int(now.failure.index)
    return now.error(f"unit {number} failed") if now.unit is None else now.unit(number)


def _interval(now: Situation) -> Exception:
    return no_interval(now.whole.description.model_name, now.failure.time)


def _order(now: Situation) -> Exception:
    return too_early(_label(now, now.failure.index), now.failure.time)


# By FailureCode in failure.h, from 1 on; behind the last comes PAUSED.
FAILURES: tuple[Callable[[Situation], Exception], ...] = (
    _status, _missing, _ended, _iteration, _value, _state, _bound, _solver, _steps, _zeno, _chatter, _through,
    _early, _event_mode, _grid, _memory, _loop, _wire, _event_time, _unit, _interval, _order,
)  # fmt: skip
PAUSED = len(FAILURES) + 1


def exception_of(now: Situation) -> Exception:
    """Return the exception for what the kernel noted."""
    return FAILURES[now.failure.code - 1](now)


def too_many_steps(solver: str, time: float) -> SimulationError:
    """Return the error for a solver that does not get on."""
    advice = "; use solver gear" if solver == "vkm" else ""
    return SimulationError(f"{solver}: more than {MAX_STEPS} steps needed between two points{advice}", time=time)


def chattering(time: float) -> SimulationError:
    """Return the error for events that follow each other without time passing."""
    words = "more and more events without time passing (chattering); give the switching condition a hysteresis"
    return SimulationError(words, time=time)


def zeno(time: float) -> SimulationError:
    """Return the error for events that follow each other faster and faster, without end before `time` [s]."""
    words = "infinitely many events (Zeno behaviour, as of a ball that comes to rest); let the model rest there"
    return SimulationError(words, time=time)


def gone_through(time: float) -> SimulationError:
    """Return the error for an indicator that went on across its zero, though the event there turned or stopped it."""
    words = (
        "the event here reverses or stops a variable at its threshold, but the variable then crosses it without"
        " another event (as when a ball comes to rest and falls through its floor); let the model rest there, held by"
        " a contact force; if the variable is meant to cross, model that without restarting a state (reinit)"
    )
    return SimulationError(words, time=time)
