"""Loops whose parameters are dragged: linearised once, and what becomes of them at other values in an instant."""

from __future__ import annotations

import tempfile
import threading
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.core.records.parsing import toml_value
from workbench.errors import InputError
from workbench.fmi.bundled import bundled_path, is_bundled_system
from workbench.ui.diagram import at_home, edited
from workbench.ui.linearised import LinearisedLoop, linearised
from workbench.ui.loop import loop_told
from workbench.ui.root import ServedFolder

__all__ = ["GAIN", "Tuning"]

GAIN = "loop gain"  # a factor on L, beside the parameters of the blocks
_KEPT = 12  # loops that are kept linearised


class Tuning:
    """The loops of one server that are tuned.

    Args:
        root: the folder from which systems are opened.
    """

    def __init__(self, root: ServedFolder) -> None:
        self._root = root
        self._loops: OrderedDict[tuple[Any, ...], LinearisedLoop] = OrderedDict()
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._drafts = 0
        self._lock = threading.Lock()  # one at a time: a slider sends the next value when it has the last answer

    def begin(self, name: str, where: str) -> dict[str, Any]:
        """Linearise a loop, and return its parameters, ready for JSON: `parameters` and `why`, see `LinearisedLoop`.

        Args:
            name: of the system, as the browser names it.
            where: see `loop`.

        Raises:
            InputError, SimulationError: see `loop`.
            LostError: an FMU crashed.
            NotHereError: it is not in the folder.
        """
        with self._lock:
            for key in [key for key in self._loops if key[0] == name]:  # the file may have been written
                del self._loops[key]
            loop = self._loop(name, where, {})
        return {"parameters": [{**p, "quick": loop.quick(p["name"])} for p in loop.parameters], "why": loop.why}

    def at(self, name: str, where: str, values: Mapping[str, float], *, locus: bool = False) -> dict[str, Any]:
        """Return what a loop is with other parameters, see `loop_told`.

        Args:
            name: of the system.
            where: see `loop`.
            values: parameter or `GAIN` → value.
            locus: whether to add the root locus.

        Raises:
            InputError: a value that the parameter cannot have, and as `begin`.
        """
        from workbench.core.machine.blas import one_thread  # noqa: PLC0415 - as above

        gain = values.get(GAIN, 1.0)
        if not gain > 0.0:
            raise InputError(f"{GAIN}: {gain:g} is not positive")
        with self._lock, one_thread():
            own = {n: v for n, v in values.items() if n != GAIN}
            first = self._loop(name, where, {})
            quick = {n: v for n, v in own.items() if first.quick(n)}
            slow = {n: v for n, v in own.items() if n not in quick}
            transfer, margins = self._loop(name, where, slow).at(quick, gain)
            return loop_told(transfer, margins, locus=locus)

    def _loop(self, name: str, where: str, values: Mapping[str, float]) -> LinearisedLoop:
        key = (name, where, *sorted(values.items()))
        if key not in self._loops:
            path = str(self.draft(name, values)) if values else self._root.find(name)
            self._loops[key] = linearised(path, where)
        self._loops.move_to_end(key)
        while len(self._loops) > _KEPT:
            self._loops.popitem(last=False)
        return self._loops[key]

    def draft(self, name: str, values: Mapping[str, float]) -> Path:
        """Write a system with other parameters to where only this server looks, and return its path.

        Args:
            name: of the system.
            values: parameter → value.

        Raises:
            InputError, NotHereError: it cannot be read, or its parts are not in the folder.
        """
        self._root.find(name)  # its parts, too, are in the folder
        text = self._root.text_of(name)
        for parameter, value in values.items():
            text = edited(text, "set", parameter, toml_value(value))
        folder = bundled_path(name).parent if is_bundled_system(name) else self._root.path(name).parent
        if self._scratch is None:
            self._scratch = tempfile.TemporaryDirectory(prefix="workbench-tune-")
        self._drafts += 1
        path = Path(self._scratch.name) / str(self._drafts % _KEPT) / (Path(name.rpartition(":")[2]).stem + ".toml")
        path.parent.mkdir(exist_ok=True)
        path.write_text(at_home(text, folder), encoding="utf-8")
        return path
