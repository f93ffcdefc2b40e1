"""The kernel's view of one session: components, forced inputs and recorded variables, made once and used again."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.kernel.native_forcing import NativeForcing
from workbench.kernel.native_record import NativeFourier, NativeRecord
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Cs, Me
from workbench.session.base import Recorded
from workbench.session.compiled_errors import PAUSED, Situation, exception_of
from workbench.session.forcing import Forcing
from workbench.session.pauses import pause
from workbench.signals.kinds import Signal

__all__ = ["InnerLoop", "Recording", "closed"]


@dataclass
class Recording:
    """How rows are recorded.

    Attributes:
        bound: a recorded value of larger magnitude is a SimulationError.
        every: of the rows at plain points each n-th is kept.
        missing: whether a value that is not finite is recorded as it is, while another one is finite; else it is a
            SimulationError.
    """

    bound: float = math.inf
    every: int = 1
    missing: bool = False


class InnerLoop:
    """Drives one instance; a replay, which makes a new instance, makes a new loop.

    Args:
        instance: the FMU.
        solver: name of the solver, for messages.
        names: see `Situation`.
        unit: see `Situation`.
    """

    def __init__(
        self,
        instance: Instance,
        solver: str,
        *,
        names: Sequence[str] = (),
        unit: Callable[[int], Exception] | None = None,
    ) -> None:
        self.instance = instance
        self.system = NativeSystem(instance.parts, instance.wiring)
        self._solver = solver
        self._names, self._unit = tuple(names), unit
        self._records: dict[tuple[str, ...], NativeRecord] = {}
        self._sums: dict[tuple[int, int], NativeFourier] = {}
        self._native: NativeForcing | None = None
        self._signals: Mapping[str, Signal] = {}
        self._forcing: Forcing | None = None

    def force(self, forcing: Forcing) -> NativeForcing:
        """Put `forcing` in force, with what the FMU sees now."""
        native = self._native
        if native is None or (self._forcing is not forcing and self._signals != forcing.signals):
            inputs = [(v, s, b, self.instance.ports(v)) for v, s, b in forcing.inputs()]
            native = self._native = NativeForcing(self.system, inputs, longest_step=forcing.longest_step)
            self._signals = forcing.signals
            native.apply()
        self._forcing = forcing
        native.written[: native.n] = forcing.written
        return native

    def reapply(self) -> None:
        """Put the session's own forcing in force again, after somebody else's."""
        if self._native is not None:
            self._native.apply()

    def record(self, variables: Sequence[Variable], how: Recording, sums: NativeFourier | None) -> NativeRecord:
        """Return what records `variables`; with sums that see every row none is kept."""
        key = tuple(v.name for v in variables)
        if key not in self._records:
            places = [self.instance.ports(v)[0] for v in variables]
            self._records[key] = NativeRecord(self.system, [(result, part) for part, result in places], variables)
        record = self._records[key]
        structure = record.structure
        record.trust_declaration()
        structure.bound, structure.every, structure.missing = how.bound, how.every, how.missing
        structure.keep = sums is None
        structure.fourier = None if sums is None else sums.address
        return record

    def fourier(self, n: int, *, orders: int) -> NativeFourier:
        """Return what sums the first `n` columns behind the time."""
        key = n, orders
        if key not in self._sums:
            columns = range(1, 1 + n)
            self._sums[key] = NativeFourier(self.system.library, columns, begin=0.0, frequency=1.0, orders=orders)
        return self._sums[key]

    def run(self, native: Me | Cs, targets: Floats, record: NativeRecord, *, new: bool) -> None:
        """Let the kernel run to the last target.

        Args:
            native: the kernel's session.
            targets: shape (n,) [s].
            record: what is recorded.
            new: whether the signals are others than before.
        """
        targets = np.ascontiguousarray(targets)
        data: int = targets.__array_interface__["data"][0]  # `targets.ctypes.data` takes longer
        library, address = self.system.library, ctypes.addressof(native)
        is_me = isinstance(native, Me)
        start = library.kernel_me_run if is_me else library.kernel_cs_run
        go_on = library.kernel_me_go_on if is_me else library.kernel_cs_go_on
        done = start(address, float(targets[-1]), data, len(targets), record.address, new)
        while not done and self.system.structure.failure.code == PAUSED:
            pause(native.time)
            done = go_on(address)  # signal handlers of Python had their turn before
        self.system.sync_times()
        self.instance.time = self.system.instances[0].time
        self.check(done, record.variables, fixed=getattr(native, "fixed", math.nan))

    def check(self, done: int, recorded: Sequence[Variable] = (), *, fixed: float = math.nan) -> None:
        """Raise what went wrong in the last call, if anything did."""
        self.system.trouble.check()
        if not done:
            raise self.failed(recorded, fixed=fixed)

    def failed(self, recorded: Sequence[Variable] = (), *, fixed: float = math.nan) -> Exception:
        """Return what the kernel has noted, as an exception."""
        failure = self.system.structure.failure
        return exception_of(Situation(failure, self.instance, recorded, self._solver, fixed, self._names, self._unit))

    @staticmethod
    def rows(record: NativeRecord, forcing: Forcing) -> Recorded:
        """Return what the last run recorded."""
        if not record.structure.keep:
            return _NO_ROWS
        columns = record.columns()
        n = len(forcing.names)
        inputs = dict(zip(forcing.names, columns[1 : 1 + n], strict=True))
        values = {v.name: c for v, c in zip(record.variables, columns[1 + n :], strict=True)}
        return Recorded(time=columns[0], values=values, inputs=inputs)


_NO_ROWS = Recorded(time=np.empty(0), values={}, inputs={})


def closed() -> SimulationError:
    """Return the error for a session that is used after `close`."""
    return SimulationError("the session is closed")
