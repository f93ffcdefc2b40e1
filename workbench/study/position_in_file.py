"""Where in a study file a message belongs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from workbench.errors import InputError, suggest

__all__ = ["known", "place"]


@contextmanager
def place(where: str) -> Iterator[None]:
    """Put the table before the message of an error.

    Args:
        where: the table, such as "[analyses.response]".

    Raises:
        InputError: with the table in front.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def known(where: str, what: str, name: str, names: Mapping[str, object] | Sequence[str]) -> None:
    """Check that a name is one of those known.

    Args:
        where: the table, for messages.
        what: it names, such as "model".
        name: to look for.
        names: the known ones.

    Raises:
        InputError: it is not; with near names.
    """
    if name not in names:
        raise InputError(f"{where}: {what} '{name}' is unknown; {suggest(name, names)}")
