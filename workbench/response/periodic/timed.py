"""Whether a model changes with time itself, so that no two periods have the same map."""

from __future__ import annotations

import math

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.session.compiled import CompiledMeSession

__all__ = ["changes_with_time"]

# Times ahead at which a model is asked whether it changes with time, in periods: irrational parts, none the sum of
# others.
_AHEAD = np.sqrt(np.array([0.05, 0.23, 0.61, 1.3, 7.1]))

# Iterations inside a model end where they like: so many times what they leave is a change.
_CLEARLY = 10.0


def changes_with_time(session: CompiledMeSession, output: str, motion: Floats, response: float, period: float) -> bool:
    """Return whether derivatives or output depend on time itself, by more than the integration tolerates.

    The model is asked for both where it stands, at five later times with states, inputs and relations held. A
    derivative may be off by the relative tolerance of what moves the state by as much as it moves in a period.

    Args:
        session: stands where a period has ended.
        output: measured.
        motion: how far each state moves in a period, shape (n,).
        response: amplitude of the output [unit of the output].
        period: of the forcing [s].
    """
    instance, access = session.instance, session.instance.access([session.setup.variables[output]])

    def asked(time: float) -> Floats:
        instance.set_time(time)
        y = [float(v) for v in access.read()]
        instance.get_derivatives()
        return np.concatenate([instance.dx, y])

    time, small = session.time, np.append(2.0 * math.pi / period * motion, response) * session.setup.rtol
    here = asked(time)
    later = [asked(time + float(part) * period) for part in _AHEAD]
    small = np.maximum(small, _CLEARLY * np.abs(asked(time) - here))
    return any(bool(np.any(np.abs(there - here) > small)) for there in later)
