"""Measure best linear approximations of a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.analysis.bla.design import Lines, RandomPhase, lines_of
from workbench.analysis.bla.estimate import Approximation, approximate
from workbench.analysis.bla.request import Bla
from workbench.analysis.bla.result import BlaResult
from workbench.analysis.excite.playing import Begin, Samples, measure, sampling_of
from workbench.analysis.excite.request import Excite
from workbench.core.job import Job
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.model import Model
from workbench.model.names import check_variables, declared_units
from workbench.model.placing import find_point
from workbench.session.base import Floats

__all__ = ["Grid", "gathered", "run"]

_PER_PERIOD = 8.0  # samples of the highest frequency's period
_SETTLED = 1e-3  # of the output: two periods that differ by more are not periodic yet


def run(model: Model, asked: Bla, job: Job) -> BlaResult:
    """Measure; see `Bla`."""
    check_variables(model, [asked.input], "input", what="input")
    check_variables(model, [asked.output], "variable", what="output")
    point, remarks = find_point(model, asked.at)
    low, high = asked.band
    dt = sampling_of(model, point, asked.dt or _usual(model, point, high)).dt
    if high >= 0.5 / dt:
        raise InputError(f"band: {high:g} Hz is not below half the sampling rate, {0.5 / dt:g} Hz")
    length = 2 * math.ceil(0.5 / (low * dt) - 1e-9)
    lines = lines_of(asked.lines, 1, math.floor(high * length * dt + 1e-6), asked.seed)
    levels = np.atleast_1d(np.asarray(asked.rms, dtype=np.float64))
    under_way = _UnderWay(model, asked, levels, Grid(lines, dt, length), list(remarks))
    total = len(levels) * asked.realisations
    for rms in levels:
        inputs, outputs, rest = [], [], 0.0
        for number in range(asked.realisations):
            design = RandomPhase(
                rms=float(rms), length=length, excited=tuple(lines.excited.tolist()), periods=asked.periods,
                transient=asked.transient, seed=1000 * asked.seed + number,
            )  # fmt: skip
            u, y, begin = _played(model, asked, design, point, dt)
            under_way.take(begin)
            rest = float(begin.y0[0])
            inputs.append(u)
            outputs.append(y)
            if number + 1 == asked.realisations:
                under_way.found.append(approximate(np.array(inputs), np.array(outputs), lines, rest=rest))
                job.partial = under_way.result
            done = len(under_way.found) * asked.realisations + (number + 1) % asked.realisations
            job.done(f"{rms:g} rms, realisation {number + 1}", done, total)
    return under_way.result()


@dataclass(frozen=True, eq=False)
class Grid:
    """Lines of a multisine, sampling interval [s] and samples of a period."""

    lines: Lines
    dt: float
    length: int


@dataclass(eq=False)
class _UnderWay:
    """What is there so far.

    Attributes:
        model, asked, levels, grid: what is measured.
        notes: found out on the way.
        found: one for each power that is done.
        where: the session began there.
    """

    model: Model
    asked: Bla
    levels: Floats
    grid: Grid
    notes: list[str]
    found: list[Approximation] = field(default_factory=list)
    where: OperatingPoint | None = None

    def take(self, begin: Begin) -> None:
        """Take what is known at the beginning of a run."""
        self.where = self.where or begin.operating_point
        self.notes += [note for note in begin.notes if note not in self.notes]

    def result(self) -> BlaResult:
        """Return the result of the powers that are done."""
        asked, model = self.asked, self.model
        units = declared_units(model, (asked.input, asked.output))
        told = {
            "model": model.name, "input": asked.input, "output": asked.output, "input_unit": units[asked.input],
            "output_unit": units[asked.output], "periods": asked.periods, "realisations": asked.realisations,
            "transient": asked.transient, "lines": asked.lines, "notes": tuple(self.notes),
            "operating_point": self.where,
        }  # fmt: skip
        return gathered(self.found, self.levels[: len(self.found)], self.grid, told)


def _usual(model: Model, point: OperatingPoint | None, high: float) -> float | None:
    """Return the sampling interval where none is given; None: the model's own."""
    try:
        sampling_of(model, point, None)
    except InputError:
        return 1.0 / (_PER_PERIOD * high)
    return None


def _played(
    model: Model, asked: Bla, design: RandomPhase, point: OperatingPoint | None, dt: float
) -> tuple[Floats, Floats, Begin]:
    """Return input and output of one realisation, shape (P, N), about their values at the operating point."""
    wish = Excite(
        inputs=(asked.input,), outputs=(asked.output,), signal=design, dt=dt, samples=design.length * design.periods,
        validation_samples=0,
    )  # fmt: skip
    begin: Begin | None = None
    pieces: list[Samples] = []
    for item in measure(model, wish, point):
        if isinstance(item, Begin):
            begin = item
        else:
            pieces.append(item)
    assert begin is not None  # noqa: S101 - `measure` begins with it
    skip = design.transient * design.length
    u, y = (np.vstack([getattr(p, side) for p in pieces])[skip:, 0] for side in ("u", "y"))
    shape = design.periods, design.length
    return (u - begin.u0[0]).reshape(shape), y.reshape(shape), begin


_STACKED = (
    "response", "error", "noise", "distortion", "noise_rms", "distortion_rms", "odd_rms", "even_rms", "offset",
)  # fmt: skip


def gathered(found: Sequence[Approximation], levels: Floats, grid: Grid, told: dict[str, Any]) -> BlaResult:
    """Return the result of all powers, with a note where periods differ.

    Args:
        found: one for each power.
        levels: root mean squares of the input.
        grid: of all.
        told: further fields by name.
    """
    stacked: dict[str, Any] = {name: np.array([getattr(a, name) for a in found]) for name in _STACKED}
    output = np.array([a.output for a in found])
    doubts = [
        f"at {rms:.4g} rms the periods differ by more than {100.0 * _SETTLED:g} % of the output: noise, or not "
        "periodic yet (more transient periods tell)"
        for rms, moves in zip(levels, stacked["noise_rms"] > _SETTLED * output, strict=True)
        if moves
    ]
    return BlaResult(
        rms=levels, frequency_hz=grid.lines.excited / (grid.length * grid.dt), output_rms=output,
        linear_rms=np.array([a.linear for a in found]), dt=grid.dt, samples=grid.length,
        **stacked, **{**told, "notes": (*told.get("notes", ()), *doubts)},
    )  # fmt: skip
