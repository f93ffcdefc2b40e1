"""An uncertain model: how the matrices depend on the parameters over a box, with all that is neglected in a block."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import balance
from workbench.errors import SimulationError
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.robust.family import Place, UncertainFamily, stacked
from workbench.loops.robust.fraction import Fraction, fraction

__all__ = ["Box", "UncertainModel", "uncertain_model"]

_COPIES = 20  # of parameters in the perturbation: AB13MD takes 0.1 s a frequency for 12, 1 to 5 s for 20, 100 s for 35
_CORNERS = 5  # of so many parameters all corners of the box are looked at, of more as many at random


@dataclass(frozen=True)
class Box:
    """Ranges of the deviations.

    Attributes:
        centre: shape (p,).
        half: half the width of each range, shape (p,).
    """

    centre: Place
    half: Place

    @classmethod
    def of_size(cls, count: int, size: float) -> Box:
        """Return the box around the middle of all ranges, `size` times as wide as these."""
        return cls((0.0,) * count, (size,) * count)

    def place(self, share: Sequence[float]) -> Place:
        """Return the deviations at shares of the half widths, each from -1 to 1."""
        return tuple(c + h * s for c, h, s in zip(self.centre, self.half, share, strict=True))

    def halves(self, number: int) -> tuple[Box, Box]:
        """Return both halves along one parameter."""
        quarter = 0.5 * self.half[number]
        half = (*self.half[:number], quarter, *self.half[number + 1 :])
        low, high = (
            (*self.centre[:number], self.centre[number] + s * quarter, *self.centre[number + 1 :]) for s in (-1.0, 1.0)
        )
        return Box(low, half), Box(high, half)


@dataclass(frozen=True, eq=False)
class UncertainModel:
    """N(δ) = N₀ + F(δ) + W E V over a box, with N = [A B; C D], |δᵢ| ≤ 1, ‖E‖ ≤ 1.

    Attributes:
        box: in which it holds.
        middle: N₀.
        fraction: F, what the parameters do.
        left, right: W and V, which with any E hold all that was found besides.
        acts: how much each parameter does by itself.
        neglected: size of what E holds, relative to what the parameters do.
        states: number of states.
        dt: period [s].
    """

    box: Box
    middle: Floats
    fraction: Fraction
    left: Floats
    right: Floats
    acts: tuple[float, ...]
    neglected: float
    states: int
    dt: float

    def matrix(self, share: Floats) -> Floats:
        """Return N without the neglected rest, at shares of the half widths."""
        return np.asarray(self.middle + self.fraction.at(share))

    @property
    def bounded(self) -> bool:
        """Whether its bounds can be had in minutes: the parameters stand few times in the perturbation."""
        return sum(self.fraction.ranks) <= _COPIES

    @property
    def centre(self) -> Linear:
        """The model without uncertainty."""
        return _taken_apart(self.middle, self.states, self.dt)

    @cached_property
    def _channels(self) -> tuple[Floats, Floats, Floats, tuple[MuBlock, ...]]:
        """L, J and R of parameters and rest together, and their structure."""
        f, more = self.fraction, self.left.shape[1]
        blocks = [MuBlock(size=k, real=True) for k in f.ranks if k]
        if more:
            blocks.append(MuBlock(size=more, varies=False))
        inner = np.zeros((len(f.inner) + more,) * 2)
        inner[: len(f.inner), : len(f.inner)] = f.inner
        return np.hstack([f.left, self.left]), inner, np.vstack([f.right, self.right]), tuple(blocks)

    def stability(self) -> tuple[Linear, tuple[MuBlock, ...]]:
        """Return what the perturbation is in a loop with, and its structure; the model's inputs and outputs are not."""
        left, inner, right, blocks = self._channels
        n = self.states
        return Linear(self.middle[:n, :n], left[:n], right[:, :n], inner, dt=self.dt), blocks

    def with_performance(self, performance: Sequence[int]) -> tuple[Linear, tuple[MuBlock, ...]]:
        """Return the same with the model's inputs and outputs behind, as complex blocks whose size is sought.

        Inputs or outputs that are fewer are filled up by those that do nothing.

        Args:
            performance: sizes of the blocks.
        """
        left, inner, right, blocks = self._channels
        n, size = self.states, right.shape[0]
        outputs, inputs = self.middle.shape[0] - n, self.middle.shape[1] - n
        most = sum(performance)
        widened = np.zeros((n + most, n + most))
        widened[: n + outputs, : n + inputs] = self.middle
        more_left, more_right = np.zeros((n + most, size)), np.zeros((size, n + most))
        more_left[: n + outputs], more_right[:, : n + inputs] = left, right
        b = np.hstack([more_left[:n], widened[:n, n:]])
        c = np.vstack([more_right[:, :n], widened[n:, :n]])
        d = np.block([[inner, more_right[:, n:]], [more_left[n:], widened[n:, n:]]])
        fixed = tuple(MuBlock(size=x.size, real=x.real, varies=False) for x in blocks)
        return Linear(widened[:n, :n], b, c, d, dt=self.dt), (*fixed, *(MuBlock(size=k) for k in performance))


