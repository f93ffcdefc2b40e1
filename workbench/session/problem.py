"""The ordinary differential equation that a solver sees: dx/dt = f(t, x, u(t)), z(t, x, u(t))."""

from __future__ import annotations

import math
from typing import Any

from workbench.fmi.instance import Instance
from workbench.session.base import Floats
from workbench.session.forcing import Forcing

__all__ = ["Problem"]


class Problem:
    """Evaluates an FMU in continuous-time mode at any (t, x), with the inputs of that very time.

    Attributes:
        n, nz: numbers of states and event indicators.
        limit: no signal is evaluated later than this [s]: the last instant before the next break,
            so that a step up to the break sees the left limit there.
        evaluations: number of right-hand sides so far.
    """

    def __init__(self, instance: Instance, forcing: Forcing) -> None:
        self.instance = instance
        self.forcing = forcing
        self.n, self.nz = instance.nx, instance.nz
        self.limit = math.inf
        self.evaluations = 0
        calls, library = instance.CALLS, instance.library
        self._names = (calls["set_time"], calls["set_states"], calls["get_derivatives"])
        self._set_time, self._set_states, self._get_derivatives = (library[n] for n in self._names)
        self._component: Any = instance.component
        self._xbuf, self._dxbuf = instance._xbuf, instance._dxbuf  # noqa: SLF001  hot path
        self.x, self.dx, self.z = instance.x, instance.dx, instance.z

    def put(self, t: float, x: Floats) -> None:
        """Set time [s], states and continuous inputs."""
        self.x[:] = x
        self.put_buffered(t)

    def put_buffered(self, t: float) -> None:
        """Set time [s], the states that already stand in the FMU's buffer, and the inputs."""
        component = self._component
        self.instance.time = t
        status = self._set_time(component, t)
        if status > 1:
            self.instance.fail(self._names[0], status)
        if self.n:
            status = self._set_states(component, self._xbuf, self.n)
            if status > 1:
                self.instance.fail(self._names[1], status)
        self.forcing.write_continuous(min(self.limit, t))

    def rhs(self, t: float, x: Floats) -> Floats:
        """Return dx/dt, shape (n,), a view that the next call overwrites."""
        self.x[:] = x
        return self.rhs_buffered(t)

    def rhs_buffered(self, t: float) -> Floats:
        """Return dx/dt for the states that already stand in the FMU's buffer."""
        self.put_buffered(t)
        self.evaluations += 1
        status = self._get_derivatives(self._component, self._dxbuf, self.n)
        if status > 1:
            self.instance.fail(self._names[2], status)
        return self.dx

    def indicators(self, t: float, x: Floats) -> Floats:
        """Return the event indicators, shape (nz,), a view that the next call overwrites."""
        self.put(t, x)
        self.instance.get_indicators()
        return self.z
