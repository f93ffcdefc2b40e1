"""What the feedback analysis of a system found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from workbench.analysis.feedback.block import CyclesLeft
from workbench.analysis.feedback.gains import Crossing
from workbench.analysis.feedback.locus import Fastest, Locus
from workbench.analysis.feedback.run import FeedbackRun
from workbench.analysis.feedback.settling import SettlingStudy
from workbench.core.linear import Complex, LinearPart
from workbench.core.operating_point import OperatingPoint, point_in_json
from workbench.core.poles import damped_frequency_hz
from workbench.core.record import Record
from workbench.csv_file import write_csv
from workbench.errors import InputError, suggest
from workbench.session.base import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CONVENTION", "FeedbackResult"]

CONVENTION = (
    "u = g·y is added to the target, y the deviation of the source from rest: negative g is negative feedback where "
    "G(0) > 0; a pole stands on the border of stability where 1 = g·G(jω)"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedbackResult(Record):
    """A scalar feedback from an output to an input, over its gain.

    Attributes:
        model, interface, solver: what was analysed.
        source, target: of the feedback, as they were named.
        source_unit, target_unit: the gain is in target_unit / source_unit; None: none declared.
        gains: lowest and highest gain looked at; infinite: none.
        plant: G from target to source, the feedback open (with the actuator, if there is one).
        lin_method: how it was linearised.
        stable_gains: (low, high) of each interval in which all poles decay; infinite: no end found in `gains`.
        crossings: all gains at which a pole reaches the border of stability, rising; those beyond `gains` too.
        unstable_open: poles beyond the border with the feedback open.
        fixed: poles that do not decay and that no gain moves, upper half-plane [1/s] (in z if sampled).
        fastest: for each stable interval the gain with which the slowest oscillation decays fastest; None: nothing
            oscillates.
        locus: poles over a range of gains worth a picture.
        frequency_hz: of the Nyquist curve, shape (k,) [Hz].
        response: G there, shape (k,), complex.
        block: component taken as the nonlinear block; None: there is none.
        cycles: limit cycles that are left, for gains in the stable intervals.
        settling: None: not asked for.
        run: None: not asked for.
        notes: one line each.
        operating_point: about which the system was linearised; None: not known.
    """

    model: str
    interface: str
    solver: str
    source: str
    target: str
    source_unit: str | None
    target_unit: str | None
    gains: tuple[float, float]
    plant: LinearPart
    lin_method: str
    stable_gains: tuple[tuple[float, float], ...]
    crossings: tuple[Crossing, ...]
    unstable_open: int
    fixed: tuple[complex, ...]
    fastest: tuple[Fastest | None, ...]
    locus: Locus
    frequency_hz: Floats
    response: Complex
    block: str | None = None
    cycles: tuple[CyclesLeft, ...] = ()
    settling: SettlingStudy | None = None
    run: FeedbackRun | None = None
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    @property
    def words(self) -> str:
        """The answer in one sentence."""
        where = within(self.gains)
        if self.fixed:
            poles = ", ".join(dict.fromkeys(self._pole(p) for p in self.fixed))
            return f"no gain{where} stabilises the system: the feedback does not move {poles}"
        if not self.stable_gains:
            return f"no gain{where} stabilises the system"
        return f"stable for gains{where}: " + ", ".join(interval_words(i) for i in self.stable_gains)

    def _pole(self, pole: complex) -> str:
        if self.plant.dt > 0.0:
            return f"the pole z = {pole.real:.4g}" + (f" ± {pole.imag:.4g}j" if pole.imag else "")
        if not pole.imag:
            return f"the real pole at {pole.real:.3g} 1/s"
        return f"the pole at {damped_frequency_hz(pole):.4g} Hz that grows with {pole.real:.3g} 1/s"

    def plot(self, path: str | Path | None = None, *, plot_kind: str = "overview") -> Figure:
        """Return a picture.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            plot_kind: "overview", "root-locus", "nyquist", "cycles", "settling" or "run".

        Raises:
            InputError: there is nothing of that kind, unknown suffix, file cannot be written.
        """
        draw = {
            "overview": super().plot,
            "root-locus": self.plot_root_locus,
            "nyquist": self.plot_nyquist,
            "cycles": self.plot_cycles,
            **({} if self.settling is None else {"settling": self.settling.plot}),
            **({} if self.run is None else {"run": self.run.plot}),
        }
        if plot_kind not in draw:
            raise InputError(f"plot_kind '{plot_kind}' is not in this result; {suggest(plot_kind, draw)}")
        return draw[plot_kind](path)

    def plot_root_locus(self, path: str | Path | None = None) -> Figure:
        """Return a picture of the poles over the gain, whole and around the border of stability.

        Args:
            path: also write it here; png, svg or pdf by suffix.
        """
        from workbench.plotting.feedback import plot_root_locus  # noqa: PLC0415  matplotlib is slow

        return plot_root_locus(self, path)

    def plot_nyquist(self, path: str | Path | None = None) -> Figure:
        """Return a picture of G(jω) in four views: all, and by bands around its crossings of the real axis.

        Args:
            path: also write it here; png, svg or pdf by suffix.
        """
        from workbench.plotting.feedback_nyquist import plot_nyquist  # noqa: PLC0415  matplotlib is slow

        return plot_nyquist(self, path)

    def plot_cycles(self, path: str | Path | None = None) -> Figure:
        """Return a picture of the Nyquist curves seen by the nonlinear block, for four of the gains.

        Args:
            path: also write it here; png, svg or pdf by suffix.

        Raises:
            InputError: there is no block.
        """
        from workbench.plotting.feedback_nyquist import plot_cycles  # noqa: PLC0415  matplotlib is slow

        return plot_cycles(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON, where an infinite end of an interval is null."""
        return {
            "model": self.model,
            "interface": self.interface,
            "solver": self.solver,
            "from": self.source,
            "to": self.target,
            "source_unit": self.source_unit,
            "target_unit": self.target_unit,
            "convention": CONVENTION,
            "words": self.words,
            "searched": [finite(g) for g in self.gains],
            "stable_gains": [[finite(g) for g in pair] for pair in self.stable_gains],
            "crossings": [{k: finite(v) for k, v in c.to_dict().items()} for c in self.crossings],
            "unstable_open": self.unstable_open,
            "fixed_poles": [[p.real, p.imag] for p in self.fixed],
            "fastest_decay": [None if f is None else dict(vars(f)) for f in self.fastest],
            "dt": self.plant.dt,
            "lin_method": self.lin_method,
            "block": self.block,
            "cycles": [c.to_dict() for c in self.cycles],
            **({} if self.settling is None else self.settling.to_dict()),
            "run": None if self.run is None else self.run.to_dict(),
            "nyquist": {
                "frequency_hz": self.frequency_hz.tolist(),
                "real": self.response.real.tolist(),
                "imag": self.response.imag.tolist(),
            },
            "notes": list(self.notes),
            **point_in_json(self.operating_point),
        }

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write the settling study as a table, else the time histories of a run, else the crossings.

        Args:
            path: of the file, or an open text stream.

        Raises:
            InputError: the file cannot be written.
        """
        if self.settling is None and self.run is not None:
            self.run.to_csv(path)
            return
        write_csv(path, self._crossing_rows() if self.settling is None else _settling_rows(self.settling))

    def _crossing_rows(self) -> list[Sequence[Any]]:
        names = list(Crossing.__dataclass_fields__)
        return [names, *([getattr(c, n) for n in names] for c in self.crossings)]


def _settling_rows(study: SettlingStudy) -> list[Sequence[Any]]:
    levels = [o.threshold for o in study.optima]
    head = [
        "gain",
        *(f"settling_seconds_{t:g}" for t in levels),
        "left",
        "peak_deflection",
        "peak_rate",
        "limit_reached",
    ]
    rows: list[Sequence[Any]] = [head]
    for r in study.runs:
        settled = [r.settled[t] for t in levels]
        rows.append([r.gain, *settled, r.left, r.peak_deflection, r.peak_rate, r.limit_reached])
    return rows


def finite(value: float) -> float | None:
    """Return a number, None if it is none that JSON holds."""
    return value if math.isfinite(value) else None


def interval_words(pair: tuple[float, float]) -> str:
    """Return an interval in words.

    Args:
        pair: its ends.
    """
    low, high = pair
    if math.isinf(low) and math.isinf(high):
        return "all"
    if math.isinf(low):
        return f"below {high:.6g}"
    if math.isinf(high):
        return f"above {low:.6g}"
    return f"{low:.6g} … {high:.6g}"


def within(limits: tuple[float, float]) -> str:
    """Return the range that was looked at in words, "" where it has no ends.

    Args:
        limits: lowest and highest gain.
    """
    low, high = limits
    if math.isinf(low) and math.isinf(high):
        return ""
    return f" within {low:g} … {high:g}"
