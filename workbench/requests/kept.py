"""Results remember their origin, beside and not inside: two equal results from different FMUs stay equal."""

from __future__ import annotations

import weakref

from workbench.requests.origin import Origin

__all__ = ["origin_of", "remember"]

# By identity: results hold arrays, which have no hash. An entry goes with its result.
_ORIGINS: dict[int, tuple[weakref.ref[object], Origin]] = {}


def remember(result: object, origin: Origin) -> None:
    """Keep the origin of a result for as long as the result lives."""
    key = id(result)
    _ORIGINS[key] = (weakref.ref(result, lambda _: _ORIGINS.pop(key, None)), origin)


def origin_of(result: object) -> Origin | None:
    """Return the origin of a result, or None for one that was put together by hand."""
    kept = _ORIGINS.get(id(result))
    return kept[1] if kept is not None and kept[0]() is result else None
