"""What the limit-cycle analysis of a system found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.limit_cycles.limit_cycle.branch import Branch
from workbench.limit_cycles.limit_cycle.free_run import FreeRun
from workbench.limit_cycles.limit_cycle.perturbed_run import Observation
from workbench.loops.nyquist.absolute import AbsoluteStability
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.show.result import Result

__all__ = ["LimitCycle", "LimitCycleResult", "SimulatedCycle"]


@dataclass(frozen=True, eq=False, kw_only=True)
class LimitCycle(RecordPart):
    """One limit cycle by one method.

    Attributes:
        method: "describing function", "harmonic balance", "shooting" or "simulation".
        crossing: position of the crossing that it comes from in `LimitCycleResult.crossings`; None: a free run.
        frequency_hz: [Hz].
        amplitude: half the peak-to-peak value of the block's input, of several blocks the first one's.
        fundamental: amplitude of its fundamental.
        mean: mean of the block's input, in its unit.
        amplitudes: input of each block, in a simulation each output asked for, too → half its peak-to-peak value;
            empty: not known.
        stable: by pole counts (describing function), Floquet multipliers (harmonic balance, shooting), or because
            the simulation stayed; None: not known, as where no multiplier is 1.
        multiplier: largest Floquet multiplier besides the one at 1, its size; None: not computed.
        residual: residual of the method's equations, relative; None: it has none.
        states: state → value at one point of the cycle; empty: not known.
    """

    method: str
    crossing: int | None
    frequency_hz: float
    amplitude: float
    fundamental: float
    mean: float = 0.0
    amplitudes: Mapping[str, float] = field(default_factory=dict)
    stable: bool | None = None
    multiplier: float | None = None
    residual: float | None = None
    states: Mapping[str, float] | None = None

    @property
    def number(self) -> str:
        """Number of its crossing, counted from 1; "" for a cycle that a free run showed."""
        return "" if self.crossing is None else str(self.crossing + 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedCycle(RecordPart):
    """The limit cycle that a simulation ends in.

    Attributes:
        crossing: position of the crossing whose predicted state it began at; None: a free run.
        frequency_hz: [Hz].
        amplitude: variable → half its peak-to-peak value.
        fundamental: variable → amplitude of its fundamental.
        mean: variable → its mean.
        units: variable → unit, None where the model declares none.
        steady: whether it was at the end.
        periods: how many were run.
        time: shape (n,), of the last periods [s].
        values: variable → shape (n,).
        predicted_frequency_hz: where it began [Hz].
        predicted_amplitude: predicted amplitude of the block's input, where it began.
        states: state → its value at the end; not kept in files.
        sizes: state → how far it moved in the last periods; not kept in files.
    """

    crossing: int | None
    frequency_hz: float
    amplitude: Mapping[str, float]
    fundamental: Mapping[str, float]
    mean: Mapping[str, float]
    units: Mapping[str, str | None]
    steady: bool
    periods: int
    time: Floats
    values: Mapping[str, Floats]
    predicted_frequency_hz: float
    predicted_amplitude: float
    states: Mapping[str, float] = field(default_factory=dict, metadata=entry(kept=False))
    sizes: Mapping[str, float] = field(default_factory=dict, metadata=entry(kept=False))


@dataclass(frozen=True, eq=False, kw_only=True)
class LimitCycleResult(Result):
    """Crossings, limit cycles by several methods side by side, and a simulation that confirms them.

    Attributes:
        model, interface, solver: what was analysed.
        block: name of the block's component; of several the first, whose input is told of.
        input, output: full names of the block's input and output.
        blocks: names of all blocks' components.
        input_unit: unit of the block's input.
        nyquist: the curve of the linear part with −1/N.
        limit_cycles: limit cycles by crossing and method.
        simulated: None: no stable cycle was predicted, or its simulation failed (see the notes).
        branches: the cycles followed over each parameter that was asked for.
        observed: free runs from disturbed operating points, made where no cycle is predicted.
        free_run: the run from rest that was asked for, with frequency and amplitude of the block's input over time.
        units: variable → unit, of what was varied and of the block's output.
        notes: what should be known, one line each.
        operating_point: about which the loop was cut; None: not known.
        absolute: sectors for which the loop is proven stable, beside the block's; None: the block has a memory, there
            are several, or there is no point of rest.
    """

    _page = "workbench.limit_cycles.limit_cycle.page:limit_cycle_page"
    _picture = "workbench.limit_cycles.limit_cycle.picture:plot_limit_cycle"

    model: str
    interface: str
    solver: str
    block: str
    input: str = field(metadata=entry(key="block_input"))
    output: str = field(metadata=entry(key="block_output"))
    input_unit: str | None
    nyquist: NyquistResult
    limit_cycles: tuple[LimitCycle, ...]
    simulated: SimulatedCycle | None
    blocks: tuple[str, ...] = ()
    observed: tuple[Observation, ...] = ()
    branches: tuple[Branch, ...] = ()
    free_run: FreeRun | None = None
    units: Mapping[str, str | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None
    absolute: AbsoluteStability | None = None

    _WHAT, _COMMAND = "a result of limit-cycle", "limit-cycle"

    @property
    def crossings(self) -> tuple[Crossing, ...]:
        """All crossings, rising in frequency."""
        return self.nyquist.crossings

    def none_predicted(self) -> str:
        """Return what is known where describing functions predict no cycle, in one line; "": they predict one."""
        if any(c.crossing is not None for c in self.limit_cycles):
            return ""
        seen = "; ".join(o.words() for o in self.observed) or "no free run was made"
        return f"describing functions predict no limit cycle, −1/N(A) is met nowhere in the band; {seen}"

    def derived(self) -> dict[str, Any]:
        """Return what the describing function says.

        Keys:
            criterion, unstable_open: what *stable* means; poles of the linear part in the right
                half-plane.
            crossings: `frequency_hz`, `real`, `imag`, `gain`, `amplitude`, `stable`,
                `unstable_below`, `unstable_above`, `distortion`.
        """
        curve = self.nyquist
        return {"criterion": curve.criterion, "unstable_open": curve.unstable_open, "crossings": curve.crossings}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return dict.fromkeys(("amplitude", "fundamental", "mean"), self.input_unit)

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each limit cycle, then one for each that was followed, with its parameter's value."""
        shared = ("frequency_hz", "amplitude", "fundamental", "mean", "stable")
        names = ("crossing", "method", *shared, "multiplier")
        yield (*names, *(("parameter", "value", "branch") if self.branches else ()))
        rest = [None] * 3 if self.branches else []
        yield from ([getattr(c, n) for n in names] + rest for c in self.limit_cycles)
        for number, branch in enumerate(self.branches, 1):
            for p in branch.points:
                yield [None, None, *(getattr(p, n) for n in shared), None, branch.parameter, p.value, number]
