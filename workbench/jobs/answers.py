"""Answers of a confined worker process: only what results are made of is made of them, and no more than was sent.

The FMU shares the worker's memory, so that it can say there whatever the worker can. So what a worker says is text in
JSON and, after it, the numbers of arrays as they lie in memory. A list is a list; all else is an object of one entry,
what it is and of what. What is made needs memory in proportion to what arrived, and the sum of a task has a limit:
nothing in it stands for more than itself.
"""

from __future__ import annotations

import json
import math
import pickle
import struct
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.plug_ins import packages
from workbench.core.records.record import fields_fit
from workbench.errors import LostError, WorkbenchError, one_line

if TYPE_CHECKING:
    import numpy as np

__all__ = ["MOST", "Records", "in_records"]

# What the answers of one task may take in memory [byte].
MOST = 2 << 30

# A byte of JSON makes at most so many: "[]," an empty list and its place in another.
_OF_TEXT = 24

_TEXT = struct.Struct("!Q")  # length of the text
_NUMBERS = "iufc"  # kinds of data types whose values are what their bytes say, whatever these are
_TRUTHS = "b"
_PLAIN = {type(None), bool, int, float, str}
_GIVEN = {"path": str, "again": int}  # all others: a list
_AXES = 64  # NumPy's arrays have no more

# What is sent as the list of its parts.
_APART: dict[type, Callable[[Any], list[Any]]] = {
    tuple: list,
    set: list,
    frozenset: list,
    dict: lambda whole: [list(whole), list(whole.values())],
    complex: lambda whole: [whole.real, whole.imag],
    slice: lambda whole: [whole.start, whole.stop, whole.step],
}


def in_records(item: object) -> bytes:
    """Return an object packed so that `Records` takes it.

    Args:
        item: made of plain values, arrays, records and the workbench's errors.

    Raises:
        TypeError: something else is in it.
        LostError: it is too large.
    """
    writer = _AnswerWriter()
    text = json.dumps(writer.tree(item), separators=(",", ":")).encode("ascii")
    if _OF_TEXT * len(text) + writer.size > MOST:
        raise LostError(
            f"a result larger than {MOST >> 30} GiB cannot come from a confined process; ask for less at a time"
        )
    return b"".join((_TEXT.pack(len(text)), text, *writer.pieces))


