"""The nonlinear block of a system, and the limit cycles that a feedback's gain leaves."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import FeedbackPath
from workbench.limit_cycles.limit_cycle.cut import SplitLoop, cut
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.nyquist.nyquist import nyquist
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.loops.opened_system import find_ports
from workbench.model.described_model import DescribedModel
from workbench.point.lin.result import LinResult
from workbench.system.description import BlockComponent, Component, FmuComponent, FunctionComponent
from workbench.system.model import SystemModel

__all__ = ["CyclesLeft", "TwoPorts", "cut_at", "cycles_in", "find_block"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CyclesLeft(RecordPart):
    """The limit cycles of the closed loop for one gain, by the describing function.

    Attributes:
        gain: g.
        cycles: crossings of the linear part with −1/N(A) to which an amplitude belongs, rising in frequency.
        unstable_small: poles in the right half-plane with the block's gain at the smallest amplitude looked at.
        unstable_large: the same at the largest.
        curve: the Nyquist curve of the linear part, from the block's output to its input, the feedback closed; None:
            read from a file, which does not hold it.
    """

    gain: float
    cycles: tuple[Crossing, ...]
    unstable_small: int
    unstable_large: int
    curve: NyquistResult | None = field(default=None, metadata=entry(kept=False))

    @property
    def words(self) -> str:
        """What remains, in a few words."""
        steady = [c for c in self.cycles if c.stable]
        if steady:
            return "; ".join(f"cycle at {c.frequency_hz:.4g} Hz, amplitude {c.amplitude:.4g}" for c in steady)
        if self.unstable_small and self.unstable_large:
            return "unstable at every amplitude"
        if self.unstable_small:
            return "unstable at small amplitudes"
        if self.cycles:
            least = min(c.amplitude or 0.0 for c in self.cycles)
            return f"settles from amplitudes below {least:.4g}; not from all larger ones"
        if self.unstable_large:
            return "small motions settle, large ones grow; no cycle lies between"
        return "no cycle predicted: small and large motions settle"

    def derived(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"words": self.words}


def cycles_in(result: NyquistResult) -> tuple[Crossing, ...]:
    """Return the crossings to which an amplitude belongs."""
    return tuple(c for c in result.crossings if c.amplitude is not None)


class _Remembering(DescribedBlock):
    """A block whose N(A) is evaluated once for each amplitude, for many gains."""

    def __init__(self, block: DescribedBlock) -> None:
        self.name, self.real, self.frequency_dependent = block.name, block.real, block.frequency_dependent
        self._block = block
        self._known: dict[tuple[float, float], complex] = {}

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        return self._block.answer(v, frequency, count)

    def static(self, v: Floats) -> Floats:
        return self._block.static(v)

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        key = (amplitude, frequency if self.frequency_dependent else 1.0)
        if key not in self._known:
            self._known[key] = self._block.gain(amplitude, frequency)
        return self._known[key]


@dataclass(frozen=True, eq=False)
class TwoPorts:
    """The system without block and feedback: from the block's output and the target to the block's input and source.

    Attributes:
        lin: with these two inputs and outputs.
        loop: of the system without feedback, cut at the block.
    """

    lin: LinResult
    loop: SplitLoop

    @cached_property
    def block(self) -> DescribedBlock | None:
        """The block about the operating point; None: it is not static."""
        return None if self.loop.block is None else _Remembering(self.loop.block)

    def part(self, gain: float) -> LinearPart:
        """Return the linear part that the block sees with u = g·y.

        Args:
            gain: g.
        """
        return self.lin.with_feedback(gain, input=1, output=1).part(sign=1.0 if self.loop.turned else -1.0)

    def left(self, gain: float, *, band: tuple[float, float], amplitudes: tuple[float, float]) -> CyclesLeft:
        """Return the limit cycles that remain with u = g·y.

        Args:
            gain: g.
            band: frequencies looked at [Hz].
            amplitudes: at the block's input.

        Raises:
            InputError: the block is not static.
        """
        if self.block is None:
            raise InputError(f"{self.loop.ports.component} is not static; its cycles are not predicted here")
        part = self.part(gain)
        result = nyquist(part, self.block, band=band, amplitudes=amplitudes, name=f"gain {gain:.4g}")
        small, large = (part.unstable(self.block.gain(a)) for a in amplitudes)
        return CyclesLeft(gain=gain, cycles=cycles_in(result), unstable_small=small, unstable_large=large, curve=result)


def find_block(model: DescribedModel) -> tuple[str | None, str]:
    """Return the only component that may be a nonlinear block, and in words why there is none.

    Candidates are Python functions, FMUs and nonlinear blocks, with one input and one output connected, without a
    memory of their own.

    Args:
        model: a system; of one FMU there is no block.
    """
    if not isinstance(model, SystemModel):
        return None, "the system has no model exchange parts, so there is no block that could make limit cycles"
    connected = [c.name for c in model.system.components if _connected(model, c)]
    result = [n for n in connected if not any(v.name.startswith(f"{n}.") for v in model.states)]
    result = result or [n for n in connected if _is_static(model, n)]
    if len(result) == 1:
        return result[0], ""
    if not result:
        return None, "no component looks like a static nonlinear block, so no limit cycles are searched for"
    return None, f"{', '.join(result)} may be the nonlinear block; name one (block) to search for limit cycles"


def _connected(model: SystemModel, component: Component) -> bool:
    linear = isinstance(component, BlockComponent) and component.block.is_linear
    if linear or not isinstance(component, FunctionComponent | FmuComponent | BlockComponent):
        return False
    try:
        find_ports(model, component.name)
    except InputError:
        return False
    return True


def _is_static(model: SystemModel, name: str) -> bool:
    """Whether the states of a component lead nowhere, as the one that OpenModelica adds."""
    with ExitStack() as keep:
        try:
            return cut(model, name, at=None, time=0.0, keep=keep).block is not None
        except WorkbenchError:
            return False


def cut_at(
    place: FeedbackPath,
    point: OperatingPoint,
    component: str,
    *,
    time: float,
    keep: ExitStack,
    actuator: Actuator | None = None,
) -> TwoPorts:
    """Return a system opened at its block and at the feedback.

    Args:
        place: of the feedback.
        point: where it is linearised.
        component: the block.
        time: session time [s].
        keep: closes the models that the block needs for its evaluation.
        actuator: before the target.

    Raises:
        InputError: unknown component, or not one input and one output of it connected.
    """
    for role, name in (("source", place.source), ("target", place.target)):
        if name.startswith(f"{component}."):
            raise InputError(
                f"{place.model.name}: block {component} contains the feedback's {role} {name}; name another"
            )
    ports = find_ports(place.model, component)
    loop = cut(place.model, component, at=point, time=time, keep=keep)
    return TwoPorts(place.two_ports(ports, point, time=time, actuator=actuator), loop)
