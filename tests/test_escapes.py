"""The wall of `--confine` holds against every attempt that is known, for root and for an ordinary user."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.jobs import confine
from workbench.jobs.system_calls import AFTER, CONDITIONS, INSTEAD, numbers

ROOT = Path(__file__).parent.parent
ENOUGH = 80
CALLS = Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"), Path("/usr/include/asm-generic/unistd.h")

whole_wall = pytest.mark.skipif(
    bool(confine.why_not()) or confine.landlock_version() < confine.SIGNALS_SINCE,
    reason="this kernel cannot confine a process, or signals from it",
)


@whole_wall
@pytest.mark.parametrize("user", ["", "nobody"])
def test_no_attempt_comes_through(user: str) -> None:
    if user and os.getuid():
        pytest.skip("only root can become another user; the other test is of an ordinary one")
    words = [sys.executable, str(ROOT / "scripts" / "escapes.py"), "--json", *(["--user", user] if user else [])]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    found = json.loads(done.stdout or done.stderr)
    assert not {name: held for name, (_, held) in found.items() if held.startswith("reached")}
    assert sum(free.startswith("reached") for free, _ in found.values()) >= ENOUGH, found


def test_conditions_are_of_calls_that_are_allowed() -> None:
    for machine in ("x86_64", "aarch64"):
        assert CONDITIONS.keys() <= numbers(machine).keys()
        assert not INSTEAD.keys() & numbers(machine).keys()
        assert max(numbers(machine).values()) < AFTER


@pytest.mark.skipif(not all(file.exists() for file in CALLS), reason="the system's headers are not installed")
def test_the_numbers_are_those_of_the_system() -> None:
    for machine, file in zip(("x86_64", "aarch64"), CALLS, strict=True):
        text = file.read_text().replace("__NR3264_fstatat", "__NR3264_newfstatat")
        told = dict(re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)$", text, re.MULTILINE))
        assert {name: str(number) for name, number in numbers(machine).items()} == {
            name: told[name] for name in numbers(machine)
        }
