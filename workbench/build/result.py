"""What was written where a model became a system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.show.result import Result

__all__ = ["SystemFile"]


@dataclass(frozen=True)
class SystemFile(Result):
    """An identified model with static blocks that was written as a system.

    Attributes:
        model: name of the system.
        file: the .toml or .ssp.
        structure: hammerstein, wiener or hammerstein-wiener.
        components: names of its parts.
        inputs, outputs: its variables.
        dt: sample period of the linear part [s].
        notes: what else should be known, one line each.
    """

    _page = "workbench.build.page:system_file_page"

    model: str
    file: Path
    structure: str
    components: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a system file that was written", "build"

    def derived(self) -> Mapping[str, Any]:
        return {"interface": None, "solver": None}
