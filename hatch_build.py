"""Build hook: compiles the inner loop (workbench/kernel/*.c) when a wheel is built or the project is installed.

The compiler is a wheel, too (ziglang): the machine needs none. An installation compiles for this machine
only; with WORKBENCH_ALL_PLATFORMS=1 in the environment the wheel holds the libraries of all platforms
and runs on each of them.
"""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags

sys.path.insert(0, str(Path(__file__).parent))

from workbench.toolchain import PLATFORMS, compile_kernel, host_only

if TYPE_CHECKING:
    _Hook = BuildHookInterface[Any]
else:
    _Hook = BuildHookInterface

ALL_PLATFORMS = "WORKBENCH_ALL_PLATFORMS"


class KernelHook(_Hook):
    """Puts the compiled inner loop into the wheel; an editable installation finds it in the source folder."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and tell the builder what to include and which platforms the wheel is for."""
        everywhere = os.environ.get(ALL_PLATFORMS, "") not in ("", "0")
        platforms = PLATFORMS if everywhere else host_only()
        if not platforms:
            self.app.display_warning(
                "the inner loop cannot be compiled for this platform; models cannot be loaded here"
            )
            return
        root = Path(self.root)
        libraries = compile_kernel(root / "workbench" / "kernel", platforms)
        if version != "editable":
            build_data["force_include"].update({str(p): p.relative_to(root).as_posix() for p in libraries.values()})
        if not everywhere:
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{_platform_tag()}"


def _platform_tag() -> str:
    """Return this machine's platform as the name of a wheel says it."""
    if sys.platform == "darwin":
        return next(platform_tags())
    # On Linux the tags say which C library this machine has; ours asks for an older one.
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")
