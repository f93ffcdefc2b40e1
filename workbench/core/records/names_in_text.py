"""Names as people and tools write them: lists of variables, `a,y[1,2]`, units in brackets, `[m3]`, misspelt ones."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from workbench.errors import InputError, article, close_names, suggest

__all__ = ["OUR_TOOL", "check_names", "plain_unit", "split_names", "unit_of_ratio"]

OUR_TOOL = "FMI workbench"  # by which an FMU names itself that was built here

_CLOSING = {"[": "]", "(": ")", "{": "}"}
_QUOTES = "\"'"
_LISTED = 8  # names in a message


def split_names(text: str) -> list[str]:
    """Return the names in "a,b": commas inside brackets and quotes belong to a name; blanks around it do not.

    A name in quotes stands without them.

    Args:
        text: as it was given; empty items are left out.

    Raises:
        InputError: a bracket or quote is not closed.
    """
    return [_bare(part) for part in _parts(text) if part]


def check_names(
    names: Iterable[str],
    known: Iterable[str],
    *,
    kinds: Sequence[str],
    what: str = "",
    model: str = "the model",
    others: Mapping[str, str] | None = None,
    first: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> None:
    """Refuse names that a model does not have; of a `Model`, `model.names.check_variables` does it.

    Args:
        names: as they were given.
        known: those that are accepted.
        kinds: what these are: ("output", "state").
        what: the option that has the names; empty: the message does not say it.
        model: name of the model.
        others: names that the model has besides → what they are.
        first: what some of those accepted are → these, which a message lists where none is near; empty: all of them.

    Raises:
        InputError: one is not accepted; the message has near ones, or says what it is.
    """
    known = known if isinstance(known, Collection) else list(known)
    inside = known if isinstance(known, Mapping | set | frozenset) else set(known)
    for name in [name for name in names if name not in inside]:
        accepted = list(known)
        where = f"{what}: " if what else ""
        if others and name in others:
            there = f"its {_series([f'{k}s' for k in kinds], 'and')} are: {_some(accepted) or 'none'}"
            raise InputError(f"{where}'{name}' of {model} is {article(others[name])}; {there}")
        shown = "; ".join(f"its {kind} are: {_some(of_it)}" for kind, of_it in first.items() if of_it)
        hint = shown if shown and not close_names(name, accepted) else suggest(name, accepted)
        raise InputError(f"{where}{model} has no {_series(kinds, 'or')} '{name}'; {hint}")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f", … ({len(names)} in all)" if len(names) > _LISTED else "")


def _series(words: Sequence[str], last: str) -> str:
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def unit_of_ratio(above: str | None, below: str | None) -> str | None:
    """Return the unit of the ratio of two quantities; None where they have the same.

    Args:
        above: unit of the one that is divided; None: it has none.
        below: unit of the other.
    """
    return None if above == below else f"{above or '1'}/{below or '1'}"


def plain_unit(name: str) -> str:
    """Return a unit without the brackets that some tools write around it: "m3" for "[m3]"."""
    inner = name.strip()
    return inner[1:-1].strip() if inner.startswith("[") and inner.endswith("]") else name


def _parts(text: str) -> Iterator[str]:
    waiting: list[str] = []  # what must close before a comma counts
    begin = 0
    for i, character in enumerate(text):
        if waiting and character == waiting[-1]:
            waiting.pop()
        elif waiting and waiting[-1] in _QUOTES:
            continue
        elif character in _CLOSING:
            waiting.append(_CLOSING[character])
        elif character in _QUOTES and not text[begin:i].strip():
            waiting.append(character)
        elif character == "," and not waiting:
            yield text[begin:i].strip()
            begin = i + 1
    if waiting:
        raise InputError(f"'{text}': {waiting[-1]} is missing")
    yield text[begin:].strip()


def _bare(name: str) -> str:
    quoted = len(name) > 1 and name[0] in _QUOTES and name[-1] == name[0]
    return name[1:-1] if quoted else name
