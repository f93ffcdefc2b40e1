"""Packages whose public names are loaded when they are first used, so that importing them is quick."""

from __future__ import annotations

import sys
from importlib import import_module

TYPE_CHECKING = False  # as type checkers know it; importing typing would take the longest of importing the package
if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["homes_in", "lazily"]


def homes_in(stub: str, *, end: str | None = None) -> dict[str, str]:
    """Return name → module of the public names that a stub imports, sorted.

    Args:
        stub: path of an `__init__.pyi`.
        end: only what stands above this line; None: all.
    """
    import ast  # noqa: PLC0415 - it takes longer than importing the package does

    with open(stub, encoding="utf-8") as file:  # noqa: PTH123 - so does pathlib
        text = file.read()
    lines = ast.parse(text.partition(end)[0] if end else text).body
    result = {a.name: line.module or "" for line in lines if isinstance(line, ast.ImportFrom) for a in line.names}
    return dict(sorted(result.items()))


def lazily(package: str, file: str, added: str = "") -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose public names are those of its stub.

    Args:
        package: its name.
        file: its `__init__.py`; beside it stands the stub `__init__.pyi`, which type checkers read. `dir` lists what
            stands above its `# isort: split`.
        added: "module:name" of a function that returns what plug-ins add, by name; empty: they add nothing.

    Source: Scientific Python, SPEC 1, lazy loading of submodules and functions.
    """
    homes: dict[str, str] = {}

    def known() -> dict[str, str]:
        if not homes:
            homes.update(homes_in(f"{file}i"))
        return homes

    def others() -> dict[str, object]:
        from workbench.core.records.named import named  # noqa: PLC0415 - see above
        from workbench.core.records.plug_ins import plug_ins  # noqa: PLC0415 - see above

        return named(added)() if added and plug_ins() else {}

    def other(name: str) -> object:
        from workbench.core.records.plug_ins import faults  # noqa: PLC0415 - see above
        from workbench.errors import close_names  # noqa: PLC0415 - see above

        there = others()
        if name in there:
            return there[name]
        near = close_names(name, known())
        why = "".join([f"; did you mean {', '.join(near)}?" if near else "", *(f"; {fault}" for fault in faults())])
        raise AttributeError(f"module '{package}' has no attribute '{name}'{why}")

    def get(name: str) -> object:
        if name == "__all__":
            return list(known())
        if name.startswith("_"):
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        from workbench.core.machine.interrupts import insisting  # noqa: PLC0415 - see above

        with insisting():
            value = getattr(import_module(homes[name]), name) if name in known() else other(name)
        setattr(sys.modules[package], name, value)
        return value

    def listed() -> list[str]:
        own = (name for name in vars(sys.modules[package]) if name.startswith("__"))
        return sorted({*own, *homes_in(f"{file}i", end="# isort: split"), *others()})

    return get, listed
