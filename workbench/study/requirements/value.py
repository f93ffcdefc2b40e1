"""A requirement on anything in a result, by its path."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

import workbench
from workbench.errors import InputError, suggest
from workbench.study.position_in_file import place
from workbench.study.requirements.base import Limited, NotMeasured, Result, Value

__all__ = ["STEP_ERROR", "STEP_REMEDY", "AnyValue", "check_path", "errors_at", "found_at", "numbers_at"]

STEP_ERROR = 2.0  # of a method of first order, in what half the communication step changes (Richardson)
STEP_REMEDY = "which half the communication step changes: make it shorter, by `step`"

_STEP = re.compile(r"(?P<key>[^.\[\]]+)|\[(?P<index>-?\d+|\*)\]|\[(?P<name>[^=\[\]]+)=(?P<value>[^\[\]]*)\]")
_QUOTED = re.compile(r'"(?P<key>[^"]+)"')


class AnyValue(Limited):
    """What stands at a path of the JSON of the command; of a list every item must keep the limits.

    Attributes:
        path: such as "margins.gain_margin_db" or "limit_cycles[method=shooting].amplitude".
        count: True: the number of items there is compared with the limits, instead of the items.
        absolute: True: the sign does not count.
    """

    path: str
    count: bool = False
    absolute: bool = False

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        with place(where):
            check_path(self.path)

    def values(self, result: Result) -> list[Value]:
        with place(self.name):
            pairs = found_at(result, self.path)
        if self.count:
            return [Value(value=float(_count(pairs)))]
        items = [pair for where, value in pairs for pair in flat(where, value)]
        errors = errors_at(result, self.path, len(items))
        return [self._value(where, value, error) for (where, value), error in zip(items, errors, strict=True)]

    def _value(self, where: str, value: Any, error: float) -> Value:  # noqa: ANN401
        if value is None:
            raise NotMeasured(f"there is no value at {self.path}{where}")
        if not isinstance(value, bool | int | float | str):
            raise InputError(
                f"{self.name}: {self.path} is neither a number nor a word; name a key in it, as in {self.path}.key"
            )
        if self.absolute and not isinstance(value, bool | str):
            value = abs(value)
        words = f"± {error:.2g} by the communication step" if error else ""
        return Value(
            value=value, where=", ".join(filter(None, [where.strip(), words])), error=error, remedy=STEP_REMEDY
        )


def _count(result: list[tuple[str, Any]]) -> int:
    return sum(len(value) if isinstance(value, list) else 1 for _, value in result)


def flat(where: str, value: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """Yield the items of nested lists with their places."""
    if isinstance(value, list):
        for k, item in enumerate(value):
            yield from flat(f"{where}[{k}]", item)
    else:
        yield where, value


def numbers_at(result: Result, path: str, name: str) -> list[tuple[str, float]]:
    """Return the numbers that stand at a path, each with its place.

    Args:
        result: as JSON has it.
        path: into it.
        name: for messages.

    Raises:
        InputError: nothing stands there, or no numbers.
        NotMeasured: one of them is null.
    """
    with place(name):
        pairs = found_at(result, path)
    items = [pair for where, value in pairs for pair in flat(where, value)]
    for where, value in items:
        if value is None:
            raise NotMeasured(f"there is no value at {path}{where}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{name}: {path}{where} is not a number")
    if not items:
        raise NotMeasured(f"there is no value at {path}")
    return [(where, float(value)) for where, value in items]


def errors_at(result: Result, path: str, count: int) -> list[float]:
    """Return how far off the numbers at a path may be: of signals of a co-simulation, by its communication step.

    Args:
        result: as JSON has it.
        path: into it.
        count: of the numbers.
    """
    head, _, rest = path.partition(".")
    if head != "signals" or not rest or not result.get("step_change"):
        return [0.0] * count
    try:
        pairs = found_at(result["step_change"], rest)
    except InputError:  # a forced input
        return [0.0] * count
    return [STEP_ERROR * float(change) for where, value in pairs for _, change in flat(where, value)]


# -- paths -------------------------------------------------------------------------------------


def _steps(path: str) -> Iterator[re.Match[str]]:
    """Yield the steps of a path.

    Raises:
        InputError: a step of it cannot be read.
    """
    place = 0
    while place < len(path):
        place += path[place] == "." and place > 0
        step = _QUOTED.match(path, place) or _STEP.match(path, place)
        if step is None:
            raise InputError(
                f"path '{path}': cannot be read at '{path[place:]}'; write it as a.b[0].c, a[*] or a[key=text].b"
            )
        yield step
        place = step.end()


def check_path(path: str) -> None:
    """Check how a path is written.

    Raises:
        InputError: it cannot be read.
    """
    if not list(_steps(path)):
        raise InputError("path: is empty")


def found_at(result: Mapping[str, Any], path: str) -> list[tuple[str, Any]]:
    """Return what stands at a path, each with the place in words.

    A key with a dot is written in quotes: simulated.amplitude."damper.rate". [*] stands for every item of a list, and
    [key=text] for every item whose key has that value; [key=text][0] is the first of those.

    Args:
        result: as JSON has it.
        path: see above.

    Raises:
        InputError: nothing stands there; near keys in the message.
    """
    pairs: list[tuple[str, Any]] = [("", result)]
    chosen = False
    keys: list[str] = []
    for step in _steps(path):
        groups = step.groupdict()
        if groups.get("name") is not None:
            _check_filter(
                [value for _, value in pairs if isinstance(value, list)], groups["name"], path, (result, keys)
            )
        keys += [groups["key"]] if groups.get("key") is not None else []
        if chosen and groups.get("index") not in (None, "*"):
            pairs = [_of_index(pairs, int(groups["index"]), path)]
        else:
            pairs = [pair for place, value in pairs for pair in _into(place, value, step, path)]
        chosen = groups.get("name") is not None
    return pairs


def _check_filter(lists: Sequence[list[Any]], key: str, path: str, at: tuple[Mapping[str, Any], list[str]]) -> None:
    """Refuse a key that no item can have; of lists without items the declaration of the record tells."""
    items = [item for value in lists for item in value]
    tables = [item for item in items if isinstance(item, dict)]
    known = {name for item in tables for name in item} if items else _declared(*at)
    if known is None or key in known:
        return
    if not known:
        raise InputError(f"path '{path}': items of the list are not tables, so that none has '{key}'")
    raise InputError(f"path '{path}': no item has '{key}'; {suggest(key, known)}")


def _declared(result: Mapping[str, Any], keys: Sequence[str]) -> set[str] | None:
    """Return which keys the items of a list can have that stands right in a record; None: that is not known."""
    from workbench.commands import COMMANDS, REQUESTS  # noqa: PLC0415 - seldom needed
    from workbench.requests.request import record_of  # noqa: PLC0415 - likewise

    if len(keys) != 1 or result.get("command") not in COMMANDS:
        return None
    result_names = {name for r in COMMANDS[str(result["command"])] for name in record_of(REQUESTS[r]).split(" | ")}
    kinds = [kind for name in result_names for kind in _items(getattr(workbench, name, None), keys[0])]
    if not kinds or any(is_dataclass(kind) and "derived" in vars(kind) for kind in kinds):
        return None
    return {f.metadata.get("key") or f.name for kind in kinds if is_dataclass(kind) for f in fields(kind)}


def _items(record: Any, key: str) -> Iterator[Any]:  # noqa: ANN401 - a class, or None
    """Yield the type of the items of a list in a record."""
    for declared in fields(record) if is_dataclass(record) else ():
        if key == (declared.metadata.get("key") or declared.name):
            hint = get_type_hints(record)[declared.name]
            yield from get_args(hint)[:1]


def _into(place: str, value: Any, step: re.Match[str], path: str) -> list[tuple[str, Any]]:  # noqa: ANN401
    groups = step.groupdict()
    if groups.get("key") is not None:
        return [(place, _of_key(value, groups["key"], path))]
    if not isinstance(value, list):
        raise InputError(f"path '{path}': there is no list before {step[0]}")
    if groups["index"] == "*":
        return [(f"{place}[{k}]", item) for k, item in enumerate(value)]
    if groups["index"] is not None:
        return [(place, _of_index(value, int(groups["index"]), path))]
    return [
        (place, item) for item in value if isinstance(item, dict) and str(item.get(groups["name"])) == groups["value"]
    ]


def _of_key(value: Any, key: str, path: str) -> Any:  # noqa: ANN401
    if not isinstance(value, Mapping):
        raise InputError(f"path '{path}': there is no '{key}' in {_what(value)}")
    if key not in value:
        raise InputError(f"path '{path}': there is no '{key}'; {suggest(key, map(str, value))}")
    return value[key]


def _of_index(value: list[Any], index: int, path: str) -> Any:  # noqa: ANN401
    if not -len(value) <= index < len(value):
        raise InputError(f"path '{path}': there is no [{index}] in a list of {len(value)}")
    return value[index]


def _what(value: object) -> str:
    return "a list" if isinstance(value, list) else "null" if value is None else f"'{value}'"
