"""Test a model made from pulses on a run that it was not made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.point.lin.realisation import Realisation
from workbench.point.lin.result import Doubt

__all__ = ["DOUBT", "MoveTrial", "accepted", "smallest", "trial_levels"]

# (first period, periods, height): no two the same, and no common divisor of the instants, so that steps that an FMU
# makes inside are met at different places; the last goes on to the end.
_MOVES = ((1, 2, -0.6), (4, 1, 0.7), (7, 5, 0.9), (17, 13, -1.0), (41, 2, 0.8), (61, 1, -0.9))
_STEP_AT = 0.25  # of the run, where it is not shorter than the pulses
_STEP = 0.5
DOUBT, _REFUSED = 0.05, 0.5
_AS_WELL = 1.5  # times the error of the best order: what the chosen order may miss
_EXACT = 1e-9  # what rounding makes of an exact prediction
_SEEN = 10.0  # times the noise: smaller answers test nothing
_REMEDY = "give the FMU a smaller `tolerance`, or move the input further (`du`)"

Flags = NDArray[np.bool_]


def trial_levels(count: int) -> Floats:
    """Return how far the input is moved over each of `count` periods, in widths of the pulse, shape (count,)."""
    levels = np.zeros(count)
    for first, length, height in _MOVES:
        levels[first : first + length] = height
    levels[max(5, round(_STEP_AT * count)) :] += _STEP
    return levels


@dataclass(frozen=True, eq=False)
class MoveTrial:
    """How the model answers to moves of one input that are not the pulse.

    If the model is linear and the same at all times, the answer is y(k) = Σ h(i) u(k − i), where h is what one pulse
    at the beginning gave: superposition, time shift and proportion in one.

    Attributes:
        input: name.
        column: of the input in the model.
        outputs: names.
        levels: how far the input was moved, shape (k,).
        answer: of the outputs, beside the run that is left alone, shape (k, q).
        pulse: h, shape (k, q).
        noise: of h, shape (q,).
        rounding: of the outputs, shape (q,).
    """

    input: str
    column: int
    outputs: Sequence[str]
    levels: Floats
    answer: Floats
    pulse: Floats
    noise: Floats
    rounding: Floats

    @cached_property
    def _size(self) -> Floats:
        """Largest answer of each output, shape (q,)."""
        size: Floats = np.abs(self.answer).max(axis=0)
        return size

    @cached_property
    def _scatter(self) -> Floats:
        """How far runs of the same inputs are from each other, as the noise of the pulse tells, shape (q,)."""
        scatter: Floats = self.noise * np.abs(self.levels).max()
        return scatter

    @property
    def _seen(self) -> Flags:
        """Which outputs answer by more than the scatter of the runs: only they test anything."""
        result: Flags = self._size > _SEEN * self._scatter
        return result

    @property
    def _lost(self) -> list[int]:
        """Outputs that moved, but not by more than the runs scatter: whether the input moves them is not known."""
        return np.flatnonzero((self._size > self.rounding) & ~self._seen).tolist()

    @property
    def untested(self) -> tuple[str, ...]:
        """Outputs of which this says nothing."""
        return tuple(self.outputs[i] for i in self._lost)

    def _lost_in_scatter(self) -> str:
        """Return why nothing at all is known of this input; empty: something is."""
        if not self._lost or self._seen.any():
            return ""
        i = self._lost[0]
        return (
            f"there is no linear model: {', '.join(self.untested)} {'move' if self._lost[1:] else 'moves'} when "
            f"{self.input} does, but by no more than the runs scatter ({self.outputs[i]}: {self._size[i]:.3g}, "
            f"scatter {self._scatter[i]:.3g}): {_REMEDY}"
        )

    def why_refused(self, way: str) -> str:
        """Return why this input has no linear model, its pulse not predicting the answer; empty: it has one.

        Args:
            way: what to do if the FMU's own solver is the cause.
        """
        if lost := self._lost_in_scatter():
            return lost
        shifted = self._gaps(self._folded())
        worst = int(shifted.argmax())
        if shifted[worst] <= _REFUSED:
            return ""
        return (
            f"there is no linear model: {self.outputs[worst]} responds to {self.input} differently "
            f"at other times (other pulses and a step are missed by {100.0 * shifted[worst]:.3g} %). Either the "
            f"model moves at this point (trim it, or leave {self.input} out of the inputs), or the FMU's own "
            "solver does not restart where inputs change (check tells), or the model samples its inputs or has "
            f"events; then {way}"
        )

    def refuse(self, realised: Realisation) -> None:
        """Refuse a model that misses the answer although the pulse predicts it.

        Raises:
            SimulationError: it does.
        """
        modelled = self._gaps(self._simulated(realised))
        worst = int(modelled.argmax())
        if modelled[worst] > _REFUSED:
            raise SimulationError(
                f"method response: order {len(realised.A)}, found in the pulses, misses other pulses and a step of "
                f"{self.input} in {self.outputs[worst]} by {100.0 * modelled[worst]:.3g} %; give order, more points or "
                "another period"
            )

    def doubts(self, realised: Realisation) -> list[Doubt]:
        """Return where the model, or any linear one, misses the answer by more than 5 %, or nothing can be said."""
        shifted, modelled = self._gaps(self._folded()), self._gaps(self._simulated(realised))
        size = np.abs(self.pulse).max(axis=0)
        result = [
            Doubt(
                self.outputs[i], self.input, float(size[i]), None,
                f"not known: it moves by {self._size[i]:.3g} when {self.input} moves, no more than the runs scatter "
                f"({self._scatter[i]:.3g}); {_REMEDY}",
                about="effect",
            )
            for i in self._lost
        ]  # fmt: skip
        for i, name in enumerate(self.outputs):
            if max(shifted[i], modelled[i]) > DOUBT:
                if shifted[i] > DOUBT:
                    why = f"pulses at other times and a step are missed by {100.0 * shifted[i]:.2g} %: "
                    why += "not linear over the width, moving at this point, or inputs act late (check tells)"
                else:
                    why = f"order {len(realised.A)} misses other pulses and a step by {100.0 * modelled[i]:.2g} %; "
                    why += "give order, more points or another period"
                result.append(Doubt(name, self.input, float(size[i]), None, why))
        return result

    def error(self, realised: Realisation) -> float:
        """Return the largest error of the model's prediction, relative to the largest answer of the same output."""
        return float(self._gaps(self._simulated(realised)).max(initial=0.0))

    def _folded(self) -> Floats:
        """Return what the pulse predicts, shape (k, q)."""
        k = len(self.levels)
        return np.column_stack([np.convolve(self.levels, h)[:k] for h in self.pulse.T])

    def _simulated(self, realised: Realisation) -> Floats:
        """Return what the model predicts, shape (k, q)."""
        state, rows = np.zeros(len(realised.A)), []
        for level in self.levels:
            rows.append(realised.C @ state + realised.D[:, self.column] * level)
            state = realised.A @ state + realised.B[:, self.column] * level
        return np.array(rows)

    def _gaps(self, predicted: Floats) -> Floats:
        """Return the largest difference for each output over its largest answer; 0 where noise is all, shape (q,)."""
        gap = np.abs(predicted - self.answer).max(axis=0)
        result: Floats = np.divide(gap, self._size, out=np.zeros_like(gap), where=self._seen)
        return result


