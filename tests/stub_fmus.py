"""Libraries of FMUs in C for tests, built for this machine; what those of FMI 2.0 share is in tests/c/fmi2_stub.h."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy

from workbench.toolchain import compile_library, host_only

__all__ = ["stub_library"]

_C = Path(__file__).parent / "c"


@lru_cache(maxsize=4)
def stub_library(name: str) -> bytes:
    """Return the shared library of tests/c/NAME/NAME.c."""
    (host,) = host_only()
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        headers = (Path(fmpy.__file__).parent / "c-code").glob("fmi[23]*.h")
        for file in (_C / name / f"{name}.c", _C / "fmi2_stub.h", _C / "fmi3_stub.h", *headers):
            (folder / file.name).write_bytes(file.read_bytes())
        library = folder / "lib" / f"{name}{host.suffix}"
        compile_library(folder, [f"{name}.c"], host, library)
        return library.read_bytes()
