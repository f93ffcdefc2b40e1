"""How long does one communication step take, beside the time that it covers?"""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.session.compiled import CompiledSession

__all__ = ["real_time"]

_STEPS = 50_000  # that are timed, so that fifty of them are the slowest 0.1 %
_PATIENCE = 2.0  # [s] after which no further step begins
_RARE = 0.999
_CLOCK = 1e-8  # [s], shorter times are not told apart


def real_time(subject: CheckedFmu) -> Answer:
    """Time single calls of doStep at the natural step, inputs at rest after a jump, in runs of the default experiment.

    Up to 50,000 calls in 2 s, one after the other in C: the time that a master sees, on this computer now; the slowest
    ones show what else it had to do. Watch: on average a step takes longer than the time that it covers.
    """
    seconds = np.empty(0)
    begin = perf_counter()
    while len(seconds) < _STEPS and perf_counter() - begin < _PATIENCE:
        made = _timed(subject, perf_counter() - begin)
        if not made.size:
            break
        seconds = np.append(seconds, made)
    if not seconds.size:
        return Answer("not applicable", "no step could be timed: the FMU ends its run, or fails, at the first one")
    mean, median, worst = float(seconds.mean()), float(np.median(seconds)), float(seconds.max())
    rare = float(np.quantile(seconds, _RARE, method="higher"))
    numbers = {
        "step": subject.step, "steps": len(seconds), "mean": mean, "median": median, "p999": rare, "worst": worst,
        "real_time_factor": subject.step / mean, "late": float((seconds > subject.step).mean()),
    }  # fmt: skip
    text = (
        f"{subject.step / mean:.3g} times real time at {subject.step:.4g} s: a step takes {_time(mean)} on average, "
        f"{_time(median)} in the middle, 99.9 % of {len(seconds)} at most {_time(rare)}, the slowest {_time(worst)}"
    )
    if mean > subject.step:
        return Answer("watch", text, "slower than real time at this step: not for hardware in the loop", numbers)
    return Answer("good", text, numbers=numbers)


def _timed(subject: CheckedFmu, spent: float) -> Floats:
    """Return the time of each step of one run but the first [s]."""
    h = subject.step
    count = min(round(subject.shorten * subject.experiment / h), _STEPS)
    with subject.open() as session:
        try:
            session.advance(subject.start + h, signals=subject.constants())
        except SimulationError:
            return np.empty(0)
        if not isinstance(session, CompiledSession):
            raise TypeError(f"{type(session).__name__} has no compiled loop")
        seconds = session.loop.system.time_steps(session.time, h, max(count, 4) - 1, _PATIENCE - spent)
    return np.maximum(seconds, _CLOCK)


def _time(seconds: float) -> str:
    """Return a time in a unit that suits it."""
    power = min(max(-math.floor(math.log10(max(seconds, 1e-12)) / 3.0), 0), 3)
    return f"{seconds * 1e3**power:.3g} {('s', 'ms', 'µs', 'ns')[power]}"
