"""Results remember their origin, beside and not inside: two equal results from different FMUs stay equal."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from workbench.origin.facts import Origin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Reportable", "origin_of", "remember", "with_origin"]

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

# By identity: results hold arrays, which have no hash. An entry goes with its result.
_ORIGINS: dict[int, tuple[weakref.ref[object], Origin]] = {}


class Reportable:
    """A result that can be drawn and written as a page; `workbench.report.results` has the tables that say how."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):  # a dataclass leaves it as it is then
            cls.__repr__ = Reportable.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return one line: what it is, and its page's first sentence."""
        from workbench.report.results import line_of  # noqa: PLC0415

        return line_of(self)

    def _repr_html_(self) -> str:
        """Return the page for a notebook."""
        from workbench.report.results import notebook_of  # noqa: PLC0415  pages need pictures, and those matplotlib

        return notebook_of(self)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw the result.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.

        Raises:
            InputError: unknown suffix, file cannot be written.
        """
        from workbench.report.results import picture_of  # noqa: PLC0415  matplotlib is slow

        return picture_of(self, path)

    def report(self, path: str | Path) -> None:
        """Write a page that stands alone: what was asked, on which FMU, pictures, tables, versions, the data as JSON.

        Args:
            path: of the page, .html.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        from workbench.report.results import write_report  # noqa: PLC0415  pages need pictures, and those matplotlib

        write_report(self, path)


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
