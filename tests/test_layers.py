"""Imports go down only: cli → study, reproduce → report → plotting → analysis → … → core, as CONTRIBUTING.md says."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
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
    ("report",),
    ("study", "reproduce"),
    ("cli",),
)
LEVEL = {layer: level for level, layers in enumerate(ORDER) for layer in layers}

# What a method looks up when it is called: layer → layers. Results are drawn and reported, systems have `.loop()`.
LATE = {"analysis": {"plotting"}, "system": {"analysis"}}
# No analysis builds; what all may use uses no layer but these.
COMMON = {
    "errors": set(),
    "core": {"csv_file", "errors"},
    "endings": set(),
    "signals": {"core", "errors", "shift_register"},
    "csv_file": {"errors"},
    "json_values": set(),
    "shift_register": set(),
    "store": {"errors"},
    "build": {"core", "errors", "origin", "toolchain"},
    "toolchain": {"errors", "fmi"},
    "origin": {"core", "errors", "fmi", "model", "system", "report"},
}


@dataclass(frozen=True)
class Import:
    """One import of one module by another: layers, where, and whether only a call or the type checker makes it."""

    source: str
    target: str
    where: str
    late: bool


def layer(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else path.stem


def imports(path: Path) -> Iterator[Import]:
    """Yield the imports from other layers, those under TYPE_CHECKING, too."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {id(n) for block in ast.walk(tree) if is_late(block) for n in ast.walk(block)}
    for node in ast.walk(tree):
        for module in modules(node):
            target = module.split(".")[1]
            if target != layer(path):
                where = f"{path.relative_to(ROOT)}:{node.lineno} imports {module}"  # type: ignore[attr-defined]
                yield Import(layer(path), target, where, id(node) in inside)


def is_late(node: ast.AST) -> bool:
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)


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


EVERY = [found for path in sorted(ROOT.rglob("*.py")) for found in imports(path)]


def test_the_imports_are_found() -> None:
    """The test sees something: each layer uses others, the lowest `errors`."""
    assert {found.source for found in EVERY} >= set(LEVEL)


def test_layers_import_downwards() -> None:
    wrong = [
        i.where
        for i in EVERY
        if i.source in LEVEL and i.target in LEVEL and LEVEL[i.target] > LEVEL[i.source]
        if not (i.late and i.target in LATE.get(i.source, ()))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", COMMON)
def test_what_all_use_depends_on_little(name: str) -> None:
    wrong = [i.where for i in EVERY if i.source == name and i.target not in COMMON[name]]
    assert not wrong, "\n".join(wrong)


def test_no_analysis_builds() -> None:
    """FMUs are built by commands; what examines them takes them as they are."""
    wrong = [i.where for i in EVERY if LEVEL.get(i.source, 99) <= LEVEL["plotting"] and i.target == "build"]
    assert not wrong, "\n".join(wrong)


def test_the_package_needs_no_tests() -> None:
    """The oracle and all that serves it stay outside."""
    upwards = re.compile(r"^\s*(?:from|import) (?:tests|scripts)\b", re.MULTILINE)
    wrong = [str(path) for path in sorted(ROOT.rglob("*.py")) if upwards.search(path.read_text(encoding="utf-8"))]
    assert not wrong, "\n".join(wrong)
