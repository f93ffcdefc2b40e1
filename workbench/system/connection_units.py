"""Units of connections: converted where both are defined or the connection names one, refused otherwise."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.core.records.names_in_text import plain_unit
from workbench.core.values.conversion import Unit, conversion, is_same_unit, known_unit
from workbench.errors import InputError, WorkbenchError
from workbench.fmi.variable import Variable
from workbench.system.description import (
    Component,
    Connection,
    FmuComponent,
    Port,
    SumComponent,
    SystemDescription,
)
from workbench.system.fmu_facts import fmu_facts

__all__ = ["UnitCheck", "all_units", "declared_unit"]

_Linear = tuple[float, float]
_NONE = "1"  # of a number without dimension, in FMUs: as good as no unit
_NAMED = 4


def declared_unit(component: Component, variable: Variable) -> str | None:
    """Return the unit of a component's variable: the FMU's, else what the system file says; None: none."""
    if variable.unit:
        return variable.unit
    written = component.unit if isinstance(component, SumComponent) else component.units.get(variable.name)
    return plain_unit(written or "") or None


def all_units(description: SystemDescription) -> dict[str, Unit]:
    """Return the definitions of the file and of all FMUs; where names clash, the first one."""
    result = dict(description.units)
    for component in description.components:
        if isinstance(component, FmuComponent):
            result = {**_fmu_units(component), **result}
    return result


def _fmu_units(component: FmuComponent) -> Mapping[str, Unit]:
    try:
        return fmu_facts(component.file, component.called).units
    except WorkbenchError:  # the FMU is open elsewhere, its file may be gone; then other definitions must do
        return {}


class UnitCheck:
    """Turns the units of connections into factors and offsets."""

    def __init__(self, description: SystemDescription) -> None:
        self.description, self._name = description, description.full_name
        self._converted: list[str] = []
        self._one_sided: list[str] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """What was converted on the user's behalf, and what could not be, as one end alone has a unit."""
        if not self._one_sided:
            return tuple(self._converted)
        shown = ", ".join(self._one_sided[:_NAMED]) + (", …" if len(self._one_sided) > _NAMED else "")
        count = f"{len(self._one_sided)} connections have" if len(self._one_sided) > 1 else "1 connection has"
        return (*self._converted, f"{count} a unit at one end only, so the number is passed on unchanged: {shown}")

    def transformation(self, connection: Connection, source: Port, target: Port) -> _Linear:
        """Return factor and offset from source to destination.

        Raises:
            InputError: the units do not fit, or are not known.
        """
        own = (connection.gain, connection.offset)
        if not connection.convert:
            if connection.unit is not None:
                raise InputError("'unit' asks for a conversion and 'convert = false' forbids it; leave one out")
            return own
        if connection.unit is not None:
            before = self._to_named(source, connection.unit, forwards=True)
            after = self._to_named(target, connection.unit, forwards=False)
            return _chain(_chain(before, own), after)
        return _chain(self._unasked(source, target), own)

    def check_same(self, first: Port, other: Port, what: str) -> None:
        """Refuse two ports of different units.

        Raises:
            InputError: they differ.
        """
        a, b = self._unit(first), self._unit(other)
        if a is None or b is None or a == b:
            return
        left, right = self._known(first, a), self._known(other, b)
        if left is None or right is None or not is_same_unit(left, right):
            raise InputError(f"{what}, whose units differ: {a} and {b}; put a gain component before one of them")

    # -- units that the connection names ------------------------------------------------------------

    def _to_named(self, port: Port, name: str, *, forwards: bool) -> _Linear:
        """Return the conversion between a port's unit and the connection's, from the source or to the destination."""
        own = self._unit(port) or name
        if own == name:
            return 1.0, 0.0
        mine, named = self._known(port, own), self._known(port, name)
        for text, unit in ((own, mine), (name, named)):
            if unit is None:
                raise InputError(
                    f"unit '{text}' is not known, so nothing can be converted; use gain and convert = false"
                )
        if mine is None or named is None:
            return 1.0, 0.0
        result = conversion(mine, named) if forwards else conversion(named, mine)
        if result is None:
            raise InputError(
                f"'{port.variable.name}' is in {own}, which is not compatible with {name}; convert = false hands the "
                "number over as it is"
            )
        return result

    # -- units that nobody named ----------------------------------------------------------------------

    def _unasked(self, source: Port, target: Port) -> _Linear:
        given, taken = self._unit(source), self._unit(target)
        if given is None or taken is None:
            self._note_one_sided(source, target, given, taken)
            return 1.0, 0.0
        if given == taken:
            return 1.0, 0.0
        left, right = self._known(source, given), self._known(target, taken)
        if left is None or right is None:
            unknown = given if left is None else taken
            raise InputError(
                f"units {given} → {taken}, and '{unknown}' is not known; if the number is right as it is (times gain), "
                "set convert = false"
            )
        if is_same_unit(left, right):
            return 1.0, 0.0
        result = conversion(left, right)
        if result is None:
            raise InputError(
                f"units {given} → {taken} measure different things; if the number is right as it is (times gain), set "
                "convert = false"
            )
        if given not in self._definitions(source) or taken not in self._definitions(target):
            raise InputError(
                f'units differ: {given} → {taken}; unit = "{taken}" converts (× {result[0]:g}{_signed(result[1])}), '
                "convert = false passes the number on unchanged"
            )
        self._note(source, target, given, taken, result)
        return result

    def _note(self, source: Port, target: Port, given: str, taken: str, result: _Linear) -> None:
        self._converted.append(
            f"{self._name(source)} → {self._name(target)}: converted from {given} to {taken} by the unit definitions "
            f"(× {result[0]:g}{_signed(result[1])})"
        )

    def _note_one_sided(self, source: Port, target: Port, given: str | None, taken: str | None) -> None:
        if (given or taken or _NONE) != _NONE:
            ends = (f"{self._name(p)} ({unit or 'none'})" for p, unit in ((source, given), (target, taken)))
            self._one_sided.append(" → ".join(ends))

    # -- lookup -----------------------------------------------------------------------------------------

    def _unit(self, port: Port) -> str | None:
        return declared_unit(self.description.components[port.component], port.variable)

    def _known(self, port: Port, name: str) -> Unit | None:
        return known_unit(name, self._definitions(port))

    def _definitions(self, port: Port) -> Mapping[str, Unit]:
        """Return the definitions that count for a port: of its FMU, else of the system file."""
        component = self.description.components[port.component]
        if not isinstance(component, FmuComponent):
            return self.description.units
        return {**self.description.units, **_fmu_units(component)}


def _chain(first: _Linear, then: _Linear) -> _Linear:
    return then[0] * first[0], then[0] * first[1] + then[1]


def _signed(offset: float) -> str:
    return f" {'+' if offset > 0.0 else '−'} {abs(offset):g}" if offset else ""
