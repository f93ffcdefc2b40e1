"""Sessions whose loop runs in compiled code: one call from Python advances many steps.

The oracle in tests/oracle is the same in plain Python; each is tested against the other.
"""

from __future__ import annotations

import ctypes
import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import EndedError, FmuError, InputError, SimulationError, StoppedError
from workbench.fmi.variable import Variable
from workbench.kernel.gear import gear_library, why_missing
from workbench.kernel.native_record import NativeFourier, NativeRecord
from workbench.kernel.native_slopes import NativeSlopes, Pattern, believed
from workbench.kernel.structs import Cs, Me
from workbench.session.base import Recorded
from workbench.session.cs import CsSession
from workbench.session.directional import newton_sparsity, slopes_pattern
from workbench.session.evaluated_point import Stand
from workbench.session.fmu import Call, FmuSession
from workbench.session.loop import InnerLoop, Recording, closed
from workbench.session.me import MeSession
from workbench.session.start_values import NotReachedError
from workbench.signals.kinds import Constant, Prbs, Signal, Step

__all__ = ["CompiledCsSession", "CompiledMeSession", "CompiledSession", "Harmonics"]


@dataclass(frozen=True)
class Harmonics:
    """Fourier coefficients over the span of one advance.

    Attributes:
        values: recorded name → shape (1 + 2·orders,): mean, then in-phase and quadrature part of each harmonic.
        inputs: the same of each forced input, as the FMU saw it.
        largest: recorded name → largest magnitude.
        rough: recorded name → what edges between its rows may put into a coefficient.
        gap: largest distance of two rows [s]; in co-simulation the longest communication step.
        steps: that the solver took; of co-simulation, communication steps.
    """

    values: dict[str, Floats]
    inputs: dict[str, Floats]
    largest: dict[str, float]
    rough: dict[str, float]
    gap: float
    steps: int


_AT_ITS_END = 0.01  # of its default experiment: a failure so near to its end may be for that
_FAR = 1e6  # spans of it: the stop time that an FMU is then told
_STEPWISE = (Constant, Step, Prbs)  # signals without slopes


class CompiledSession(FmuSession):
    """What both compiled sessions share.

    Attributes:
        recording: how rows are recorded from now on.
    """

    _loop: InnerLoop | None = None
    _communicates: ClassVar[bool]
    recording: Recording

    @property
    def loop(self) -> InnerLoop:
        """The kernel's view of this session."""
        if self._loop is None:
            raise closed()
        return self._loop

    def _make_loop(self) -> InnerLoop:
        self.recording = Recording()
        self._loop = InnerLoop(self.instance, self.setup.solver)
        return self._loop

    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        with self._under_way(until, variables) as (native, record):
            self.loop.run(native, targets, record, new=new)
        return self.loop.rows(record, self.forcing)

    @contextmanager
    def _under_way(
        self, until: float, variables: Sequence[Variable], sums: NativeFourier | None = None
    ) -> Iterator[tuple[Me | Cs, NativeRecord]]:
        """Yield the kernel's session and what records, for a run; after it the session stands where the run ended."""
        forcing, record = self.loop.force(self.forcing), self.loop.record(variables, self.recording, sums)
        try:
            yield self._ready(until), record
        except SimulationError as error:
            error.before = self.loop.rows(record, self.forcing)
            self._failed_at(error)
            raise
        except KeyboardInterrupt:
            raise StoppedError(self.loop.rows(record, self.forcing)) from None
        finally:
            self._take_over()
            self.forcing.written = forcing.written[: forcing.n]

    def _failed_at(self, error: SimulationError) -> None:
        """Learn from a failure what lets a later session go on."""

    @abstractmethod
    def _ready(self, until: float) -> Me | Cs:
        """Return the kernel's session, ready to run to a time [s]."""

    @abstractmethod
    def _take_over(self) -> None:
        """Take over where the kernel's session stands."""

    def harmonics(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str],
        begin: float,
        frequency: float,
        orders: int = 10,
        points: Floats | None = None,
        basis: Floats | None = None,
    ) -> Harmonics:
        """Advance as `advance` does, over whole periods; keep no rows, only their Fourier coefficients.

        The integrals are those of `workbench.response.periodic.fourier.measure_period`.

        Args:
            until: see `advance`, as for the next three.
            signals: forced inputs.
            record: what is measured.
            points: evenly spaced; where the trapezoids begin and end.
            begin: time at which the phase is zero [s].
            frequency: [Hz].
            orders: number of harmonics.
            basis: 1, sin, cos, sin 2, cos 2, … at the points, shape (points, 1 + 2·orders), C-contiguous; None:
                computed as they come.

        Raises:
            InputError: see `advance`; `basis` has another shape.
        """
        n_inputs, n = len(signals), len(record)
        sums = self.loop.fourier(n_inputs + n, orders=orders)
        sums.aim(begin=begin, frequency=frequency, known=_known(points, basis, orders), grid=not self._communicates)
        targets, variables, new = self._set_out(until, signals, record, points)
        before = self.loop.system.structure.steps
        with self._under_way(until, variables, sums) as (native, rows):
            self.loop.run(native, targets, rows, new=new)
        result = sums.result()
        return Harmonics(
            values=dict(zip(record, result[n_inputs:], strict=True)),
            inputs=dict(zip(signals, result[:n_inputs], strict=True)),
            largest=dict(zip(record, sums.largest[n_inputs:].tolist(), strict=True)),
            rough=dict(zip(record, sums.rough[n_inputs:].tolist(), strict=True)),
            gap=sums.gap,
            steps=self.loop.system.structure.steps - before,
        )


