"""Plants a changed text into one module of this Python process, and of all that it starts.

The folder stands first in PYTHONPATH only where `scripts/planting.py` puts it there; WORKBENCH_PLANTED names a file
with {"module": …, "file": …, "text": …}. The Python process imports this module by itself at its start.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType


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


if "WORKBENCH_PLANTED" in os.environ:
    sys.meta_path.insert(0, Planted(**json.loads(Path(os.environ["WORKBENCH_PLANTED"]).read_text(encoding="utf-8"))))
