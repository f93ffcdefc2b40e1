"""Inputs that swing as fast as the model follows them: what shows whether a communication step is short enough."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.health.check.subject import CheckedFmu
from workbench.signals.kinds import Signal

__all__ = ["Swing", "swing_of"]

_WAY = 1.0 - math.exp(-1.0)  # what a lag of first order covers in its time constant
_NEAR, _PARTS = 16, 256  # natural steps that are looked at closely, in so many parts each
_SEEN = 1e-6  # of a variable's magnitude: what is below may be what the FMU's error control leaves
_SPREAD = 0.12  # between the periods of the inputs, so that they do not cancel


@dataclass(frozen=True)
class Swing:
    """How the inputs swing.

    Attributes:
        subject: what is checked, observed at the fastest output, or state where no output shows a delay: slower ones
            hardly move at its pace.
        signals: cosines from the start on, so that they jump first; the fastest has `frequency`.
        frequency: 1/(2π T) of the time T in which this one covers 63 % of its way after a jump [Hz].
        name: of it.
        steps: natural steps of one period, at least 64, at most a test run.
    """

    subject: CheckedFmu
    signals: dict[str, Signal]
    frequency: float
    name: str
    steps: int

    @property
    def words(self) -> str:
        """The excitation, in one clause."""
        return f"inputs swinging by 5 % of their size at {self.frequency:.3g} Hz, as fast as {self.name} follows"


def swing_of(subject: CheckedFmu) -> Swing | str:
    """Return the inputs at the pace of the model, or why there are none.

    The response is the difference of two runs, inputs after a jump and at rest. What it has covered in 1/256 of the
    natural step is taken for immediate: such an output is right at each communication point, whatever the step.
    """
    if not subject.inputs:
        return "it has no continuous inputs"
    try:
        found = _quickest(subject)
    except SimulationError as error:
        return f"the pace of the model cannot be measured: {error}"
    if found is None:
        return "no output or state follows them with a delay"
    time, name = found
    frequency = 0.5 / (math.pi * time)
    signals: dict[str, Signal] = {
        n: replace(sine, frequency=frequency / (1.0 + _SPREAD * i), phase=90.0)
        for i, (n, sine) in enumerate(subject.sines().items())
    }
    period = math.ceil(1.0 / (frequency * subject.step))
    return Swing(replace(subject, observed=(name,)), signals, frequency, name, min(subject.steps, max(64, period)))


def _quickest(subject: CheckedFmu) -> tuple[float, str] | None:
    """Return the shortest time to 63 % of the way [s], and whose it is."""
    h, outputs = subject.step, [v.name for v in subject.model.outputs if v.is_number]
    near: Floats = h / _PARTS * np.arange(1.0, min(_NEAR, subject.steps) * _PARTS + 1.0)
    far: Floats = h * np.arange(1.0, subject.steps + 1.0)
    far = far[far > near[-1] + 0.5 * h]
    parts = [_response(subject, near, h / _PARTS)]
    if len(far):
        parts.append(_response(subject, far, h))
    time = np.concatenate([near, far])
    moved, size = (np.concatenate(both) for both in zip(*parts, strict=True))
    way, large = moved.max(axis=0, initial=0.0), size.max(axis=0, initial=0.0)
    found = []
    for k, name in enumerate(subject.names):
        first = int(np.argmax(moved[:, k] >= _WAY * way[k]))
        if way[k] > _SEEN * large[k] and first:
            found.append((float(time[first]), name))
    of_outputs = [one for one in found if one[1] in outputs]
    return min(of_outputs or found, default=None)  # states move, too, where outputs hide it, as a dead band does


def _response(subject: CheckedFmu, times: Floats, h: float) -> tuple[Floats, Floats]:
    """Return how far a jump of the inputs moves each variable, and how large it is; shapes (n, k)."""
    points = subject.start + times
    moved, rest = (subject.run(subject.constants(share), step=h, points=points).values for share in (1.0, 0.0))
    return np.abs(moved - rest), np.maximum(np.abs(moved), np.abs(rest))