def _known(points: Floats | None, basis: Floats | None, orders: int) -> tuple[Floats, Floats | None] | None:
    """Return the points, and the basis there where it is known."""
    if points is None:
        return None
    times = np.ascontiguousarray(points, dtype=np.float64)
    if basis is None:
        return times, None
    if basis.shape != (len(points), 1 + 2 * orders):
        raise InputError(f"basis has shape {basis.shape}, not {(len(points), 1 + 2 * orders)}")
    return times, np.ascontiguousarray(basis, dtype=np.float64)


class CompiledCsSession(CompiledSession, CsSession):
    """Co-simulation of one FMU: the loop of `CsSession` in compiled code."""

    _communicates = True

    def _started(self, due: float) -> None:
        CsSession._started(self, due)  # noqa: SLF001  its own
        self._native = Cs(system=self._make_loop().system.address)
        if self.setup.hold_inputs:
            self.loop.system.hold_inputs()

    def _ready(self, until: float) -> Cs:
        native = self._native
        native.time, native.previous = self.time, self._previous
        native.fixed = math.nan if self._fixed is None else self._fixed
        native.longest = self._longest(until)
        native.variable_step = self.instance.capabilities.variable_step
        native.step_given = self.setup.step is not None
        self.loop.system.event_due = self._event_due
        if not self.setup.hold_inputs and self._inputs_move() and not self.setup.slopes_act():
            self.loop.system.without_slopes()
        return native

    def _failed_at(self, error: SimulationError) -> None:
        experiment, manners = self.instance.description.experiment, self.setup.manners
        own, begin = experiment.stop_time, experiment.start_time or 0.0
        if own is None or error.time is None or isinstance(error, EndedError):
            return
        if abs(error.time + self.instance.clock - own) > _AT_ITS_END * (own - begin):
            return
        manners.stops = ""  # where that did not help it was something else
        if manners.stop is None:
            manners.stop = own + _FAR * (own - begin)
            manners.stops = (
                f"the FMU goes no further than {own:g} s, where its default experiment stops, unless it is told a "
                f"later stop time: it is told {manners.stop:g} s"
            )

    def _inputs_move(self) -> bool:
        """Whether continuous inputs change between their breaks, and the FMU takes slopes of them."""
        forced = (s for v, s, _ in self.forcing.inputs() if v.is_continuous_input)
        return self.instance.capabilities.interpolates_inputs and any(not isinstance(s, _STEPWISE) for s in forced)

    def _take_over(self) -> None:
        native = self._native
        self.time, self._previous = native.time, native.previous
        self._event_due = self.loop.system.event_due
        self._fixed = None if math.isnan(native.fixed) else native.fixed


