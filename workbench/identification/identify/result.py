"""The result of an identification."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.record import entry
from workbench.core.values.closed_loop import ClosedLoop, between
from workbench.data.advice.result import Advice
from workbench.data.experiment.experiment import Experiment
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.prediction.result import NOT_REFINED, Refinement
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.validate.overlay import Overlay
from workbench.identification.validate.result import Validation
from workbench.identification.validate.spread import ModelSpread
from workbench.show.result import Result

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["IdentifyResult"]


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifyResult(Result):
    """An identified model, how it came about and what it is worth.

    Attributes:
        data: what it was identified from, without the settling part.
        advice: judgement of these data.
        estimate: the model, the order with its reason, singular values and principal angles.
        refinement: how the model was refined, or why not.
        detrend: what was taken off before.
        settle: how much was cut off the beginning [s].
        own: the model compared with the data of the fit.
        other: compared with other data; None where there were none.
        experiments: names and lengths of all that were fitted together, the first is `data`.
        closed_loop_method: "direct", or the reference by which the plant was identified in a closed loop; None: as
            from an open loop.
        delays_told: where estimated delays come from; empty: they were given.
        uncertainty: regions of poles and frequency response of a refined model; None: not refined.
        overlay: its frequency response beside those of other analyses; None where there were none.
    """

    _page = "workbench.identification.identify.page:identify_page"

    data: Experiment = field(metadata=entry(key="experiment"))
    advice: Advice = field(metadata=entry(kept=False))
    estimate: SubspaceEstimate = field(metadata=entry(inline=True))
    detrend: str
    settle: float
    own: Validation = field(metadata=entry(key="identification", kept=False))
    other: Validation | None = field(metadata=entry(key="validation"))
    overlay: Overlay | None = None
    refinement: Refinement = NOT_REFINED
    uncertainty: ModelSpread | None = None
    experiments: tuple[str, ...] = ()
    closed_loop_method: str | None = None
    delays_told: str = ""

    _WHAT, _COMMAND = "an identification", "identify"

    @property
    def model(self) -> IdentifiedModel:
        """The identified model."""
        return self.estimate.model

    @property
    def order(self) -> int:
        """Number of states, delays not counted."""
        return self.estimate.order

    @property
    def validation(self) -> Validation:
        """On other data where there are some, else on the data of the fit."""
        return self.own if self.other is None else self.other

    @property
    def fit_percent(self) -> float:
        """Fit of the simulation on the validation data, mean over the outputs [%]; see `residuals.OutputFit`."""
        return _mean(self.validation.fit_percent)

    @property
    def error_percent(self) -> float:
        """Error of the simulation on the validation data, mean over the outputs [%]; see `residuals.OutputFit`."""
        return _mean(self.validation.error_percent)

    @property
    def closed_loop(self) -> bool | None:
        """Whether the data were recorded in closed loop, as they say or the advice finds; None: they cannot tell.

        If they were, the model is not that of the plant unless `closed_loop_method` says how it was identified.
        """
        if self._loops:
            return True
        return {"poor": True, "unknown": None}.get(self.advice.finding("feedback").verdict, False)

    @property
    def _loops(self) -> dict[str, ClosedLoop]:
        return between(self.data.loops, self.data.input_names, self.data.output_names)

    @property
    def failed(self) -> dict[str, str]:
        """Data and output → why the model's simulation has no fit there."""
        both = (self.own,) if self.other is None else (self.own, self.other)
        return {f"{v.data.name}, {f.output}": f.reason for v in both for f in v.simulation.fits if f.reason}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What has to be known before any number of the model is used, one line each; mostly none."""
        feedback = self.advice.finding("feedback")
        result = f"NOT A MODEL OF THE PLANT: the data come from a closed loop: {feedback.evidence}; {feedback.advice}"
        if self.closed_loop_method is not None:
            result = ""
        missing = [f"NO FIT on {where}: {why}" for where, why in self.failed.items()]
        known = [f"NOT A MODEL OF THE PLANT: {loop.words(name)}" for name, loop in self._loops.items()]
        return (*known, *((result,) if result and feedback.verdict == "poor" else ()), *missing)

    @property
    def notes(self) -> tuple[str, ...]:
        """Choices and doubts, one line each."""
        alone = (
            ()
            if self.other is not None
            else ("validated on the data of the fit, which makes the model look too good: give other data",)
        )
        evidence = self.advice.finding("feedback").evidence
        unknown = f"whether the data come from a closed loop is unknown: {evidence}"
        loop = (unknown,) if self.closed_loop is None else ()
        result = (*loop, *self.data.notes, *self._refined_notes, *self.model.notes, *self.validation.notes, *alone)
        return tuple(dict.fromkeys(result))

    @property
    def _refined_notes(self) -> tuple[str, ...]:
        notes = [] if self.refinement is NOT_REFINED else [self.refinement.words]
        if self.closed_loop_method == "direct":
            notes.append(
                "identified directly in a closed loop: the plant is right if the residuals are white and no "
                "feedthrough of plant and controller closes it within the sample"
            )
        elif self.closed_loop_method is not None:
            by = f"identified in a closed loop by what {self.closed_loop_method} makes of the inputs"
            notes.append(
                f"{by} (two stages); no regions are given: the instrument's equations have no solution near, and the "
                "covariance of the second stage lacks the error of the first"
                if self.uncertainty is None
                else f"{by} (two stages), then with it as an instrument, whose covariance the regions come from"
            )
        if len(self.experiments) > 1:
            notes.append(f"fitted together: {'; '.join(self.experiments)}; judged and drawn: the first")
        notes += [self.delays_told] if self.delays_told else []
        return (*notes, *self.estimate.notes)

    def to_ss(self) -> control.StateSpace:
        """Return the model for python-control."""
        return self.model.to_ss()

    def derived(self) -> dict[str, Any]:
        """Return what the parts say together, and those on the same data, which stand in the file once.

        Keys:
            model: of the data.
            poles: pairs.
            natural_frequency_hz, damping, damped_frequency_hz: of each pole; `null`: a delay, or no
                damping ratio at 0.
            warnings: what has to be known before any number is used; mostly empty.
            closed_loop: true: the data come from a closed loop (they say so, or the advice finds it),
                the model is not that of the plant unless `closed_loop_method` says how it was
                identified; null: the data cannot tell.
            failed: `where` (data, output) and `reason`: no fit there; exit code 1.
            fit_percent, error_percent, residual_tests, validated_on: on the other data where there
                are any; null where `failed` says why.
            identification: the same in full, for both parts.
            advice: judgement of the data.
            model_notes: singular values up to it are rounding; remarks on estimate and model.
        """
        return {
            "advice": _beside(self.advice, self.data),
            "identification": _beside(self.own, self.data),
            "model": self.data.name,
            "warnings": self.warnings,
            "closed_loop": self.closed_loop,
            "failed": [{"where": where, "reason": why} for where, why in self.failed.items()],
            "fit_percent": self.fit_percent,
            "error_percent": self.error_percent,
            "residual_tests": self.validation.prediction.tests,
            "validated_on": "other data" if self.other is not None else "the data of the fit",
            "notes": self.notes,
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the parts with the data that all are about."""
        parts = {key: {"experiment": data["experiment"], **data[key]} for key in ("advice", "identification")}
        return {**data, **parts}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Return measured, simulated and predicted outputs of the validation data."""
        return self.validation.rows()

    def plot(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Draw measured, simulated and predicted outputs of the validation data.

        `plot_order`, `validation.plot_residuals` and `validation.plot_poles` draw the rest.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        return self.validation.plot(path, axes=axes)

    def plot_order(self, path: str | Path | None = None) -> Figure:
        """Draw singular values and principal angles as bars, with the order that was chosen.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        return self.estimate.plot(path)


def _beside(part: Advice | Validation, data: Experiment) -> dict[str, Any]:
    """Return the keys of a part, without its data where they are those that stand beside it."""
    known = data.to_dict()
    return {key: value for key, value in part.to_dict().items() if key != "experiment" or value != known}


def _mean(values: dict[str, float]) -> float:
    return math.fsum(values.values()) / len(values)
