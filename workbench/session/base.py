"""What a session is: one initialised run of a model that can be continued."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.machine.closable import Closable
from workbench.core.values.arrays import Floats
from workbench.signals.kinds import Signal

__all__ = ["Recorded", "Session", "Snapshot"]


@dataclass(frozen=True)
class Recorded:
    """What one `Session.advance` recorded.

    Attributes:
        time: shape (n,) [s], never falling; two rows with the same time are the left and the
            right limit there.
        values: name → shape (n,), for every name in `record`.
        inputs: forced input → shape (n,), what the model really saw (held, linear or continuous).
    """

    time: Floats
    values: dict[str, Floats]
    inputs: dict[str, Floats]

    def right_limits(self, points: Floats | None = None) -> Recorded:
        """Return the last row of each time.

        Args:
            points: of these times only [s]; None: of all.
        """
        keep = np.append(self.time[1:] > self.time[:-1], True)
        if points is not None:
            keep &= np.isin(self.time, points)
        rows = ({n: v[keep] for n, v in columns.items()} for columns in (self.values, self.inputs))
        return Recorded(self.time[keep], *rows)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A saved state of one session; only that session can take it back.

    Attributes:
        time: session time of the snapshot [s].
    """

    time: float


class Session(Closable):
    """One initialised run that can be continued, saved and restored.

    Obligations of a subclass:
      1. `time` only moves through `advance` and `restore`.
      2. `advance` in two parts equals one advance over the whole, to the solver's tolerance.
      3. An input that is not forced keeps the value it has; at the start that is its start value
         (plus bias).
      4. After `restore(s)` the session stands exactly where it stood at `s`; what is computed
         after two restores of one snapshot is equal to the last bit.
      5. `close` may be called at any time, also after an error, and more than once.
      6. `communication_step` is the longest step of the last `advance` of a co-simulation [s]; None
         where the workbench integrates.
      7. After a SimulationError nothing but `restore` and `close` may be called.
    """

    time: float
    communication_step: float | None = None

    @abstractmethod
    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        """Advance from where the session stands to `until`.

        The first row is the right limit at the present time, then each of `points` and every
        event between them as two rows (left limit, right limit). An event exactly at `until`
        belongs to the next call, whose first row is its right limit; `until` equal to `time` is
        allowed and gives that one row.
        Co-simulation: `points` are communication points too, the steps between them never exceed
        the communication step, and every communication point is two rows.

        Args:
            until: [s], not before `time`.
            signals: forced inputs; functions of absolute session time.
            record: names of variables to record.
            points: shape (m,) [s], rising, in (time, until]; None: only `until`.

        Raises:
            InputError: unknown name, not an input, points out of order.
            SimulationError: a value is not finite, the FMU or the solver gave up.
        """

    @abstractmethod
    def values(self, names: Sequence[str]) -> dict[str, float]:
        """Return present values by name; Booleans as 0.0 and 1.0.

        Args:
            names: of variables.
        """

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Save the state. Dropped with the session at the latest."""

    @abstractmethod
    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot.

        Args:
            snapshot: one that this session made.
        """
