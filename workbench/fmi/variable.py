"""One scalar variable of a model."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["EXACT_TO", "FLOAT_TYPES", "NEGATED", "WHOLE_RANGES", "Value", "Variable"]

Value = float | int | bool | str

FLOAT_TYPES = frozenset({"Real", "Float64", "Float32"})
# Type → smallest and largest whole number that it can be.
WHOLE_RANGES = {
    **{f"Int{bits}": (-(1 << bits - 1), (1 << bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, (1 << bits) - 1) for bits in (8, 16, 32, 64)},
    "Integer": (-(1 << 31), (1 << 31) - 1),
}
NEGATED = "negated "  # before the type of what is minus another variable (FMI 1.0): it is listed, and not used
EXACT_TO = 1 << 53  # whole numbers up to this are themselves in signals and results, which are 64-bit floating point


class Variable(NamedTuple):
    """One scalar variable; an element of an FMI 3 array is a variable of its own (`u[1]`).

    A tuple, because a model may have 100,000 of them.

    Attributes:
        name: as the FMU gives it, array elements with 1-based indices appended.
        type: FMI type name: "Real", "Integer", "Boolean", "String", "Enumeration" (FMI 1 and 2),
            "Float64", "Int32", … (FMI 3).
        unit: unit as declared, None where none is.
        start: start value as declared, None where none is.
        description: as declared.
        causality: "input", "output", "parameter", "local", …
        variability: "continuous", "discrete", "fixed", "tunable", "constant".
        minimum, maximum: as declared, of the variable or of its type.
        nominal: as declared, of the variable or of its type; None where none is (never 0).
        value_reference: the FMU's handle; elements of one array share it.
        element: position in the flattened array, 0 for a scalar.
        derivative_of: name of the state whose derivative this is.
        dependencies: for outputs and derivatives, names of what it depends on; None: not declared.
        initial: "exact", "approx" (the start value is a guess) or "calculated"; None: not declared.
        display_unit: unit in which values are to be shown, as declared.
        declared_type: name of the type that it is declared to be of.
        alias_of: name of the variable that this is another name of.
    """

    name: str
    type: str = "Real"
    unit: str | None = None
    start: Value | None = None
    description: str | None = None
    causality: str = "local"
    variability: str = "continuous"
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    value_reference: int = 0
    element: int = 0
    derivative_of: str | None = None
    dependencies: tuple[str, ...] | None = None
    initial: str | None = None
    display_unit: str | None = None
    declared_type: str | None = None
    alias_of: str | None = None

    @property
    def is_continuous_input(self) -> bool:
        """Whether it may change between events: a real input of continuous variability."""
        return self.causality == "input" and self.type in FLOAT_TYPES and self.variability == "continuous"

    @property
    def is_number(self) -> bool:
        """Whether a float stands for its value (everything but String, Binary, Clock and what is negated)."""
        return self.type not in ("String", "Binary", "Clock") and not self.type.startswith(NEGATED)
