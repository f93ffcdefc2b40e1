"""What a description of FMI 3.0 means by its clocks: how they tick, and what changes at their ticks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from workbench.fmi.declared import ClockVariable, DeclaredVariable
from workbench.fmi.description import Clock

__all__ = ["clocked_by", "clocks_of"]


def clocked_by(variables: Iterable[DeclaredVariable]) -> dict[str, tuple[str, ...]]:
    """Return variable → names of the clocks at whose ticks alone its value changes.

    Args:
        variables: as declared.
    """
    known = list(variables)
    names = {v.value_reference: v.name for v in known if isinstance(v, ClockVariable) and v.name}
    result = {v.name: tuple(names[r] for r in v.clocks if r in names) for v in known if v.name and v.clocks}
    return {name: clocks for name, clocks in result.items() if clocks}


def clocks_of(variables: Iterable[DeclaredVariable], clocked: Mapping[str, tuple[str, ...]]) -> dict[str, Clock]:
    """Return name → how a clock ticks.

    Args:
        variables: as declared.
        clocked: see `clocked_by`.
    """
    clocks = (v for v in variables if isinstance(v, ClockVariable) and v.name)
    return {v.name: _clock(v, clocked.get(v.name, ())) for v in clocks if v.name}


def _clock(v: ClockVariable, clocks: tuple[str, ...]) -> Clock:
    interval, shift = v.interval_decimal, v.shift_decimal
    # Counters are exact where the decimal is rounded: 1/3 s.
    if v.resolution is not None and v.resolution > 0.0:
        interval = interval if v.interval_counter is None else v.interval_counter / v.resolution
        shift = v.shift_counter / v.resolution if v.shift_counter else shift
    return Clock(
        kind=v.interval_variability or "triggered",
        causality=v.causality or "local",
        value_reference=v.value_reference or 0,
        interval=interval,
        shift=shift or 0.0,
        clocks=clocks,
    )
