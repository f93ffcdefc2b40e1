"""Limit cycles of a system with one nonlinear block, by several methods side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from workbench.analysis.describing.base import Block
from workbench.analysis.limit_cycle.branch import Branch, BranchPoint
from workbench.analysis.limit_cycle.confirm import Simulated, confirm
from workbench.analysis.limit_cycle.continuation import Family, follow
from workbench.analysis.limit_cycle.cut import SplitLoop, cut, driven_block, only_block
from workbench.analysis.limit_cycle.driven import DrivenBlock
from workbench.analysis.limit_cycle.entries import (
    contradictions,
    from_orbit,
    from_run,
    largest_multiplier,
    same_cycle,
    simulated_cycle,
)
from workbench.analysis.limit_cycle.family import GAIN, SystemFamily, gain_family
from workbench.analysis.limit_cycle.floquet import multipliers, others
from workbench.analysis.limit_cycle.free_run import FreeRun, free_run
from workbench.analysis.limit_cycle.harmonic_balance import Cycle, balance, states_of
from workbench.analysis.limit_cycle.measure import measured_crossings
from workbench.analysis.limit_cycle.observe import Observation, observe
from workbench.analysis.limit_cycle.request import (
    DESCRIBING_FUNCTION,
    HARMONIC_BALANCE,
    METHODS,
    SHOOTING,
    SIMULATION,
    LimitCycles,
)
from workbench.analysis.limit_cycle.result import LimitCycle, LimitCycleResult, SimulatedCycle
from workbench.analysis.limit_cycle.shooting import Orbits, follow_orbits, shoot
from workbench.analysis.nyquist.nyquist import AMPLITUDES, nyquist
from workbench.analysis.nyquist.result import Crossing, NyquistResult
from workbench.analysis.periodic.continuation import Manner, Place
from workbench.analysis.periodic.stability import is_stable
from workbench.core.blas import one_thread
from workbench.core.job import Job
from workbench.errors import InputError, SimulationError
from workbench.model.described import DescribedModel
from workbench.model.names import check_variables
from workbench.model.placing import named, start_at
from workbench.model.varied import Varied
from workbench.signals import Signal, signals_of

__all__ = ["run"]

_ON_BRANCH = 0.02  # interpolated
_FAR = 0.2  # logarithm of a ratio of frequencies
_OUTSIDE = 3.0  # times: so far beyond the band a cycle of harmonic balance may lie
_VANISHED = 1e-3  # of the predicted amplitude: an orbit smaller than that is the equilibrium
_FASTEST = 10.0  # [Hz], where no crossing says what to expect
_SMALL_PUSH, _LARGE_PUSH = 0.1, 10.0  # nominal values of the block's input
_TIME_CONSTANTS = 40.0  # of the slowest pole: length of the first stretch of a free run
_PARTS = 100  # that a step is told of
_PHASES = 400  # at which the predicted states are looked at


def run(model: DescribedModel, asked: LimitCycles, job: Job) -> LimitCycleResult:
    """Find limit cycles; see `LimitCycles`."""
    names = _outputs(model, asked.outputs)
    check_variables(model, [n for n in asked.vary if n != GAIN], "parameter", "state", what="vary", number=True)
    system, remarks = start_at(model, asked.at)
    time = system.start_time if asked.time is None else asked.time
    steps = 3 + len(asked.vary)
    with ExitStack() as keep, one_thread():
        loop = cut(system, asked.block, at=system.at, time=time, keep=keep)
        curve = _crossings(system, loop, asked)
        job.done("crossings", _PARTS, _PARTS * steps)
        work = _Work(system, loop, curve, names, asked, time, keep, job)
        result = work.run()
        job.partial = lambda: replace(result, branches=work.followed_so_far())
        job.done("limit cycles", 2 * _PARTS, _PARTS * steps)
        for count, (name, limits) in enumerate(asked.vary.items(), start=2):
            work.stage = count * _PARTS, _PARTS * steps
            work.follow(name, limits)
            job.done(f"cycles over {name}", (count + 1) * _PARTS, _PARTS * steps)
        units = {v.name: v.unit for v in system.description.variables if v.name in asked.vary}
        run_freely = None if asked.run_until is None else work.run_freely(asked.run_until, signals_of(asked.inputs))
        job.done("run from rest", _PARTS * steps, _PARTS * steps)
        return replace(
            result,
            branches=tuple(work.branches),
            free_run=run_freely,
            units=units,
            notes=tuple(dict.fromkeys([*remarks, *work.notes])),
            operating_point=named(system, loop.point),
        )


def _outputs(system: DescribedModel, outputs: Sequence[str] | None) -> tuple[str, ...]:
    check_variables(system, outputs or (), "variable", what="outputs")
    return tuple(outputs) if outputs is not None else tuple(v.name for v in system.outputs if v.is_number)


def _crossings(system: DescribedModel, loop: SplitLoop, asked: LimitCycles) -> NyquistResult:
    name, band, amplitudes = f"{system.name}: loop through {loop.ports.component}", asked.band, asked.amplitudes
    if loop.block is not None:
        return nyquist(loop.part, loop.block, band=band, amplitudes=amplitudes or AMPLITUDES, name=name)
    if amplitudes is None:
        raise InputError(
            f"{system.name}: block {loop.ports.component} has a memory of its own and must be measured; "
            "give amplitudes (lowest, highest) and a band"
        )
    with only_block(system, loop.ports, centre=loop.centre) as alone:
        return measured_crossings(
            alone, loop.part, amplitudes=amplitudes, band=band, name=loop.ports.component, workers=asked.workers
        )


@dataclass
class _Work:
    """One analysis under way."""

    system: DescribedModel
    loop: SplitLoop
    curve: NyquistResult
    outputs: tuple[str, ...]
    asked: LimitCycles
    time: float
    keep: ExitStack
    job: Job
    found: list[LimitCycle] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    simulated: SimulatedCycle | None = None
    driven: DrivenBlock | None = None
    cycles: list[Cycle] = field(default_factory=list)
    observed: list[Observation] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    following: list[Callable[[], Branch]] = field(default_factory=list)
    stage: tuple[int, int] = (0, 1)

    def followed_so_far(self) -> tuple[Branch, ...]:
        """Return the branches that were followed, the last as far as it goes."""
        return (*self.branches, *(branch() for branch in self.following))

    def run(self) -> LimitCycleResult:
        self.notes += self.loop.notes
        for number, crossing in enumerate(self.curve.crossings):
            if crossing.amplitude is not None:
                self._refine(number, crossing, crossing.amplitude)
        if not self.found and SIMULATION in self.asked.methods:
            self._observe()
        self.notes += contradictions(self.found, self.loop.ports.v)
        model, ports = self.system, self.loop.ports
        return LimitCycleResult(
            model=model.name,
            interface=model.interface,
            solver=model.solver,
            block=ports.component,
            input=ports.v,
            output=ports.w,
            input_unit=next((v.unit for v in model.description.variables if v.name == ports.v), None),
            nyquist=self.curve,
            limit_cycles=tuple(sorted((c for c in self.found if c.method in self.asked.methods), key=_place)),
            simulated=self.simulated,
            observed=tuple(self.observed),
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _refine(self, number: int, c: Crossing, amplitude: float) -> None:
        first = LimitCycle(
            method=DESCRIBING_FUNCTION, crossing=number, frequency_hz=c.frequency_hz, amplitude=amplitude,
            fundamental=amplitude, mean=self.loop.centre, stable=c.stable,
        )  # fmt: skip
        self.found.append(first)
        if c.distortion is not None and c.distortion > 0.05:
            self.notes.append(
                f"crossing {number + 1}: a harmonic of {100.0 * c.distortion:.3g} % returns to the block; "
                "the describing function is a rough estimate there"
            )
        block = self.loop.block if self.loop.block is not None else self._driven()
        cycle = None if block is None else self._balanced(number, first, block)
        if block is not None and cycle is None:
            return
        cycle = cycle or self._sine(first)
        states, sizes = self._predicted(cycle)
        if isinstance(block, DrivenBlock) and self.found[-1].method == HARMONIC_BALANCE:
            own, moved = block.states()
            states, sizes = {**states, **own}, {**sizes, **moved}
        shootable = self.loop.block is not None or len(states) > len(self.loop.rest.state_names)
        before = len(self.notes)
        shot = shootable and self._shot(number, states, sizes, cycle.frequency, cycle.amplitude)
        failed = self.notes[before:]
        last = self.found[-1]
        stable = c.stable if last.stable is None else last.stable
        if SIMULATION not in self.asked.methods or stable is False:
            return
        run = self._confirmed(number, last.states or states, frequency=last.frequency_hz, amplitude=last.amplitude)
        if run is None or not run.steady or not shootable or shot:
            return
        if self._shot(number, run.states, run.sizes, run.frequency, run.amplitude[self.loop.ports.v]):
            self.notes = [n for n in self.notes if n not in failed]

    # -- where nothing is predicted ---------------------------------------------------------

    def _observe(self) -> None:
        """Run the system from its disturbed operating point: what keeps oscillating is a cycle not predicted."""
        part, rest = self.loop.part, self.loop.rest
        size = next((v.nominal for v in self.system.description.variables if v.name == self.loop.ports.v), None) or 1.0
        low, high = self.asked.amplitudes or (_SMALL_PUSH * size, _LARGE_PUSH * size)
        speeds = np.abs(part.poles)
        slowest = float(speeds[speeds > 0.0].min(initial=np.inf))
        seconds = _TIME_CONSTANTS / slowest if np.isfinite(slowest) else 1.0 / self.asked.band[0]
        for push in (float(np.sqrt(low * high)), high):
            moved = self._pushed(push)
            values = {**self.loop.point.u, **rest.operating_point.x, **moved}
            try:
                seen = observe(
                    self.system, values=values, states=list(rest.state_names), watch=self.loop.ports.v, push=push,
                    seconds=seconds, time=self.time,
                )  # fmt: skip
            except (InputError, SimulationError) as error:
                self.notes.append(f"the system cannot be run from a disturbed operating point: {error}")
                return
            self.observed.append(seen)
            if seen.outcome == "oscillation" and seen.frequency_hz is not None:
                self._unpredicted(seen, seen.frequency_hz)
                return

    def _pushed(self, push: float) -> dict[str, float]:
        """Return states of the linear part that move the block's input by `push`, each by the same part of its size."""
        names, c = self.loop.rest.state_names, self.loop.part.c
        nominal = {v.name: v.nominal for v in self.system.states}
        sizes = np.array([abs(nominal.get(n) or 1.0) for n in names])
        square = float(((sizes * c) ** 2).sum())
        moved = sizes**2 * c * push / square if square > 0.0 else np.zeros(len(names))
        return {n: self.loop.rest.operating_point.x[n] + d for n, d in zip(names, moved.tolist(), strict=True)}

    def _unpredicted(self, seen: Observation, frequency: float) -> None:
        run = self._confirmed(None, seen.states, frequency=frequency, amplitude=seen.swing)
        if run is not None and run.steady and self.loop.block is not None:
            self._shot(None, run.states, run.sizes, run.frequency, run.amplitude[self.loop.ports.v])

    def _driven(self) -> DrivenBlock | None:
        """Return the block with a memory as harmonic balance drives it; None: only its describing function is asked."""
        if set(self.asked.methods) <= {DESCRIBING_FUNCTION}:
            return None
        if self.driven is None:
            loop = self.loop
            alone = self.keep.enter_context(
                driven_block(self.system, loop.ports, self.asked.harmonics, centre=loop.centre)
            )
            name = self.loop.ports.component
            self.driven = DrivenBlock(
                alone, count=self.asked.harmonics, name=name, time=self.time, centre=loop.centre, rest=loop.output
            )
            self.keep.callback(self.driven.close)
        return self.driven

    def run_freely(self, stop: float, inputs: Mapping[str, Signal]) -> FreeRun:
        """Return the run from rest."""
        found = [c.frequency_hz for c in self.curve.crossings if c.amplitude is not None]
        fastest = max(found) if found else _FASTEST
        return free_run(self.system, self.loop.ports.v, stop=stop, inputs=inputs, fastest=fastest, start_time=self.time)

    def follow(self, name: str, limits: tuple[float, float]) -> None:
        """Follow the cycles that were found over a parameter, each branch once.

        Those that shooting found are followed by it; else harmonic balance follows its own.

        Args:
            name: of the parameter.
            limits: lowest and highest value.
        """
        block = self.loop.block
        if block is None or (name != GAIN and any(c.method == SHOOTING for c in self.found)):
            self._follow_orbits(name, limits)
            return
        family, start = self._family(name, block, limits)
        if not limits[0] <= start <= limits[1] or not limits[0] < limits[1]:
            raise InputError(f"{name}: its value {start:g} must lie between the limits {limits[0]:g} and {limits[1]:g}")
        before = len(self.branches)
        for cycle in self.cycles:
            if not any(_passes(b, start, cycle.fundamental, lambda p: p.fundamental) for b in self.branches[before:]):
                self.branches.append(follow(family, parameter=name, start=start, limits=limits, cycle=cycle))

    def _follow_orbits(self, name: str, limits: tuple[float, float]) -> None:
        """Follow the closed orbits that shooting found over a parameter of the system."""
        if name == GAIN:
            self.notes.append("gain: it is no parameter of a measured loop; vary one of the system's")
            return
        with self.system.open_session(start_time=self.time) as session:
            start = session.values([name])[name]
        if not limits[0] < start < limits[1]:
            raise InputError(f"{name}: its value {start:g} must lie between the limits {limits[0]:g} and {limits[1]:g}")
        varied, span = Varied(self.system, name), limits[1] - limits[0]
        self.keep.callback(varied.close)
        before = len(self.branches)
        cycles = [c for c in self.found if c.method == SHOOTING]
        done, total = self.stage
        seen = 0.0

        def told(place: Place) -> None:
            nonlocal seen
            p = (start - limits[0]) / span
            far = min(abs(place.p - p) / (1.0 - p if place.p > p else p), 1.0)
            seen = max(seen, number + far)
            part = int(0.99 * _PARTS * seen / len(cycles))
            self.job.done(f"{name} = {limits[0] + span * place.p:.6g}", done + part, total)

        number = 0
        for number, cycle in enumerate(cycles):  # noqa: B007 - `told` does
            states = cycle.states or {}
            if any(_passes(b, start, cycle.amplitude, lambda p: p.amplitude) for b in self.branches[before:]):
                continue
            sizes = {n: max(abs(x), 1e-6) for n, x in states.items()}
            orbits = Orbits(
                lambda p: varied.at(limits[0] + span * p), tuple(states), sizes, self.loop.point.u, self.loop.ports.v,
                self.time, varied=True,
            )  # fmt: skip
            try:
                first = orbits.arrive(states, cycle.frequency_hz, (start - limits[0]) / span)
            except SimulationError as error:
                self.notes.append(f"{name}: the cycle of {cycle.frequency_hz:.4g} Hz cannot be followed: {error}")
                continue
            manner = Manner(stopped=lambda: self.job.stopped, told=told)
            self.branches.append(
                follow_orbits(orbits, first, parameter=name, limits=limits, manner=manner, begun=self.following.append)
            )
            self.following.clear()

    def _family(self, name: str, block: Block, limits: tuple[float, float]) -> tuple[Family, float]:
        if name == GAIN:
            return (lambda value: gain_family(self.loop.part, block, value)), 1.0
        family = SystemFamily(self.system, self.loop, name, time=self.time, keep=self.keep)
        family.prepare(*limits)
        with self.system.open_session(start_time=self.time) as session:
            return family, session.values([name])[name]

    def _sine(self, first: LimitCycle) -> Cycle:
        """Return a describing function's prediction as a motion of the linear part."""
        v = np.array([0.0, -1j * first.amplitude], dtype=np.complex128)
        with np.errstate(all="ignore"):
            value = complex(self.loop.part.response(np.array([first.frequency_hz]))[0])
            w = -v[1] / np.complex128(value)
        return Cycle(first.frequency_hz, v, np.array([0.0, w], dtype=np.complex128))

    def _balanced(self, number: int, first: LimitCycle, block: Block) -> Cycle | None:
        part = self.loop.part
        cycle = balance(
            part, block, frequency=first.frequency_hz, amplitude=first.amplitude, count=self.asked.harmonics
        )
        if cycle is None:
            self.notes.append(f"crossing {number + 1}: harmonic balance finds no cycle near it")
            return self._sine(first)
        if not self.asked.band[0] / _OUTSIDE <= cycle.frequency <= self.asked.band[1] * _OUTSIDE:
            self.notes.append(
                f"crossing {number + 1}: harmonic balance leads out of the band, to {cycle.frequency:.3g} Hz; "
                "that is not accepted as a cycle"
            )
            return self._sine(first)
        for other in self.found:
            if other.method == HARMONIC_BALANCE and other.crossing is not None and same_cycle(other, cycle):
                self.notes.append(
                    f"crossing {number + 1}: harmonic balance leads to the cycle of crossing {other.crossing + 1}"
                )
                return None
        if abs(np.log(cycle.frequency / first.frequency_hz)) > _FAR:
            self.notes.append(
                f"crossing {number + 1}: harmonic balance leads from {first.frequency_hz:.4g} to "
                f"{cycle.frequency:.4g} Hz, far from the describing function"
            )
        driven = isinstance(block, DrivenBlock)
        if isinstance(block, DrivenBlock) and not block.settled:
            self.notes.append(f"block {block.name}: its response to a periodic input is not periodic")
        if not driven:
            self.cycles.append(cycle)
        floquet, doubt = (None, 0.0) if driven else others(multipliers(part, block, cycle))
        if floquet is None and not driven:
            self.notes.append(
                f"crossing {number + 1}: harmonic balance with {self.asked.harmonics} harmonics does not give the "
                "multiplier 1 that every cycle has; its stability is not known (more harmonics, or shooting)"
            )
        self.found.append(
            LimitCycle(
                method=HARMONIC_BALANCE,
                crossing=number,
                frequency_hz=cycle.frequency,
                amplitude=cycle.amplitude,
                fundamental=cycle.fundamental,
                mean=self.loop.centre + float(cycle.v[0].real),
                stable=is_stable(floquet, doubt=doubt),
                multiplier=largest_multiplier(floquet),
                residual=cycle.residual,
                states={**self._predicted(cycle)[0], **(block.states()[0] if isinstance(block, DrivenBlock) else {})},
            )
        )
        return cycle

    def _predicted(self, cycle: Cycle) -> tuple[dict[str, float], dict[str, float]]:
        """Return the states of the linear part at phase 0, and how far each moves."""
        names = self.loop.rest.state_names
        with np.errstate(all="ignore"):
            along = states_of(self.loop.part, cycle, np.linspace(0.0, 2.0 * np.pi, _PHASES, endpoint=False))
        rest = self.loop.rest.operating_point.x
        if not np.isfinite(along).all():  # the linear part has a pole at that very frequency
            pushed = self._pushed(cycle.amplitude)
            return pushed, {n: max(abs(pushed[n] - rest[n]), 1e-3 * cycle.amplitude) for n in names}
        states = {n: rest[n] + x for n, x in zip(names, along[0].tolist(), strict=True)}
        return states, dict(zip(names, np.ptp(along, axis=0).tolist(), strict=True))

    def _shot(
        self,
        number: int | None,
        states: Mapping[str, float],
        sizes: Mapping[str, float],
        frequency: float,
        amplitude: float,
    ) -> bool:
        """Look for the closed orbit near a motion; whether there is one."""
        if SHOOTING not in self.asked.methods:
            return False
        orbit = shoot(
            self.system, states=states, sizes=sizes, frequency=frequency, inputs=self.loop.point.u,
            watch=self.loop.ports.v, time=self.time,
        )  # fmt: skip
        if not isinstance(orbit, str) and orbit.amplitude < _VANISHED * amplitude:
            orbit = "shooting leads to an equilibrium, not to a cycle"
        if isinstance(orbit, str):
            self.notes.append(f"{_named(number)}: {orbit}")
            return False
        self.found.append(from_orbit(number, orbit))
        return True

    def _confirmed(
        self, number: int | None, states: Mapping[str, float], *, frequency: float, amplitude: float
    ) -> Simulated | None:
        """Simulate from a predicted state; None: no oscillation stays."""
        run = confirm(
            self.system,
            states=states,
            inputs=self.loop.point.u,
            frequency=frequency,
            amplitude=amplitude,
            watch=self.loop.ports.v,
            outputs=self.outputs,
            end=[v.name for v in self.system.states],
            time=self.time,
            periods=self.asked.periods,
        )
        if isinstance(run, str):
            self.notes.append(f"{_named(number)}: {run}")
            return None
        if run.note:
            self.notes.append(f"{_named(number)}: simulation {run.note}")
        self.found.append(from_run(number, run, self.loop.ports.v))
        if self.simulated is None:
            self.simulated = simulated_cycle(self.system, number, run, frequency, amplitude)
        return run


def _place(c: LimitCycle) -> tuple[int, int]:
    return (10**9 if c.crossing is None else c.crossing, METHODS.index(c.method))


def _named(number: int | None) -> str:
    return "free run" if number is None else f"crossing {number + 1}"


def _passes(branch: Branch, value: float, size: float, of: Callable[[BranchPoint], float]) -> bool:
    """Whether a branch has a cycle of a size at a value of its parameter."""
    for a, b in pairwise(branch.points):
        if (a.value - value) * (b.value - value) <= 0.0 and a.value != b.value:
            part = (value - a.value) / (b.value - a.value)
            if abs((of(a) + part * (of(b) - of(a))) / size - 1.0) < _ON_BRANCH:
                return True
    return False
