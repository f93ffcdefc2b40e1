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
from workbench.data.advice.flat import ClippingLevel, flat_extremes
from workbench.data.advice.noise import signal_to_rest_db
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy

__all__ = ["Rest", "judge_saturation", "rests"]

_MOVES = 0.01  # of an input's range
_FEW_LEVELS = 8
_AGAIN = 3
_LINEAR_DB = 60.0
_ENOUGH = 0.1  # of the stretches


@dataclass(frozen=True)
class Rest:
    """A signal that rests at its extreme.

    Attributes:
        column: its name.
        flat: where, and how long.
        moving: share of the stretches during which an input moves.
        known: the value is one of the limits that the user named.
    """

    column: str
    flat: ClippingLevel
    moving: float
    known: bool


def rests(study: DataStudy) -> list[Rest]:
    """Return every output, and every input of many levels, that rests at its extreme."""
    data = study.raw
    late = _delay_of_outputs(study)
    found = []
    for i, name in enumerate(data.output_names):
        for flat in flat_extremes(data.y[:, i]):
            moving = _share_moving(flat, study.u[:, study.varying_inputs], late[name])
            found.append(Rest(name, flat, moving, _is_limit(study, name, flat.value)))
    for j, name in enumerate(data.input_names):
        if len(np.unique(data.u[:, j])) > _FEW_LEVELS:
            # A held input rests at its extreme once by chance; a clipped one again and again.
            clipped = [flat for flat in flat_extremes(data.u[:, j]) if flat.stretches >= _AGAIN]
            found += [Rest(name, flat, 0.0, known=False) for flat in clipped]
    return found


def _delay_of_outputs(study: DataStudy) -> dict[str, int]:
    known = [(target, d) for (_, target), d in delays(study).items() if d is not None]
    return {y: min((d for t, d in known if t == y), default=0) for y in study.experiment.output_names}


def judge_saturation(study: DataStudy) -> Finding:
    """Judge every rest at an extreme."""
    found = rests(study)
    marks: dict[str, tuple[int, ...]] = {}
    for r in found:
        marks[r.column] = tuple(k + study.settling for k in r.flat.samples) + marks.get(r.column, ())
    values = {
        f"{r.column} {'high' if r.flat.upper else 'low'}": {
            "value": r.flat.value, "share": r.flat.share, "stretches": r.flat.stretches, "input_moves": r.moving,
        }
        for r in found
    }  # fmt: skip
    sure = [r for r in found if r.known or r.moving > _ENOUGH]
    if sure:
        why = "while the input moves on: a limit" if any(r.moving > _ENOUGH for r in sure) else "its known limit"
        return Finding("saturation", "poor", f"{_text(study, sure)}, {why}", _ADVICE, values, marks)
    inputs = [r for r in found if r.column in study.experiment.input_names]
    if inputs:
        advice = "use the record only if the input was measured behind its limit"
        return Finding("saturation", "watch", f"{_text(study, inputs)}: it is clipped", advice, values, marks)
    again = [r for r in found if r.flat.stretches >= _AGAIN]
    if again and np.min(signal_to_rest_db(study)[study.varying_outputs]) < _LINEAR_DB:
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
        f"{'highest' if r.flat.upper else 'lowest'} value, {r.flat.value:.6g}{tail}, in {100 * r.flat.share:.1f} % of "
        f"the samples ({r.flat.stretches} times)"
        for r in some
        if r.column == name
    ]
    return f"{name} rests at its {' and its '.join(levels)}"


def _share_moving(flat: ClippingLevel, u: Floats, delay: int) -> float:
    """Return the share of the stretches in which an input moves before the stretch's end can show it."""
    span = np.maximum(np.ptp(u, axis=0), 1e-300)
    moving = 0
    for first, last in flat.runs:
        # From the sample that brought the output here to the last one that still acts.
        begin, end = max(first - delay, 0), max(last - delay, 0)
        moving += bool(np.any(np.ptp(u[begin:end], axis=0) > _MOVES * span)) if end > begin else False
    return moving / max(len(flat.runs), 1)


def _is_limit(study: DataStudy, name: str, value: float) -> bool:
    limits = study.limits.get(name)
    if limits is None:
        return False
    size = max(abs(limits[1] - limits[0]), abs(value)) if np.all(np.isfinite(limits)) else max(abs(value), 1e-300)
    return any(abs(value - limit) < 1e-3 * size for limit in limits if np.isfinite(limit))
