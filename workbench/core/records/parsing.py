"""JSON and TOML that somebody else wrote: read, or refused with one reason; and values as TOML has them."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

__all__ = ["from_json", "from_toml", "toml_key", "toml_value"]

_DEEPEST = 100  # whatever goes through it later does so by recursion
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_LARGEST = int(sys.float_info.max)


def from_json(text: str) -> Any:  # noqa: ANN401 - whatever JSON holds
    """Return what a text holds.

    Args:
        text: JSON.

    Raises:
        ValueError: it is not JSON, nested too deeply, or has a number beyond all that can be calculated with.
    """
    with _told():
        return _sound(json.loads(text))


def from_toml(text: str) -> dict[str, Any]:
    """Return what a text holds.

    Args:
        text: TOML.

    Raises:
        ValueError: it is not TOML, nested too deeply, or has a number beyond all that can be calculated with.
    """
    if _MANY_DOTS.search(text):  # reading these takes time with the square of their number
        raise ValueError(_TOO_DEEP)
    import tomllib  # noqa: PLC0415 - most commands read none

    with _told():
        result: dict[str, Any] = _sound(tomllib.loads(text))
    return result


_TOO_DEEP = f"it is nested more than {_DEEPEST} deep"

# A key of more parts, in a table's heading or before a value.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_MANY_DOTS = re.compile(rf"(?<![\w.-]){_PART}(?:\.[ \t]*+{_PART}){{{_DEEPEST}}}")


@contextmanager
def _told() -> Iterator[None]:
    """Say in our words what Python's readers cannot take."""
    try:
        yield
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except ValueError as error:
        if "int_max_str_digits" in str(error):  # there is no other sign of it
            raise ValueError(f"a number has more than {sys.get_int_max_str_digits()} digits") from None
        raise


def _sound(whole: Any) -> Any:  # noqa: ANN401
    """Return it unchanged; by levels, so that no depth is too deep to be found."""
    level = [whole]
    for _ in range(_DEEPEST):
        for item in level:
            if isinstance(item, int) and abs(item) > _LARGEST:
                raise ValueError(f"the number {str(item)[:12]}… of {len(str(abs(item)))} digits is too large")
        inner = [item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list)]
        level = [item for items in inner for item in items]
        if not level:
            return whole
    raise ValueError(_TOO_DEEP)


def toml_key(name: str) -> str:
    """Return a key as TOML has it, quoted where it must be.

    Args:
        name: any text.
    """
    return name if _BARE.fullmatch(name) else toml_value(name)


def toml_value(value: object) -> str:
    """Return a value as TOML has it, in one line.

    Args:
        value: a text, number, truth value, list of such, or a table.
    """
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{toml_key(str(name))} = {toml_value(one)}' for name, one in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    # A string of JSON is one of TOML, but for one character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)
