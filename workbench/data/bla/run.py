"""Measure best linear approximations of a model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.bla.design import Lines, RandomPhase, lines_of
from workbench.data.bla.estimate import MATTERS, Approximation, approximate, response_of
from workbench.data.bla.request import Bla
from workbench.data.bla.result import BlaResult
from workbench.data.excite.recording import Begin, Samples, measure, sampling_of
from workbench.data.excite.request import Excite
from workbench.errors import FmuError, InputError, SimulationError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.names import check_variables, declared_units
from workbench.model.operating_point import find_point

__all__ = ["Grid", "gathered", "run"]

_PER_PERIOD = 8.0  # samples of the highest frequency's period
# With this part of the tolerance the first realisation has about this part of the integration's error; the change is
# the rest of it.
_TIGHTER = 0.1
_DOMINATES = 0.5  # of the error
_LONG = 1e4  # periods that nobody waits for


def run(model: Model, request: Bla, job: Job) -> BlaResult:
    """Measure; see `Bla`."""
    check_variables(model, [request.input], "input", what="input")
    check_variables(model, [request.output], "variable", what="output")
    point, remarks = find_point(model, request.at)
    low, high = request.band
    dt = sampling_of(model, point, request.dt or _usual(model, point, high)).dt
    if high >= 0.5 / dt:
        raise InputError(f"band: {high:g} Hz is not below half the sampling rate, {0.5 / dt:g} Hz")
    length = 2 * math.ceil(0.5 / (low * dt) - 1e-9)
    lines = lines_of(request.lines, 1, math.floor(high * length * dt + 1e-6), request.seed)
    levels = np.atleast_1d(np.asarray(request.rms, dtype=np.float64))
    under_way = _UnderWay(model, request, levels, Grid(lines, dt, length), list(remarks))
    total = len(levels) * request.realisations
    for rms in levels:
        inputs, outputs, rest, designs = [], [], 0.0, list[RandomPhase]()
        for number in range(request.realisations):
            design = RandomPhase(
                rms=float(rms), length=length, excited=tuple(lines.excited.tolist()), periods=request.measured_periods,
                transient=request.transient, seed=1000 * request.seed + number,
            )  # fmt: skip
            designs.append(design)
            u, y, begin = _played(model, request, design, point, dt)
            under_way.take(begin)
            rest = float(begin.y0[0])
            inputs.append(u)
            outputs.append(y)
            if number + 1 == request.realisations:
                result = approximate(np.array(inputs), np.array(outputs), lines, rest=rest)
                finer = _finer(model, request, designs[0], point, dt)
                if not isinstance(finer, str):
                    away = np.abs(response_of(*finer, lines) - response_of(inputs[0], outputs[0], lines))
                    result = _with_integration(result, away)
                under_way.take_integration(result, float(rms), finer if isinstance(finer, str) else "changes nothing")
                under_way.found.append(result)
                job.partial = under_way.result
            done = len(under_way.found) * request.realisations + (number + 1) % request.realisations
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

    def take_integration(self, result: Approximation, rms: float, why: str) -> None:
        """Say what the errors are where they are not statistics; `why`: what became of a tighter tolerance."""
        if not result.integration.any():
            words = f"the integration error is not included in the error: a tighter tolerance {why}"
            self.notes += [words] * (self.model.solver != "none" and words not in self.notes)
        elif np.median(result.integration / result.error) > _DOMINATES:
            self.notes.append(
                f"at {rms:.4g} rms the error is what the integration makes, as a tenth of the tolerance shows: noise "
                "and distortion are below it (a smaller `tolerance` narrows it)"
            )

    def result(self) -> BlaResult:
        """Return the result of the powers that are done."""
        request, model = self.asked, self.model
        units = declared_units(model, (request.input, request.output))
        facts = {
            "model": model.name, "input": request.input, "output": request.output, "input_unit": units[request.input],
            "output_unit": units[request.output], "periods": request.measured_periods,
            "realisations": request.realisations, "transient": request.transient, "lines": request.lines,
            "notes": tuple(self.notes), "operating_point": self.where,
        }  # fmt: skip
        return gathered(self.found, self.levels[: len(self.found)], self.grid, facts)


def _usual(model: Model, point: OperatingPoint | None, high: float) -> float | None:
    """Return the sampling interval where none is given; None: the model's own."""
    try:
        sampling_of(model, point, None)
    except InputError:
        return 1.0 / (_PER_PERIOD * high)
    return None


