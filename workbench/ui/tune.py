"""Loops whose parameters are dragged: linearised once, and what becomes of them at other values in an instant."""

from __future__ import annotations

import math
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.option import Option, options_of
from workbench.core.records.parsing import toml_value
from workbench.errors import InputError, SimulationError
from workbench.fmi.bundled import bundled_path, is_bundled_system
from workbench.model.loading import Loading
from workbench.ui.diagram import at_home, edited
from workbench.ui.loop import loop_told, margins_at
from workbench.ui.root import ServedFolder

# As in `curves`: the page is there before numerics are.
if TYPE_CHECKING:
    from workbench.core.values.linear import LinearPart
    from workbench.core.values.margins import Margins
    from workbench.loops.loop.result import LinearLoop
    from workbench.loops.loop.tunable import TunableLoop
    from workbench.system.description import Component, SystemDescription

__all__ = ["GAIN", "Tuning"]

GAIN = "loop gain"  # a factor on L, beside the parameters of the blocks
_KEPT = 12  # loops that are kept linearised


@dataclass(frozen=True, eq=False)
class _LinearisedLoop:
    """A loop that is linearised.

    Attributes:
        system: as it is written down.
        tunable: with its linear blocks taken out; None: it is linearised as a whole, `whole` is that.
        whole: linear model of the loop as it is; None: its blocks are taken out.
        why: why its blocks cannot be taken out; empty: they are.
    """

    system: SystemDescription
    tunable: TunableLoop | None
    whole: LinearLoop | None = None
    why: str = ""

    def at(self, values: Mapping[str, float], gain: float) -> tuple[LinearPart, Margins]:
        """Return L and its margins with other parameters of linear blocks and a factor."""
        from workbench.loops.loop.margins import margins_of  # noqa: PLC0415 - as above

        if self.tunable is None:
            assert self.whole is not None  # noqa: S101 - one of the two
            return self.whole.transfer.scaled(gain), margins_at(self.whole, gain)
        transfer = self.tunable.loop(values).scaled(gain)
        return transfer, margins_of(transfer, peaks=False)

    def quick(self, name: str) -> bool:
        """Whether another value of a parameter needs no other linearisation."""
        return self.tunable is not None and name.rpartition(".")[0] in self.tunable.blocks


class Tuning:
    """The loops of one server that are tuned.

    Args:
        root: the folder from which systems are opened.
    """

    def __init__(self, root: ServedFolder) -> None:
        self._root = root
        self._loops: OrderedDict[tuple[Any, ...], _LinearisedLoop] = OrderedDict()
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._drafts = 0
        self._lock = threading.Lock()  # one at a time: a slider sends the next value when it has the last answer

    def begin(self, name: str, where: str) -> dict[str, Any]:
        """Linearise a loop, and return its parameters, ready for JSON: `parameters` and `why`, see `_LinearisedLoop`.

        Args:
            name: of the system, as the browser names it.
            where: see `loop`.

        Raises:
            InputError, SimulationError: see `loop`.
            NotHereError: it is not in the folder.
        """
        with self._lock:
            loop = self._loop(name, where, {}, fresh=True)
        parameters = [p for component in loop.system.components for p in _parameters(component)]
        return {"parameters": [{**p, "quick": loop.quick(p["name"])} for p in parameters], "why": loop.why}

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

    def _loop(self, name: str, where: str, values: Mapping[str, float], *, fresh: bool = False) -> _LinearisedLoop:
        key = (name, where, *sorted(values.items()))
        if fresh or key not in self._loops:
            self._loops[key] = self._linearised(name, where, values)
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

    def _linearised(self, name: str, where: str, values: Mapping[str, float]) -> _LinearisedLoop:
        from workbench.jobs.job import Job  # noqa: PLC0415
        from workbench.loops.loop.request import Loop  # noqa: PLC0415 - as above
        from workbench.loops.loop.run import run  # noqa: PLC0415
        from workbench.loops.loop.tunable import tunable_loop  # noqa: PLC0415
        from workbench.loops.opened_system import system_of  # noqa: PLC0415
        from workbench.system.load import open_files  # noqa: PLC0415

        path = str(self.draft(name, values)) if values else self._root.find(name)
        with open_files([path], Loading()) as models:
            model = next(iter(models.values()))
            try:
                return _LinearisedLoop(system_of(model, "tuning needs"), tunable_loop(model, where, in_process=True))
            except (InputError, SimulationError) as error:
                whole = run(model, Loop(open=where), Job()).linear
                if whole is None:
                    raise
                return _LinearisedLoop(system_of(model, "tuning needs"), None, whole, str(error))


def _parameters(component: Component) -> list[dict[str, Any]]:
    """Return the numbers that a component can be given, with the range that each may have."""
    from workbench.system.description import BlockComponent, GainComponent  # noqa: PLC0415 - as above

    own: list[tuple[str, Any, Option | None]]
    if isinstance(component, GainComponent):
        own = [("gain", component.gain, None)]
    elif isinstance(component, BlockComponent):
        block = component.block
        own = [(d.name, getattr(block, d.name), d.option) for d in options_of(type(block))]
    else:
        return []
    return [
        {
            "name": f"{component.name}.{name}", "component": component.name, "value": value,
            "kind": getattr(component, "kind", "gain"), "unit": "" if option is None else option.unit,
            "least": None if option is None else 0.0 if option.positive else option.least,
            "help": "" if option is None else option.help,
        }
        for name, value, option in own
        if isinstance(value, float) and math.isfinite(value) and name != "start"
    ]  # fmt: skip
