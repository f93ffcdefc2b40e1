"""Does the FMU run, and what does it do by itself?"""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import EndedError, FmuError, SimulationError
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu

__all__ = ["drift", "runs"]


def runs(subject: CheckedFmu) -> Answer:
    """Instantiate, initialise and run over the test run with every continuous input swinging.

    The swing is 5 % of the input's size (the larger of start value and nominal value) within its minimum and
    maximum, at least three periods. Broken: an error status, a value that is not a finite number, and (told by the
    worker) a crash or a hang. Watch: it runs, but only with its inputs at their start values, or the FMU ends the run,
    which FMI allows it, or it has no variable to look at.
    """
    try:
        result = subject.run(subject.sines())
    except (FmuError, SimulationError) as error:
        return _still(subject, error)
    moved = int((result.scale > 0.0).sum())
    text = f"{subject.span:.4g} s in {subject.steps} steps, {moved} of {len(subject.names)} variables move"
    text = "; ".join([text, *subject.model.remarks()])
    numbers = {"span": subject.span, "steps": subject.steps, "moving": moved}
    if not subject.names:
        return Answer("watch", text, "no outputs, states or local numbers: the checks have nothing to compare", numbers)
    return Answer("good", text, numbers=numbers)


def _still(subject: CheckedFmu, failure: Exception) -> Answer:
    """The same with the inputs at rest."""
    if subject.inputs:
        try:
            subject.run({})
        except (FmuError, SimulationError):
            pass
        else:
            evidence = f"with inputs changed by a twentieth of their size it fails: {failure}"
            return Answer("watch", evidence, "start from a trim point, with amplitudes for which the model is valid")
    beyond = "no analysis gets beyond this point; the other checks use a shorter run"
    if isinstance(failure, EndedError):
        return Answer("watch", str(failure), beyond, {"ended": failure.time or 0.0})
    return Answer("broken", str(failure), beyond)


# -- what does the FMU do by itself, with its inputs at rest ---------------------------------------

_NOTHING = 1e-9
_DECAY = 0.7  # of the movement in the first quarter: more in the last quarter is not settling
_GROWTH = 100.0
_MOVES = (
    "this movement is added to every response: begin at rest (workbench trim), or use much larger amplitudes; nfr "
    "reports it"
)


def drift(subject: CheckedFmu) -> Answer:
    """Run with inputs at their start values; compare the movement in the first quarter with that in the last.

    Movement is the range of a variable in a quarter over its range in the whole run. Good: nothing moves, or what
    moves dies away (at most 0.7 of the first quarter's movement in the last). Watch: something goes on moving, as a
    drift (more than half of it a straight line), a swing, or growing more than a hundredfold (unstable). No
    promise is broken by any of it: a model may begin anywhere.
    """
    result = subject.run({})
    parts = np.array_split(result.values, 4)
    first, last = (np.ptp(p, axis=0) for p in (parts[0], parts[-1]))
    size = np.abs(result.values).max(axis=0, initial=0.0)
    moving = result.scale > _NOTHING * size
    if not moving.any():
        return Answer("good", f"nothing moves in {subject.span:.4g} s", numbers={"moving": 0})
    lasting = moving & (last > _DECAY * first)
    numbers = {"moving": int(moving.sum()), "lasting": int(lasting.sum())}
    if not lasting.any():
        return Answer("good", f"{numbers['moving']} variables move by themselves and then settle", numbers=numbers)
    worst = int(np.argmax(np.where(lasting, np.ptp(result.values, axis=0) / np.maximum(size, 1e-300), -1.0)))
    kind = _kind(result.time, result.values[:, worst], float(first[worst]), float(last[worst]))
    return Answer("watch", f"{subject.names[worst]} {kind}", _MOVES, numbers)


def _kind(time: Floats, y: Floats, first: float, last: float) -> str:
    if last > _GROWTH * first > _GROWTH * _NOTHING * last:
        return f"grows by itself, {last / first:.3g} times from the first to the last quarter"
    slope, level = np.polyfit(time - time[0], y, 1)
    rest = y - level - slope * (time - time[0])
    if abs(slope) * (time[-1] - time[0]) > 0.5 * float(np.ptp(y)):
        return f"drifts by itself, by {slope:.3g} per s"
    return f"swings by itself, by ±{0.5 * float(np.ptp(rest)):.3g}"
