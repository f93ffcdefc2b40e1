"""Limit cycles of a system with nonlinear blocks, by several methods side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.limit_cycles.limit_cycle.branch import Branch
from workbench.limit_cycles.limit_cycle.confirm import VANISHED, confirm
from workbench.limit_cycles.limit_cycle.cut import SplitLoop, cut, driven_block
from workbench.limit_cycles.limit_cycle.driven import DrivenBlock
from workbench.limit_cycles.limit_cycle.entries import contradictions, from_balance, from_run, same_cycle
from workbench.limit_cycles.limit_cycle.floquet import multipliers, others
from workbench.limit_cycles.limit_cycle.free_run import FreeRun, free_run
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle, balance, states_of
from workbench.limit_cycles.limit_cycle.over_parameter import GAIN, follow_cycles, range_of
from workbench.limit_cycles.limit_cycle.perturbed_run import Observation, observe
from workbench.limit_cycles.limit_cycle.predict import Prediction, predict
from workbench.limit_cycles.limit_cycle.request import (
    DESCRIBING_FUNCTION,
    HARMONIC_BALANCE,
    METHODS,
    SHOOTING,
    SIMULATION,
    LimitCycles,
)
from workbench.limit_cycles.limit_cycle.result import LimitCycle, LimitCycleResult, SimulatedCycle
from workbench.limit_cycles.limit_cycle.shooting import Orbits, shoot
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.nyquist.absolute import AbsoluteStability, absolute_stability
from workbench.loops.nyquist.nyquist import AMPLITUDES
from workbench.loops.nyquist.result import Crossing
from workbench.loops.opened_system import Ports
from workbench.model.described_model import DescribedModel
from workbench.model.names import check_variables, forced_inputs
from workbench.model.operating_point import named, start_at
from workbench.signals.kinds import Signal

__all__ = ["run"]

_FAR = 0.2  # logarithm of a ratio of frequencies
_OUTSIDE = 3.0  # times: so far beyond the band a cycle of harmonic balance may lie
_FASTEST = 10.0  # [Hz], where no crossing says what to expect
_SMALL_PUSH, _LARGE_PUSH = 0.1, 10.0  # nominal values of the block's input
_TIME_CONSTANTS = 40.0  # of the slowest pole: length of the first stretch of a free run
_PARTS = 100  # that a step is told of
_PHASES = 400  # at which the predicted states are looked at


def run(model: DescribedModel, request: LimitCycles, job: Job) -> LimitCycleResult:
    """Find limit cycles; see `LimitCycles`."""
    names = _outputs(model, request.outputs)
    check_variables(model, [n for n in request.vary if n != GAIN], "parameter", "state", what="vary", number=True)
    system, remarks = start_at(model, request.at)
    time = system.start_time if request.time is None else request.time
    steps, inputs = 3 + len(request.vary), forced_inputs(system, request.inputs)
    with ExitStack() as keep, one_thread():
        loop = cut(system, *request.block, at=system.at, time=time, keep=keep)
        predicted = predict(system, loop, request)
        work = _LimitCycleRun(system, loop, predicted, names, request, time, keep, job)
        work.notes += remarks
        job.partial, work.stage = work.result, (_PARTS, _PARTS * steps)
        job.done("crossings", *work.stage)
        work.run()
        job.done("limit cycles", 2 * _PARTS, _PARTS * steps)
        for count, (name, limits) in enumerate(request.vary.items(), start=2):
            work.stage = count * _PARTS, _PARTS * steps
            work.follow(name, limits)
            job.done(f"cycles over {name}", (count + 1) * _PARTS, _PARTS * steps)
        if request.run_until is not None:
            work.run_freely(request.run_until, inputs)
        job.done("run from rest", _PARTS * steps, _PARTS * steps)
        return work.result()


def _outputs(system: DescribedModel, outputs: Sequence[str] | None) -> tuple[str, ...]:
    check_variables(system, outputs or (), "variable", what="outputs")
    return tuple(outputs) if outputs is not None else tuple(v.name for v in system.outputs if v.is_number)


@dataclass
class _LimitCycleRun:
    """One analysis under way."""

    system: DescribedModel
    loop: SplitLoop
    predicted: Prediction
    outputs: tuple[str, ...]
    asked: LimitCycles
    time: float
    keep: ExitStack
    job: Job
    found: list[LimitCycle] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    simulated: SimulatedCycle | None = None
    answering: tuple[DescribedBlock, ...] = ()
    observed: list[Observation] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    following: Callable[[], Branch] | None = None
    run_from_rest: FreeRun | None = None
    absolute: AbsoluteStability | None = None
    stage: tuple[int, int] = (0, 1)

    def run(self) -> None:
        """Refine each predicted cycle; where none is predicted, look for one."""
        self.notes += [*self.loop.notes, *self.predicted.notes]
        self._prove()
        crossings, (done, total) = self.predicted.curve.crossings, self.stage
        for number, crossing in enumerate(crossings):
            if crossing.amplitude is not None:
                self._refine(number, crossing, crossing.amplitude)
            far = (number + 1) / (len(crossings) + 1)
            self.job.done(f"cycles of crossing {number + 1}", done + int(_PARTS * far), total)
        if not self.found and SIMULATION in self.asked.methods:
            self._observe()

    def _prove(self) -> None:
        """Compare the block's sector with those for which the loop is proven stable."""
        loop, block = self.loop, self.loop.block
        if block is None or len(loop.every) > 1 or loop.moving:
            return
        reach = (self.asked.amplitudes or AMPLITUDES)[1]
        try:
            self.absolute = absolute_stability(loop.part, block, reach=reach, name=self.predicted.curve.name)
        except InputError as error:
            self.notes.append(f"nothing is proven by circle and Popov criterion: {error}")

    def result(self) -> LimitCycleResult:
        """Return what is found so far; of a branch that is being followed, what there is of it."""
        shown = tuple(sorted((c for c in self.found if c.method in self.asked.methods), key=_place))
        notes = [*self.notes, *contradictions(shown, self.loop.ports.v)]
        model, ports = self.system, self.loop.ports
        return LimitCycleResult(
            model=model.name,
            interface=model.interface,
            solver=model.solver,
            block=ports.component,
            blocks=tuple(p.component for p in self.loop.every),
            input=ports.v,
            output=ports.w,
            input_unit=next((v.unit for v in model.description.variables if v.name == ports.v), None),
            nyquist=self.predicted.curve,
            limit_cycles=shown,
            simulated=self.simulated,
            observed=tuple(self.observed),
            branches=(*self.branches, *([] if self.following is None else [self.following()])),
            free_run=self.run_from_rest,
            units={v.name: v.unit for v in model.description.variables if v.name in (*self.asked.vary, ports.w)},
            notes=tuple(dict.fromkeys(notes)),
            operating_point=named(model, self.loop.point),
            absolute=self.absolute,
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
        blocks = self._blocks()
        cycle = self._balanced(number, first, blocks) if blocks else self.predicted.sine(c.frequency_hz, amplitude)
        if cycle is None:
            return
        states, sizes = self._predicted(cycle)
        if self.found[-1].method == HARMONIC_BALANCE:
            for block in blocks:
                own, moved = block.states() if isinstance(block, DrivenBlock) else ({}, {})
                states, sizes = {**states, **own}, {**sizes, **moved}
        shootable = self._is_shootable(states)
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
        if self._shot(number, run.states, run.sizes, run.frequency_hz, run.amplitude[self.loop.ports.v]):
            self.notes = [n for n in self.notes if n not in failed]

    def _is_shootable(self, states: Mapping[str, float]) -> bool:
        """Whether the states of every block with a memory are among those that are known, and nothing is delayed."""
        return not self._unknown_memories(states) and self.loop.rest.delayed is None

    def _unknown_memories(self, states: Iterable[str]) -> list[Ports]:
        """Return the blocks with a memory of which no state is among those that are known."""
        known = list(states)
        with_memory = [p for p, b in zip(self.loop.every, self.loop.blocks, strict=True) if b is None]
        return [p for p in with_memory if not any(n.startswith(f"{p.component}.") for n in known)]

    # -- where nothing is predicted ---------------------------------------------------------

    def _observe(self) -> None:
        """Run the system from its disturbed operating point: what keeps oscillating is a cycle not predicted."""
        rest = self.loop.rest
        size = next((v.nominal for v in self.system.description.variables if v.name == self.loop.ports.v), None) or 1.0
        low, high = self.asked.amplitudes or (_SMALL_PUSH * size, _LARGE_PUSH * size)
        speeds = np.abs(self.loop.whole.poles)
        slowest = float(speeds[speeds > 0.0].min(initial=np.inf))
        seconds = _TIME_CONSTANTS / slowest if np.isfinite(slowest) else 1.0 / self.asked.band[0]
        for push in (float(np.sqrt(low * high)), high):
            moved = self._pushed(push)
            values = {**self.loop.point.u, **rest.operating_point.x, **moved}
            try:
                seen = observe(
                    self.system, values=values, states=list(rest.states), watch=self.loop.ports.v, push=push,
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
        rest = self.loop.rest
        names, c = list(rest.states), rest.C[0, list(rest.states.values())]
        nominal = {v.name: v.nominal for v in self.system.states}
        sizes = np.array([abs(nominal.get(n) or 1.0) for n in names])
        square = float(((sizes * c) ** 2).sum())
        moved = sizes**2 * c * push / square if square > 0.0 else np.zeros(len(names))
        return {n: rest.operating_point.x[n] + d for n, d in zip(names, moved.tolist(), strict=True)}

    def _unpredicted(self, seen: Observation, frequency: float) -> None:
        run = self._confirmed(None, seen.states, frequency=frequency, amplitude=seen.swing)
        if run is not None and run.steady and self._is_shootable(run.states):
            self._shot(None, run.states, run.sizes, run.frequency_hz, run.amplitude[self.loop.ports.v])

    def _blocks(self) -> tuple[DescribedBlock, ...]:
        """Return the blocks as harmonic balance asks them; none where one has a memory, and only N is asked for."""
        loop = self.loop
        needs_none = set(self.asked.methods) <= {DESCRIBING_FUNCTION} and not self.asked.vary
        if not self.answering and not (needs_none and None in loop.blocks):
            self.answering = tuple(self._driven(i) if block is None else block for i, block in enumerate(loop.blocks))
        return self.answering

    def _driven(self, number: int) -> DrivenBlock:
        """Return a block with a memory as harmonic balance drives it."""
        loop, ports, count = self.loop, self.loop.every[number], self.asked.harmonics
        centre, rest = loop.centres[number], loop.outputs[number]
        alone = self.keep.enter_context(driven_block(self.system, ports, count, centre=centre))
        driven = DrivenBlock(alone, count=count, name=ports.component, time=self.time, centre=centre, rest=rest)
        self.keep.callback(driven.close)
        return driven

    def run_freely(self, stop: float, inputs: Mapping[str, Signal]) -> None:
        """Run from rest."""
        result = [c.frequency_hz for c in self.predicted.curve.crossings if c.amplitude is not None]
        fastest = max(result) if result else _FASTEST
        v, begin = self.loop.ports.v, self.time
        self.run_from_rest = free_run(self.system, v, stop=stop, inputs=inputs, fastest=fastest, start_time=begin)

    def follow(self, name: str, limits: tuple[float, float]) -> None:
        """Follow the closed orbits that shooting found over a parameter, each branch once.

        Args:
            name: of the parameter.
            limits: lowest and highest value.
        """
        over = range_of(self.system, name, limits, ports=self.loop.ports, time=self.time)
        cycles = [c for c in self.found if c.method == SHOOTING]
        if not cycles:
            kept = [p.component for p in self._unknown_memories([v.name for v in self.system.states])]
            kept += ["a delay"] if self.loop.rest.delayed is not None else []
            why = f"; shooting cannot set what {', '.join(kept)} keeps besides continuous states" if kept else ""
            self.notes.append(f"{name}: shooting found no cycle that could be followed{why}")
        done, total = self.stage

        def orbits(opened: Callable[[float], DescribedModel], cycle: LimitCycle) -> Orbits:
            states = cycle.states or {}
            sizes = {n: max(abs(x), 1e-6) for n, x in states.items()}
            v = self.loop.ports.v
            return Orbits(opened, tuple(states), sizes, self.loop.point.u, v, self.time, varied=True)

        def ended(branch: Branch) -> None:
            self.branches.append(branch)
            self.following = None

        def begun(so_far: Callable[[], Branch]) -> None:
            self.following = so_far

        self.notes += follow_cycles(
            cycles,
            over,
            orbits,
            stopped=lambda: self.job.stopped,
            told=lambda part, value: self.job.done(f"{name} = {value:.6g}", done + int(_PARTS * part), total),
            begun=begun,
            ended=ended,
        )

    def _balanced(self, number: int, first: LimitCycle, blocks: tuple[DescribedBlock, ...]) -> Cycle | None:
        """Return the motion by harmonic balance; where it leads nowhere, the sine; None: it has been found before."""
        part, sine = self.loop.whole, self.predicted.sine(first.frequency_hz, first.amplitude)
        cycle = balance(
            part, blocks, frequency=sine.frequency, amplitude=first.amplitude, others=sine.v[1:, 1].tolist(),
            count=self.asked.harmonics,
        )  # fmt: skip
        if cycle is None:
            self.notes.append(f"crossing {number + 1}: harmonic balance finds no cycle near it")
            return sine
        if not self.asked.band[0] / _OUTSIDE <= cycle.frequency <= self.asked.band[1] * _OUTSIDE:
            self.notes.append(
                f"crossing {number + 1}: harmonic balance leads out of the band, to {cycle.frequency:.3g} Hz; "
                "that is not accepted as a cycle"
            )
            return sine
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
        driven = [b for b in blocks if isinstance(b, DrivenBlock)]
        self.notes += [
            f"block {b.name}: its response to a periodic input is not periodic" for b in driven if not b.settled
        ]
        floquet, doubt = (None, 0.0) if driven else others(multipliers(part, blocks, cycle))
        if floquet is None and not driven:
            self.notes.append(
                f"crossing {number + 1}: harmonic balance with {self.asked.harmonics} harmonics does not give the "
                "multiplier 1 that every cycle has; its stability is not known (more harmonics, or shooting)"
            )
        own = {n: x for b in driven for n, x in b.states()[0].items()}
        states = {**self._predicted(cycle)[0], **own}
        self.found.append(from_balance(number, cycle, self.loop, floquet, doubt=doubt, states=states))
        return cycle

    def _predicted(self, cycle: Cycle) -> tuple[dict[str, float], dict[str, float]]:
        """Return the states of the linear part at phase 0, and how far each moves."""
        names = list(self.loop.rest.states)
        with np.errstate(all="ignore"):
            along = states_of(self.loop.whole, cycle, np.linspace(0.0, 2.0 * np.pi, _PHASES, endpoint=False))
        along = along[:, list(self.loop.rest.states.values())]
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
        if SHOOTING not in self.asked.methods and not self.asked.vary:
            return False
        orbit = shoot(
            self.system, states=states, sizes=sizes, frequency=frequency, inputs=self.loop.point.u,
            watch=[p.v for p in self.loop.every], time=self.time,
        )  # fmt: skip
        if not isinstance(orbit, str) and orbit.amplitude < VANISHED * amplitude:
            orbit = "shooting leads to an equilibrium, not to a cycle"
        if isinstance(orbit, str):
            self.notes.append(f"{_named(number)}: {orbit}")
            return False
        self.found.append(replace(orbit, crossing=number))
        return True

    def _confirmed(
        self, number: int | None, states: Mapping[str, float], *, frequency: float, amplitude: float
    ) -> SimulatedCycle | None:
        """Simulate from a predicted state; None: no oscillation stays."""
        run = confirm(
            self.system,
            number,
            states=states,
            inputs=self.loop.point.u,
            frequency=frequency,
            amplitude=amplitude,
            watch=self.loop.ports.v,
            outputs=[*(p.v for p in self.loop.every), *self.outputs],
            time=self.time,
            periods=self.asked.max_periods,
        )
        if isinstance(run, str):
            self.notes.append(f"{_named(number)}: {run}")
            return None
        if not run.steady:
            self.notes.append(f"{_named(number)}: simulation not steady after {run.periods} periods")
        self.found.append(from_run(run, [p.v for p in self.loop.every]))
        self.simulated = self.simulated or run
        return run


def _place(c: LimitCycle) -> tuple[int, int]:
    return (10**9 if c.crossing is None else c.crossing, METHODS.index(c.method))


def _named(number: int | None) -> str:
    return "free run" if number is None else f"crossing {number + 1}"
