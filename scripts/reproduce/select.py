"""Which targets a user means: chapters, figures and names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from scripts.reproduce.targets import PublishedTarget, read_targets
from workbench.errors import InputError, suggest

__all__ = ["select"]

_FIGURE = re.compile(r"(?:fig|figure)\.?\s*-?(\d+)[a-z]?", re.IGNORECASE)
_CHAPTER = re.compile(r"(?:chapter\s*)?(\d+(?:\.\d+)*)\.?", re.IGNORECASE)
_ALONE = ("fig", "fig.", "figure", "chapter")


def select(
    words: Sequence[str] = (), targets: Mapping[str, PublishedTarget] | None = None
) -> tuple[PublishedTarget, ...]:
    """Return the targets that any of the words means, in the order of the file; all without words.

    A word is a chapter ("3", "8.3", "chapter 8"), a figure ("fig31", "figure 48"), a target ("cycle-rate"), or how the
    names of several begin ("rudder", "example-2-1").

    Args:
        words: as a user types them; "figure" and "chapter" may stand before their number as words of their own.
        targets: to choose from; None: all.

    Raises:
        InputError: a word that means nothing; near ones are suggested.
    """
    known = read_targets() if targets is None else targets
    if not words:
        return tuple(known.values())
    chosen = {target.name for word in _joined(words) for target in _meant(word, known)}
    return tuple(target for target in known.values() if target.name in chosen)


def _joined(words: Sequence[str]) -> Iterator[str]:
    """Put "figure" "48" together."""
    waiting = ""
    for word in words:
        if word.strip().lower() in _ALONE:
            waiting = f"{word.strip()} "
            continue
        yield f"{waiting}{word.strip()}"
        waiting = ""
    if waiting:
        raise InputError(f"'{waiting.strip()}': the number is missing, as in '{waiting}8'")


def _meant(word: str, known: Mapping[str, PublishedTarget]) -> list[PublishedTarget]:
    if found := [t for t in known.values() if t.name == word.lower()]:
        return found
    if figure := _FIGURE.fullmatch(word):
        return _of_figure(int(figure[1]), known)
    if chapter := _CHAPTER.fullmatch(word):
        return _of_chapter(chapter[1], known)
    if found := [t for t in known.values() if t.name.startswith(f"{word.lower()}-")]:
        return found
    raise InputError(f"'{word}' is not a chapter, figure or target; {suggest(word, _words(known))}")


def _of_figure(number: int, known: Mapping[str, PublishedTarget]) -> list[PublishedTarget]:
    if found := [t for t in known.values() if number in t.figures]:
        return found
    numbers = sorted({n for t in known.values() for n in t.figures}, key=lambda n: abs(n - number))
    raise InputError(f"figure {number}: no target belongs to it; the nearest are {_listed(sorted(numbers[:4]))}")


def _of_chapter(chapter: str, known: Mapping[str, PublishedTarget]) -> list[PublishedTarget]:
    if found := [t for t in known.values() if f"{t.chapter}.".startswith(f"{chapter}.")]:
        return found
    chapters = sorted({t.chapter for t in known.values()})
    raise InputError(f"chapter {chapter}: no target belongs to it; there are {', '.join(chapters)}")


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(str(n) for n in numbers)


def _words(known: Mapping[str, PublishedTarget]) -> set[str]:
    """Return what a word may be, for suggestions."""
    starts = {"-".join(name.split("-")[:k]) for name in known for k in range(1, 1 + name.count("-"))}
    return {*known, *starts, *(f"figure{n}" for t in known.values() for n in t.figures)}
