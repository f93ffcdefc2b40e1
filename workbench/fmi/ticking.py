"""When the clocks of an FMI 3.0 instance tick: the memory that Python and the kernel share, and Python's part.

The kernel's twin is `clocks.c`. A clock that the importer lets tick (a time-based input clock) is activated on entering
event mode at its time; FMI's `fmi3UpdateDiscreteStates` ends the tick.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping

from workbench.core.values.calendar import Sampler, exact, is_due
from workbench.errors import SimulationError
from workbench.fmi.c_array import array_type
from workbench.fmi.description import Clock
from workbench.fmi.instants import Instants

__all__ = ["Clocks", "Tick", "Ticking", "no_interval", "periodic", "time_based"]

PERIODIC, APERIODIC, TUNABLE = 0, 1, 2
_KINDS = {"constant": PERIODIC, "fixed": PERIODIC, "tunable": TUNABLE, "changing": APERIODIC, "countdown": APERIODIC}
_CHANGED = 2  # of fmi3IntervalQualifier
_UNCHANGED = 1


class Tick(ctypes.Structure):
    """One clock, as clocks.h has it.

    Attributes:
        next: time of the next tick [s]; infinite: not known, or none.
        instants: of a periodic clock.
        count: of these, so far.
        reference: the FMU's handle.
        kind: PERIODIC: known for good; APERIODIC: the FMU is asked for each next tick; TUNABLE: periodic, and asked.
        ticked: it has ticked in this event, and the FMU has not been asked since.
        place: where its ticks are counted.
    """

    next: float
    instants: Instants
    count: float
    reference: int
    kind: int
    ticked: int
    place: int
    _fields_ = (
        ("next", ctypes.c_double),
        ("instants", Instants),
        ("count", ctypes.c_double),
        ("reference", ctypes.c_uint32),
        ("kind", ctypes.c_int32),
        ("ticked", ctypes.c_int32),
        ("place", ctypes.c_int32),
    )


class Clocks(ctypes.Structure):
    """All of an instance, as clocks.h has it."""

    _fields_ = (
        ("ticks", ctypes.c_void_p),
        ("n", ctypes.c_size_t),
        ("told", ctypes.c_void_p),
        ("places", ctypes.c_void_p),
        ("n_told", ctypes.c_size_t),
        ("counts", ctypes.c_void_p),
        ("references", ctypes.c_void_p),
        ("active", ctypes.c_void_p),
        ("intervals", ctypes.c_void_p),
        ("qualifiers", ctypes.c_void_p),
    )


def time_based(clocks: Mapping[str, Clock]) -> dict[str, Clock]:
    """Return those that tick at times that the FMU tells: the importer has to let them."""
    return {name: c for name, c in clocks.items() if c.causality == "input" and c.kind in _KINDS}


def periodic(clocks: Mapping[str, Clock]) -> tuple[Sampler, ...]:
    """Return when those clocks tick whose period is declared, counted from where a session begins.

    Others tick at times that the FMU tells while it runs, or with another clock.
    """
    known = ((n, c) for n, c in time_based(clocks).items() if c.interval and _KINDS[c.kind] != APERIODIC)
    return tuple(Sampler(exact(c.interval or 0.0), exact(c.shift), f"clock {n}") for n, c in known)


def no_interval(who: str, time: float) -> SimulationError:
    """Return the error for an interval that is negative or not finite.

    Args:
        who: model, and clock where it is known.
        time: [s].
    """
    words = "the FMU gives an interval to the next tick that is negative or not finite"
    return SimulationError(f"{who}: {words}", time=time)


class Ticking:
    """The clocks of one instance.

    Args:
        clocks: name → how it ticks.
        call: calls an FMI function of the instance and checks its status.
        model: name of the model, for messages.

    Attributes:
        counts: how often each clock has ticked, an array of c_double.
        places: clock → where in it.
        address: of the structure that the kernel works on.
    """

    def __init__(self, clocks: Mapping[str, Clock], call: Callable[..., None], model: str) -> None:
        self._call, self._model = call, model
        self.places = {name: i for i, name in enumerate(clocks)}
        self._clocks = tuple(time_based(clocks).items())
        listened = [(c.value_reference, self.places[name]) for name, c in clocks.items() if c.causality != "input"]
        n, most = len(self._clocks), max(len(clocks), 1)
        self._ticks = array_type(Tick, n)()
        self.counts = array_type(ctypes.c_double, most)()
        self._told = array_type(ctypes.c_uint32, len(listened))(*(reference for reference, _ in listened))
        self._places = array_type(ctypes.c_int32, len(listened))(*(place for _, place in listened))
        self._references = array_type(ctypes.c_uint32, most)()
        self._active = array_type(ctypes.c_bool, most)()
        self._intervals = array_type(ctypes.c_double, most)()
        self._qualifiers = array_type(ctypes.c_int, most)()
        for tick, (name, clock) in zip(self._ticks, self._clocks, strict=True):
            tunable = clock.kind == "tunable" and clock.interval is not None  # by the importer, which does not
            tick.kind = PERIODIC if tunable else _KINDS[clock.kind]
            tick.reference, tick.next, tick.place = clock.value_reference, math.inf, self.places[name]
        where = map(ctypes.addressof, (self._told, self._places))
        scratch = (self._references, self._active, self._intervals, self._qualifiers)
        self._structure = Clocks(
            ctypes.addressof(self._ticks), n, *where, len(listened), ctypes.addressof(self.counts),
            *map(ctypes.addressof, scratch),
        )  # fmt: skip
        self.address = ctypes.addressof(self._structure)

    @property
    def next_tick(self) -> float:
        """Time of the next tick of any [s]; infinite: none is known."""
        return float(min((tick.next for tick in self._ticks), default=math.inf))

    def start(self, time: float) -> None:
        """Find the first ticks, in initialisation mode.

        Args:
            time: start time [s].
        """
        for tick, (name, clock) in zip(self._ticks, self._clocks, strict=True):
            unknown = clock.interval is None
            interval, known = self._asked(tick.reference) if unknown else (clock.interval or 0.0, True)
            shift = self._shift(tick.reference) if unknown and tick.kind != APERIODIC else clock.shift
            if known and not (0.0 <= interval < math.inf and (interval or tick.kind == APERIODIC)):
                raise no_interval(f"{self._model}: clock {name}", time)
            tick.count = 0.0
            if not known:  # `ask` finds it, after the first events
                tick.next = math.inf
            elif tick.kind == APERIODIC:
                tick.next = time + interval
            else:
                tick.instants = Instants.of(Sampler(exact(interval), exact(time) + exact(shift)))
                tick.next = tick.instants.at(0)

    def _asked(self, reference: int) -> tuple[float, bool]:
        """Return an interval and whether the FMU knows it by now."""
        self._references[0] = reference
        self._call("fmi3GetIntervalDecimal", self._references, 1, self._intervals, self._qualifiers)
        return float(self._intervals[0]), self._qualifiers[0] in (_CHANGED, _UNCHANGED)

    def _shift(self, reference: int) -> float:
        self._references[0] = reference
        self._call("fmi3GetShiftDecimal", self._references, 1, self._intervals)
        return float(self._intervals[0])

    def tick(self, time: float) -> None:
        """Let tick what is due, in event mode that was just entered.

        Args:
            time: [s].
        """
        n = 0
        for tick in self._ticks:
            if is_due(tick.next, time):
                self._references[n], self._active[n] = tick.reference, True
                n += 1
                tick.ticked = True
                self.counts[tick.place] += 1.0
                tick.count += 1.0
                tick.next = math.inf if tick.kind == APERIODIC else tick.instants.at(tick.count)
        if n:
            self._call("fmi3SetClock", self._references, n, self._active)

    def listen(self) -> None:
        """Count the clocks that the FMU lets tick, before the event is evaluated, which ends their ticks."""
        if len(self._told):
            self._call("fmi3GetClock", self._told, len(self._told), self._active)
        for i, place in enumerate(self._places):
            self.counts[place] += float(self._active[i])

    def ask(self, time: float) -> None:
        """Ask the FMU for the next ticks that it alone knows, after an event iteration.

        Args:
            time: [s].
        """
        asked = [(t, n) for t, (n, _) in zip(self._ticks, self._clocks, strict=True) if t.kind != PERIODIC]
        for i, (tick, _) in enumerate(asked):
            self._references[i] = tick.reference
        if asked:
            self._call("fmi3GetIntervalDecimal", self._references, len(asked), self._intervals, self._qualifiers)
        for i, (tick, name) in enumerate(asked):
            changed = self._qualifiers[i] == _CHANGED
            if changed or (tick.ticked and tick.kind == APERIODIC and self._qualifiers[i] == _UNCHANGED):
                interval = float(self._intervals[i])
                if not 0.0 <= interval < math.inf:
                    raise no_interval(f"{self._model}: clock {name}", time)
                tick.next, tick.count = time + interval, 0.0
                tick.instants = Instants(tick.next, interval, 1.0)
            tick.ticked = False

    def saved(self) -> tuple[bytes, bytes]:
        """Return when everything ticks and how often it has, for `restore`."""
        return bytes(self._ticks), bytes(self.counts)

    def restore(self, saved: tuple[bytes, bytes]) -> None:
        """Go back to what `saved` returned."""
        for array, contents in zip((self._ticks, self.counts), saved, strict=True):
            ctypes.memmove(array, contents, ctypes.sizeof(array))
