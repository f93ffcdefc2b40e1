"""Results remember their origin, beside and not inside: two equal results from different FMUs stay equal."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from workbench.origin.facts import Origin

__all__ = ["origin_of", "remember", "with_origin"]

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

# By identity: results hold arrays, which have no hash. An entry goes with its result.
_ORIGINS: dict[int, tuple[weakref.ref[object], Origin]] = {}


def remember(result: object, origin: Origin) -> None:
    """Keep the origin of a result for as long as the result lives."""
    key = id(result)
    _ORIGINS[key] = (weakref.ref(result, lambda _: _ORIGINS.pop(key, None)), origin)


def origin_of(result: object) -> Origin | None:
    """Return the origin of a result, or None for one that was put together by hand."""
    found = _ORIGINS.get(id(result))
    return found[1] if found is not None and found[0]() is result else None


def with_origin(
    *parts: str,
) -> Callable[[Callable[_Arguments, _Result]], Callable[_Arguments, _Result]]:
    """Let the results of a function remember how they were made: its call, models and files among the arguments, time.

    Args:
        parts: attributes of the result that are results themselves.
    """

    def decorate(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
        @wraps(function)
        def call(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
            begin = time.monotonic()
            result = function(*args, **kwargs)
            from workbench.origin.call import origin_of_call  # noqa: PLC0415  it knows models

            origin = origin_of_call(function, args, kwargs, seconds=time.monotonic() - begin)
            remember(result, origin)
            for part in parts:
                if (inner := getattr(result, part)) is not None:
                    remember(inner, origin)
            return result

        return call

    return decorate
