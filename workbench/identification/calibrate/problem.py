"""Residuals and their derivatives by the coordinates: what the search and the information are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import SimulationError
from workbench.identification.calibrate.noise import ColouredNoise, Loss, Segments
from workbench.identification.calibrate.quantities import FreeValues
from workbench.identification.calibrate.runs import ModelRuns

__all__ = ["CalibrationProblem", "Flags", "Gradient"]

Flags = NDArray[np.bool_]
_Run = Callable[[Sequence[Floats]], list[list[Floats | None]] | None]  # points → outputs, [point][data]

_UNSURE = 0.1  # error of a derivative, relative: from here on other steps are tried
_OTHER = 10.0  # times the step, and one over it
_ROOM = 0.1  # of a step, between a coordinate and its limit
_GROWN = 1e100  # standard deviations
_WIDER, _ALIKE = 30.0, 0.05  # a wider step, and how far (relative) derivatives by it may be off
_ROUNDING = 1e-14  # relative error of differences of runs that share their steps
_LEAST = 1e-10  # relative error of a run that is assumed at least
_STEPPED = 1e-6  # likewise of a co-simulation, whose integration is its own


@dataclass(frozen=True, eq=False)
class Gradient:
    """Derivatives of the outputs.

    Attributes:
        y: by the coordinates, shape (n, p, q) of each data set.
        error: of these, shape (n, p, q) of each data set: half the second difference; zeros: not known.
        failed: coordinates at whose sides runs failed.
    """

    y: tuple[Floats, ...]
    error: tuple[Floats, ...]
    failed: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """What is fitted to what.

    Attributes:
        data: measured.
        segments: where there are samples.
        quantities: of the coordinates.
        runs: of the model.
        noise: of the outputs.
        rtol: relative error of a run, as its tolerance says; 0: not known.
        loss: how residuals count.
    """

    data: tuple[Experiment, ...]
    segments: Segments
    quantities: FreeValues
    runs: ModelRuns
    noise: ColouredNoise
    rtol: float
    loss: Loss

    def with_noise(self, noise: ColouredNoise) -> CalibrationProblem:
        """Return the problem with other noise."""
        return replace(self, noise=noise)

    @property
    def samples(self) -> int:
        """How many samples there are in all."""
        return sum(piece.stop - piece.start for *_, piece in self.segments.each())

    def difference(self, z: Floats) -> list[Floats] | None:
        """Return measured less computed, shape (n, p) of each data set; None: a run failed."""
        known = _whole(self.runs.outputs([z])[0])
        return None if known is None else [one.y - y for one, y in zip(self.data, known, strict=True)]

    def residuals(self, z: Floats) -> Floats:
        """Return the whitened residuals, shape (N,); infinite where a run failed, or grew beyond all bounds."""
        found = self.difference(z)
        e = np.full(self.samples, np.inf) if found is None else self.noise.whitened(found, self.segments)
        return e if np.all(np.abs(e) < _GROWN) else np.full(self.samples, np.inf)

    def cost(self, z: Floats) -> float:
        """Return Σ ρ of the whitened residuals; infinite where a run failed."""
        return self.loss.cost(self.residuals(z))

    def gradient(self, z: Floats, *, central: bool) -> Gradient:
        """Return the derivatives by differences of runs.

        The step follows from the error ε of a difference: √ε to one side, ∛ε to both (Press et al., Numerical Recipes,
        section 5.7), in coordinates in which a step of 1 is large. Runs that share their steps differ by rounding
        alone; where there are none, or events on the way make them differ by more, ε is the tolerance of a run. Where
        the second difference says that a derivative which counts is poor, steps ten times larger and smaller are tried,
        and the best is taken.

        Args:
            z: coordinates.
            central: to both sides, which gives errors as well.

        Raises:
            SimulationError: the model cannot be run there.
        """
        power = 1.0 / 3.0 if central else 0.5
        found = self._of_shared_steps(z, _ROUNDING**power, central=central)
        step = max(self.rtol or _STEPPED, _LEAST) ** power
        for factor in (1.0, _OTHER, 1.0 / _OTHER):
            unsure = np.ones(len(z), dtype=np.bool_) if found is None else self._unsure(found)
            if not unsure.any():
                break
            other = self._differences(z, step * factor, self.runs.outputs, central=central, only=unsure)
            found = found or other
            if other is not None and found is not None:
                better = unsure & (_relative(other) < _relative(found))
                y, error = (_taken(*parts, better) for parts in ((found.y, other.y), (found.error, other.error)))
                found = replace(found, y=y, error=error)
        if found is None:
            raise SimulationError("the model cannot be run here")
        return found

    def _of_shared_steps(self, z: Floats, step: float, *, central: bool) -> Gradient | None:
        """Return the derivatives by runs that share their steps; None: there are none, or they depend on the step."""
        found, place = self._differences(z, step, self.runs.together, central=central), self.runs.place
        if found is None or place.checked:
            return found
        place.checked = True
        wider = self._differences(z, _WIDER * step, self.runs.together, central=central)
        if wider is not None and np.all(_apart(found, wider) <= _ALIKE):
            return found
        place.joint = None  # an event falls elsewhere by more than such a step moves the outputs
        return None

    def _unsure(self, found: Gradient) -> Flags:
        """Return which derivatives are poor, and are of a parameter that the data may tell."""
        counts = np.linalg.norm(self.noise.whitened(found.error, self.segments), axis=0) > _UNSURE
        return np.asarray(counts & (_relative(found) > _UNSURE), dtype=np.bool_)

    def _differences(
        self, z: Floats, step: float, run: _Run, *, central: bool, only: Flags | None = None
    ) -> Gradient | None:
        """Return differences, to the other side alone at a limit or beside a run that failed; None: no run there."""
        low, high = self.quantities.limits
        chosen = np.arange(len(z)) if only is None else np.flatnonzero(only)
        sides = []
        for sign in (1.0, -1.0)[: 1 + central]:
            there = np.clip(z + sign * step, low, high)
            there = np.where(np.abs(there - z) > _ROOM * step, there, np.clip(z - sign * step, low, high))
            found = run([z, *(np.where(np.arange(len(z)) == k, there, z) for k in chosen)])
            base = None if found is None else _whole(found[0])
            if found is None or base is None:
                return None
            sides.append([_slopes(y, [f[i] for f in found[1:]], chosen, there - z) for i, y in enumerate(base)])
        both = list(zip(sides[0], sides[-1], strict=True))
        y = [np.where(np.isnan(a), b, np.where(np.isnan(b), a, 0.5 * (a + b))) for a, b in both]
        error = tuple(np.nan_to_num(0.5 * np.abs(a - b)) for a, b in both)
        failed = tuple(int(k) for k in chosen if any(np.isnan(one[..., k]).any() for one in y))
        return Gradient(tuple(np.nan_to_num(one) for one in y), error, failed)

    def whitened(self, gradient: Gradient) -> tuple[Floats, Floats]:
        """Return J = −∂e/∂z, shape (N, q), and its error."""
        return self.noise.whitened(gradient.y, self.segments), self.noise.whitened(gradient.error, self.segments)


def _whole(found: Sequence[Floats | None]) -> list[Floats] | None:
    known = [y for y in found if y is not None and np.all(np.isfinite(y))]
    return known if len(known) == len(found) else None


def _slopes(base: Floats, moved: Sequence[Floats | None], chosen: NDArray[np.intp], steps: Floats) -> Floats:
    """Return differences over steps, shape (n, p, q); zero where none was chosen, NaN where a run failed."""
    result = np.zeros((*base.shape, len(steps)))
    for k, y in zip(chosen, moved, strict=True):
        result[..., k] = np.nan if y is None or not np.all(np.isfinite(y)) else (y - base) / steps[k]
    return result


def _apart(one: Gradient, other: Gradient) -> Floats:
    """Return how far two derivatives by each coordinate are apart, relative to the larger, shape (q,)."""
    sizes = [np.sqrt(sum(np.sum(part**2, axis=(0, 1)) for part in g.y)) for g in (one, other)]
    between = np.sqrt(sum(np.sum((a - b) ** 2, axis=(0, 1)) for a, b in zip(one.y, other.y, strict=True)))
    largest = np.maximum(*sizes)
    return np.asarray(np.divide(between, largest, out=np.zeros_like(between), where=largest > 0.0))


def _relative(gradient: Gradient) -> Floats:
    """Return the error of each derivative relative to it, shape (q,); 0 where both are."""
    sizes, errors = (
        np.sqrt(sum(np.sum(part**2, axis=(0, 1)) for part in parts)) for parts in (gradient.y, gradient.error)
    )
    return np.asarray(np.divide(errors, sizes, out=np.where(errors > 0.0, np.inf, 0.0), where=sizes > 0.0))


def _taken(first: Sequence[Floats], other: Sequence[Floats], better: Flags) -> tuple[Floats, ...]:
    return tuple(np.where(better, b, a) for a, b in zip(first, other, strict=True))
