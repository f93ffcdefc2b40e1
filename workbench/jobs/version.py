"""What tells one state of the workbench from another: on a cluster only workers of the same state get work."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from workbench import __version__
from workbench.kernel.library import VERSION, why_kernel_missing

__all__ = ["Stamp", "stamp"]

_SOURCES = (".py", ".c", ".h", ".toml")
_SHOWN = 10  # digits


class Stamp(NamedTuple):
    """State of the workbench in a process; a tuple, so that another version can read it.

    Attributes:
        workbench: version of the package.
        kernel: version of the compiled kernel, or why there is none.
        algorithms: SHA-256 of all sources of the package, in Python and in C.
    """

    workbench: str
    kernel: str
    algorithms: str

    def __str__(self) -> str:
        return f"workbench {self.workbench}, kernel {self.kernel}, sources {self.algorithms[:_SHOWN]}"

    @property
    def in_store(self) -> dict[str, str]:
        """What of it stored results are kept under; the number of its algorithm is each analysis' own."""
        return {"workbench": self.workbench, "kernel": self.kernel}


@lru_cache(maxsize=1)
def stamp() -> Stamp:
    """Return the state of this process."""
    digest = hashlib.sha256()
    folder = Path(__file__).parents[1]
    for file in sorted(p for p in folder.rglob("*") if p.suffix in _SOURCES):
        content = hashlib.sha256(file.read_bytes().replace(b"\r\n", b"\n")).hexdigest()
        digest.update(f"{file.relative_to(folder).as_posix()}\0{content}\n".encode())
    return Stamp(__version__, why_kernel_missing() or str(VERSION), digest.hexdigest())
