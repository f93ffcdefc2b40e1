"""Imports go down only: cli → study, reproduce → report → plotting → analysis → … → core, as CONTRIBUTING.md says."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "workbench"
ORDER = (
    ("core",),
    ("fmi",),
    ("session", "kernel"),
    ("model",),
    ("system",),
    ("workers",),
    ("analysis",),
    ("plotting",),
    ("report", "to_fmu"),
    ("study", "reproduce", "ui"),
    ("cli",),
)
LEVEL = {layer: level for level, layers in enumerate(ORDER) for layer in layers}

# What a method looks up when it is called: layer → layers. Results are drawn and reported, systems have `.loop()`.
LATE = {"analysis": {"plotting"}, "system": {"analysis"}}
# No analysis builds; what all may use uses no layer but these.
COMMON = {
    "errors": set(),
    "core": {"errors"},
    "endings": set(),
    "signals": {"core", "errors", "shift_register"},
    "signal_numbers": {"core", "errors", "signals"},
    "signal_file": {"core", "errors", "signal_numbers", "signals"},
    "signal_text": {"core", "errors", "gusts", "signal_file", "signal_numbers", "signals"},
    "gusts": {"errors", "signals"},
    "shift_register": set(),
    "store": {"core", "errors"},
    "build": {"core", "errors", "origin", "toolchain"},
    "toolchain": {"core", "errors", "fmi"},
    "origin": {"core", "errors", "fmi", "model", "system", "report"},
}


@dataclass(frozen=True)
class Import:
    """One import of one module by another: layers, where, and whether only a call or the type checker makes it."""

    source: str
    target: str
    where: str
    late: bool


@dataclass(frozen=True)
class Statement:
    """One statement that imports, and whether the type checker alone makes it, or it or a call."""

    node: ast.Import | ast.ImportFrom
    typing: bool
    late: bool


@cache
def statements(path: Path) -> list[Statement]:
    """Return the statements of a file that import; it is read once."""
    return list(statements_in(ast.parse(path.read_text(encoding="utf-8"))))


def statements_in(tree: ast.AST, *, typing: bool = False, late: bool = False) -> Iterator[Statement]:
    typing, late = typing or is_typing(tree), late or is_late(tree)
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield Statement(node, typing, late)
        elif isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):  # there is none in an expression
            yield from statements_in(node, typing=typing, late=late)


def module_of(path: Path) -> str:
    """Return the dotted name of a file's module."""
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


def imported_modules(statements: Iterable[Statement], known: Collection[str]) -> set[str]:
    """Return the modules that a file imports when it is loaded or when one of its functions is called."""
    found: set[str] = set()
    for node in (statement.node for statement in statements if not statement.typing):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in known else node.module or "" for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & set(known)


def circle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """Return the modules of a circle, first and last the same; empty: there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def layer(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else path.stem


def imports(path: Path) -> Iterator[Import]:
    """Yield the imports from other layers, those under TYPE_CHECKING, too."""
    for statement in statements(path):
        for module in modules(statement.node):
            target = module.split(".")[1]
            if target != layer(path):
                where = f"{path.relative_to(ROOT)}:{statement.node.lineno} imports {module}"
                yield Import(layer(path), target, where, statement.late)


def is_late(node: ast.AST) -> bool:
    return is_typing(node) or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)


def is_typing(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def modules(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        found = [alias.name for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module == "workbench":
        found = [f"workbench.{alias.name}" for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and node.level == 0:
        found = [node.module or ""]
    else:
        found = []
    return [name for name in found if name.startswith("workbench.")]


@cache
def every() -> list[Import]:
    """Return all imports of the package; found once, when a test asks."""
    return [found for path in sorted(ROOT.rglob("*.py")) for found in imports(path)]


def test_the_imports_are_found() -> None:
    """The test sees something: each layer uses others, the lowest `errors`."""
    assert {found.source for found in every()} >= set(LEVEL)


def test_layers_import_downwards() -> None:
    wrong = [
        i.where
        for i in every()
        if i.source in LEVEL and i.target in LEVEL and LEVEL[i.target] > LEVEL[i.source]
        if not (i.late and i.target in LATE.get(i.source, ()))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", COMMON)
def test_what_all_use_depends_on_little(name: str) -> None:
    wrong = [i.where for i in every() if i.source == name and i.target not in COMMON[name]]
    assert not wrong, "\n".join(wrong)


def test_no_modules_import_each_other() -> None:
    """Not in functions either; what stands above is looked up by name (`core.named`), or only a type."""
    paths = {module_of(path): path for path in ROOT.rglob("*.py")}
    graph = {name: imported_modules(statements(path), paths) - {name} for name, path in paths.items()}
    assert not (circle := circle_in(graph)), " → ".join(circle)


def test_a_circle_is_found() -> None:
    text = "if TYPE_CHECKING:\n    from a import x\ndef f():\n    from b import c\n    import a"
    assert imported_modules(statements_in(ast.parse(text)), {"a", "b", "b.c"}) == {"b.c", "a"}
    assert set(circle_in({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
    assert circle_in({"a": {"b"}, "b": {"c"}, "d": {"a"}}) == []


def test_no_analysis_builds() -> None:
    """FMUs are built by commands; what examines them takes them as they are."""
    wrong = [i.where for i in every() if LEVEL.get(i.source, 99) <= LEVEL["plotting"] and i.target == "build"]
    assert not wrong, "\n".join(wrong)


def test_the_package_needs_no_tests() -> None:
    """The oracle and all that serves it stay outside."""
    upwards = re.compile(r"^\s*(?:from|import) (?:tests|scripts)\b", re.MULTILINE)
    wrong = [str(path) for path in sorted(ROOT.rglob("*.py")) if upwards.search(path.read_text(encoding="utf-8"))]
    assert not wrong, "\n".join(wrong)
