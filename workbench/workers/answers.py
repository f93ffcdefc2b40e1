"""Answers of a confined worker process: only what results are made of is made of them.

Pickle calls whatever a stream names, and changes the attributes of whatever it has got by then, be it a class, a
member of an enumeration, or a data type of NumPy. So a confined worker says everything in calls of the few functions
below, with plain values as arguments; a stream that holds anything else is refused before it is read.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.errors import WorkbenchError, one_line

if TYPE_CHECKING:
    import numpy as np

__all__ = ["in_records", "records_only"]

# Instructions for plain values, containers of them, and calls; not BUILD, which sets attributes of anything.
_PLAIN = {
    "PROTO", "FRAME", "STOP", "MARK", "NONE", "NEWTRUE", "NEWFALSE", "BININT", "BININT1", "BININT2", "LONG1",
    "LONG4", "BINFLOAT", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8", "SHORT_BINBYTES", "BINBYTES", "BINBYTES8",
    "BYTEARRAY8", "EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "EMPTY_LIST", "APPEND", "APPENDS",
    "EMPTY_DICT", "SETITEM", "SETITEMS", "EMPTY_SET", "ADDITEMS", "FROZENSET", "MEMOIZE", "BINGET", "LONG_BINGET",
    "STACK_GLOBAL", "REDUCE",
}  # fmt: skip
_NUMBERS = "iufc"  # kinds of data types whose values are what their bytes say, whatever these are
_TRUTHS = "b"


def in_records(item: object) -> bytes:
    """Return an object pickled so that `records_only` takes it.

    Args:
        item: made of plain values, arrays, records and the workbench's errors.

    Raises:
        pickle.PicklingError, TypeError, …: something else is in it that cannot be pickled at all.
    """
    file = io.BytesIO()
    _Writer(file, pickle.HIGHEST_PROTOCOL).dump(item)
    return file.getvalue()


def records_only(packed: bytes) -> Any:  # noqa: ANN401 - any result
    """Return a pickled object if it is made of records.

    Args:
        packed: as `in_records` makes it.

    Raises:
        pickle.UnpicklingError: something else is in it.
        Exception: it is damaged; pickle says that in many ways.
    """
    others = {code.name for code, _, _ in pickletools.genops(packed)} - _PLAIN
    if others:
        raise pickle.UnpicklingError(f"a worker sent what is not part of a result ({', '.join(sorted(others))})")
    return _Reader(io.BytesIO(packed)).load()


class _Writer(pickle.Pickler):
    def reducer_override(self, obj: Any, /) -> Any:  # noqa: ANN401 - as `pickle` has it
        kind = type(obj)
        names = kind.__module__, kind.__qualname__
        if isinstance(obj, Enum):
            return _member, (*names, obj.name)
        if isinstance(obj, WorkbenchError):
            return _error, (*names, obj.args, vars(obj))
        if _is_record(kind):
            return _record, (*names, {**_in_slots(obj), **getattr(obj, "__dict__", {})})
        if isinstance(obj, Path):
            return _path, (str(obj),)
        if kind.__module__ == "numpy" and hasattr(obj, "dtype") and hasattr(obj, "tobytes"):
            return _array if hasattr(obj, "__setitem__") else _number, (obj.dtype.str, obj.shape, obj.tobytes())
        return NotImplemented


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str, /) -> Any:  # noqa: ANN401 - a function
        if (module, name) not in _CALLED:
            raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which is not part of a result")
        return _CALLED[module, name]


# -- what a stream may call -----------------------------------------------------------------------


def _record(module: str, name: str, values: Mapping[str, object]) -> object:
    kind = _class(module, name)
    if not _is_record(kind):
        raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which is not a record")
    made = object.__new__(kind)  # what its own way of making does was done in the worker
    _fill(made, values)
    return made


def _error(module: str, name: str, texts: tuple[str, ...], values: Mapping[str, object]) -> WorkbenchError:
    kind = _class(module, name)
    if not issubclass(kind, WorkbenchError):
        raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which is not an error of the workbench")
    made = kind.__new__(kind, *map(one_line, texts))
    _fill(made, values)
    return made


def _member(module: str, name: str, member: str) -> Enum:
    kind = _class(module, name)
    if not issubclass(kind, Enum):
        raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which has no members")
    return kind[member]


def _path(text: str) -> Path:
    return Path(text)


def _array(kind: str, shape: tuple[int, ...], content: bytes) -> np.ndarray[Any, Any]:
    import numpy as np  # noqa: PLC0415 - the process that asks may not have it yet

    dtype = np.dtype(str(kind))
    if dtype.kind == _TRUTHS:
        return np.frombuffer(content, np.uint8).reshape(shape).astype(np.bool_)
    if dtype.kind not in _NUMBERS:  # objects, and structures that could hide some
        raise pickle.UnpicklingError(f"a worker sent an array of {kind}, which are not numbers")
    made: np.ndarray[Any, Any] = np.frombuffer(content, dtype).reshape(shape).copy()
    return made


def _number(kind: str, shape: tuple[int, ...], content: bytes) -> Any:  # noqa: ANN401 - one of NumPy's numbers
    return _array(kind, shape, content)[()]


_OWN: tuple[Callable[..., object], ...] = (_record, _error, _member, _path, _array, _number)
_OTHERS: tuple[Callable[..., object], ...] = (complex, range, slice, OrderedDict, deque)
_CALLED = {(made.__module__, made.__name__): made for made in (*_OWN, *_OTHERS)}


def _class(module: str, name: str) -> type[Any]:
    """Return a class of the workbench; a module that is not there yet is loaded by an answer only if it is its own."""
    if module.startswith("workbench.") and not module.endswith("__main__") and name.isidentifier():
        found = getattr(import_module(module), name, None)
        if isinstance(found, type) and found.__module__ == module:
            return found
    raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which is not part of a result")


def _is_record(kind: type[Any]) -> bool:
    """Return whether it keeps values and does nothing else."""
    return is_dataclass(kind) and kind.__module__.startswith("workbench.") and _frozen(kind)


def _frozen(kind: type[Any]) -> bool:
    return bool(getattr(kind, "__dataclass_params__").frozen)  # noqa: B009 - not in typeshed


def _in_slots(made: Any) -> dict[str, object]:  # noqa: ANN401 - a record
    return {f.name: getattr(made, f.name) for f in fields(made) if hasattr(made, f.name)}


def _fill(made: object, values: Mapping[str, object]) -> None:
    for name, value in values.items():
        if not name.isidentifier() or name.startswith("__"):
            raise pickle.UnpicklingError(f"a worker sent a record with {name!r} in it")
        object.__setattr__(made, name, value)
