"""What the delays of a system with co-simulation parts are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result
from workbench.system.master.richardson import Halving

__all__ = ["ConnectionDelay", "DelayReport", "LoopDelay", "NoDelays"]

_SMALL = 0.01  # of the span: errors below that are called small


@dataclass(frozen=True)
class ConnectionDelay:
    """One connection between components that are stepped by themselves.

    Attributes:
        connection: "component.output → component.input".
        how: what the destination sees over a step.
        mean_s: how late the value is on average [s]; negative: early.
        longest_s: how old it gets [s].
        phase_lost_deg: at the report's frequency [deg]; None without one.
    """

    connection: str
    how: str
    mean_s: float
    longest_s: float
    phase_lost_deg: float | None


@dataclass(frozen=True)
class LoopDelay:
    """One loop through several components.

    Attributes:
        components: in the direction of the signals.
        mean_s: once around [s].
        crossover_hz: where the gain of the loop, opened at one connection, falls through 1 [Hz]; None: not known.
        phase_lost_deg: at the report's frequency, else at the crossover [deg]; None if neither is known.
    """

    components: tuple[str, ...]
    mean_s: float
    crossover_hz: float | None
    phase_lost_deg: float | None


@dataclass(frozen=True)
class DelayReport(Result):
    """What the master costs at this communication step.

    Attributes:
        system: name of the system.
        order: "gauss-seidel" or "jacobi".
        stages: the units in the order in which they are stepped; those of one stage side by side.
        step: communication step [s].
        fixed: why the step is not controlled; empty if it is, in runs without a given step.
        periods: sampled components → [s] (the longest time between two instants).
        frequency: for which phases are given [Hz]; None: each loop's crossover.
        connections: all that lead from one unit to another.
        loops: through several units.
        outputs: how they change when the step is halved, and their estimated error.
        stop: length of the runs [s].
        interface, solver: interface and solver of the system.
        notes: remarks on the operating point.
        operating_point: where they start; None: not known.
    """

    _page = "workbench.health.delays.page:delays_page"

    system: str
    order: str
    stages: tuple[tuple[str, ...], ...]
    step: float
    fixed: str
    periods: Mapping[str, float]
    frequency: float | None
    connections: tuple[ConnectionDelay, ...]
    loops: tuple[LoopDelay, ...]
    outputs: tuple[Halving, ...]
    stop: float
    interface: str = "cs"
    solver: str = "fmu"
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a report of delays", "check --delays"

    def derived(self) -> dict[str, Any]:
        """Return the name by which other results have the system."""
        return {"model": self.system}

    def lines(self) -> tuple[str, ...]:
        """Return the report in plain words, one statement a line."""
        return (
            self._head(),
            *(
                f"{name} is sampled, at most {1e3 * p:.6g} ms apart; it is stepped then"
                for name, p in self.periods.items()
            ),
            *(_connection_words(c, self.frequency) for c in self.connections),
            *(_loop_words(loop, self.frequency) for loop in self.loops),
            *(_output_words(o, self.step) for o in self.outputs),
            *self.conclusions,
        )

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _head(self) -> str:
        order = " → ".join(" | ".join(stage) for stage in self.stages)
        control = f"fixed: {self.fixed}" if self.fixed else "controlled in runs without a given step"
        return f"{self.system}: {self.order}, {order}; communication step {1e3 * self.step:.6g} ms ({control})"

    @property
    def conclusions(self) -> list[str]:
        """What these figures say of the FMUs and of the step, one statement each."""
        result = []
        late = [c for c in self.connections if c.mean_s != 0.0]
        orders = [o.order for o in self.outputs if o.order is not None]
        if not late and orders and min(orders) < 1.5:
            result.append(
                "no connection is delayed on average, but the error only falls in proportion to the step: an FMU makes "
                "one explicit Euler step in each communication step, or ignores the slopes of its inputs"
            )
        worst = max(self.outputs, key=lambda o: o.error / o.span if o.span else 0.0, default=None)
        if worst is not None and worst.error > _SMALL * worst.span:
            result.append(f"the error of {worst.name} is more than {100 * _SMALL:g} % of its range: use a shorter step")
        return result


def _connection_words(c: ConnectionDelay, frequency: float | None) -> str:
    if c.mean_s == 0.0:
        return f"{c.connection}: {c.how}: no delay on average"
    side = "late" if c.mean_s > 0.0 else "early"
    phase = "" if c.phase_lost_deg is None else f", {c.phase_lost_deg:+.3g}° lost at {frequency:g} Hz"
    return f"{c.connection}: {c.how}: {1e3 * abs(c.mean_s):.4g} ms {side} on average{phase}"


def _loop_words(loop: LoopDelay, frequency: float | None) -> str:
    way = " → ".join([*loop.components, loop.components[0]])
    delay = f"loop {way}: {1e3 * loop.mean_s:.4g} ms in all"
    if loop.phase_lost_deg is None:
        return delay + ("; its crossover is not known, give a frequency for the phase" if loop.mean_s else "")
    if frequency is not None:
        return f"{delay}, {loop.phase_lost_deg:.3g}° lost at {frequency:g} Hz"
    return f"{delay}, {loop.phase_lost_deg:.3g}° of its phase margin lost at its crossover, {loop.crossover_hz:.4g} Hz"


def _output_words(o: Halving, step: float) -> str:
    if o.change == 0.0:
        return f"{o.name}: the same with half the step"
    order = "unevenly, so the error is a guess" if o.order is None else f"with order {o.order:.2f}"
    return (
        f"{o.name}: changes by {o.change:.3g} when the step of {1e3 * step:.6g} ms is halved, falling {order}; "
        f"estimated error {o.error:.3g}, of a range of {o.span:.3g}"
    )


@dataclass(frozen=True, kw_only=True)
class NoDelays(Result):
    """A model without a master.

    Attributes:
        model, interface, solver: which.
        notes: what else should be known, one line each.
    """

    _page = "workbench.health.delays.page:no_delays_page"

    model: str
    interface: str
    solver: str
    notes: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Why there is no delay."""
        return "all parts are model exchange, one set of equations: no connection carries a delay"

    def derived(self) -> dict[str, Any]:
        """Return what other systems have here.

        Keys:
            connections, loops: empty for Model Exchange: no connection carries a delay.
        """
        return {"connections": [], "loops": []}
