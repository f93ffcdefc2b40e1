"""What an integrator of constant steps makes of a model: the error that a reference made with one may have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.model.load import FmuModel
from workbench.session.fmu import FmuSession
from workbench.session.readings import find
from workbench.signals.kinds import Signal

__all__ = ["euler"]

_SAME = 1e-6  # of a step: rounding
_MOST = 50_000  # steps, made one by one from Python: a second or two


def euler(model: FmuModel, signals: Mapping[str, Signal], names: Sequence[str], times: Floats, step: float) -> Floats:
    """Return what the explicit method of Euler gives with constant steps, shape (n, k); NaN from where it fails.

    x(t + h) = x(t) + h·f(t, x). Events are looked for after each step and not located, as simple masters do. It tells
    what first order costs and is not a way to simulate: the FMU is not told of completed steps.

    Args:
        model: of model exchange.
        signals: forced inputs.
        names: k variables.
        times: n times, the first is where it starts [s].
        step: longest step [s].
    """
    result = np.full((len(times), len(names)), math.nan)
    if not (times[-1] - times[0]) / step <= _MOST:
        return result
    with model.open_session(start_time=float(times[0]), signals=signals) as session:
        access = session.instance.access(find(names, session.setup.variables))
        stepping = _Stepping(session, float(times[0]))
        try:
            for row, target in enumerate(times.tolist()):
                for left in range(math.ceil((target - stepping.now) / step - _SAME), 0, -1):
                    stepping.step(target if left == 1 else stepping.now + (target - stepping.now) / left)
                result[row] = access.read()
        except SimulationError:
            pass
    return result


class _Stepping:
    """A session that is stepped from here."""

    def __init__(self, session: FmuSession, now: float) -> None:
        self.instance, self.forcing, self.now = session.instance, session.forcing, now
        self._event()

    def step(self, until: float) -> None:
        instance = self.instance
        instance.get_states()
        instance.get_derivatives()
        x = instance.x + (until - self.now) * instance.dx
        instance.set_time(until)
        instance.x[:] = x
        instance.set_states()
        self.now = until
        instance.get_indicators()
        crossed = (self._positive != (instance.z > 0.0)).any()
        if crossed or until >= self._due or (self.forcing.names and self.forcing.at(until) != self.forcing.written):
            self._event()

    def _event(self) -> None:
        self.instance.enter_event_mode()
        if self.forcing.names:
            self.forcing.write_all(self.forcing.at(self.now))
        info = self.instance.iterate_events()
        if info.terminate:
            raise SimulationError("the FMU ended its run", time=self.now)
        self.instance.enter_continuous_mode()
        self._due = info.next_time
        self.instance.get_indicators()
        self._positive = self.instance.z > 0.0
