"""The result of a validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import entry
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.pole_zero import NearCancellation
from workbench.identification.validate.residuals import Residuals
from workbench.identification.validate.spread import model_spread
from workbench.show.result import Result, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Validation"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Validation(Result):
    """An identified model compared with data.

    Attributes:
        model: what was validated.
        data: recorded data with the model's channels.
        simulation: output from the input alone.
        prediction: output corrected by what was measured before.
        cancellations: poles that a zero nearly cancels, nearest first.
        notes: what else should be known, one line each.
    """

    _page = "workbench.identification.validate.page:validation_page"
    _picture = "workbench.identification.validate.picture:plot_fit"

    model: IdentifiedModel
    data: Experiment = field(metadata=entry(key="experiment"))
    simulation: Residuals
    prediction: Residuals
    cancellations: tuple[NearCancellation, ...] = field(metadata=entry(key="near_cancellations"))
    notes: tuple[str, ...]

    @property
    def fit_percent(self) -> dict[str, float]:
        """Output → fit of the simulation [%]; see `OutputFit`."""
        return {f.output: f.fit_percent for f in self.simulation.fits}

    @property
    def error_percent(self) -> dict[str, float]:
        """Output → error of the simulation [%]; see `OutputFit`."""
        return {f.output: f.error_percent for f in self.simulation.fits}

    @property
    def words(self) -> tuple[str, ...]:
        """The verdict in sentences."""
        pairs = [c.words for c in self.cancellations] or ["no pole is nearly cancelled by a zero"]
        return (*self.simulation.words, *self.prediction.words, *pairs, *self.notes)

    def plot(
        self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None, seconds: float | None = None
    ) -> Figure:
        """Draw measured, simulated and predicted outputs over time [s] and the errors below.

        `plot_residuals` and `plot_poles` draw the rest.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
            seconds: show only so much from the start [s]; None: so much that single samples can be told apart.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        return drawn("workbench.identification.validate.picture:plot_fit", path, self, axes=axes, seconds=seconds)

    def plot_residuals(self, path: str | Path | None = None, *, kind: str = "prediction") -> Figure:
        """Draw residuals, their autocorrelation and their cross-correlation with the inputs, with 95 % bands.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.
            kind: "prediction" or "simulation".

        Raises:
            InputError: unknown kind or suffix, file cannot be written.
        """
        return drawn("workbench.identification.validate.picture:plot_residuals", path, self, self.residuals(kind))

    def plot_poles(self, path: str | Path | None = None) -> Figure:
        """Draw poles and zeros with their near-cancellations and, where known, the poles' 95 % regions.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        known = None if self.model.spread is None else model_spread(self.model)
        name = "workbench.identification.validate.picture:plot_poles"
        return drawn(name, path, self.model, cancellations=self.cancellations, spread=known)

    def residuals(self, kind: str) -> Residuals:
        """Return one of the two ways of computing the output.

        Args:
            kind: "prediction" or "simulation".

        Raises:
            InputError: another kind.
        """
        known = {"prediction": self.prediction, "simulation": self.simulation}
        if kind not in known:
            raise InputError(f"residuals '{kind}' are unknown; known: {', '.join(known)}")
        return known[kind]

    def derived(self) -> dict[str, Any]:
        """Return the figures and the verdict."""
        return {
            "data": self.data.name,
            "samples": self.data.n_samples,
            "fit_percent": self.fit_percent,
            "error_percent": self.error_percent,
            "words": self.words,
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each instant: measured, simulated and predicted outputs."""
        outputs = [(n, k) for n in self.data.output_names for k in ("measured", "simulated", "predicted")]
        yield ("time [s]", *(_head(n, k, self.data.units.get(n)) for n, k in outputs))
        three = np.stack([self.data.y, self.simulation.computed, self.prediction.computed], axis=-1)
        yield from np.column_stack([self.data.time, three.reshape(len(three), -1)]).tolist()


def _head(name: str, kind: str, unit: str | None) -> str:
    return f"{name} {kind}" + (f" [{unit}]" if unit else "")
