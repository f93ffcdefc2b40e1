"""Values of requirements in the unit of their limits."""

from __future__ import annotations

from workbench.errors import InputError

__all__ = ["convert"]

# Of frequency responses and ratios; the system's units know no logarithms.
_PLAIN = (None, "1", "", "-")


def convert(value: float, unit: str | None, wanted: str, where: str) -> float:
    """Return a value in another unit.

    Args:
        value: the number.
        unit: its unit; None: it has none.
        wanted: unit of the limits.
        where: for messages.

    Raises:
        InputError: one is not the other's kind, or is unknown.
    """
    if unit == wanted or (unit in _PLAIN and wanted in _PLAIN):
        return value
    from workbench.system.units import conversion, known_unit  # noqa: PLC0415 - seldom needed

    source, target = known_unit(unit or "1"), known_unit(wanted)
    if target is None and wanted not in ("dB", "%"):
        raise InputError(f"{where}: unit '{wanted}' is unknown")
    found = conversion(source, target) if source is not None and target is not None else None
    if found is None:
        raise InputError(f"{where}: unit '{wanted}' does not fit: the value is in {unit or 'no unit'}")
    factor, offset = found
    return factor * value + offset
