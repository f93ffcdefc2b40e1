"""Functions whose results remember their origin."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from workbench.requests.kept import remember

__all__ = ["with_origin"]

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


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
            from workbench.requests.call import origin_of_call  # noqa: PLC0415  it knows models

            origin = origin_of_call(function, args, kwargs, seconds=time.monotonic() - begin, result=result)
            remember(result, origin)
            for part in parts:
                if (inner := getattr(result, part)) is not None:
                    remember(inner, origin)
            return result

        return call

    return decorate
