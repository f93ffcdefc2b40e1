"""What the comparison of motions found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import entry, plain
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.response.compare.measures import Measure
from workbench.response.compare.units import DisplayedUnit
from workbench.show.result import Result

__all__ = ["Motion", "MotionComparison", "MotionFailed", "MotionHistory"]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One signal of one system in one window.

    Attributes:
        system: name of the system in the comparison.
        signal: variable.
        window: position in `MotionComparison.windows`.
        measure: peak, rms and more, in the variable's own unit.
    """

    system: str
    signal: str
    window: int
    measure: Measure = field(metadata=entry(inline=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionHistory:
    """The record of one system.

    Attributes:
        system: name of the system in the comparison.
        time: shape (n,) [s].
        values: signal → shape (n,), in its own unit.
    """

    system: str
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    values: Mapping[str, Floats] = field(metadata=entry(dims=("time",)))


@dataclass(frozen=True, kw_only=True)
class MotionFailed:
    """A run that ended early.

    Attributes:
        system: name of the system in the comparison.
        time: when [s]; None: not known.
        reason: in one line.
        kind: what went wrong, see `WorkbenchError.kind`.
    """

    system: str
    time: float | None
    reason: str
    kind: str


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionComparison(Result):
    """Motions of several models under the same signals.

    Attributes:
        systems: their names, the reference first.
        models: what each of them calls itself.
        signals: variables.
        windows: begin and end [s].
        units: signal → unit, None where the model declares none.
        shown: signal → unit in which it is shown as well.
        motions: by system, signal and window; a window that a failed run did not reach is missing.
        histories: the records; not written to files, which they would make a hundred times as long.
        failed: runs that ended early.
        inputs: forced input → signal, in words.
        stop: end of the runs [s].
        operating_points: system → where its run began; one whose run failed at once is missing.
        notes: one line each.
    """

    _page = "workbench.response.compare.page:motions_page"
    _picture = "workbench.response.compare.picture:plot_motions"

    systems: tuple[str, ...]
    models: tuple[str, ...]
    signals: tuple[str, ...]
    windows: tuple[tuple[float, float], ...]
    units: Mapping[str, str | None]
    shown: Mapping[str, DisplayedUnit]
    motions: tuple[Motion, ...] = field(metadata=entry(kept=False))
    histories: tuple[MotionHistory, ...] = field(default=(), metadata=entry(kept=False))
    failed: tuple[MotionFailed, ...]
    inputs: Mapping[str, str]
    stop: float
    operating_points: Mapping[str, OperatingPoint | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a comparison of motions", "simulate"

    def measure(self, system: str, signal: str, window: int = 0) -> Measure | None:
        """Return one entry; None: the run did not reach that window.

        Args:
            system: name of the system in the comparison.
            signal: variable.
            window: position in `windows`.
        """
        wanted = (system, signal, window)
        return next((m.measure for m in self.motions if (m.system, m.signal, m.window) == wanted), None)

    def ratio(self, system: str, signal: str, window: int = 0) -> float | None:
        """Return the peak over that of the first system; None: one of them is missing, or the first is at rest.

        Args:
            system: name of the system in the comparison.
            signal: variable.
            window: position in `windows`.
        """
        own, first = self.measure(system, signal, window), self.measure(self.systems[0], signal, window)
        return own.peak / first.peak if own is not None and first is not None and first.peak > 0.0 else None

    def derived(self) -> dict[str, Any]:
        """Return the motions in the units they are shown in, too.

        Keys:
            motions: `system`, `signal`, `window`, `peak`, `peak_time`, `rms`, `mean`, `half_range`,
                `peak_shown`, `rms_shown`, `peak_ratio`.
        """
        return {"motions": [self._entry(m) for m in self.motions]}

    def _entry(self, m: Motion) -> dict[str, Any]:
        factor = self.shown[m.signal].factor
        return {
            **plain(m),
            "peak_shown": factor * m.measure.peak,
            "rms_shown": factor * m.measure.rms,
            "peak_ratio": self.ratio(m.system, m.signal, m.window),
        }

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return dict.fromkeys(("begin", "end", "peak_time"), "s")

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each motion."""
        yield (
            "system", "signal", "begin", "end", "unit", "peak", "peak_time", "rms", "mean", "half_range", "shown_unit",
            "peak_shown", "rms_shown", "peak_ratio",
        )  # fmt: skip
        for m in self.motions:
            shown = self.shown[m.signal]
            yield (
                m.system, m.signal, *self.windows[m.window], self.units[m.signal], *m.measure.to_dict().values(),
                shown.unit, shown.factor * m.measure.peak, shown.factor * m.measure.rms,
                self.ratio(m.system, m.signal, m.window),
            )  # fmt: skip
