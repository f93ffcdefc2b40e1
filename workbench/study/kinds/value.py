"""A requirement on anything in a result, by its path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from workbench.errors import InputError
from workbench.study.kinds.base import Limited, NotMeasured, Result, Value
from workbench.study.kinds.paths import check_path, found_at
from workbench.study.place import place

__all__ = ["AnyValue", "numbers_at"]


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
            found = found_at(result, self.path)
        if self.count:
            return [Value(value=float(_count(found)))]
        items = [pair for where, value in found for pair in flat(where, value)]
        return [self._value(where, value) for where, value in items]

    def _value(self, where: str, value: Any) -> Value:  # noqa: ANN401
        if value is None:
            raise NotMeasured(f"there is no value at {self.path}{where}")
        if not isinstance(value, bool | int | float | str):
            raise InputError(
                f"{self.name}: {self.path} is neither a number nor a word; name a key in it, as in {self.path}.key"
            )
        if self.absolute and not isinstance(value, bool | str):
            value = abs(value)
        return Value(value=value, where=where.strip())


def _count(found: list[tuple[str, Any]]) -> int:
    return sum(len(value) if isinstance(value, list) else 1 for _, value in found)


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
        found = found_at(result, path)
    items = [pair for where, value in found for pair in flat(where, value)]
    for where, value in items:
        if value is None:
            raise NotMeasured(f"there is no value at {path}{where}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{name}: {path}{where} is not a number")
    if not items:
        raise NotMeasured(f"there is no value at {path}")
    return [(where, float(value)) for where, value in items]
