"""An option declared once: a field of a frozen dataclass with its type, its unit and a sentence of help."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Hashable, Iterator
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Annotated, Any, cast, dataclass_transform, get_args, get_origin

from workbench.core.forms import Form
from workbench.errors import InputError

__all__ = ["Declared", "Option", "Options", "option", "options_of"]

_DECLARED = "option"


@dataclass(frozen=True, kw_only=True)
class Option:
    """What is declared of an option besides its name, type and default.

    Attributes:
        help: one sentence that stands alone, with a full stop.
        unit: of the value; empty: it has none, or the sentence says it.
        flag: on the command line, "--max-periods"; empty: made from the name.
        metavar: what `--help` shows in place of the value; empty: that of its form.
        group: heading under which `--help` shows it; empty: the first one.
        python: whether only Python has it.
        least: smallest value; None: any.
        positive: whether it must be above 0.
        needed: why it has to be given, where a default is only for the order of the fields; empty: it need not.
        form: how values are written; None: as their type is.
    """

    help: str
    unit: str = ""
    flag: str = ""
    metavar: str = ""
    group: str = ""
    python: bool = False
    least: float | None = None
    positive: bool = False
    needed: str = ""
    form: Form | None = None


@dataclass(frozen=True, kw_only=True)
class Declared:
    """An option of a request, complete.

    Attributes:
        name: of the field.
        type: of the value, without None and its form.
        form: how values are written as text; None: as their type is.
        default: if it is not given.
        required: whether there is no default.
        option: the rest.
    """

    name: str
    type: Any
    form: Form | None
    default: Any
    required: bool
    option: Option

    @property
    def flag(self) -> str:
        """On the command line."""
        return self.option.flag or f"--{self.name.replace('_', '-')}"

    @property
    def spoken(self) -> str:
        """In messages."""
        return self.name.replace("_", " ")

    @property
    def help(self) -> str:
        """The sentence of help with the unit."""
        unit = self.option.unit
        return f"{self.option.help.removesuffix('.')} [{unit}]." if unit else self.option.help

    def checked(self, value: Any) -> Any:  # noqa: ANN401 - of any option
        """Return a value as the analysis takes it.

        Raises:
            InputError: it is outside its range, or is nothing of the kind.
        """
        if value is None and self.option.needed:
            raise InputError(f"{self.spoken}: none given; {self.option.needed}")
        if value is None or value is self.default:
            return value
        try:
            found = value if self.form is None else self.form.take(value)
            self._check_range(found)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.spoken}: {error}") from None
        return found

    def _check_range(self, value: Any) -> None:  # noqa: ANN401
        unit = f" [{self.option.unit}]" if self.option.unit else ""
        for x in value if isinstance(value, tuple) else (value,):
            if self.option.positive and not 0.0 < x < float("inf"):
                raise ValueError(f"{x:g} is not a positive number{unit}")
            if self.option.least is not None and not x >= self.option.least:
                raise ValueError(f"{x:g} is too small; take at least {self.option.least:g}{unit}")


def option(
    help: str,  # noqa: A002 - what it is
    *,
    default: Any = MISSING,  # noqa: ANN401 - of the option's type
    unit: str = "",
    flag: str = "",
    metavar: str = "",
    group: str = "",
    python: bool = False,
    least: float | None = None,
    positive: bool = False,
    needed: str = "",
    form: Form | None = None,
) -> Any:  # noqa: ANN401 - a field of whatever type is annotated
    """Declare an option of a request: a field of the dataclass. See `Option` for the arguments."""
    declared = Option(
        help=help, unit=unit, flag=flag, metavar=metavar, group=group, python=python, least=least, positive=positive,
        needed=needed, form=form,
    )  # fmt: skip
    return field(default=default, metadata={_DECLARED: declared})


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(option, field))
class Options:
    """Options that belong together: a request, or a part that several requests share.

    Every field of a subclass is made by `option`; those behind `_: KW_ONLY` are given by name.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, eq=False)(cls)

    def __post_init__(self) -> None:
        for declared in options_of(type(self)):
            object.__setattr__(self, declared.name, declared.checked(getattr(self, declared.name)))


def options_of(request: type[Options]) -> tuple[Declared, ...]:
    """Return the options of a request: those given by position, its own, then those of its parts."""
    return _options_of(cast("Hashable", request))


@cache
def _options_of(request: Any) -> tuple[Declared, ...]:  # noqa: ANN401 - a class; mypy holds it for unhashable
    hints = _hints(request)
    own = vars(request).get("__annotations__", {})
    return tuple(
        Declared(
            name=f.name,
            type=_plain(hints[f.name]),
            form=f.metadata[_DECLARED].form or next(_forms(hints[f.name]), None),
            default=None if f.default is MISSING else f.default,
            required=f.default is MISSING or bool(f.metadata[_DECLARED].needed),
            option=f.metadata[_DECLARED],
        )
        for f in sorted(fields(request), key=lambda f: (bool(f.kw_only), f.name not in own))
    )


class _Known(dict[str, Any]):
    """Names that an annotation may use; one that only the type checker imports stands for anything."""

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(builtins, name, object)


def _hints(request: type[Options]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for owner in reversed(request.__mro__):
        known = _Known(vars(sys.modules[owner.__module__]))
        for name, text in vars(owner).get("__annotations__", {}).items():
            found[name] = eval(text, {}, known) if isinstance(text, str) else text  # noqa: S307 - our own source
    return found


def _forms(hint: Any) -> Iterator[Form]:  # noqa: ANN401 - a type
    yield from (m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Form))
    for part in get_args(hint):
        yield from _forms(part)


def _plain(hint: Any) -> Any:  # noqa: ANN401 - a type
    """Return the type without None and remarks."""
    if get_origin(hint) is Annotated:
        return _plain(get_args(hint)[0])
    rest = [part for part in get_args(hint) if part is not type(None)]
    return _plain(rest[0]) if len(rest) == 1 and len(get_args(hint)) == 2 else hint
