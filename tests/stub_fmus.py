"""Libraries of FMUs in C for tests, built for this machine; what those of FMI 2.0 share is in tests/c/fmi2_stub.h."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy

from workbench.build.toolchain import compile_library, host_only
from workbench.core.machine.files import pack

__all__ = ["stub_fmu", "stub_library", "write_stub"]

_C = Path(__file__).parent / "c"
_RUNTIME = Path(__file__).parent.parent / "workbench" / "build" / "runtime"
# What the wrappers of FMI 1.0 ask a model for; one without states has nothing to say.
_STATELESS = '#include "fmi1.h"\nconst ModelInfo model_info = {0};\n'


@lru_cache(maxsize=8)
def stub_library(name: str, fmi1: str = "") -> bytes:
    """Return the shared library of tests/c/NAME/NAME.c.

    Args:
        name: of the folder.
        fmi1: "me" or "cs": its functions of FMI 2.0 as those of FMI 1.0, by tests/c/fmi1*.c; it has no states.
    """
    (host,) = host_only()
    with TemporaryDirectory() as temporary:
        folder, sources = Path(temporary), [f"{name}.c", "absent.c"]
        headers = (Path(fmpy.__file__).parent / "c-code").glob("fmi*.h")
        for file in (_C / name / f"{name}.c", _C / "fmi2_stub.h", _C / "fmi3_stub.h", *headers):
            (folder / file.name).write_bytes(file.read_bytes())
        if fmi1:
            added = ["fmi1_values.c", f"fmi1_{fmi1}.c"]
            for file in (*(_C / c for c in added), _C / "fmi1.h", _RUNTIME / "core.h"):
                (folder / file.name).write_bytes(file.read_bytes())
            (folder / "identifier.h").write_text(f"#define MODEL_IDENTIFIER {name}\n", encoding="ascii")
            (folder / "stateless.c").write_text(_STATELESS, encoding="ascii")
            sources += [*added, "stateless.c"]
        (folder / "absent.c").write_text(_absent(), encoding="ascii")
        library = folder / "lib" / f"{name}{host.suffix}"
        compile_library(folder, sources, host, library)
        return library.read_bytes()


def _absent() -> str:
    """Return all functions of FMI 2.0 and 3.0, each returning an error, for those that a library does not define.

    An FMU must have them all, and FMPy loads no other. Not for Windows, which has no such weak definitions.
    """
    headers = (Path(fmpy.__file__).parent / "c-code").glob("fmi[23]Functions.h")
    names = re.findall(r"^\s*FMI\d_Export\s+\w+\s+(fmi\d\w+);", "\n".join(h.read_text() for h in headers), re.MULTILINE)
    absent = '__attribute__((weak, visibility("default"))) int {0}(void);\nint {0}(void) {{ return 3; }}'
    return "\n".join(["typedef int nothing;", "#ifndef _WIN32", *(absent.format(name) for name in names), "#endif\n"])


def stub_fmu(library: str, fmi: int, interface: str = "") -> dict[str, bytes]:
    """Return the binary of an FMU around a library of `stub_library`: name in the archive → contents.

    Args:
        library: its name, which is the model identifier, too.
        fmi: version of FMI, of which 1 also needs the interface.
        interface: "me" or "cs".
    """
    (host,) = host_only()
    folder = host.name if fmi == 3 else host.name_2
    return {f"binaries/{folder}/{library}{host.suffix}": stub_library(library, interface if fmi == 1 else "")}


def write_stub(file: Path, library: str, description: str, *, fmi: int = 2, more: Mapping[str, bytes] = {}) -> Path:
    """Write an FMU around a library of `stub_library`; return the file.

    Args:
        file: to be written.
        library: its name, which is the model identifier, too.
        description: what becomes modelDescription.xml.
        fmi: version of FMI, 2 or 3.
        more: name in the archive → contents.
    """
    pack(file, {"modelDescription.xml": description.encode(), **stub_fmu(library, fmi), **more})
    return file
