"""Does a signal stop at a limit?

An output at rest at its highest or lowest value while the inputs still move is at a limit. While the inputs rest as
well, as between the switches of a PRBS, it may as well have settled; where a linear model explains the record to the
last digit it has, else such data cannot tell. Limits that are known are better than any guess.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.advice.delay import delays
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy

__all__ = ["judge_saturation", "stretches_at"]

_STILL = 1e-6  # of the range
_LONG = 3  # samples in a row
_FEW = 6  # samples in all
_SHARE = 0.002  # of the record
_MOVES = 0.01  # of an input's range
_FEW_LEVELS = 8
_AGAIN = 3
_LINEAR_DB = 60.0
_ENOUGH = 0.1  # of the stretches

Stretches = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Rest:
    """A signal that rests at its highest or lowest value.

    Attributes:
        column: its name.
        value: the level.
        upper: whether it is the highest.
        stretches: first sample and the one after the last of each.
        share: of the record.
        moving: share of the stretches during which an input moves.
        known: the value is one of the limits that the user named.
    """

    column: str
    value: float
    upper: bool
    stretches: Stretches
    share: float
    moving: float
    known: bool


def stretches_at(x: Floats, level: float) -> Stretches:
    """Return the stretches of several samples in which a signal rests at a level; none where they are few.

    Args:
        x: shape (n,).
        level: its highest or lowest value.
    """
    there = np.abs(x - level) <= _STILL * np.ptp(x)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    runs = tuple((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _LONG)
    count = sum(b - a for a, b in runs)
    return runs if count >= max(_FEW, _SHARE * len(x)) and np.ptp(x) > 0.0 else ()


def rests(study: DataStudy) -> list[Rest]:
    """Return every output, and every input of many levels, that rests at its extreme."""
    data, late = study.raw, _delay_of_outputs(study)
    u = study.u[:, study.varying_inputs]
    levels = []
    for name, x in zip((*data.output_names, *data.input_names), np.hstack([data.y, data.u]).T, strict=True):
        for value, upper in ((float(x.max()), True), (float(x.min()), False)):
            runs = stretches_at(x, value)
            if name in late:
                moving, known = _share_moving(runs, u, late[name]), _is_limit(study, name, value)
            elif len(runs) >= _AGAIN and len(np.unique(x)) > _FEW_LEVELS:
                # A held input rests at its extreme once by chance; a clipped one again and again.
                moving, known = 0.0, False
            else:
                continue
            if runs:
                share = sum(b - a for a, b in runs) / len(x)
                levels.append(Rest(name, value, upper, runs, share, moving, known))
    return levels


def _delay_of_outputs(study: DataStudy) -> dict[str, int]:
    known = [(target, d) for (_, target), d in delays(study).items() if d is not None]
    return {y: min((d for t, d in known if t == y), default=0) for y in study.experiment.output_names}


def judge_saturation(study: DataStudy) -> Finding:
    """Judge every rest at an extreme."""
    every = rests(study)
    marks: dict[str, tuple[int, ...]] = {}
    for r in every:
        samples = tuple(k + study.settling for first, last in r.stretches for k in range(first, last))
        marks[r.column] = samples + marks.get(r.column, ())
    values = {
        f"{r.column} {'high' if r.upper else 'low'}": {
            "value": r.value, "share": r.share, "stretches": len(r.stretches), "input_moves": r.moving,
        }
        for r in every
    }  # fmt: skip
    sure = [r for r in every if r.known or r.moving > _ENOUGH]
    if sure:
        why = "while the input moves on: a limit" if any(r.moving > _ENOUGH for r in sure) else "its known limit"
        return Finding("saturation", "poor", f"{_text(study, sure)}, {why}", _ADVICE, values, marks)
    inputs = [r for r in every if r.column in study.experiment.input_names]
    if inputs:
        advice = "use the record only if the input was measured behind its limit"
        return Finding("saturation", "watch", f"{_text(study, inputs)}: it is clipped", advice, values, marks)
    again = [r for r in every if len(r.stretches) >= _AGAIN]
    if again and np.min(study.signal_to_rest_db[study.varying_outputs]) < _LINEAR_DB:
        evidence = f"{_text(study, again)}, and the input rests as well: a limit, or the settled response"
        advice = (
            "such an input cannot tell which; repeat with a smaller amplitude or a moving input, or name the limits"
        )
        return Finding("saturation", "watch", evidence, advice, values, marks)
    return Finding("saturation", "good", "no signal rests at a limit", "", values)


_ADVICE = "lower the amplitude or move the operating point; a linear model mistakes a limit for a smaller gain"


def _text(study: DataStudy, some: list[Rest]) -> str:
    name = some[0].column
    unit = study.experiment.units.get(name)
    tail = f" {unit}" if unit and unit != "1" else ""
    levels = [
        f"{'highest' if r.upper else 'lowest'} value, {r.value:.6g}{tail}, in {100 * r.share:.1f} % of "
        f"the samples ({len(r.stretches)} times)"
        for r in some
        if r.column == name
    ]
    return f"{name} rests at its {' and its '.join(levels)}"


def _share_moving(stretches: Stretches, u: Floats, delay: int) -> float:
    """Return the share of the stretches in which an input moves before the stretch's end can show it."""
    span = np.maximum(np.ptp(u, axis=0), 1e-300)
    moving = 0
    for first, last in stretches:
        # From the sample that brought the output here to the last one that still acts.
        begin, end = max(first - delay, 0), max(last - delay, 0)
        moving += bool(np.any(np.ptp(u[begin:end], axis=0) > _MOVES * span)) if end > begin else False
    return moving / max(len(stretches), 1)


def _is_limit(study: DataStudy, name: str, value: float) -> bool:
    limits = study.limits.get(name)
    if limits is None:
        return False
    size = max(abs(limits[1] - limits[0]), abs(value)) if np.all(np.isfinite(limits)) else max(abs(value), 1e-300)
    return any(abs(value - limit) < 1e-3 * size for limit in limits if np.isfinite(limit))
