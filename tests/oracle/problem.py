"""The ordinary differential equation that a solver sees: dx/dt = f(t, x, u(t)), z(t, x, u(t))."""

from __future__ import annotations

import math

from tests.oracle.forcing import write_continuous
from workbench.core.values.arrays import Floats
from workbench.fmi.instance import Instance
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
        self.x, self.dx, self.z = instance.x, instance.dx, instance.z

    def put(self, t: float, x: Floats) -> None:
        """Set time [s], states and continuous inputs."""
        self.x[:] = x
        self.put_buffered(t)

    def put_buffered(self, t: float) -> None:
        """Set time [s], the states that already stand in the FMU's buffer, and the inputs."""
        self.instance.set_time(t)
        self.instance.set_states()
        write_continuous(self.forcing, min(self.limit, t))

    def rhs(self, t: float, x: Floats) -> Floats:
        """Return dx/dt, shape (n,), a view that the next call overwrites."""
        self.x[:] = x
        return self.rhs_buffered(t)

    def rhs_buffered(self, t: float) -> Floats:
        """Return dx/dt for the states that already stand in the FMU's buffer."""
        self.put_buffered(t)
        self.evaluations += 1
        self.instance.get_derivatives()
        return self.dx

    def indicators(self, t: float, x: Floats) -> Floats:
        """Return the event indicators, shape (nz,), a view that the next call overwrites."""
        self.put(t, x)
        self.instance.get_indicators()
        return self.z
