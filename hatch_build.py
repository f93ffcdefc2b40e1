"""Build hook: compiles the inner loop (workbench/kernel/*.c) when a wheel is built or the project is installed.

The compiler is a wheel, too (ziglang): the machine needs none. It compiles for this machine, or for the
platform that WORKBENCH_PLATFORM in the environment names (`scripts/dev.py release`): one wheel, one platform.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))

from workbench.build.toolchain import PLATFORMS, Platform, compile_kernel, host_only

if TYPE_CHECKING:
    _Hook = BuildHookInterface[Any]
else:
    _Hook = BuildHookInterface

PLATFORM = "WORKBENCH_PLATFORM"


class KernelHook(_Hook):
    """Puts the compiled inner loop into the wheel; an editable installation finds it in the source folder."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and tell the builder what to include and which platforms the wheel is for."""
        platforms = _asked()
        if not platforms:
            self.app.display_warning(
                "the inner loop cannot be compiled for this platform; models cannot be loaded here"
            )
            return
        root = Path(self.root)
        libraries = compile_kernel(root / "workbench" / "kernel", platforms)
        if version != "editable":
            build_data["force_include"].update({str(p): p.relative_to(root).as_posix() for p in libraries.values()})
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platforms[0].wheel}"


def _asked() -> tuple[Platform, ...]:
    """Return the one platform to compile for; nothing if this machine is none of them."""
    name = os.environ.get(PLATFORM)
    if not name:
        return host_only()
    found = tuple(p for p in PLATFORMS if p.name == name)
    if not found:
        raise ValueError(f"{PLATFORM}={name}: no such platform; there are {', '.join(p.name for p in PLATFORMS)}")
    return found
