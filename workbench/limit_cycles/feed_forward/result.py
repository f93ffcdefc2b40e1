"""What the design of a feed-forward filter found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.limit_cycles.feed_forward.design_step import FilterStep
from workbench.limit_cycles.feed_forward.remaining_cycles import Remaining
from workbench.limit_cycles.feed_forward.trial import Trial
from workbench.limit_cycles.feed_forward.weighting import Weighting
from workbench.point.reduction.balanced import BalancedReduction
from workbench.point.reduction.band_error import BandError
from workbench.point.reduction.factored import Factored
from workbench.show.result import Result, drawn

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Design", "FeedForwardResult"]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedForwardResult(Result):
    """A filter from the nonlinear block's output to the control input, and how it came about.

    Attributes:
        model, interface, solver: what was analysed.
        block: name of the block's component.
        input, output: full names of its input v and its output w.
        target: full name of the control input u.
        second: full name of the control input that shares the filter's output; None: none.
        shared: by which weights; None: there is no second input.
        source: full name of the variable that is fed back; None: no feedback.
        gain: gain of the scalar feedback.
        filter_units: units of w and u, None where undeclared.
        band: frequencies in which errors count [Hz].
        frequency_hz: shape (n,), rising [Hz].
        g: shape (n,), response from u to v with the feedback.
        h: shape (n,), response from w to v with the feedback, sign turned: v = G u − H w.
        open_unstable: poles right of the imaginary axis without feedback [1/s].
        closed_unstable: unstable poles with the feedback.
        design: reductions, steps and the filter.
        limit_cycles: predicted by the describing function with the feedback alone and with the filter; None: the block
            has a memory, see the notes.
        trials: simulations: scalar feedback alone, with the filter, crude filters.
        notes: what should be known, one line each.
        operating_point: about which the system was linearised; None: not known.
    """

    _page = "workbench.limit_cycles.feed_forward.page:filter_page"
    _picture = "workbench.limit_cycles.feed_forward.picture:plot_feed_forward"

    model: str
    interface: str
    solver: str
    block: str
    input: str = field(metadata=entry(key="block_input"))
    output: str = field(metadata=entry(key="block_output"))
    target: str
    source: str | None
    gain: float
    filter_units: tuple[str | None, str | None]
    band: tuple[float, float]
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    g: Complex = field(metadata=entry(dims=("frequency_hz",)))
    h: Complex = field(metadata=entry(dims=("frequency_hz",)))
    open_unstable: Complex
    closed_unstable: Complex
    design: Design = field(metadata=entry(inline=True))
    second: str | None = None
    shared: Weighting | None = field(default=None, metadata=entry(key="weighting"))
    limit_cycles: Remaining | None = None
    trials: tuple[Trial, ...] = ()
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a feed-forward filter", "feed-forward"

    @property
    def steps(self) -> tuple[FilterStep, ...]:
        """The filter after each step, with its errors."""
        return self.design.steps

    @property
    def part(self) -> LinearPart:
        """The filter's matrices."""
        return self.design.part

    @property
    def filter(self) -> control.StateSpace:
        """The filter, for python-control; input and output are named as in the system, with _ for the dot."""
        return replace(self.part, input_names=(self.output,), output_names=(self.target,)).to_state_space(name="F")

    @property
    def exact(self) -> Complex:
        """H/G, shape (n,)."""
        with np.errstate(all="ignore"):
            return np.asarray(self.h / self.g, dtype=np.complex128)

    def trial(self, name: str) -> Trial:
        """Return a simulation by its name.

        Args:
            name: as in `trials`.

        Raises:
            KeyError: there is none.
        """
        for trial in self.trials:
            if trial.name == name:
                return trial
        raise KeyError(name)

    def plot(
        self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None, figure: str = "overview"
    ) -> Figure:
        """Return a picture.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
            figure: "overview"; "reduced" (filter before and after the reduction), "compensation" (G·F and H),
                "mirrored" (before and after mirroring, and the low-pass), "simulated" (time histories), "error"
                (G·F/H − 1), "poles" (what was cancelled and mirrored).

        Raises:
            InputError: unknown figure or suffix, nothing was simulated, the file cannot be written.
        """
        return drawn(
            "workbench.limit_cycles.feed_forward.picture:plot_feed_forward", path, self, axes=axes, figure=figure
        )

    def filter_dict(self) -> dict[str, Any]:
        """Return the filter as `workbench build` and the components of system files take it."""
        part = self.part
        units = {"u": self.filter_units[0], "y": self.filter_units[1]}
        return {
            "A": part.A.tolist(),
            "B": part.B.tolist(),
            "C": part.C.tolist(),
            "D": part.D.tolist(),
            "dt": 0.0,
            "input_names": ["u"],
            "output_names": ["y"],
            "state_names": [f"x{k + 1}" for k in range(len(part.A))],
            "units": {name: unit for name, unit in units.items() if unit},
        }

    def derived(self) -> dict[str, Any]:
        """Return the filter as system files take it.

        Keys:
            reduced: balanced reduction of *G* and *H*.
            filter: zeros, poles and gain; `A`, `B`, `C`, `D` with names and units.
        """
        return {"filter": self.filter_dict()}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency: gain and phase of G, H, H/G and of the filter after each step."""
        curves = {"G": self.g, "H": self.h, "H/G": self.exact, **{s.name: s.response for s in self.steps}}
        yield ("frequency_hz", *(f"{n} {what}" for n in curves for what in ("gain", "phase_deg")))
        columns = [c for v in curves.values() for c in (np.abs(v), np.angle(v, deg=True))]
        yield from np.column_stack([self.frequency_hz, *columns]).tolist()


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(RecordPart):
    """The filter and how it came about.

    Attributes:
        G, H: reduced.
        band_errors: of G and of H, in the band.
        steps: one after the other.
        factored: the filter by zeros, poles and gain.
        part: the filter as a state-space system.
        mirrored: poles that were mirrored, where they had been [1/s].
        notes: what the user should know.
    """

    G: BalancedReduction = field(metadata=entry(kept=False))
    H: BalancedReduction = field(metadata=entry(kept=False))
    band_errors: tuple[BandError, BandError] = field(metadata=entry(kept=False))
    steps: tuple[FilterStep, ...]
    factored: Factored
    part: LinearPart
    mirrored: Complex
    notes: tuple[str, ...] = field(metadata=entry(key="design_notes"))

    def derived(self) -> dict[str, Any]:
        """Return each reduction with its error."""
        both = zip("GH", self.reductions, self.band_errors, strict=True)
        return {"reduced": {name: {**r.to_dict(), "band_error": e} for name, r, e in both}}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the reductions apart from their errors."""
        reduced = data["reduced"]
        return {**data, **reduced, "band_errors": [reduced[name]["band_error"] for name in "GH"]}

    @property
    def reductions(self) -> tuple[BalancedReduction, BalancedReduction]:
        """Those of G and of H."""
        return self.G, self.H