class Records:
    """Makes objects of the answers of one worker, as many as its memory allows.

    Obligations:
      1. Nothing but plain values, arrays, records and the workbench's errors is made, and no code is run for it.
      2. What is made between two calls of `renew` takes at most `MOST` bytes or so.
    """

    def __init__(self) -> None:
        self._left = MOST

    def renew(self) -> None:
        """Begin to count anew, for another task."""
        self._left = MOST

    def __call__(self, packed: bytes | bytearray) -> Any:  # noqa: ANN401 - any result
        """Return the object that was packed.

        Args:
            packed: as `in_records` makes it.

        Raises:
            pickle.UnpicklingError: something else is in it, or it is too large.
            Exception: it is damaged, in one of many ways.
        """
        (length,) = _TEXT.unpack_from(packed)
        self._spend(_OF_TEXT * length)
        text, content = packed[_TEXT.size : _TEXT.size + length], memoryview(packed)[_TEXT.size + length :]
        return json.loads(text.decode("ascii"), object_pairs_hook=_AnswerMaker(content, self._spend).made)

    def _spend(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise pickle.UnpicklingError(f"a confined worker sent more than {MOST >> 30} GiB")


class _AnswerWriter:
    """What is being packed.

    Attributes:
        pieces: contents that come after the text.
        size: of them [byte].
    """

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self.size = 0
        self._known: dict[int, tuple[object, int]] = {}  # arrays: what is one here is one there

    def tree(self, item: Any) -> Any:  # noqa: ANN401 - any result
        """Return it as JSON has it."""
        kind = type(item)
        if kind in _PLAIN:
            return item
        if kind is list:
            return item if set(map(type, item)) <= _PLAIN else [self.tree(part) for part in item]
        if kind in _APART:
            return {kind.__name__: self.tree(_APART[kind](item))}
        return self._object(item, [kind.__module__, kind.__qualname__])

    def _object(self, item: Any, name: list[str]) -> dict[str, Any]:  # noqa: ANN401
        if isinstance(item, bytes | bytearray):
            return {"bytes": self._put(bytes(item))}
        if isinstance(item, Enum):
            return {"member": [*name, item.name]}
        if isinstance(item, WorkbenchError):
            return {"error": [*name, self.tree(list(map(str, item.args))), *self._named(vars(item))]}
        if _is_record(type(item)):
            return {"record": [*name, *self._named({**_in_slots(item), **getattr(item, "__dict__", {})})]}
        if isinstance(item, Path):
            return {"path": str(item)}
        if name[0] == "numpy" and hasattr(item, "dtype") and item.dtype.kind in _NUMBERS + _TRUTHS:
            return self._array(item) if hasattr(item, "__setitem__") else {"number": self._laid_out(item)}
        raise TypeError(f"{'.'.join(name)} cannot be part of a confined worker's answer")

    def _named(self, values: Mapping[str, object]) -> list[Any]:
        return [list(values), self.tree(list(values.values()))]

    def _array(self, item: Any) -> dict[str, Any]:  # noqa: ANN401
        if id(item) in self._known:
            return {"again": self._known[id(item)][1]}
        self._known[id(item)] = item, len(self._known)
        return {"array": self._laid_out(item)}

    def _laid_out(self, item: Any) -> list[Any]:  # noqa: ANN401
        return [item.dtype.str, list(item.shape), self._put(item.tobytes())[0]]

    def _put(self, piece: bytes) -> list[int]:
        self.pieces.append(piece)
        self.size += len(piece)
        return [self.size - len(piece), len(piece)]


class _AnswerMaker:
    """What is being made.

    Args:
        content: what comes after the text.
        spend: is told the size of what is made beside the text [byte].
    """

    def __init__(self, content: memoryview, spend: Callable[[int], None]) -> None:
        self._content, self._spend = content, spend
        self._arrays: list[np.ndarray[Any, Any]] = []
        self._kinds: dict[str, Callable[[Any], object]] = {
            "tuple": tuple,
            "set": set,
            "frozenset": frozenset,
            "dict": lambda given: dict(zip(*_lists(given, 2), strict=True)),
            "bytes": lambda given: bytes(self._piece(*given)),
            "complex": lambda given: complex(*given),
            "slice": lambda given: slice(*given),
            "path": Path,
            "member": lambda given: _member(*given),
            "record": lambda given: _record(*given),
            "error": lambda given: _error(*given),
            "array": self._array,
            "number": lambda given: self._values(*given)[()],
            "again": self._again,
        }

    def made(self, pairs: list[tuple[str, Any]]) -> object:
        """Return what an object of the text stands for; its parts are made already."""
        ((kind, given),) = pairs
        if kind not in self._kinds or type(given) is not _GIVEN.get(kind, list):
            raise pickle.UnpicklingError(f"a worker sent {kind!r}, which is not part of a result")
        return self._kinds[kind](given)

    def _piece(self, at: int, size: int) -> memoryview:
        if at < 0 or not 0 <= size <= len(self._content) - at:
            raise pickle.UnpicklingError("a worker sent numbers that are not there")
        self._spend(size)
        return self._content[at : at + size]

    def _values(self, kind: str, shape: list[int], at: int) -> np.ndarray[Any, Any]:
        import numpy as np  # noqa: PLC0415 - the process that asks may not have it yet

        dtype = np.dtype(str(kind))
        if dtype.kind not in _NUMBERS + _TRUTHS:  # objects, and structures that could hide some
            raise pickle.UnpicklingError(f"a worker sent an array of {kind}, which are not numbers")
        if len(shape) > _AXES or min(shape, default=0) < 0:
            raise pickle.UnpicklingError("a worker sent an array whose shape is none")
        piece = self._piece(at, math.prod(shape) * dtype.itemsize)
        if dtype.kind == _TRUTHS:
            return np.frombuffer(piece, np.uint8).reshape(shape).astype(np.bool_)
        made: np.ndarray[Any, Any] = np.frombuffer(piece, dtype).reshape(shape).copy()
        return made

    def _array(self, given: list[Any]) -> object:
        self._arrays.append(self._values(*given))
        return self._arrays[-1]

    def _again(self, number: int) -> object:
        self._spend(self._arrays[number].nbytes)  # as whoever takes it apart meets it again
        return self._arrays[number]


# -- what stands for an object of the workbench --------------------------------------------------


def _record(module: str, name: str, names: list[str], values: list[object]) -> object:
    kind = _class(module, name, _is_record, "is not a record")
    made = object.__new__(kind)  # what its own way of making does was done in the worker
    _fill(made, names, values)
    if wrong := fields_fit(made):
        raise pickle.UnpicklingError(f"a worker sent {module}.{name}, whose {wrong} is not what it should be")
    return made


def _error(module: str, name: str, texts: list[str], names: list[str], values: list[object]) -> WorkbenchError:
    kind: type[WorkbenchError] = _class(
        module, name, lambda kind: issubclass(kind, WorkbenchError), "is not an error of the workbench"
    )
    made = kind.__new__(kind, *map(one_line, texts))
    _fill(made, names, values)
    return made


def _member(module: str, name: str, member: str) -> Enum:
    kind: type[Enum] = _class(module, name, lambda kind: issubclass(kind, Enum), "has no members")
    return kind[member]


def _lists(given: object, count: int) -> list[list[object]]:
    if not (isinstance(given, list) and len(given) == count and all(isinstance(part, list) for part in given)):
        raise pickle.UnpicklingError("a worker sent a dictionary that is none")
    return given


def _class(module: str, name: str, fits: Callable[[type[Any]], bool], otherwise: str) -> type[Any]:
    """Return a class of the workbench or a plug-in; an answer loads only their modules where they are not there yet."""
    wrong = "is not part of a result"
    if _known(module) and not module.endswith("__main__") and name.isidentifier():
        result = getattr(import_module(module), name, None)
        if isinstance(result, type) and result.__module__ == module:
            if fits(result):
                return result
            wrong = otherwise
    raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which {wrong}")


def _is_record(kind: type[Any]) -> bool:
    """Return whether it keeps values and does nothing else."""
    return is_dataclass(kind) and _known(kind.__module__) and _frozen(kind)


def _known(module: str) -> bool:
    """Return whether a module is part of the workbench or of a package with plug-ins."""
    return module.startswith("workbench.") or module.partition(".")[0] in packages()


def _frozen(kind: type[Any]) -> bool:
    return bool(getattr(kind, "__dataclass_params__").frozen)  # noqa: B009 - not in typeshed


def _in_slots(made: Any) -> dict[str, object]:  # noqa: ANN401 - a record
    return {f.name: getattr(made, f.name) for f in fields(made) if hasattr(made, f.name)}


def _fill(made: object, names: list[str], values: list[object]) -> None:
    for name, value in zip(names, values, strict=True):
        if not name.isidentifier() or name.startswith("__"):
            raise pickle.UnpicklingError(f"a worker sent a record with {name!r} in it")
        object.__setattr__(made, name, value)