def _played(
    model: Model, request: Bla, design: RandomPhase, point: OperatingPoint | None, dt: float
) -> tuple[Floats, Floats, Begin]:
    """Return input and output of one realisation, shape (P, N), about their values at the operating point."""
    wish = Excite(
        inputs=(request.input,), outputs=(request.output,), signal=design, dt=dt,
        samples=design.length * design.periods, validation_samples=0,
    )  # fmt: skip
    items = list(measure(model, wish, point))
    begin = next(item for item in items if isinstance(item, Begin))
    pieces = [item for item in items if isinstance(item, Samples)]
    skip = design.transient * design.length
    u, y = (np.vstack([getattr(p, side) for p in pieces])[skip:, 0] for side in ("u", "y"))
    shape = design.periods, design.length
    return (u - begin.u0[0]).reshape(shape), y.reshape(shape), begin


def _finer(
    model: Model, request: Bla, design: RandomPhase, point: OperatingPoint | None, dt: float
) -> tuple[Floats, Floats] | str:
    """Return a realisation with a tighter tolerance, or words why there is none."""
    if model.recipe is None or model.solver == "none":
        return "cannot be tried"
    try:
        with model.recipe.tighter(_TIGHTER).open() as exact:
            u, y, _ = _played(exact, request, design, point, dt)
    except (FmuError, SimulationError) as error:
        return f"fails ({error})"
    return u, y


def _with_integration(result: Approximation, away: Floats) -> Approximation:
    """Return the approximation, its error widened by what the integration gets wrong.

    Args:
        result: without.
        away: how far a tighter tolerance has the response off, shape (k,).
    """
    part = np.max([np.append(away[1:], 0.0), away, np.append(0.0, away[:-1])], axis=0) / (1.0 - _TIGHTER)
    return replace(result, error=np.hypot(result.error, part), integration=part)


_STACKED = (
    "response", "error", "integration", "noise", "distortion", "noise_rms", "distortion_rms", "removed_rms",
    "unsettled_rms", "odd_rms", "even_rms", "offset",
)  # fmt: skip


def _doubts(result: Approximation, size: float) -> Iterator[str]:
    """Yield what is to be said of the periods at one power.

    Args:
        result: there.
        size: root mean square of the output.
    """
    removed, unsettled, noise = (part / size for part in (result.removed_rms, result.unsettled_rms, result.noise_rms))
    if removed > MATTERS:
        wait = max(result.wait, 1.0)
        later = f"; about {wait:.2g} more transient periods let it decay" if wait < _LONG else ""
        yield f"a transient of {100.0 * removed:.3g} % of the output was estimated and taken off{later}"
    if unsettled > MATTERS:
        yield (
            f"the periods have not settled: up to {100.0 * unsettled:.3g} % of the output may still be a transient "
            "(more transient periods)"
        )
    elif noise > MATTERS:
        yield (
            f"the periods differ by {100.0 * noise:.3g} % of the output, which does not decay: noise, or no answer "
            "with this period"
        )


def gathered(result: Sequence[Approximation], levels: Floats, grid: Grid, facts: dict[str, Any]) -> BlaResult:
    """Return the result of all powers, with a note where periods differ.

    Args:
        result: one for each power.
        levels: root mean squares of the input.
        grid: of all.
        facts: further fields by name.
    """
    stacked: dict[str, Any] = {name: np.array([getattr(a, name) for a in result]) for name in _STACKED}
    output = np.array([a.output for a in result])
    doubts = [
        f"at {rms:.4g} rms {words}"
        for rms, size, found_there in zip(levels, np.maximum(output, 1e-300), result, strict=True)
        for words in _doubts(found_there, float(size))
    ]
    return BlaResult(
        rms=levels, frequency_hz=grid.lines.excited / (grid.length * grid.dt), output_rms=output,
        linear_rms=np.array([a.linear for a in result]), dt=grid.dt, samples=grid.length,
        **stacked, **{**facts, "notes": (*facts.get("notes", ()), *doubts)},
    )  # fmt: skip
