"""Plants a changed text into one module of this Python process, and of all that it starts; or records what runs.

The folder stands first in PYTHONPATH only where `scripts/planting.py` puts it there; WORKBENCH_PLANTED names a file
with {"module": …, "file": …, "text": …}. The Python process imports this module by itself at its start.
WORKBENCH_TRACED names the folder in which lines that run are recorded, see `scripts/covered.py`.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import json
import mmap
import os
import sys
import threading
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

# So often in a test a function is looked at: what it runs later only, in a loop of thousands, is not worth the time.
_OFTEN = 300


class Changed(importlib.machinery.SourceFileLoader):
    """Loads a module from a text that is not the one of its file."""

    def __init__(self, name: str, path: str, text: str) -> None:
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname: str) -> CodeType:
        """Return the changed code; never what is compiled already."""
        return compile(self._text, self.path, "exec", dont_inherit=True)


class Planted(importlib.abc.MetaPathFinder):
    """Finds the module that is changed."""

    def __init__(self, module: str, file: str, text: str) -> None:
        self._module, self._file, self._text = module, file, text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the spec with the changed loader, for that module only."""
        if fullname != self._module:
            return None
        loader = Changed(fullname, self._file, self._text)
        return importlib.util.spec_from_file_location(fullname, self._file, loader=loader)


class Traced:
    """Writes which lines of the package's functions run in which test, each once a test and process.

    Args:
        folder: its file `now` holds the number of the test, 8 bytes; 0: none. `wanted` has rows of line and module:
            what is looked for. To `hits` rows of number, line and module are appended. The files stay open, so that
            a process that may not open files later writes, too.
    """

    def __init__(self, folder: Path) -> None:
        self._root = f"{Path(__file__).resolve().parents[2]}{os.sep}"
        self._wanted: dict[str, set[int]] = defaultdict(set)
        for row in (folder / "wanted").read_text(encoding="utf-8").splitlines():
            line, name = row.split("\t")
            self._wanted[f"{self._root}{name}"].add(int(line))
        self._has: dict[CodeType, bool] = {}  # of a function: whether it has such a line
        with (folder / "now").open("rb") as now:
            self._now = mmap.mmap(now.fileno(), 8, access=mmap.ACCESS_READ)
        self._hits = os.open(folder / "hits", os.O_WRONLY | os.O_APPEND)
        self._begin()

    def _begin(self) -> None:
        self._test = self._now[:8]
        self._seen: set[tuple[CodeType, int]] = set()
        self._calls: Counter[CodeType] = Counter()

    def call(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Look at a function that begins, if it has a line that is looked for."""
        code = frame.f_code
        if (has := self._has.get(code)) is None:
            has = self._has[code] = self._has_wanted(code)
        if not has:
            return None
        if self._now[:8] != self._test:
            self._begin()
        self._calls[code] += 1
        return self._line if self._calls[code] <= _OFTEN and int(self._test) else None

    def _has_wanted(self, code: CodeType) -> bool:
        wanted = self._wanted.get(code.co_filename)
        if not wanted or not code.co_flags & 1:  # 1: of a function
            return False
        return any(line in wanted for _, _, line in code.co_lines())

    def _line(self, frame: FrameType, event: str, argument: Any) -> Any:
        code, line = frame.f_code, frame.f_lineno
        if event == "line" and (code, line) not in self._seen:
            self._seen.add((code, line))
            name = code.co_filename.removeprefix(self._root)
            with suppress(OSError):  # tests set limits to the length of files
                os.write(self._hits, f"{int(self._test)}\t{line}\t{name}\n".encode())
        return self._line


if "WORKBENCH_TRACED" in os.environ:
    traced = Traced(Path(os.environ["WORKBENCH_TRACED"]))
    sys.settrace(traced.call)
    threading.settrace(traced.call)

if "WORKBENCH_PLANTED" in os.environ:
    sys.meta_path.insert(0, Planted(**json.loads(Path(os.environ["WORKBENCH_PLANTED"]).read_text(encoding="utf-8"))))
