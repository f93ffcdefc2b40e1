"""What a kind of block is: parameters, ports, states, what analyses may know of it, and its number in the kernel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

from workbench.core.records.forms import LISTED, Form, several
from workbench.core.records.option import Options, options_of, values_of
from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["Block", "BlockStateSpace", "Described", "Matrix", "Values"]


def _rows(value: Any) -> tuple[tuple[float, ...], ...]:  # noqa: ANN401 - what Python or a TOML file holds
    result = tuple(several(row) for row in value)
    if len({len(row) for row in result}) > 1:
        raise ValueError("has rows of different lengths")
    return result


def _values(value: Any) -> tuple[float, ...]:  # noqa: ANN401 - what Python or a TOML file holds
    if isinstance(value, str):
        raise ValueError(f"'{value}' is not a list of numbers")
    return several(value)


Values = Annotated[tuple[float, ...], Form(metavar="[A, ..]", read=_values, layout=LISTED, items=("number",))]
Matrix = Annotated[
    tuple[tuple[float, ...], ...],
    Form(metavar="[[A, ..], ..]", read=_rows, layout=LISTED, items=("array",)),
]


class Described(NamedTuple):
    """A describing function in closed form.

    Attributes:
        name: of the standard block.
        parameters: of it.
    """

    name: str
    parameters: Mapping[str, float]


class BlockStateSpace(NamedTuple):
    """A block that is a linear system, by rows; dt [s], 0: continuous."""

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    dt: float = 0.0


class Block(Options):
    """One block with its parameters, which are the fields of a subclass.

    Obligations of a subclass:
      1. The first sentence of its docstring says what the block is.
      2. `kind` is its name in a system file; `equations` what it computes, in lines.
      3. A block of the kernel has a `number` (kernel/native_blocks.py), `packed` parameters in the order that
         `kernel/block_kinds.c` says, and `states`, `remembers`, `indicators` that fit. Another one is linear, and
         `matrices` says how.
      4. `check` refuses parameters that do not fit each other.
      5. `static`, `levels`, `sector` and `described` are given where the block has them.

    Attributes:
        kind: see 2.
        group: heading in lists and palettes.
        equations: see 2.
        number: name of its number in the kernel; empty: it is linear.
        sample: values to begin with, of parameters that have to be given.
        feeds: whether the output depends on the inputs without delay.
    """

    kind: ClassVar[str] = ""
    equations: ClassVar[str] = ""
    number: ClassVar[str] = ""
    feeds: ClassVar[bool] = True
    sample: ClassVar[Mapping[str, Any]] = {}

    def __post_init__(self) -> None:
        """Check every parameter, then all of them together."""
        for declared in options_of(type(self)):
            value = getattr(self, declared.name)
            if declared.required and value is None:
                raise InputError(f"{self.kind}: parameter '{declared.name}' is missing")
            if isinstance(value, float) and math.isnan(value):
                raise InputError(f"{self.kind}: {declared.name} is not a number")
        try:
            super().__post_init__()
            self.check()
        except InputError as error:
            raise InputError(f"{self.kind}: {error}") from None

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and values_of(self) == values_of(other)

    def __hash__(self) -> int:
        return hash((self.kind, *values_of(self).values()))

    def check(self) -> None:
        """Refuse parameters that do not fit each other.

        Raises:
            InputError: with the name of the parameter.
        """

    # -- ports ------------------------------------------------------------------------------------

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return ("u",)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the continuous states."""
        return ()

    @property
    def remembers(self) -> Mapping[str, float]:
        """Names of the discrete states that are shown → where they start."""
        return {}

    @property
    def indicators(self) -> int:
        """Number of event indicators."""
        return 0

    # -- the kernel's ------------------------------------------------------------------------------

    def packed(self) -> tuple[float, ...]:
        """Return the parameters as the kernel takes them."""
        return ()

    def grids(self) -> tuple[tuple[float, ...], ...]:
        """Return the arrays of a table."""
        return ()

    def starts(self) -> tuple[float, ...]:
        """Return where the continuous states start."""
        return (0.0,) * len(self.states)

    def first_mode(self) -> tuple[float, ...]:
        """Return the mode before the first event."""
        return tuple(self.remembers.values())

    def matrices(self) -> BlockStateSpace | None:
        """Return the block as a linear system; None: it is not one."""
        return None

    # -- what is known of it -----------------------------------------------------------------------

    def static(self, u: Floats) -> Floats:
        """Return the output of a block without memory, shape (n,).

        Args:
            u: inputs, shape (n,).
        """
        raise NotImplementedError

    def levels(self) -> tuple[float, ...]:
        """Return the inputs at which the output or its slope jumps."""
        return ()

    def described(self) -> Described | None:
        """Return the describing function in closed form; None: it has none."""
        return None

    def sector(self) -> tuple[float, float] | None:
        """Return the smallest sector [α, β] with α u² ≤ u y ≤ β u²; None: it has none, or a memory."""
        return None

    @property
    def is_linear(self) -> bool:
        """Whether it is linear, sampled or delayed."""
        return self.number == "delay" or self.matrices() is not None

    @property
    def given(self) -> dict[str, Any]:
        """Parameters that have to be given, and those that are not at their default."""
        values = values_of(self)
        return {d.name: values[d.name] for d in options_of(type(self)) if d.required or values[d.name] != d.default}

    @property
    def words(self) -> str:
        """The block in a few words: its kind, and those parameters."""
        shown = ", ".join(f"{name} = {_short(value)}" for name, value in self.given.items())
        return f"{self.kind.replace('_', ' ')}{', ' if shown else ''}{shown}"

    def has_characteristic(self) -> bool:
        """Whether `static` can be asked."""
        return type(self).static is not Block.static


def _short(value: object) -> str:
    if isinstance(value, tuple) and len(value) > 4:
        return f"{len(value)} values"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def ordered(lower: float, upper: float, names: tuple[str, str] = ("lower", "upper")) -> None:
    """Refuse limits in the wrong order.

    Raises:
        InputError: they are.
    """
    if not lower < upper:
        raise InputError(f"{names[0]} = {lower:g} must be below {names[1]} = {upper:g}")