def accepted(trials: Sequence[MoveTrial], way: str) -> tuple[list[MoveTrial], dict[str, str]]:
    """Return the trials of the inputs that have a linear model, numbered anew, and the other inputs with the reason.

    Args:
        trials: one for each input.
        way: what to do if the FMU's own solver is the cause.

    Raises:
        SimulationError: none has one.
    """
    refused = {t.input: why for t in trials if (why := t.why_refused(way))}
    if len(refused) == len(trials):
        raise SimulationError(f"method response: {next(iter(refused.values()))}")
    kept = [t for t in trials if t.input not in refused]
    return [replace(t, column=j) for j, t in enumerate(kept)], refused


def smallest(largest: Realisation, trials: Sequence[MoveTrial], *, given: bool) -> Realisation:
    """Return the model of the smallest order that predicts the trials about as well as the best order does.

    States beyond it are made of the pulses' own errors.

    Args:
        largest: the model of the largest order that the pulses carry.
        trials: of all its inputs.
        given: whether the order was asked for: then it stays, and a bad one is what was wanted.

    Raises:
        SimulationError: no order predicts them.
    """
    if given:
        return largest
    models = [largest.truncated(order) for order in range(len(largest.A) + 1)]
    errors = [max(t.error(model) for t in trials) for model in models]
    enough = max(_AS_WELL * min(errors), _EXACT)
    result = next(model for model, error in zip(models, errors, strict=True) if error <= enough)
    for trial in trials:
        trial.refuse(result)
    return result
