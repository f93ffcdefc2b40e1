"""Every test is run: none stands where pytest does not look, and none is misspelt."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
Function = ast.FunctionDef | ast.AsyncFunctionDef
WORD = re.compile(r"\w+")


@cache
def parsed() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(TESTS.rglob("*.py"))}


def is_run(path: Path, function: Function, tree: ast.Module) -> bool:
    """Whether pytest finds a test: at the top of a module `test_*.py`, or of a class `Test…` there."""
    classes = [n for n in tree.body if isinstance(n, ast.ClassDef) and n.name.startswith("Test")]
    places = [tree.body, *(found.body for found in classes)]
    return path.name.startswith("test_") and any(function in place for place in places)


def lost(path: Path, tree: ast.Module) -> Iterator[str]:
    for found in ast.walk(tree):
        if isinstance(found, Function) and found.name.startswith("test_") and not is_run(path, found, tree):
            yield f"{path.relative_to(TESTS)}:{found.lineno}: {found.name} is never run"


def is_fixture(found: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("fixture" in ast.unparse(decorator) for decorator in found.decorator_list)


def unused(path: Path, tree: ast.Module, used: dict[str, int]) -> Iterator[str]:
    """Yield functions of a module with tests that are none and stand nowhere else: misspelt tests, or dead."""
    if not path.name.startswith("test_"):
        return
    for found in tree.body:
        called = isinstance(found, Function) and (found.name.startswith(("test_", "pytest_")) or is_fixture(found))
        if isinstance(found, Function) and not called and used[found.name] == 1:
            yield f"{path.relative_to(TESTS)}:{found.lineno}: {found.name} is no test, and nothing uses it"


def test_every_test_is_run() -> None:
    assert [line for path, tree in parsed().items() for line in lost(path, tree)] == []


def test_every_function_of_the_tests_is_used() -> None:
    used: dict[str, int] = {}
    for word in (word for path in parsed() for word in WORD.findall(path.read_text(encoding="utf-8"))):
        used[word] = used.get(word, 0) + 1
    assert [line for path, tree in parsed().items() for line in unused(path, tree, used)] == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("helpers.py", "def test_a(): pass"),
        ("test_b.py", "def f():\n    def test_a(): pass"),
        ("test_b.py", "class Some:\n    def test_a(self): pass"),
    ],
)
def test_a_lost_test_is_found(name: str, text: str) -> None:
    assert list(lost(TESTS / name, ast.parse(text))) == [f"{name}:{text.count(chr(10)) + 1}: test_a is never run"]
