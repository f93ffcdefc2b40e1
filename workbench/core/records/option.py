"""An option declared once: a field of a frozen dataclass with its type, its unit and a sentence of help."""

from __future__ import annotations

import builtins
import inspect
import math
import re
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import cache, cached_property
from numbers import Integral, Real
from typing import (
    Annotated,
    Any,
    ClassVar,
    Concatenate,
    Literal,
    ParamSpec,
    TypeVar,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from workbench.core.machine.interrupts import insisting
from workbench.core.records.forms import Form, of_type
from workbench.core.records.quantity import plain, quantities_in
from workbench.errors import InputError, suggest

__all__ = [
    "EACH",
    "DeclaredOption",
    "Option",
    "Options",
    "asked_in_json",
    "asked_of",
    "documented",
    "in_unit",
    "option",
    "options_of",
    "parts_of",
    "put_together",
    "recast",
    "values_of",
    "with_options",
]

EACH = "each"
_DECLARED = "option"
_ARGUMENTS = "Args:"
_NUMERIC = {"number", "integer"}  # among `Form.items`

_Given = ParamSpec("_Given")
_Asked = TypeVar("_Asked")
_First = TypeVar("_First")
_Made = TypeVar("_Made")
_Kind = TypeVar("_Kind", bound="Options")


@dataclass(frozen=True, kw_only=True)
class Option:
    """What is declared of an option besides its name, type and default.

    Attributes:
        help: one sentence that stands alone, with a full stop.
        unit: unit of the value; empty: it has none, or the sentence says it.
        of: option that names the variable in whose unit the value is, so that one may be given in another; `EACH`: its
            own names do; empty: none.
        change: whether it is a difference of two values of that variable, such as an amplitude, and not a value.
        flag: on the command line, "--max-periods"; empty: made from the name.
        also: another flag of the same meaning; empty: none.
        metavar: what `--help` shows in place of the value; empty: that of its form.
        group: heading under which `--help` shows it; empty: that of the class it is declared in.
        first: whether `--help` of a command with many options describes it; those that have to be given in any case.
        python: whether only Python has it.
        least: smallest value; None: any.
        positive: whether it must be above 0.
        below: what it must be less than; None: anything.
        infinite: whether it may be infinite.
        choices: values that it can have; empty: any of its type.
        needed: why it has to be given, where a default is only for the order of the fields; empty: it need not.
        form: how values are written; None: as their type is.
        part: options that stand for it on the command line; None: those of its type, if these are options.
    """

    help: str
    unit: str = ""
    of: str = ""
    change: bool = False
    flag: str = ""
    also: str = ""
    metavar: str = ""
    group: str = ""
    first: bool = False
    python: bool = False
    least: float | None = None
    positive: bool = False
    below: float | None = None
    infinite: bool = False
    choices: tuple[str, ...] = ()
    needed: str = ""
    form: Form | None = None
    part: type[Options] | None = None

    @property
    def sentence(self) -> str:
        """The sentence of help with the unit."""
        return f"{self.help.removesuffix('.')}{self.in_brackets}." if self.unit else self.help

    @property
    def in_brackets(self) -> str:
        """The unit, as it stands behind words; empty: there is none."""
        return f" [{self.unit}]" if self.unit else ""


@dataclass(frozen=True, kw_only=True)
class DeclaredOption:
    """An option of a request, complete.

    Attributes:
        name: name of the field.
        type: type of the value, without None and its form.
        form: how values are written as text; None: as their type is.
        default: if it is not given.
        required: whether there is no default.
        group: heading under which `--help` shows it; empty: the first one.
        option: the rest.
    """

    name: str
    type: Any
    form: Form | None
    default: Any
    required: bool
    group: str
    option: Option

    @property
    def flag(self) -> str:
        """On the command line."""
        return self.option.flag or f"--{self.name.replace('_', '-')}"

    @cached_property
    def choices(self) -> tuple[str, ...]:
        """Values that it can have; empty: any of its type."""
        return get_args(self.type) if get_origin(self.type) is Literal else self.option.choices

    @property
    def metavar(self) -> str:
        """What `--help` shows in place of the value; empty: it has none."""
        return self.option.metavar or "|".join(self.choices) or (self.form.metavar if self.form is not None else "")

    @property
    def repeated(self) -> bool:
        """Whether it can be given several times."""
        return self.form is not None and self.form.repeated

    @property
    def help(self) -> str:
        """The sentence of help with the unit."""
        return self.option.sentence

    def checked(self, value: Any, spoken: str = "") -> Any:  # noqa: ANN401 - of any option
        """Return a value as the analysis takes it.

        Args:
            value: as Python or a TOML file has it, or the parts of a text.
            spoken: what a message calls the option; empty: its name.

        Raises:
            InputError: it is outside its range, or is nothing of the kind.
        """
        spoken, value = spoken or self.name, plain(value)
        if value is None and self.option.needed:
            raise InputError(f"{spoken}: none given; {self.option.needed}")
        if value is None or value is self.default:
            return value
        if self.choices and value not in self.choices:
            raise InputError(f"{spoken} '{value}' is unknown; {suggest(str(value), self.choices)}")
        try:
            result = value if self.form is None else self.form.read(value)
            if not self.option.of and (given := next(quantities_in(result), None)) is not None:
                raise ValueError(f"'{given}' is not a number")
            self._check_range(result)
        except (TypeError, AttributeError):
            form = f"of the form {self.form.metavar}" if self.form is not None else "a number"
            raise InputError(f"{spoken}: '{value}' is not {form}") from None
        except ValueError as error:
            words = (
                in_unit(str(error), self.option.unit) if spoken == self.flag else f"{error}{self.option.in_brackets}"
            )
            raise InputError(f"{spoken}: {words}") from None
        return result

    def read(self, given: Any) -> Any:  # noqa: ANN401 - what a command line or a form holds
        """Return the value that is written as a command line has it; what is wrong with it is said of the flag.

        Args:
            given: text, or texts where the form is repeated; true or false of a switch.

        Raises:
            InputError: it is outside its range, or is nothing of the kind.
        """
        if self.form is None:
            return self.checked(given, self.flag)
        try:
            parts = self.form.layout.split(given if self.form.repeated else [given])
        except ValueError as error:
            raise InputError(f"{self.flag}: {in_unit(str(error), self.option.unit)}") from None
        return self.checked(parts, self.flag)

    def write(self, value: Any) -> list[str]:  # noqa: ANN401 - of this option
        """Return the words by which a command line gives a value, one for each time the option stands there.

        Args:
            value: as the analysis takes it.
        """
        if self.form is None:
            return [self.flag if value else f"--no-{self.flag.removeprefix('--')}"]
        return [f"{self.flag}={text}" for text in self.form.layout.join(value)]

    def _check_kind(self, value: Any) -> None:  # noqa: ANN401
        if self.type is bool and value not in (True, False):
            raise ValueError(f"{value!r} is not True or False")
        if self.type is str and not isinstance(value, str):
            raise ValueError(f"{value!r} is not a text; give one, in quotes")

    def _check_range(self, value: Any) -> None:  # noqa: ANN401
        self._check_kind(value)
        if self.form is not None and not _NUMERIC.isdisjoint(self.form.items):
            for name, x in _numbers_in(value):
                self._check_number(name, x, infinite=self.option.infinite or self.form.infinite)
        ranged = self.option.positive or {self.option.below, self.option.least} != {None}
        for x in _extremes(value) if isinstance(value, tuple) else (value,):
            if (ranged or self.type in (int, float)) and not isinstance(x, Real):
                raise ValueError(f"{x!r} is not a number")
            if self.type is int and not isinstance(x, Integral):
                raise ValueError(f"{x!r} is not a whole number")
            if self.option.positive and not (x > 0.0 and (x < math.inf or self.option.infinite)):
                raise ValueError(f"{x:g} is not a positive number")
            if self.option.below is not None and not x < self.option.below:
                raise ValueError(f"{x:g} is too large; it must be below {self.option.below:g}")
            if self.option.least is not None and not x >= self.option.least:
                raise ValueError(f"{x:g} is too small; take at least {self.option.least:g}")

    def _check_number(self, name: str, x: Any, *, infinite: bool) -> None:  # noqa: ANN401 - a number
        said = f"{name}: {x}" if name else f"{x}"
        if isinstance(x, bool) and self.form is not None and "boolean" not in self.form.items:
            raise ValueError(f"{said} is not a number")
        if isinstance(x, int) and abs(x) > sys.float_info.max:
            raise ValueError("a whole number beyond 1e308 is too large")
        if math.isnan(x):
            raise ValueError(f"{said} is not a number")
        if math.isinf(x) and not infinite:
            raise ValueError(f"{said} is not a {'positive ' if self.option.positive else ''}finite number")


def _numbers_in(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - of any option
    """Yield the numbers in a value, with the name that each has in it; of many alike those that stand for all."""
    if isinstance(value, Real):
        yield name, value
    elif isinstance(value, Mapping):
        for key, x in value.items():
            yield from _numbers_in(x, key)
    elif isinstance(value, tuple | list):
        for x in _extremes(tuple(value)):
            yield from _numbers_in(x, name)
    elif getattr(value, "size", 0) and value.dtype.kind in "biuf":
        yield from ((name, value.min().item()), (name, value.max().item()))  # NaN wins


def _extremes(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the smallest and the largest, where they stand for all: of numbers that can be compared."""
    plain = set(map(type, values)) == {float} and not math.isnan(sum(values))
    return (min(values), max(values)) if plain else values


def in_unit(complaint: str, unit: str) -> str:
    """Return the message for a text that is not a number, with the unit in which the number is expected.

    Args:
        complaint: such as "'1s' is not a number".
        unit: of the option; empty: it has none.
    """
    if not unit:
        return complaint
    return (
        f"{complaint}; give it in {unit}, without a unit" if complaint.endswith("a number") else f"{complaint} [{unit}]"
    )


def option(
    help: str,  # noqa: A002 - what it is
    *,
    default: Any = MISSING,  # noqa: ANN401 - of the option's type
    default_factory: Any = MISSING,  # noqa: ANN401 - it makes a default that can be changed, as a dictionary
    unit: str = "",
    of: str = "",
    change: bool = False,
    flag: str = "",
    also: str = "",
    metavar: str = "",
    group: str = "",
    first: bool = False,
    python: bool = False,
    least: float | None = None,
    positive: bool = False,
    below: float | None = None,
    infinite: bool = False,
    choices: tuple[str, ...] = (),
    needed: str = "",
    form: Form | None = None,
    part: type[Options] | None = None,
) -> Any:  # noqa: ANN401 - a field of whatever type is annotated
    """Declare an option of a request: a field of the dataclass. See `Option` for the arguments."""
    declared = Option(
        help=help, unit=unit, of=of, change=change, flag=flag, also=also, metavar=metavar, group=group,
        first=first, python=python, least=least, positive=positive, below=below, infinite=infinite, choices=choices,
        needed=needed, form=form, part=part,
    )  # fmt: skip
    made: Any = field(
        metadata={_DECLARED: declared},
        **{k: v for k, v in (("default", default), ("default_factory", default_factory)) if v is not MISSING},
    )
    return made


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(option, field))
class Options:
    """Options that belong together: a request, or a part that several requests share.

    Every field of a subclass is made by `option`; those behind `_: KW_ONLY` are given by name.

    Attributes:
        group: heading under which `--help` shows those that are declared in this class; empty: the first one.
    """

    group: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, eq=False)(cls)

    def __post_init__(self) -> None:
        for declared in options_of(type(self)):
            object.__setattr__(self, declared.name, declared.checked(getattr(self, declared.name)))


def options_of(request: type[Options]) -> tuple[DeclaredOption, ...]:
    """Return the options of a request: those given by position, its own, then those of its parts."""
    return _options_of(cast("Hashable", request))


def values_of(request: Options) -> dict[str, Any]:
    """Return the options of a request by name, as they are."""
    return {d.name: getattr(request, d.name) for d in options_of(type(request))}


def parts_of(request: type[Options], group: str = "") -> Iterator[tuple[DeclaredOption, str]]:
    """Yield each option with its heading as a command line has it: a part of options is taken apart.

    Args:
        request: class of the options.
        group: heading of those that have none.
    """
    for declared in options_of(request):
        if declared.option.python:
            continue
        if part := _part(declared):
            yield from parts_of(part, declared.group)
        else:
            yield declared, declared.group or group


def put_together(request: type[_Kind], given: Mapping[str, Any]) -> _Kind:
    """Return a request, parts of options put together; what is not given has its default.

    Args:
        request: class of the options.
        given: values by name, others among them.
    """
    values: dict[str, Any] = {}
    for declared in options_of(request):
        part = None if declared.option.python else _part(declared)
        if part:
            values[declared.name] = put_together(part, given)
        elif not declared.option.python and given.get(declared.name) is not None:
            values[declared.name] = given[declared.name]
    return request(**values)


def asked_of(request: Options) -> dict[str, list[str]]:
    """Return what is asked for, as JSON can hold it: options that have not their default, in the words of `write`.

    Args:
        request: a request.
    """
    result: dict[str, list[str]] = {}
    for declared in options_of(type(request)):
        value = getattr(request, declared.name)
        if declared.option.python or value is None or value == declared.default:
            continue
        if isinstance(value, Options):
            result |= asked_of(value)
        elif words := declared.write(value):
            result[declared.name] = words
    return result


def asked_in_json(request: Options) -> dict[str, Any]:
    """Return what is asked for as a record's file tells it: option → text of its value, true or false.

    Args:
        request: a request.
    """
    result: dict[str, Any] = {}
    for name, words in asked_of(request).items():
        texts = [word.partition("=")[2] for word in words]
        result[name] = texts if len(texts) > 1 else texts[0] or not words[0].startswith("--no-")
    return result


def _part(declared: DeclaredOption) -> type[Options] | None:
    """Return the options that stand for one; None: it is an option itself."""
    kind = declared.option.part or declared.type
    return kind if inspect.isclass(kind) and issubclass(kind, Options) else None


def recast(request: type[_Kind], asked: Options, **others: Any) -> _Kind:  # noqa: ANN401
    """Return another request with those options that both have.

    Args:
        request: class of the other one.
        asked: whose options are taken.
        others: what it has in place of them, or besides.

    Raises:
        TypeError: one of the others is not an option of the other request.
    """
    known = {d.name for d in options_of(request)}
    if wrong := next((name for name in others if name not in known), None):
        raise TypeError(f"{request.__name__} has no option '{wrong}'; {suggest(wrong, known)}")
    return request(**{**{name: x for name, x in values_of(asked).items() if name in known}, **others})


@cache
def _options_of(request: Any) -> tuple[DeclaredOption, ...]:  # noqa: ANN401 - a class; mypy holds it for unhashable
    hints = _hints(request)
    return tuple(
        DeclaredOption(
            name=f.name,
            type=_plain(hints[f.name]),
            form=f.metadata[_DECLARED].form or next(_forms(hints[f.name]), of_type(_plain(hints[f.name]))),
            default=None if f.default is MISSING else f.default,
            required=f.default is f.default_factory is MISSING or bool(f.metadata[_DECLARED].needed),
            group=f.metadata[_DECLARED].group or _heading(request, f.name),
            option=f.metadata[_DECLARED],
        )
        for f in _declared(request)
    )


def _declared(request: Any) -> list[Field[Any]]:  # noqa: ANN401 - a class
    """Return the fields of `options_of`, whose types need not be known yet."""
    own = vars(request).get("__annotations__", {})
    every = sorted(fields(request), key=lambda f: (bool(f.kw_only), f.name not in own))
    return [f for f in every if _DECLARED in f.metadata]


def _heading(request: Any, name: str) -> str:  # noqa: ANN401 - a class
    """Return the heading of the class that declares a field; what is inherited is that of another part."""
    owner = next(c for c in request.__mro__ if name in vars(c).get("__annotations__", {}))
    return str(vars(owner).get("group", ""))


class _AnnotationNames(dict[str, Any]):
    """Names that an annotation may use; one that only the type checker imports stands for anything."""

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(builtins, name, object)


def _hints(request: type[Options]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for owner in reversed(request.__mro__):
        own = type(owner.__name__, (), {"__annotations__": vars(owner).get("__annotations__", {})})
        result |= get_type_hints(own, {}, _AnnotationNames(vars(sys.modules[owner.__module__])), include_extras=True)
    return result


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


# -- functions ---------------------------------------------------------------------------------


def with_options(
    request: Callable[_Given, _Asked],
    make: Callable[[_First, _Asked], _Made],
    *,
    name: str,
    first: tuple[str, str, str],
    optional: bool = False,
    returns: str = "",
    words: str = "",
) -> Callable[Concatenate[_First, _Given], _Made]:
    """Return a function whose parameters are an object and the options of a request.

    Args:
        request: class of the options.
        make: what the function does with the object and the request.
        name: name of the function.
        first: name, type and help of the object.
        optional: whether it may be left out, and is empty then.
        returns: type of what the function returns; empty: as `make` says.
        words: what comes before the docstring of the request.
    """
    kind: Any = request
    parameter = inspect.Parameter(first[0], inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=first[1])
    parameter = parameter.replace(default=()) if optional else parameter
    own = inspect.signature(kind).parameters  # those that several requests share come first there
    given = [parameter, *(own[f.name] for f in _declared(kind))]
    returned = returns or (make.__name__ if inspect.isclass(make) else make.__annotations__["return"])
    signature = inspect.Signature(given, return_annotation=returned)

    def call(*args: Any, **kwargs: Any) -> _Made:  # noqa: ANN401 - the signature says which
        try:
            values = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"{name}() {_wrong_call(signature, args, kwargs) or error}") from None
        with insisting():
            return make(values.pop(first[0], ()), kind(**values))

    call.__signature__ = signature  # type: ignore[attr-defined]
    call.__annotations__ = {**{p.name: p.annotation for p in given}, "return": returned}
    call.__doc__ = f"{words}\n\n" if words else ""
    call.__doc__ += kind.__doc__.replace(_ARGUMENTS, f"{_ARGUMENTS}\n    {first[0]}: {first[2]}", 1)
    call.__name__ = call.__qualname__ = name
    call.__module__ = kind.__module__
    return call


def _wrong_call(signature: inspect.Signature, args: Sequence[object], given: Mapping[str, object]) -> str:
    """Return what is wrong with the arguments of a call, as far as Python says less of it; empty: it says it well."""
    for key in given:
        if key not in signature.parameters:
            return f"has no parameter '{key}'; {suggest(key, signature.parameters)}"
    placed = [p.name for p in signature.parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    if len(args) > len(placed):
        there = f"{len(placed)} argument{'s' if len(placed) > 1 else ''} by position ({', '.join(placed)})"
        return f"takes {there}, not {len(args)}; give the others by name"
    return ""


def documented(request: type[Options]) -> str:
    """Return the docstring of a request with its options before what is returned.

    Args:
        request: class of the options.
    """
    text = inspect.cleandoc(request.__doc__ or "")
    head, *tail = re.split(r"^(?=(?:Returns|Raises|Examples):$)", text, maxsplit=1, flags=re.MULTILINE)
    lines = [_ARGUMENTS, *(f"    {f.name}: {f.metadata[_DECLARED].sentence}" for f in _declared(request))]
    return "\n".join([head.rstrip(), "", *lines, "", *tail])