def uncertain_model(family: UncertainFamily, box: Box, *, seed: int = 0) -> UncertainModel:
    """Return how the matrices depend on the parameters over a box.

    The fraction comes from the ends of each range, the points half way and the corners. What it leaves there and at
    points between, on which nothing was fitted, is held by the block of the rest: the smallest found that has all of
    it, and larger in the ratio by which the points between surpass the others.

    Args:
        family: of the linear models.
        box: in deviations.
        seed: of the points between.

    Raises:
        SimulationError: at one of the points there is no linear model.
    """
    count = len(box.half)
    unit = np.eye(count)
    design = [np.zeros(count), *unit, *-unit, *0.5 * unit, *-0.5 * unit, *_corners(count, seed)]
    between = list(np.random.default_rng(seed).uniform(-1.0, 1.0, (min(2 * count, 8), count)))
    models = family.at([box.place(share) for share in (*design, *between)])
    if any(m is None for m in models):
        place = next(box.place(s) for s, m in zip((*design, *between), models, strict=True) if m is None)
        where = ", ".join(f"{name} = {value:g}" for name, value in family.values(place).items())
        raise SimulationError(f"robust: there is no linear model at {where}: {family.failed[place]}")
    linear = [m for m in models if m is not None]
    scale = balance(linear[0].A)[1]
    every = [stacked(m, scale) for m in linear]
    size = float(np.abs(every[0]).max(initial=0.0))
    least = 10.0 * family.accuracy * size
    middle = every[0]
    moved = [n - middle for n in every]
    alone = [[moved[1 + k * count + i] for k in (0, 3, 1, 2)] for i in range(count)]
    first, last = 1 + 4 * count, len(design)
    found = fraction(alone, design[first:last], moved[first:last], least)
    rest = [n - found.at(share) for n, share in zip(moved, (*design, *between), strict=True)]
    left, right, norm = _held(rest, len(design), 1e-12 * size)
    most = max(float(np.linalg.norm(n, 2)) for n in moved)
    acts = tuple(max(float(np.linalg.norm(m)) for m in each) for each in alone)
    neglected = norm / most if most > 0.0 else 0.0
    return UncertainModel(
        box, middle, found, left, right, acts, neglected, len(linear[0].A), linear[0].dt
    )  # fmt: skip


def _corners(count: int, seed: int) -> list[Floats]:
    """Return corners of the box, or some at random where there are many."""
    if count <= _CORNERS:
        return [np.array(signs) for signs in itertools.product((-1.0, 1.0), repeat=count)]
    return list(np.random.default_rng(seed).choice([-1.0, 1.0], (2**_CORNERS, count)))


def _held(rest: Sequence[Floats], design: int, least: float) -> tuple[Floats, Floats, float]:
    """Return L and R with which L Δ R, ‖Δ‖ ≤ 1, has every rest, and the largest norm of a rest.

    The weights are the roots of the roots of Σ R Rᵀ and Σ Rᵀ R: of a single rest the singular values.

    Args:
        rest: of every point.
        design: so many of them come first, on which the model was fitted.
        least: what is smaller is 0.
    """
    norms = np.array([np.linalg.norm(r, 2) for r in rest])
    largest = float(norms.max(initial=0.0))
    if not largest > least:
        return np.zeros((len(rest[0]), 0)), np.zeros((0, rest[0].shape[1])), 0.0
    left, into = _root(sum((r @ r.T for r in rest), np.zeros((len(rest[0]),) * 2)), least)
    right, out = _root(sum((r.T @ r for r in rest), np.zeros((rest[0].shape[1],) * 2)), least)
    sizes = np.array([np.linalg.norm(into @ r @ out.T, 2) for r in rest])
    fitted, checked = float(sizes[:design].max(initial=0.0)), float(sizes[design:].max(initial=0.0))
    grown = max(fitted, checked) * (max(checked / fitted, 1.0) if fitted > 0.0 else 1.0)
    # What the roots leave out, below `least`, is as good as rounding.
    order = max(left.shape[1], right.shape[1])
    wide = np.zeros((len(left), order)), np.zeros((order, len(right)))
    wide[0][:, : left.shape[1]] = left * np.sqrt(grown)
    wide[1][: right.shape[1]] = right.T * np.sqrt(grown)
    return wide[0], wide[1], largest


def _root(square: Floats, least: float) -> tuple[Floats, Floats]:
    """Return the fourth root of a positive matrix, as a factor with fewest columns, and its inverse from the left."""
    values, vectors = np.linalg.eigh(square)
    some = values > max(least**2, 1e-20 * float(values[-1]))
    root = values[some] ** 0.25
    return vectors[:, some] * root, (vectors[:, some] / root).T


def _taken_apart(matrix: Floats, n: int, dt: float) -> Linear:
    return Linear(matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:], dt=dt)
