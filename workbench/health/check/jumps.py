"""Does the solver inside a co-simulation FMU see at once that an input changes?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.signals.kinds import Signal, Step

__all__ = ["jumps"]

_PLACES = 12  # neighbouring communication points at which inputs jump
_WINDOW = 4  # steps over which each answer is observed
_GAP = 0.1  # of the answer, between neighbours
_NOISE = 3.0  # times which a gap must be larger
_SHARES = (1.0, 20.0)  # of the usual amplitude: a twentieth of an input's size, and all of it


@dataclass(frozen=True, eq=False)
class _JumpResponses:
    """Answers to the same jump at neighbouring communication points, beside the run without it.

    Attributes:
        rising: shape (places, window + 1, variables), each from its own jump on.
        noise: how far rising and falling differ, shape (variables,).
    """

    rising: Floats
    noise: Floats

    @property
    def size(self) -> Floats:
        """Largest answer of each variable, shape (variables,)."""
        result: Floats = np.abs(self.rising).max(axis=(0, 1))
        return result

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Which variables answer by more than noise, shape (variables,)."""
        return np.asarray(self.size > _NOISE / _GAP * self.noise)

    @property
    def gap(self) -> Floats:
        """How far neighbouring answers differ, over the answer, 0 where that is not clear; shape (variables,)."""
        apart = np.abs(np.diff(self.rising, axis=0)).max(axis=(0, 1))
        result: Floats = np.divide(apart, self.size, out=np.zeros_like(apart), where=self.clear)
        return result

    def late(self, column: int) -> Floats:
        """Return after how many steps a variable has left the run without a jump, shape (places,)."""
        moved = np.abs(self.rising[:, :, column]) > max(1e-9 * self.size[column], self.noise[column])
        return np.asarray(np.where(moved.any(axis=1), moved.argmax(axis=1), _WINDOW), dtype=np.float64)


def jumps(subject: CheckedFmu) -> Answer:
    """Let all inputs jump at neighbouring communication points and compare the answers, each from its own jump on.

    In the middle of a test run the inputs jump by 5 % of their size (by all of it, where nothing answers) at one of 12
    communication points, one run for each, and the answers over the next 4 steps are taken beside a run without a
    jump. From one point to the next they hardly change, also where the model moves by itself, if the FMU restarts its
    solver there; a solver that goes on with steps, or with a history, of its own takes the jump sooner or later,
    depending on where in its own step it falls, and pulses shorter than that step are lost or drawn out.

    Watch: neighbouring answers differ by more than 10 % (a model that samples its inputs or has events there does
    that, too; from outside these cannot be told apart). Good: they do not. Not applicable: no continuous inputs,
    nothing answers within 4 steps, rising and falling differ by more than 3 % of the answer, the run fails, or the
    answers differ and the FMU declares discrete variables: then it may be its samplers that take the jump later.
    """
    if not subject.inputs:
        return Answer("not applicable", "no continuous inputs")
    if subject.steps < _PLACES + _WINDOW:
        return Answer("not applicable", f"the test run has {subject.steps} steps only")
    try:
        result = next((a for a in (_answers(subject, s) for s in _SHARES) if a.size.any()), None)
    except SimulationError as error:
        return Answer("not applicable", f"the run with a jump of the inputs fails: {error}")
    if result is None:
        return Answer("not applicable", f"nothing responds within {_WINDOW} steps")
    if not result.clear.any():
        return Answer("not applicable", "rising and falling inputs give different responses: not linear, or noise")
    return _verdict(subject, result)


def _verdict(subject: CheckedFmu, result: _JumpResponses) -> Answer:
    worst = int(result.gap.argmax())
    gap, name = float(result.gap[worst]), subject.names[worst]
    late = result.late(worst)
    numbers = {"gap": gap, "output": name, "steps_late": late.tolist(), "step": subject.step}
    if gap <= _GAP:
        text = f"a jump has the same effect at {_PLACES} instants (within {100.0 * gap:.2g} %)"
        return Answer("good", text, numbers=numbers)
    spread = int(np.ptp(late))
    when = f", up to {spread} steps ({spread * subject.step:.3g} s) later" if spread else ""
    text = (
        f"the response of {name} to the same jump differs by {100.0 * gap:.3g} % between {_PLACES} neighbouring steps"
    )
    samplers = [v.name for v in subject.model.description.variables if _is_sampled(v)]
    if samplers:
        why = f"as it may in a sampled model: it declares {samplers[0]} to be discrete"
        return Answer("not applicable", f"{text}{when}, {why}", numbers=numbers)
    return Answer(
        "watch",
        f"{text}{when}: its own solver does not restart where inputs change, or the model samples them or has events",
        "fast inputs act late, pulses are lost or drawn out: "
        + subject.model.way_out("for lin a period, and for nfr frequencies, that are slow beside it"),
        numbers,
    )


def _is_sampled(variable: Variable) -> bool:
    """Whether a variable keeps its value between samples, by its declaration."""
    own = variable.causality in {"local", "output"}
    return own and variable.type in FLOAT_TYPES and variable.variability == "discrete"


def _answers(subject: CheckedFmu, share: float) -> _JumpResponses:
    first = max(1, (subject.steps - _PLACES - _WINDOW) // 2)
    points = subject.start + subject.step * np.arange(first, first + _PLACES + _WINDOW + 1, dtype=np.float64)

    def answer(place: int, sign: float) -> Floats:
        rest, high = subject.constants(0.0), subject.sines(sign * share)
        at = float(points[place])
        signals: dict[str, Signal] = {
            n: Step(time=at, value=rest[n].value + high[n].amplitude, initial=rest[n].value) for n in rest
        }
        values = subject.run(signals, points=points[: place + _WINDOW + 1]).values
        return np.asarray(values[place:], dtype=np.float64)

    alone = subject.run(subject.constants(0.0), points=points).values
    base = [alone[k : k + _WINDOW + 1] for k in range(_PLACES)]
    rising = np.array([answer(k, 1.0) - base[k] for k in range(_PLACES)])
    falling = answer(0, -1.0) - base[0]
    return _JumpResponses(rising, np.abs(rising[0] + falling).max(axis=0))
