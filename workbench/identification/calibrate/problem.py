"""Residuals and their derivatives by the coordinates: what the search and the information are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.identification.calibrate.noise import ColouredNoise, Loss, Segments
from workbench.identification.calibrate.quantities import FreeValues
from workbench.identification.calibrate.runs import ModelRuns

__all__ = ["CalibrationProblem", "Flags", "Gradient"]

Flags = NDArray[np.bool_]

_UNSURE = 0.1  # error of a derivative, relative: from here on other steps are tried
_OTHER = 10.0  # times the step, and one over it
_ROOM = 0.1  # of a step, between a coordinate and its limit
_GROWN = 1e100  # standard deviations
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
        found = self.runs.outputs([z])[0]
        known = [y for y in found if y is not None]
        if len(known) < len(found) or not all(np.all(np.isfinite(y)) for y in known):
            return None
        return [one.y - y for one, y in zip(self.data, known, strict=True)]

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

        The step follows from the error ε of a run: √ε to one side, ∛ε to both (Press et al., Numerical Recipes,
        section 5.7), in coordinates in which a step of 1 is large. Where the second difference says that a derivative
        is poor, steps ten times larger and smaller are tried, and the best is taken.

        Args:
            z: coordinates.
            central: to both sides, which gives errors as well.
        """
        noise = max(self.rtol or _STEPPED, _LEAST)
        steps = np.full(len(z), noise ** (1.0 / 3.0) if central else np.sqrt(noise))
        found = self._differences(z, steps, central=central)
        if not central:
            return found
        unsure = _relative(found) > _UNSURE
        for factor in (_OTHER, 1.0 / _OTHER) if unsure.any() else ():
            other = self._differences(z, steps * factor, central=True, only=unsure)
            better = unsure & (_relative(other) < _relative(found))
            found = replace(found, y=_taken(found.y, other.y, better), error=_taken(found.error, other.error, better))
        return found

    def _differences(self, z: Floats, steps: Floats, *, central: bool, only: Flags | None = None) -> Gradient:
        """Return differences; at a limit, or beside a run that failed, to the other side alone."""
        low, high = self.quantities.limits
        numbers = [k for k in range(len(z)) if only is None or only[k]]
        points = [z]
        sides = [(k, x) for k in numbers for x in _sides(z[k], steps[k], low[k], high[k], central=central)]
        points += [_moved(z, k, x) for k, x in sides]
        base, *found = self.runs.outputs(points)
        shapes = [(*one.y.shape, len(z)) for one in self.data]
        y, error = [np.zeros(s) for s in shapes], [np.zeros(s) for s in shapes]
        failed = []
        for k in numbers:
            ran = [(x, o) for (n, x), o in zip(sides, found, strict=True) if n == k and _whole(o) is not None]
            if not ran:
                failed.append(k)
                continue
            for i in range(len(self.data)):
                at = [(x, o[i]) for x, o in ran]
                y[i][..., k], error[i][..., k] = _derivative(z[k], base[i], at)
        return Gradient(tuple(y), tuple(error), tuple(failed))

    def whitened(self, gradient: Gradient) -> tuple[Floats, Floats]:
        """Return J = −∂e/∂z, shape (N, q), and its error."""
        return self.noise.whitened(gradient.y, self.segments), self.noise.whitened(gradient.error, self.segments)


def _whole(found: Sequence[Floats | None]) -> Sequence[Floats] | None:
    known = [y for y in found if y is not None and np.all(np.isfinite(y))]
    return known if len(known) == len(found) else None


def _sides(at: float, step: float, low: float, high: float, *, central: bool) -> list[float]:
    """Return where else the model is run; of the sides those on which there is room, the wider one first."""
    ends = sorted((min(at + step, high), max(at - step, low)), key=lambda x: -abs(x - at))
    return [x for x in ends[: 1 + central] if abs(x - at) > _ROOM * step]


def _moved(z: Floats, k: int, x: float) -> Floats:
    result = z.copy()
    result[k] = x
    return result


def _derivative(at: float, base: Floats | None, sides: Sequence[tuple[float, Floats | None]]) -> tuple[Floats, Floats]:
    """Return a derivative and its error; of both sides where there are both."""
    slopes = [(y - base) / (x - at) for x, y in sides if y is not None and base is not None]
    if len(slopes) == 1:
        return slopes[0], np.zeros_like(slopes[0])
    return 0.5 * (slopes[0] + slopes[1]), 0.5 * np.abs(slopes[0] - slopes[1])


def _relative(gradient: Gradient) -> Floats:
    """Return the error of each derivative relative to it, shape (q,); 0 where both are."""
    sizes, errors = (
        np.sqrt(sum(np.sum(part**2, axis=(0, 1)) for part in parts)) for parts in (gradient.y, gradient.error)
    )
    return np.asarray(np.divide(errors, sizes, out=np.where(errors > 0.0, np.inf, 0.0), where=sizes > 0.0))


def _taken(first: Sequence[Floats], other: Sequence[Floats], better: Flags) -> tuple[Floats, ...]:
    return tuple(np.where(better, b, a) for a, b in zip(first, other, strict=True))