class CompiledMeSession(CompiledSession, MeSession):
    """Model exchange, loop and solver in compiled code."""

    _communicates = False

    def _make_solver(self) -> None:
        name = self.setup.solver
        if name == "gear" and why_missing():
            raise FmuError(f"solver gear is not available: {why_missing()}; use solver vkm")
        self._scale, self._most = (np.ascontiguousarray(a, dtype=np.float64) for a in self.scales())
        self._sparsity = newton_sparsity(self.instance.description) if name == "gear" else None
        self._native = Me(
            system=self._make_loop().system.address,
            solver_name=name.encode(),
            gear=ctypes.addressof(gear_library()) if name == "gear" else None,
            sparsity=None if self._sparsity is None else self._sparsity.address,
            rtol=self.setup.rtol,
            scale=self._scale.ctypes.data,
            most=self._most.ctypes.data,
            next_time=self._next_time,
        )
        self._patterns: dict[tuple[str, ...], Pattern] = {}
        self._begin_anew("kernel_me_open")

    def _begin_anew(self, name: str) -> None:
        """Call a function that starts the solver at the present time."""
        forcing = self.loop.force(self.forcing)
        self.loop.system.set_times(self.time)
        self._native.time = self.time
        done = getattr(self.loop.system.library, name)(ctypes.addressof(self._native))
        self.forcing.written = forcing.written[: forcing.n]
        self.loop.check(done)

    @property
    def next_event(self) -> float:
        return float(self._native.next_time)

    @property
    def evaluations(self) -> int:
        """Number of right-hand sides so far."""
        return int(self.loop.system.structure.evaluations)

    @property
    def events(self) -> int:
        """Number of events handled so far, while time passed."""
        return int(self._native.events)

    @contextmanager
    def slopes(self, times: Floats, record: Sequence[str]) -> Iterator[NativeSlopes]:
        """Yield where ∂f/∂x and ∂y/∂x along the runs made meanwhile are put.

        By the FMU's directional derivatives where it has true ones; else by differences, several states at once where
        their declared dependencies allow it. What an evaluation refutes at most of the times is not tried again.

        Args:
            times: rising, ahead of the session, shape (k,) [s].
            record: what the runs record.
        """
        names = tuple(record)
        if names not in self._patterns:
            variables = [self.setup.variables[name] for name in names]
            self._patterns[names] = slopes_pattern(self.instance, variables)
        result = NativeSlopes(times, len(names), self._patterns[names])
        self._native.slopes = result.address
        try:
            yield result
            self._patterns[names] = believed(self._patterns[names], result)
        finally:
            self._native.slopes = None

    def stand(self) -> Floats:
        """Return the states where the session stands, shape (n,)."""
        self.instance.get_states()
        return self.instance.x.copy()

    def jump(self, x: Floats) -> None:
        stand = Stand(self.instance)
        _, u = stand.read()
        stand.put(self.time, x, u)
        info = stand.event(u)
        if info.terminate:
            raise self._ended()
        there = self.stand()
        if not info.states_changed and not np.allclose(there, x, rtol=1e-12, atol=1e-300):
            i = int(np.argmax(np.abs(there - x)))
            raise NotReachedError(
                f"state {i + 1} of {len(x)} cannot be set: {x[i]:.9g} was asked for, it is {there[i]:.9g}"
            )
        self._native.next_time = info.next_time
        self._calls.append(Call(self.time, dict(self.forcing.signals), None, x=x.copy()))
        self._forget()

    def _ready(self, _: float) -> Me:
        return self._native

    def _take_over(self) -> None:
        self.time = self._native.time

    def _memory(self) -> object:
        return self._native.next_time, self._scale.copy()

    def _resume(self, memory: object) -> None:
        if not isinstance(memory, tuple):
            raise InputError("this snapshot belongs to another kind of session")
        self._native.next_time, self._scale[:] = memory
        self._forget()

    def _forget(self) -> None:
        self._begin_anew("kernel_me_restart")

    def _close_solver(self) -> None:
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.system.library.kernel_me_close(ctypes.addressof(self._native))
