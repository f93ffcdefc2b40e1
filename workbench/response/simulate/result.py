"""The record of a simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result

__all__ = ["SimulationResult"]


@dataclass(frozen=True, eq=False)
class SimulationResult(Result):
    """Time histories.

    Attributes:
        model, interface, solver: what ran.
        time: shape (n,) [s], never falling; a time given twice is an event (left, right limit).
        signals: name → shape (n,): the outputs, then the forced inputs as the model saw them.
        units: name → unit, None where the model declares none.
        notes: doubts about the result, e.g. a communication step that is too long.
        ended_at: when the run was cut short [s], by the FMU itself or by a failure; None: it came to its end.
        failed: why it failed; None: it did not. An FMU that ends its own run has not failed.
        operating_point: where the run begins.
        step_change: name → by how much it changes with half the communication step, shape (n,) [its unit]; empty: the
            run was not repeated. The error of a method of first order is twice that.
    """

    _page = "workbench.response.simulate.page:simulate_page"
    _picture = "workbench.response.simulate.picture:time_history"

    model: str
    interface: str
    solver: str
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    signals: dict[str, Floats] = field(metadata=entry(dims=("time",)))
    units: dict[str, str | None]
    notes: tuple[str, ...] = ()
    ended_at: float | None = None
    failed: str | None = None
    operating_point: OperatingPoint | None = None
    step_change: dict[str, Floats] = field(default_factory=dict)

    _WHAT, _COMMAND = "a simulation", "simulate"

    def rows(self) -> Iterator[Sequence[Any]]:
        """Return time [s] and every signal as columns; the last row of a run cut short is a remark."""
        yield from super().rows()
        if self.ended_at is not None:
            yield [f"# ended at {self.ended_at:.9g} s: {self.failed or 'by the FMU itself'}"]
