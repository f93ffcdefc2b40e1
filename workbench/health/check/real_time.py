"""How long does one communication step take, beside the time that it covers?"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from ctypes import byref
from time import perf_counter
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.access import is_good
from workbench.fmi.instance import Instance
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.session.fmu import FmuSession

__all__ = ["real_time"]

_STEPS = 50_000  # that are timed, so that fifty of them are the slowest 0.1 %
_PATIENCE = 2.0  # [s] after which no further run begins, and none goes on
_RARE = 0.999
_EMPTY = 200  # calls that do nothing
_CLOCK = 1e-8  # [s], shorter times are not told apart


def real_time(subject: CheckedFmu) -> Answer:
    """Time single calls of doStep at the natural step, inputs at rest after a jump, in runs as long as a test run.

    Up to 50,000 calls in 2 s, less what an empty call takes: the time that a master in C would see, on this computer
    now; the slowest ones show what else it had to do. Watch: on average a step takes longer than the time that it
    covers.
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
    """Return the time of each step of one run [s]."""
    h, result, overhead = subject.step, list[float](), 0.0
    with subject.open() as session:
        try:
            session.advance(subject.start + h, signals=subject.constants())
            overhead = _overhead(session.instance)
            step, now, until = _stepper(session), session.time, perf_counter() + _PATIENCE - spent
            for k in range(subject.steps - 1):
                begin = perf_counter()
                good = step(now + k * h, h)
                end = perf_counter()
                if not good:
                    break
                result.append(end - begin)
                if end > until:
                    break
        except SimulationError:
            pass
    return np.maximum(np.array(result) - overhead, _CLOCK)


def _stepper(session: FmuSession) -> Callable[[float, float], bool]:
    """Return what makes a step from a time [s], so long [s]; it tells whether the run may go on."""
    instance = session.instance
    function, arguments, told = _call(instance)
    event, terminate, early = told

    def step(time: float, h: float) -> bool:
        status = function(instance.component, time + instance.clock, h, *arguments)
        if event.value and instance.event_mode:
            return is_good(status) and _handled(instance)
        return is_good(status) and not terminate.value and not early.value

    return step


def _call(instance: Instance) -> tuple[Any, tuple[Any, ...], tuple[ctypes.c_bool, ctypes.c_bool, ctypes.c_bool]]:
    """Return doStep, its arguments after the step, and what it tells by them: event, end of the run, early return."""
    told = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
    last: tuple[Any, ...] = (b"\1",) if instance.version == 1 else (1,)
    if instance.version == 3:
        last = (True, *map(byref, told), byref(ctypes.c_double()))
    return instance.library[f"fmi{instance.version}DoStep"], last, told


def _overhead(instance: Instance) -> float:
    """Return what calling a function of C from here takes, that does nothing and has the arguments of doStep [s]."""
    function, arguments, _ = _call(instance)
    address = ctypes.cast(ctypes.pythonapi.Py_IsInitialized, ctypes.c_void_p).value or 0
    nothing = ctypes.CFUNCTYPE(ctypes.c_int, *function.argtypes)(address)
    made = []
    for _ in range(_EMPTY):
        begin = perf_counter()
        nothing(instance.component, 0.0, 0.0, *arguments)
        made.append(perf_counter() - begin)
    return float(np.median(made))


def _handled(instance: Instance) -> bool:
    instance.enter_event_mode()
    if instance.iterate_events().terminate:
        return False
    instance.enter_step_mode()
    return True


def _time(seconds: float) -> str:
    """Return a time in a unit that suits it."""
    power = min(max(-math.floor(math.log10(max(seconds, 1e-12)) / 3.0), 0), 3)
    return f"{seconds * 1e3**power:.3g} {('s', 'ms', 'µs', 'ns')[power]}"
