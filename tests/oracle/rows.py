"""The rows that one advance records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError, StoppedError
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.session.base import Recorded
from workbench.session.forcing import Forcing
from workbench.session.readings import read_finite

__all__ = ["Rows"]


class Rows:
    """Collects rows of (time, recorded values, forced inputs)."""

    def __init__(self, instance: Instance, variables: Sequence[Variable], forcing: Forcing) -> None:
        self._variables = variables
        self._access = instance.access(variables)
        self._forcing = forcing
        self._times: list[float] = []
        self._values: list[list[float]] = []
        self._inputs: list[list[float]] = []

    def add(self, time: float, *, inputs: Sequence[float] | None = None) -> None:
        """Read the FMU as it stands and keep the row.

        Raises:
            SimulationError: a value is not finite.
        """
        if self._variables:
            self._values.append(read_finite(self._access, self._variables, time))
        self._times.append(time)
        self._inputs.append(list(self._forcing.written if inputs is None else inputs))

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Hand the rows so far to whoever catches a failure."""
        try:
            yield
        except SimulationError as error:
            error.before = self.record()
            raise
        except KeyboardInterrupt:
            raise StoppedError(self.record()) from None

    def record(self) -> Recorded:
        """Return all rows as arrays."""
        names = [v.name for v in self._variables]
        return Recorded(
            time=np.array(self._times, dtype=np.float64),
            values=_columns(names, self._values),
            inputs=_columns(self._forcing.names, self._inputs),
        )


def _columns(names: Sequence[str], rows: list[list[float]]) -> dict[str, Floats]:
    if not names:
        return {}
    table = np.array(rows, dtype=np.float64)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}
