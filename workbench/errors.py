"""The workbench's exceptions.

Every message is one line: what went wrong, where (file, variable, time), what to do.
The command line turns `InputError`, `FmuError` and `BuildError` into exit code 2.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

__all__ = [
    "UNSEEN",
    "BuildError",
    "CrashedError",
    "EndedError",
    "ExitedError",
    "FmuError",
    "InputError",
    "LostError",
    "Mistake",
    "OutOfMemoryError",
    "SimulationError",
    "StoppedError",
    "TimedOutError",
    "WorkbenchError",
    "article",
    "close_names",
    "is_choice",
    "one_line",
    "shortened",
    "suggest",
    "unbroken",
    "visible",
]


class WorkbenchError(Exception):
    """Base class of everything the workbench raises on purpose.

    Attributes:
        message: one line; line breaks in it become blanks.
        kind: what went wrong, in words that a program can compare: "failed", "bad input", "refused", "crashed",
            "exited", "timed out", "out of memory", "ended".
    """

    kind: ClassVar[str] = "failed"

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


@dataclass(frozen=True)
class Mistake:
    """One of the mistakes in a file.

    Attributes:
        message: what is wrong, in one line.
        file: as it was named.
        line: number of the line, from 1; None: it is not known.
    """

    message: str
    file: str
    line: int | None = None


class InputError(WorkbenchError):
    """What the user asked for cannot be done: unknown name, value out of range, bad syntax; `message` says which.

    Attributes:
        message: one line.
        mistakes: each, where it is in a file.
    """

    kind = "bad input"

    def __init__(self, message: str, mistakes: Iterable[Mistake] = ()) -> None:
        super().__init__(message)
        self.mistakes = tuple(mistakes)


class FmuError(WorkbenchError):
    """The FMU itself is at fault: archive, description, binary, instantiation; `message` says how."""

    kind = "refused"


class BuildError(WorkbenchError):
    """A Modelica source could not be turned into an FMU; `message` says where and why."""

    kind = "refused"


class SimulationError(WorkbenchError):
    """The FMU or the integration failed while running.

    Attributes:
        message: one line, the time is appended.
        time: session time at which it happened [s]; None where there is none.
        before: what was recorded or computed until then; None where nothing was.
    """

    before: object = None

    def __init__(self, message: str, *, time: float | None = None) -> None:
        super().__init__(message if time is None else f"{message} (at t = {time:.9g} s)")
        self.time = time


class LostError(SimulationError):
    """The process that ran the FMU ended before its work did; `message` says how.

    Attributes:
        message: one line.
        before: what was finished until then; None where nothing was.
    """


class CrashedError(LostError):
    """The FMU crashed, or aborted its process; `message` names the signal."""

    kind = "crashed"


class ExitedError(LostError):
    """The FMU ended its process; `message` gives the exit code."""

    kind = "exited"


class TimedOutError(LostError):
    """There was no result within the time limit; `message` gives it."""

    kind = "timed out"


class OutOfMemoryError(LostError):
    """The FMU needed more memory than it may have, or than there is; `message` gives the limit."""

    kind = "out of memory"


class StoppedError(KeyboardInterrupt):
    """A KeyboardInterrupt with what there was: Ctrl-C, or a callback that raised one, while something ran.

    Its text says how far it came; `before` holds what was finished.

    Attributes:
        before: the record of what was finished, or the rows of one run; None where nothing was.
        reached: number of parts that were finished, and of all; (0, 0): not told.
    """

    def __init__(self, before: object, reached: tuple[int, int] = (0, 0)) -> None:
        done, total = reached
        far = f"stopped after {done} of {total}" if total else "stopped"
        kept = "nothing was finished"
        if before is not None:
            kept = f"what was finished is the `before` of this error, {article(type(before).__name__)}"
        super().__init__(f"{far}; {kept}")
        self.before, self.reached = before, reached


class EndedError(SimulationError):
    """The FMU ended its run by itself, as FMI lets it: an answer with an end time, not a failure.

    Attributes:
        message: one line, the time is appended.
        time: session time at which it ended [s].
    """

    kind = "ended"


def is_choice(note: str) -> bool:
    """Return whether a note only says what `auto` took of the interfaces and solvers."""
    return (note.startswith("interface: ") and "(chosen by auto; " in note) or note == "solver: gear (chosen by auto)"


def one_line(text: str) -> str:
    """Return `text` with every run of white space, line breaks included, as one blank; nothing unseen or endless."""
    return shortened(visible(" ".join(str(text).split())))


_WORD, _LINE = 300, 4000  # no file's name is longer, and no message that somebody reads [characters]


def shortened(text: str, word: int = _WORD, line: int = _LINE) -> str:
    """Return a text in which the middle of what is too long to be shown is left out, and how much of it.

    Names and messages come from files that somebody else wrote; files of results have them in full.

    Args:
        text: in one line.
        word: longest word that is shown as it is [characters]; at least 60; of a longer one a ninth at either end.
        line: longest text.

    Examples:
        >>> from workbench.errors import shortened
        >>> print(shortened("u" * 100_000, word=90))
        uuuuuuuuuu…(99980 more)…uuuuuuuuuu
    """
    if len(text) > word:
        text = re.sub(rf"\S{{{word + 1},}}", lambda match: _without_middle(match[0], word // 9), text)
    return _without_middle(text, line // 3) if len(text) > line else text


def _without_middle(text: str, kept: int) -> str:
    return f"{text[:kept]}…({len(text) - 2 * kept} more)…{text[-kept:]}"


# Control characters but tabulator and line feed, line separators, and what changes the direction of writing.
UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    r"""Return a text in which characters that command a terminal, or change the order of writing, are spelt out.

    Names and messages come from files that somebody else wrote.

    Examples:
        >>> from workbench.errors import visible
        >>> print(visible("\x1b[31mred"))
        \x1b[31mred
    """
    return UNSEEN.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def unbroken(text: str) -> str:
    """Return the same with line breaks and tabulators spelt out as well, shortened: for one line, or one cell."""
    return shortened(visible(text).replace("\n", "\\n").replace("\t", "\\t"))


def article(noun: str) -> str:
    """Return `noun` with the indefinite article before it."""
    vowel = noun[:1].lower() in "aeiou" and not noun.startswith("UInt")  # which is spoken "you"
    return f"{'an' if vowel else 'a'} {noun}"


_SUGGESTED = 8  # names at most


def close_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the known names that one may be a misspelling of, the closest first."""
    folded = {n.casefold(): n for n in known}
    return [folded[n] for n in difflib.get_close_matches(name.casefold(), list(folded), n=3, cutoff=0.6)]


def suggest(name: str, known: Iterable[str], *, most: int = _SUGGESTED) -> str:
    """Return the tail of an "unknown name" message: close names, else the first known ones, `most` of them."""
    names = sorted(set(known))
    if not names:
        return "there are none"
    if close := close_names(name, names):
        return "did you mean " + ", ".join(close) + "?"
    more = f", … ({len(names)} in all)" if len(names) > most else ""
    return "known: " + ", ".join(names[:most]) + more
