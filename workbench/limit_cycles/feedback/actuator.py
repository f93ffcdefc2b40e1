"""What stands between a feedback's gain and its target: limits of deflection and rate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.quantity import quantity
from workbench.core.records.record import RecordPart, entry
from workbench.core.values.conversion import named_conversion
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Value
from workbench.system.description import FmuComponent
from workbench.system.load import load

__all__ = ["Actuator", "in_unit", "limited", "wrapped"]

_NAME = "feedback_actuator"
_FASTEST = 100.0  # largest rate limit of `LimitedActuator` [1/s], against a deflection limit of 1
_QUICK = 1e-4  # lag within the limits [s]: the least that the model takes; more would move the stable gains


@dataclass(frozen=True)
class Actuator(RecordPart):
    """An FMU between gain and target.

    Attributes:
        component: the FMU.
        input, output: of it.
        limit: of the deflection, either way [unit of the target]; None: not known.
        rate_limit: [unit of the target / s]; None: not known.
        scale: the target's value for 1 of the FMU's.
        set: parameters that were given.
    """

    component: FmuComponent
    input: str
    output: str
    limit: float | None = None
    rate_limit: float | None = None
    scale: float = 1.0
    set: dict[str, Value] = field(default_factory=dict, metadata=entry(key="given"))

    def derived(self) -> dict[str, Any]:
        """Return the FMU, with all that is set."""
        return {"fmu": self.component.file, "set": self.component.set}


def limited(limit: float | None, rate_limit: float | None) -> Actuator | None:
    """Return the bundled `LimitedActuator` with limits in the target's unit; None: no limit is given.

    It works on parts of its limit, so that any unit and size will do, and follows within them with a lag of 0.1 ms.

    Args:
        limit: of the deflection, either way [unit of the target]; None: none, but what the rate limit reaches in 100 s.
        rate_limit: [unit of the target / s]; None: none, but no faster than 100 limits in a second.

    Raises:
        InputError: a limit that is not positive.
    """
    for name, value in (("limit", limit), ("rate limit", rate_limit)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{name}: it must be positive, not {value:g}")
    if limit is None and rate_limit is None:
        return None
    scale = _FASTEST * (rate_limit or 0.0) if limit is None else limit
    rate = _FASTEST if rate_limit is None else rate_limit / scale
    if rate > _FASTEST:
        raise InputError(f"rate limit: {rate_limit:g} is more than {_FASTEST:g} times the limit {scale:g} in a second")
    parts: dict[str, Value] = {"upper": 1.0, "lower": -1.0, "rateLimit": rate, "timeConstant": _QUICK}
    component = FmuComponent(name=_NAME, file="fmu:LimitedActuator", set=parts)
    return Actuator(component, "command", "deflection", limit, rate_limit, float(scale))


def wrapped(name: str) -> Actuator:
    """Return any FMU with one real input and one real output as an actuator; its limits are its own.

    Args:
        name: file, or `fmu:NAME`.

    Raises:
        InputError, FmuError: it cannot be loaded, or has other inputs or outputs.
    """
    with load(name) as model:
        ends = [[v.name for v in group if v.type in FLOAT_TYPES] for group in (model.inputs, model.outputs)]
        starts = {v.name: float(v.start or 0.0) for v in model.parameters if v.type in FLOAT_TYPES}
    for what, result in zip(("input", "output"), ends, strict=True):
        if len(result) != 1:
            listed = f" ({', '.join(result)})" if result else ""
            raise InputError(f"actuator {name}: it has {len(result)} real {what}s{listed}, and must have one")
    limit = rate = None
    if {"upper", "lower", "rateLimit"} <= set(starts):
        limit, rate = min(starts["upper"], -starts["lower"]), starts["rateLimit"]
    return Actuator(FmuComponent(name=_NAME, file=name), ends[0][0], ends[1][0], limit, rate)


def in_unit(option: str, size: float | str | None, target: str, unit: str | None, *, per: str = "") -> float | None:
    """Return a limit in the unit of the target; a number alone is in that unit.

    Args:
        option: that it was given by, for the message.
        size: such as 0.4 or "25deg"; None: no limit.
        target: that it limits, for the message.
        unit: of the target; None: none is declared.
        per: "/s" of a rate.

    Raises:
        InputError: a unit that cannot be converted.
    """
    value, given = (None, "") if size is None else quantity(size)
    if value is None or not given:
        return value
    factor = named_conversion(given, f"{unit}{per}") if unit else None
    if factor is None:
        raise InputError(f"{option}: '{given}' cannot be converted to {unit or 'no unit'}{per}, that of {target}")
    return factor[0] * value
