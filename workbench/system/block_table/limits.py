"""Blocks that limit: saturation, dead band, quantiser, rate limiter, limited integrator, PI and PID."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from workbench.core.records.option import option
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.system.block_table.base import Block, Described, ordered

__all__ = ["Backlash", "DeadBand", "Integrator", "Pi", "Pid", "Quantiser", "RateLimiter", "Relay", "Saturation"]

_LIMITS = "limits"


class Saturation(Block):
    """Limits the input: y = u between lower and upper."""

    kind = "saturation"
    group = _LIMITS
    equations = "y = min(max(u, lower), upper)"
    number = "saturation"
    lower: float = option("Smallest output.", default=-1.0, infinite=True)
    upper: float = option("Largest output.", default=1.0, infinite=True)

    def check(self) -> None:
        ordered(self.lower, self.upper)

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return self.lower, self.upper

    def static(self, u: Floats) -> Floats:
        return np.clip(u, self.lower, self.upper)

    def levels(self) -> tuple[float, ...]:
        return self.lower, self.upper

    def described(self) -> Described | None:
        return Described("saturation", {"limit": self.upper}) if _even(self.lower, self.upper) else None

    def sector(self) -> tuple[float, float] | None:
        return (0.0, 1.0) if self.lower <= 0.0 <= self.upper else None


def _even(lower: float, upper: float) -> bool:
    return -lower == upper and math.isfinite(upper)


class DeadBand(Block):
    """Is insensitive to small inputs: y = 0 between lower and upper."""

    kind = "dead_band"
    group = _LIMITS
    equations = "y = slope (u − upper) above upper, slope (u − lower) below lower, else 0"
    number = "dead_band"
    lower: float = option("Lower end of the band.", default=-1.0)
    upper: float = option("Upper end of the band.", default=1.0)
    slope: float = option("Slope of the output beyond the band.", default=1.0)

    def check(self) -> None:
        ordered(self.lower, self.upper)

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return self.lower, self.upper, self.slope

    def static(self, u: Floats) -> Floats:
        return self.slope * (u - np.clip(u, self.lower, self.upper))

    def levels(self) -> tuple[float, ...]:
        return self.lower, self.upper

    def described(self) -> Described | None:
        if not _even(self.lower, self.upper) or self.slope <= 0.0:
            return None
        return Described("dead_band", {"width": self.upper, "slope": self.slope})

    def sector(self) -> tuple[float, float] | None:
        return (min(0.0, self.slope), max(0.0, self.slope)) if self.lower <= 0.0 <= self.upper else None


class Quantiser(Block):
    """Rounds the input to the nearest multiple of a step."""

    kind = "quantiser"
    group = _LIMITS
    equations = "y = step · round(u / step)"
    number = "quantiser"
    step: float = option("Distance of two levels.", default=1.0, positive=True)

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return (self.step,)

    def static(self, u: Floats) -> Floats:
        result: Floats = self.step * np.floor(u / self.step + 0.5)
        return result

    def described(self) -> Described | None:
        return Described("quantiser", {"resolution": self.step})

    def sector(self) -> tuple[float, float] | None:
        return 0.0, 2.0


class Relay(Block):
    """Switches between two outputs, with hysteresis where the two thresholds differ."""

    kind = "relay"
    group = _LIMITS
    equations = (
        "on where u > on_above, off where u < off_below, as before between them\ny = upper where on, lower where off"
    )
    number = "relay"
    lower: float = option("Output while the relay is off.", default=-1.0)
    upper: float = option("Output while the relay is on.", default=1.0)
    off_below: float = option("Input below which the relay switches off.", default=0.0)
    on_above: float = option("Input above which the relay switches on.", default=0.0)
    starts_on: bool = option("Whether the relay starts on, where the input is between the thresholds.", default=False)

    def check(self) -> None:
        if self.off_below > self.on_above:
            raise InputError(f"off_below = {self.off_below:g} must not be above on_above = {self.on_above:g}")
        if self.lower == self.upper:
            raise InputError(f"lower and upper are both {self.upper:g}: a relay has two outputs")

    @property
    def remembers(self) -> Mapping[str, float]:
        return {"on": float(self.starts_on)}

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return self.lower, self.upper, self.off_below, self.on_above

    def has_characteristic(self) -> bool:
        """Whether `static` can be asked: without hysteresis."""
        return self.off_below == self.on_above

    def static(self, u: Floats) -> Floats:
        """Return the output, shape (n,); on the threshold itself, the middle of its jump.

        Args:
            u: inputs, shape (n,).
        """
        result: Floats = self.lower + (self.upper - self.lower) * np.heaviside(u - self.on_above, 0.5)
        return result

    def levels(self) -> tuple[float, ...]:
        return self.off_below, self.on_above

    def described(self) -> Described | None:
        if -self.lower != self.upper or self.upper <= 0.0 or self.on_above != -self.off_below:
            return None
        if self.on_above == 0.0:
            return Described("relay", {"level": self.upper})
        return Described("relay_with_hysteresis", {"level": self.upper, "half_width": self.on_above})

    def sector(self) -> tuple[float, float] | None:
        ideal = self.on_above == self.off_below == 0.0 and self.lower <= 0.0 <= self.upper
        return (0.0, math.inf) if ideal else None


class _Trailing(Block):
    """The output follows by a state, which stops or goes on at either of two limits."""

    feeds = False
    start: float = option("Where the state starts.", default=0.0)

    @property
    def states(self) -> tuple[str, ...]:
        return ("x",)

    @property
    def indicators(self) -> int:
        return 2

    def starts(self) -> tuple[float, ...]:
        return (self.start,)


class Backlash(_Trailing):
    """Play of gears and linkages: the output moves when the input has taken up the gap.

    The contact is a fast lag: the rate of an input is not known to a block, so where it turns can only be seen by a
    state. The output trails the ideal one by lag times its rate; the error of a frequency response is about
    2π · frequency · lag, and goes to 0 with it. The ideal output is what remains as lag → 0.
    """

    kind = "backlash"
    group = _LIMITS
    equations = "dx/dt = (u − x ∓ half_width) / lag beyond the gap, 0 while |u − x| ≤ half_width\ny = slope · x"
    number = "backlash"
    half_width: float = option("Half of the gap.", default=0.1, positive=True)
    slope: float = option("Slope of the output where the two sides are in contact.", default=1.0)
    lag: float = option("Time constant of the contact.", default=1e-3, unit="s", positive=True)

    def packed(self) -> tuple[float, ...]:
        return -self.half_width, self.half_width, self.lag, self.slope

    def described(self) -> Described | None:
        return Described("backlash", {"half_width": self.half_width, "slope": self.slope})


class RateLimiter(_Trailing):
    """Limits the rate of the output: it follows the input, but not faster than the limits.

    Below the limits the output follows by a fast lag: the rate of an input is not known to a block. With the input's
    rate within the limits it trails by lag times that rate; the error of a frequency response is about
    2π · frequency · lag, and goes to 0 with it. Choose a lag that is small against all that matters in the loop.
    """

    kind = "rate_limiter"
    group = _LIMITS
    equations = "dy/dt = min(max((u − y) / lag, falling), rising)"
    number = "rate_limiter"
    rising: float = option("Highest rate of the output.", default=1.0, unit="1/s", positive=True)
    falling: float | None = option(
        "Lowest rate of the output, negative; left out: −rising.", default=None, unit="1/s", infinite=True
    )
    lag: float = option("Time constant with which the output follows.", default=1e-3, unit="s", positive=True)

    @property
    def lowest(self) -> float:
        """Lowest rate of the output."""
        return -self.rising if self.falling is None else self.falling

    def check(self) -> None:
        if not self.lowest < 0.0:
            raise InputError(f"falling = {self.lowest:g} must be negative")

    def packed(self) -> tuple[float, ...]:
        return self.lowest, self.rising, self.lag

    def described(self) -> Described | None:
        return Described("rate_limiter", {"rate": self.rising}) if self.lowest == -self.rising else None


class Integrator(Block):
    """Integrates the input, and stops at limits: no windup.

    It leaves a limit as soon as the input changes its sign.
    """

    kind = "integrator"
    group = "dynamic"
    equations = "dx/dt = gain · u, 0 at a limit that u would pass\ny = x"
    number = "integrator"
    feeds = False
    gain: float = option("Gain of the input.", default=1.0, unit="1/s")
    lower: float = option("Smallest output.", default=-math.inf, infinite=True)
    upper: float = option("Largest output.", default=math.inf, infinite=True)
    start: float = option("Where the output starts.", default=0.0)

    def check(self) -> None:
        ordered(self.lower, self.upper)
        if not self.lower <= self.start <= self.upper:
            raise InputError(f"start = {self.start:g} is beyond the limits {self.lower:g} … {self.upper:g}")

    @property
    def states(self) -> tuple[str, ...]:
        return ("x",)

    @property
    def indicators(self) -> int:
        return 3 if math.isfinite(self.lower) or math.isfinite(self.upper) else 0

    def packed(self) -> tuple[float, ...]:
        return self.lower, self.upper, self.gain

    def starts(self) -> tuple[float, ...]:
        return (self.start,)


class _Controller(Block):
    """What PI and PID have in common."""

    group = "dynamic"
    number = "pid"
    proportional: float = option("Proportional gain.", default=1.0)
    integral: float = option("Integral gain.", default=1.0, unit="1/s")
    lower: float = option("Smallest output.", default=-math.inf, infinite=True)
    upper: float = option("Largest output.", default=math.inf, infinite=True)
    tracking: float | None = option(
        "Time constant with which the integral follows a limited output (back-calculation); left out: "
        "|proportional / integral|, of a PID √(|proportional / integral| · |derivative / proportional|).",
        default=None, unit="s", positive=True,
    )  # fmt: skip
    start: float = option("Where the integral starts.", default=0.0)

    def check(self) -> None:
        ordered(self.lower, self.upper)
        if self.limited and self.tracking is None and not (self.integral and self._tracks > 0.0):
            raise InputError("tracking must be given where a gain is 0 and the output has limits")

    @property
    def limited(self) -> bool:
        """Whether the output has limits."""
        return math.isfinite(self.lower) or math.isfinite(self.upper)

    @property
    def _tracks(self) -> float:
        return abs(self.proportional / self.integral)

    @property
    def states(self) -> tuple[str, ...]:
        return ("integrated",)

    @property
    def indicators(self) -> int:
        return 2 if self.limited else 0

    def packed(self) -> tuple[float, ...]:
        follows = self.tracking if self.tracking is not None else self._tracks if self.limited else 1.0
        return self.lower, self.upper, self.proportional, self.integral, 0.0, 1.0, follows

    def starts(self) -> tuple[float, ...]:
        return (self.start,)


class Pi(_Controller):
    """PI controller, parallel form, with limits and back-calculation against windup; the input is the error."""

    kind: ClassVar[str] = "pi"
    equations = "v = proportional · u + x\ny = min(max(v, lower), upper)\ndx/dt = integral · u + (y − v) / tracking"


class Pid(_Controller):
    """PID controller, parallel form, with filtered derivative, limits and back-calculation; the input is the error."""

    kind: ClassVar[str] = "pid"
    equations = (
        "v = proportional · u + x + derivative · (u − w) / filter\ny = min(max(v, lower), upper)\n"
        "dx/dt = integral · u + (y − v) / tracking\ndw/dt = (u − w) / filter"
    )
    derivative: float = option("Derivative gain.", default=0.1, unit="s")
    filter: float = option("Time constant of the derivative's filter.", default=0.01, unit="s", positive=True)

    @property
    def _tracks(self) -> float:
        return math.sqrt(abs(self.derivative / self.integral))

    @property
    def states(self) -> tuple[str, ...]:
        return "integrated", "filtered"

    def packed(self) -> tuple[float, ...]:
        lower, upper, proportional, integral, _, _, follows = super().packed()
        return lower, upper, proportional, integral, self.derivative, self.filter, follows

    def starts(self) -> tuple[float, ...]:
        return self.start, 0.0
