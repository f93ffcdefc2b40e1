"""Best linear approximations of recorded data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.bla.design import Lines
from workbench.data.bla.estimate import approximate
from workbench.data.bla.request import BestLinear
from workbench.data.bla.result import BlaResult
from workbench.data.bla.run import Grid, gathered
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.jobs.job import Job

__all__ = ["run"]

# Two periods of one realisation differ by noise. More than so many times that, and of the input, is another phase; half
# of the √2 of the input that random phases differ by is one in any case.
_NOISE, _LITTLE, _OTHER = 5.0, 0.05, 0.7
_SMALL = 1e-3  # of the largest amplitude: lines below are not excited
_CLEAR = 20.0  # times the noise of the mean: chance does not make a line so large


def run(experiments: Sequence[Experiment], request: BestLinear, job: Job) -> BlaResult:
    """Evaluate recorded data; see `BestLinear`."""
    if not experiments:
        raise InputError("there is no experiment")
    first = experiments[0]
    length = round(request.period / first.dt)
    if length < 4 or abs(length * first.dt - request.period) > 1e-6 * request.period:
        raise InputError(f"period: {request.period:g} s is not a whole number of samples of {first.dt:g} s")
    for data in experiments:
        _check(data, first)
    result = [piece for data in experiments for piece in _realisations(data, length)]
    kept = [piece for piece in result if len(piece.u) - request.transient >= 2]
    if not kept:
        most = max(len(piece.u) for piece in result)
        raise InputError(_too_few(first, request, most))
    periods = min(len(piece.u) for piece in kept) - request.transient
    u, y = (np.array([getattr(piece, side)[-periods:] for piece in kept]) for side in ("u", "y"))
    lines = _lines(u)
    approximation = approximate(u, y, lines, rest=math.nan)
    facts = {
        "model": request.name, "input": first.input_names[0], "output": first.output_names[0],
        "input_unit": first.input_units[0], "output_unit": first.output_units[0], "periods": periods,
        "realisations": len(u), "transient": request.transient, "lines": _kind(lines),
        "notes": (*(n for data in experiments for n in data.notes), *_notes(result, kept, periods + request.transient)),
    }  # fmt: skip
    level = float(np.sqrt(np.mean(np.var(u, axis=2))))
    job.done("data evaluated", 1, 1)
    return gathered([approximation], np.array([level]), Grid(lines, first.dt, length), facts)


@dataclass(frozen=True, eq=False)
class _Piece:
    """One realisation of the phases: input and output, shape (periods, samples of a period)."""

    u: Floats
    y: Floats


def _check(data: Experiment, first: Experiment) -> None:
    if data.n_inputs != 1 or data.n_outputs != 1:
        raise InputError(f"{data.name}: one input and one output are needed; select them")
    if abs(data.dt - first.dt) > 1e-9 * first.dt:
        raise InputError(f"{data.name}: sampled every {data.dt:g} s, {first.name} every {first.dt:g} s; resample one")


def _realisations(data: Experiment, length: int) -> list[_Piece]:
    """Return the whole periods, divided where the input's phases change."""
    count = data.n_samples // length
    if count < 2:
        raise InputError(
            f"{data.name}: {data.n_samples} samples are {count} whole periods of {length}, at least two are needed"
        )
    u, y = (side[: count * length, 0].reshape(count, length) for side in (data.u, data.y))
    about = u - u.mean()
    change = np.sqrt(np.mean(np.diff(about, axis=0) ** 2, axis=1))
    size = float(np.sqrt(np.mean(about**2)))
    least = min(_OTHER * size, max(_NOISE * float(change.min()), _LITTLE * size))
    places = np.flatnonzero(change > least) + 1
    return [_Piece(*pair) for pair in zip(np.split(u, places), np.split(y, places), strict=True)]


def _too_few(data: Experiment, request: BestLinear, most: int) -> str:
    """Return why no realisation can be evaluated."""
    if most < 2:
        return (
            f"{data.name}: the input '{data.input_names[0]}' does not repeat with a period of {request.period:g} s: a "
            "multisine with another period, or none"
        )
    left = max(most - request.transient, 0)
    return (
        f"{data.name}: {left} whole period{'' if left == 1 else 's'} of {request.period:g} s after the transient, at "
        "least two are needed"
    )


def _lines(u: Floats) -> Lines:
    """Return the lines where the input has power in every realisation.

    Args:
        u: shape (M, P, N).

    Raises:
        InputError: realisations have power at other lines.
    """
    _, P, N = u.shape
    U = np.fft.rfft(u, axis=2)[:, :, 1 : (N + 1) // 2] / N
    power, noise = np.abs(U.mean(axis=1)) ** 2, np.var(U, axis=1, ddof=1) / P
    least = np.maximum(_SMALL**2 * power.max(axis=1, keepdims=True), _CLEAR * np.median(noise, axis=1, keepdims=True))
    there = power > least
    share = there.mean(axis=0)
    excited = np.flatnonzero(share > 0.5) + 1
    if len(excited) < 3:
        raise InputError(f"the input has power beyond its noise at {len(excited)} lines, at least three are needed")
    odd = np.flatnonzero((share > 0.0) & (share < 1.0)) + 1
    if len(odd) > 0.05 * len(excited):
        raise InputError(
            f"the realisations excite different lines ({len(odd)} are not in all): evaluate those with the same lines"
        )
    between = np.setdiff1d(np.arange(1, excited[-1] + 1), [*excited, *odd])
    return Lines(excited, between[between % 2 == 1], between[between % 2 == 0])


def _kind(lines: Lines) -> str:
    if np.any(lines.excited % 2 == 0):
        return "all"
    return "random-odd" if len(lines.odd) else "odd"


def _notes(result: Sequence[_Piece], kept: Sequence[_Piece], periods: int) -> tuple[str, ...]:
    """Return what was left out."""
    notes = []
    if len(kept) == 1:
        notes.append("one realisation: distortion at excited lines is taken from odd lines that are not excited")
    short = [len(piece.u) for piece in result if not any(piece is other for other in kept)]
    if short:
        notes.append(f"{sum(short)} periods at other phases are left out, too few after the transient")
    longer = sum(len(piece.u) - periods for piece in kept)
    if longer:
        notes.append(f"{longer} first periods of longer realisations are left out: all are evaluated alike")
    return tuple(notes)
