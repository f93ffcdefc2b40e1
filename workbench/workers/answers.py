"""Answers of a confined worker process: only what results are made of is made of them."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from dataclasses import is_dataclass
from enum import Enum
from typing import Any

from workbench.errors import WorkbenchError

__all__ = ["records_only"]

# What results have in them besides the workbench's own records: module → names.
_KNOWN: Mapping[str, frozenset[str]] = {
    "builtins": frozenset({"bytearray", "complex", "frozenset", "range", "set", "slice"}),
    "collections": frozenset({"OrderedDict", "deque"}),
    "pathlib": frozenset({"Path", "PosixPath", "PurePosixPath"}),
    "pathlib._local": frozenset({"Path", "PosixPath", "PurePosixPath"}),
    "numpy": frozenset({"dtype", "ndarray"}),
    "numpy.core.multiarray": frozenset({"_reconstruct", "scalar"}),
    "numpy._core.multiarray": frozenset({"_reconstruct", "scalar"}),
    "numpy.core.numeric": frozenset({"_frombuffer"}),
    "numpy._core.numeric": frozenset({"_frombuffer"}),
    "control.statesp": frozenset({"StateSpace"}),
}


class _Reader(pickle.Unpickler):
    """Pickle calls whatever a stream names; this one knows records, arrays and the workbench's errors only."""

    def find_class(self, module: str, name: str, /) -> Any:  # noqa: ANN401 - a class
        if name in _KNOWN.get(module, ()):
            return super().find_class(module, name)
        # A module that is not there yet is loaded by its worker's answer only if it is the workbench's.
        if module.startswith("workbench.") and not module.endswith("__main__") and name.isidentifier():
            found = super().find_class(module, name)
            if getattr(found, "__module__", "") == module and _is_record(found):
                return found
        raise pickle.UnpicklingError(f"a worker sent {module}.{name}, which is no part of a result")


def _is_record(found: object) -> bool:
    """Return whether making one does nothing but keep values."""
    if not isinstance(found, type):
        return False
    frozen = is_dataclass(found) and getattr(found, "__dataclass_params__").frozen  # noqa: B009 - not in typeshed
    return frozen or issubclass(found, Enum | WorkbenchError)


def records_only(packed: bytes) -> Any:  # noqa: ANN401 - any result
    """Return a pickled object if it is made of records.

    Args:
        packed: as `pickle.dumps` makes it.

    Raises:
        pickle.UnpicklingError: something else is in it.
    """
    return _Reader(io.BytesIO(packed)).load()
