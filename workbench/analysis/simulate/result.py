"""The record of a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from workbench.core.operating_point import OperatingPoint, point_in_json
from workbench.csv_file import write_csv
from workbench.origin import Reportable
from workbench.session.base import Floats

__all__ = ["SimulationResult"]


@dataclass(frozen=True)
class SimulationResult(Reportable):
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
    """

    model: str
    interface: str
    solver: str
    time: Floats
    signals: dict[str, Floats]
    units: dict[str, str | None]
    notes: tuple[str, ...] = ()
    ended_at: float | None = None
    failed: str | None = None
    operating_point: OperatingPoint | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, as the command line writes them to JSON."""
        return {
            "model": self.model,
            "interface": self.interface,
            "solver": self.solver,
            "time": self.time.tolist(),
            "signals": {name: values.tolist() for name, values in self.signals.items()},
            "units": dict(self.units),
            "notes": list(self.notes),
            "ended_at": self.ended_at,
            "failed": self.failed,
            **point_in_json(self.operating_point),
        }

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write time [s] and every signal as columns with a heading line; a run cut short ends with a comment.

        Args:
            path: of the file, or an open text stream.

        Raises:
            InputError: the file cannot be written.
        """
        write_csv(path, [["time", *self.signals], *zip(*self._columns(), strict=True), *self._cut()])

    def _cut(self) -> list[list[str]]:
        if self.ended_at is None:
            return []
        return [[f"# ended at {self.ended_at:.9g} s: {self.failed or 'by the FMU itself'}"]]

    def _columns(self) -> list[list[float]]:
        return [self.time.tolist(), *(v.tolist() for v in self.signals.values())]
