"""Compiling the kernel: once for each change of its sources, whole or not at all, in the bare standard library."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from workbench.build import toolchain
from workbench.build.toolchain import (
    PLATFORMS,
    CFile,
    Platform,
    chosen_platforms,
    compile_files,
    compile_kernel,
    host_only,
)
from workbench.errors import BuildError, InputError

ROOT = Path(__file__).parent.parent
ANSWER = '__attribute__((visibility("default"))) int answer(void);\nint answer(void)\n{\n    return %d;\n}\n'
BARE = """
import sys
sys.path.insert(0, {root!r})
import workbench.build.toolchain
print(sorted(m for m in ("numpy", "fmpy", "workbench.kernel", "rich") if m in sys.modules))
"""


def write(folder: Path, text: str) -> None:
    # A library for Windows must export something declared so; the test needs one platform only.
    (folder / "answer.c").write_text(
        text.replace('visibility("default")', "dllexport") if sys.platform == "win32" else text
    )


@pytest.mark.usefixtures("real_compiler")
def test_a_change_of_the_sources_and_nothing_else_compiles_anew(tmp_path: Path) -> None:
    write(tmp_path, ANSWER % 1)
    (library,) = compile_kernel(tmp_path, host_only()).values()
    first = library.stat().st_mtime_ns
    assert compile_kernel(tmp_path, host_only()) == {host_only()[0].name: library}
    assert library.stat().st_mtime_ns == first
    write(tmp_path, ANSWER % 2)
    compile_kernel(tmp_path, host_only())
    assert ctypes.CDLL(str(library)).answer() == 2
    write(tmp_path, "no C at all\n")
    with pytest.raises(BuildError, match=r"the C compiler failed for .*error"):
        compile_kernel(tmp_path, host_only())
    assert ctypes.CDLL(str(library)).answer() == 2  # the old one stands
    assert [p.name for p in (tmp_path / "lib").iterdir()] == [host_only()[0].name]


def test_what_takes_minutes_the_first_time_is_told_then_and_not_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    windows = next(p for p in toolchain.PLATFORMS if p.suffix == ".dll")
    files, told = [CFile("answer.c")], list[str]()
    refused = True

    def compiler(command: Sequence[str], _folder: Path, _platform: Platform) -> None:
        assert told, "told before the compiler runs"
        if refused:
            raise BuildError("the C compiler failed")
        if "-c" in command:
            Path(command[-1]).touch()

    monkeypatch.setattr(toolchain, "_run", compiler)
    with pytest.raises(BuildError):
        compile_files(tmp_path, files, windows, tmp_path / "a.dll", say=told.append)
    refused = False
    compile_files(tmp_path, files, windows, tmp_path / "a.dll", say=told.append)
    compile_files(tmp_path, files, windows, tmp_path / "a.dll", say=told.append)
    assert len(told) == 2  # where it failed nothing is ready
    assert told[0].startswith("compiling for x86_64-windows: this machine does so for the first time")


def test_it_needs_nothing_but_the_standard_library() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BARE.format(root=str(ROOT))], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_platforms_have_names_and_two_words(monkeypatch: pytest.MonkeyPatch) -> None:
    here = tuple(p.name for p in host_only())
    every = tuple(p.name for p in PLATFORMS)

    def names(*given: str, usual: str = "all") -> tuple[str, ...]:
        return tuple(p.name for p in chosen_platforms(given or None, usual=usual))

    assert names("linux64", "x86_64-linux", "win64") == ("x86_64-linux", "x86_64-windows")
    assert (names("host"), names(usual="host"), names("all"), names()) == (here, here, every, every)
    with pytest.raises(InputError, match=r"no platform 'amiga'; there are: .*; host for this machine's, all for all"):
        names("amiga")
    monkeypatch.setattr("workbench.build.toolchain.host_only", tuple)
    with pytest.raises(InputError, match="this machine is none of those"):
        names("host")
