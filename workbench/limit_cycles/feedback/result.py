"""What the feedback analysis of a system found."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.record import complex_of, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import damped_frequency_hz
from workbench.errors import InputError, suggest
from workbench.limit_cycles.feedback.block import CyclesLeft
from workbench.limit_cycles.feedback.closing_run import FeedbackRun
from workbench.limit_cycles.feedback.gains import CriticalGain
from workbench.limit_cycles.feedback.locus import Fastest, Locus, locus, shown_gains
from workbench.limit_cycles.feedback.settling import SettlingStudy
from workbench.show.result import Result, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["CONVENTION", "FeedbackResult", "interval_words"]

CONVENTION = (
    "u = g·y is added to the target, y the deviation of the source from rest: negative g is negative feedback where "
    "G(0) > 0; a pole stands on the border of stability where 1 = g·G(jω)"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedbackResult(Result):
    """A scalar feedback from an output to an input, over its gain.

    Attributes:
        model, interface, solver: what was analysed.
        source, target: output and input of the feedback, as they were named.
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
        frequency_hz: frequency of the Nyquist curve, shape (k,) [Hz].
        response: G there, shape (k,), complex.
        block: component taken as the nonlinear block; None: there is none.
        cycles: limit cycles that are left, for gains in the stable intervals.
        settling: None: not asked for.
        run: None: not asked for.
        notes: one line each.
        operating_point: about which the system was linearised; None: not known.
    """

    _page = "workbench.limit_cycles.feedback.page:feedback_page"
    _picture = "workbench.limit_cycles.feedback.picture:plot_feedback"

    model: str
    interface: str
    solver: str
    source: str = field(metadata=entry(key="from"))
    target: str = field(metadata=entry(key="to"))
    source_unit: str | None
    target_unit: str | None
    gains: tuple[float, float] = field(metadata=entry(key="searched"))
    plant: LinearPart
    lin_method: str
    stable_gains: tuple[tuple[float, float], ...]
    crossings: tuple[CriticalGain, ...]
    unstable_open: int
    fixed: tuple[complex, ...] = field(metadata=entry(key="fixed_poles"))
    fastest: tuple[Fastest | None, ...] = field(metadata=entry(key="fastest_decay"))
    frequency_hz: Floats = field(metadata=entry(kept=False, dims=("frequency_hz",), unit="Hz"))
    response: Complex = field(metadata=entry(kept=False, dims=("frequency_hz",)))
    block: str | None = None
    cycles: tuple[CyclesLeft, ...] = ()
    settling: SettlingStudy | None = field(default=None, metadata=entry(kept=False))
    run: FeedbackRun | None = None
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a feedback", "feedback"

    @cached_property
    def locus(self) -> Locus:
        """The poles over a range of gains worth a picture."""
        low, high = shown_gains(self.stable_gains, self.crossings, self.gains)
        return locus(self.plant, low, high, also=[c.gain for c in self.crossings])

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

    def plot(
        self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None, plot_kind: str = "overview"
    ) -> Figure:
        """Return a picture.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
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
        return draw[plot_kind](path, axes=axes)

    def plot_root_locus(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Return a picture of the poles over the gain, whole and around the border of stability.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
        """
        return drawn("workbench.limit_cycles.feedback.picture:plot_root_locus", path, self, axes=axes)

    def plot_nyquist(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Return a picture of G(jω) in four views: all, and by bands around its crossings of the real axis.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
        """
        return drawn("workbench.limit_cycles.feedback.picture_nyquist:plot_nyquist", path, self, axes=axes)

    def plot_cycles(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Return a picture of the Nyquist curves seen by the nonlinear block, for four of the gains.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.

        Raises:
            InputError: there is no block.
        """
        return drawn("workbench.limit_cycles.feedback.picture_nyquist:plot_cycles", path, self, axes=axes)

    def derived(self) -> dict[str, Any]:
        """Return what stands beside the fields, and the settling study.

        Keys:
            convention, words: sign; the answer in words; lowest and highest gain.
            dt: of the linear model.
            nyquist: `frequency_hz`, `real`, `imag`.
        """
        curve = {"frequency_hz": self.frequency_hz, "real": self.response.real, "imag": self.response.imag}
        study = {} if self.settling is None else self.settling.to_dict()
        own = {"convention": CONVENTION, "words": self.words, "dt": self.plant.dt, "nyquist": curve}
        return {**study, **own}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the settling study, whose keys stand among the others, and gains without a limit as infinite."""
        curve = data["nyquist"]
        return {
            **data,
            "searched": _ends(data["searched"]),
            "stable_gains": [_ends(pair) for pair in data["stable_gains"]],
            "frequency_hz": curve["frequency_hz"],
            "response": complex_of(curve),
            "settling": SettlingStudy.from_dict(data) if "runs" in data else None,
        }

    def rows(self) -> Iterable[Sequence[Any]]:
        """Return the settling study as a table, else the time histories of a run, else the crossings."""
        if self.settling is not None:
            return self.settling.rows()
        if self.run is not None:
            return self.run.rows()
        names = tuple(CriticalGain.__dataclass_fields__)
        return [names, *([getattr(c, n) for n in names] for c in self.crossings)]


def _ends(pair: Sequence[float | None]) -> tuple[float, float]:
    low, high = pair
    return -math.inf if low is None else low, math.inf if high is None else high


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
