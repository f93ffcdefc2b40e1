"""From the options of an analysis, as TOML gives them, to the arguments of its command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from workbench.errors import InputError
from workbench.study.commands import Command, Option
from workbench.study.description import Reference, Word

__all__ = ["arguments"]


def arguments(command: Command, options: Mapping[str, Any]) -> list[Word]:
    """Return the arguments of a command.

    A list goes to an option that can be repeated, or becomes "1,4" or "0.5:20" where the help shows such a form; a
    table becomes NAME=VALUE; {from = "analysis"} stands for the file with the result of that analysis.

    Args:
        command: whose options they are.
        options: name → value, names without dashes.

    Raises:
        InputError: no such option (near names in the message), or a value that it cannot take.
    """
    found: list[Word] = []
    named: list[Word] = []
    for name, value in options.items():
        option = command.option(name)
        (found if option.argument else named).extend(_words(name, option, value))
    return [*found, *named]


def _words(name: str, option: Option, value: Any) -> Iterator[Word]:  # noqa: ANN401 - what TOML can hold
    if option.flag:
        yield from _switch(name, option, value)
        return
    if isinstance(value, bool):
        raise InputError(f"key '{name}' takes a value ({option.metavar or 'text'}), not {str(value).lower()}")
    for word in _values(name, option, value):
        yield word if option.argument else _named(option.name, word)


def _switch(name: str, option: Option, value: object) -> Iterator[Word]:
    if not isinstance(value, bool):
        raise InputError(f"key '{name}' is true or false, not {value!r}")
    if value:
        yield f"--{option.name}"
    elif option.off:
        yield option.off


def _named(name: str, word: Word) -> Word:
    if isinstance(word, Reference):
        return Reference(analysis=word.analysis, kind=word.kind, prefix=f"--{name}={word.prefix}")
    return f"--{name}={word}"


def _values(name: str, option: Option, value: Any) -> list[Word]:  # noqa: ANN401
    if _is_reference(value):
        return [_reference(name, value)]
    if isinstance(value, Mapping):
        return _pairs(name, option, value)
    if not isinstance(value, list):
        return [_text(name, value)]
    separator = _separator(option)
    if option.multiple:
        return [_reference(name, item) if _is_reference(item) else _joined(name, item, separator) for item in value]
    if not separator:
        raise InputError(f"key '{name}' takes one value, not a list")
    return [separator.join(_text(name, item) for item in value)]


def _pairs(name: str, option: Option, values: Mapping[str, Any]) -> list[Word]:
    """Read a table as NAME=VALUE, several times or separated by commas as the option takes it."""
    if "=" not in option.metavar:
        raise InputError(f"key '{name}' is not a table; it takes {option.metavar or 'one value'}")
    # "NAME=A,B,.." is a list for each name; in "KEY=VALUE,.." the comma parts the pairs, and a list goes with colons.
    inner = "," if option.multiple and "," in option.metavar.partition("=")[2] else ":"
    pairs: list[Word] = []
    for key, value in values.items():
        if _is_reference(value):
            found = _reference(name, value)
            pairs.append(Reference(analysis=found.analysis, kind=found.kind, prefix=f"{key}="))
        else:
            pairs.append(f"{key}={_joined(name, value, inner)}")
    if option.multiple:
        return pairs
    return [",".join(_text(name, pair) for pair in pairs)]


def _joined(name: str, value: object, separator: str) -> str:
    if isinstance(value, list) and separator:
        return separator.join(_text(name, v) for v in value)
    return _text(name, value)


def _separator(option: Option) -> str:
    """Return what stands between the values of the option's help: "A,.." or "LO:HI"."""
    if "," in option.metavar:
        return ","
    return ":" if ":" in option.metavar else ""


def _is_reference(value: object) -> bool:
    return isinstance(value, Mapping) and "from" in value


def _reference(name: str, value: Mapping[str, Any]) -> Reference:
    unknown = set(value) - {"from", "as"}
    if unknown:
        raise InputError(f"key '{name}': '{min(unknown)}' is unknown beside 'from'; known: as, from")
    if not all(isinstance(v, str) for v in value.values()):
        raise InputError(f"key '{name}': from and as must be strings")
    return Reference(analysis=value["from"], kind=value.get("as", "json"))


def _text(name: str, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float | str):
        return str(value)
    raise InputError(f"key '{name}': {value!r} is neither a number nor a string")
