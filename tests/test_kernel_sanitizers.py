"""The compiled inner loop under the address and undefined-behaviour sanitizers; C11 without a warning."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

KERNEL = Path(__file__).parent.parent / "workbench" / "kernel"
DRIVER = Path(__file__).parent / "c" / "kernel_driver.c"
COMPILER = shutil.which("gcc")
STRICT = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-ffp-contract=off"]
WATCH = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]
WRAP = "-Wl,--wrap=calloc,--wrap=malloc,--wrap=realloc"

needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="needs gcc: the compiler of the wheel ziglang has no address sanitizer for C programs"
)


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)


@needs_compiler
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    program = tmp_path / "driver"
    assert COMPILER is not None
    sources = sorted(KERNEL.glob("*.c"))
    # Function types that differ from a call's are FMI's nature: the driver casts its own to one type.
    made = run(COMPILER, *STRICT, "-Wno-cast-function-type", *WATCH, f"-I{KERNEL}", *sources, DRIVER, "-o", program,
               WRAP, "-lm")  # fmt: skip
    assert made.returncode == 0, made.stderr[-3000:]
    done = run(program)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stderr == ""
