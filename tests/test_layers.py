"""Everything points down: imports, also of types, and modules named in strings; CONTRIBUTING has the house."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1] / "workbench"
# Floors from the lowest; rooms of one floor do not see each other.
ORDER = (
    ("errors",),
    ("core",),
    ("fmi", "signals"),
    ("kernel",),
    ("session",),
    ("model",),
    ("jobs", "system"),
    ("requests",),
    ("show",),
    ("point",),
    ("health", "response"),
    ("data", "loops"),
    ("identification",),
    ("build",),
    ("limit_cycles",),
    ("commands",),
    ("study",),
    ("ui",),
    ("cli",),
)
FLOOR = {room: floor for floor, rooms in enumerate(ORDER) for room in rooms}
STRING = re.compile(r"(workbench(?:\.\w+)+)(?::\w+)?")  # a module, or "module:name"
NAMED = re.compile(r"`([a-z_]+)\.(?!(?:c|py|pyi)`)([A-Za-z_]\w*)`")  # "`module.name`", not "`file.py`"


@dataclass(frozen=True)
class Arrow:
    """One module names another.

    Attributes:
        source: module.
        target: module, as far as there is one.
        line: number.
        how: "import", "type" (for the type checker alone) or "string".
    """

    source: str
    target: str
    line: int
    how: str

    def __str__(self) -> str:
        return f"{self.source}:{self.line} → {self.target} ({self.how})"


@cache
def modules() -> dict[str, Path]:
    """Return every module of the package by its dotted name."""
    return {
        ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): path
        for path in sorted(ROOT.rglob("*.py"))
    }


def arrows_of(name: str, tree: ast.Module, known: Mapping[str, object]) -> Iterator[Arrow]:
    """Yield what a module names of the package."""

    def home(dotted: str) -> str:
        """Return the module that holds a dotted name."""
        while dotted not in known and "." in dotted:
            dotted = dotted.rpartition(".")[0]
        return dotted

    def walk(node: ast.AST, *, typing: bool) -> Iterator[tuple[str, int, str]]:
        typing = typing or (
            isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        )
        how = "type" if typing else "import"
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno, how) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((f"{node.module}.{alias.name}", node.lineno, how) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and (found := STRING.fullmatch(node.value)):
            yield found[1], node.lineno, "string"
        for inner in ast.iter_child_nodes(node):
            yield from walk(inner, typing=typing)

    for dotted, line, how in walk(tree, typing=False):
        target = home(dotted)
        if target.startswith("workbench.") and target != name:
            yield Arrow(name, target, line, how)


@dataclass(frozen=True)
class Seen:
    """What the tests look at in a module.

    Attributes:
        arrows: to others.
        classes: their names.
        defined: names of its functions, classes and variables.
        used: what is used by name.
        docstrings: all of them.
    """

    arrows: tuple[Arrow, ...]
    classes: tuple[str, ...]
    defined: frozenset[str]
    used: frozenset[str]
    docstrings: tuple[str | None, ...]


@cache
def seen() -> dict[str, Seen]:
    """Look through all modules; once, when a test asks, and one after the other: their trees take much memory."""
    known, found = modules(), {}
    for name, path in known.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        blocks = [n for n in nodes if isinstance(n, ast.FunctionDef | ast.ClassDef)]
        names = [n for n in nodes if isinstance(n, ast.Name)]
        defined = {n.name for n in blocks} | {n.id for n in names if isinstance(n.ctx, ast.Store)}
        found[name] = Seen(
            arrows=tuple(arrows_of(name, tree, known)),
            classes=tuple(n.name for n in blocks if isinstance(n, ast.ClassDef)),
            defined=frozenset(defined),
            used=frozenset({n.arg for n in nodes if isinstance(n, ast.arg)} | {n.id for n in names} | defined),
            docstrings=tuple(map(ast.get_docstring, [tree, *blocks])),
        )
    return found


def every() -> tuple[Arrow, ...]:
    """Return all arrows of the package."""
    return tuple(arrow for one in seen().values() for arrow in one.arrows)


def room(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def circle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """Return the modules of a circle, first and last the same; empty: there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def upwards(arrows: Iterator[Arrow] | tuple[Arrow, ...]) -> list[str]:
    return [
        str(a)
        for a in arrows
        if room(a.source) in FLOOR and room(a.source) != room(a.target)
        if FLOOR[room(a.target)] >= FLOOR[room(a.source)]
    ]


def test_every_room_has_its_floor() -> None:
    assert {room(name) for name in modules()} - {"", "__main__"} == set(FLOOR)
    assert {room(a.source) for a in every()} >= set(FLOOR) - {"errors"}, "the test sees something"


def test_everything_points_down() -> None:
    assert not (wrong := upwards(every())), "\n".join(wrong)


def graph_of(arrows: Iterable[Arrow]) -> dict[str, set[str]]:
    """Return what each module imports; a string that names one, as a request its run, is no import."""
    graph: dict[str, set[str]] = {name: set() for name in modules()}
    for arrow in arrows:
        if arrow.how != "string":
            graph.setdefault(arrow.source, set()).add(arrow.target)
    return graph


def test_no_modules_import_each_other() -> None:
    """Not in functions, and not for types either."""
    assert not (circle := circle_in(graph_of(every()))), " → ".join(circle)


def test_a_class_has_one_name_and_a_name_one_class() -> None:
    where: dict[str, list[str]] = {}
    for module, one in seen().items():
        for name in one.classes:
            where.setdefault(name.lstrip("_"), []).append(module)
    assert {name: homes for name, homes in where.items() if len(homes) > 1} == {}


def test_what_points_up_is_found() -> None:
    text = """
from workbench.errors import InputError
if TYPE_CHECKING:
    from workbench.point import x
def f():
    import workbench.cli.app
    named("workbench.show.result:page_of")
    say("workbench.lin is not the name of a module, and this is no name")
"""
    known = dict.fromkeys(["workbench.errors", "workbench.point", "workbench.cli.app", "workbench.show.result"])
    found = list(arrows_of("workbench.fmi.archive", ast.parse(text), known))
    assert [a.how for a in found] == ["import", "type", "import", "string"]
    assert [a.target for a in found] == list(known)
    assert len(upwards(tuple(found))) == len(found) - 1


def test_a_circle_is_found() -> None:
    known = {"workbench.a": None, "workbench.b": None}
    there = arrows_of("workbench.a", ast.parse("def f():\n    from workbench.b import x"), known)
    back = arrows_of("workbench.b", ast.parse("if TYPE_CHECKING:\n    from workbench.a import X"), known)
    assert set(circle_in(graph_of([*there, *back]))) == set(known)
    assert set(circle_in({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
    assert circle_in({"a": {"b"}, "b": {"c"}, "d": {"a"}}) == []


def test_the_package_needs_no_tests() -> None:
    """The oracle and all that serves it stay outside."""
    upwards = re.compile(r"^\s*(?:from|import) (?:tests|scripts)\b", re.MULTILINE)
    wrong = [str(path) for path in modules().values() if upwards.search(path.read_text(encoding="utf-8"))]
    assert not wrong, "\n".join(wrong)


def pointless(text: str | None, used: frozenset[str] | set[str], defined: Mapping[str, set[str]]) -> list[str]:
    """Return the dotted names of a docstring that stand for nothing.

    Args:
        text: the docstring.
        used: of its module.
        defined: name of a module or a folder of the package → names in it. Other names are those of libraries.
    """
    pairs = [(home, name) for home, name in NAMED.findall(text or "") if home not in used]
    return [f"{h}.{n}" for h, n in pairs if (n not in defined[h] if h in defined else find_spec(h) is None)]


def test_docstrings_point_to_what_is_there() -> None:
    defined: dict[str, set[str]] = {}
    for name, one in seen().items():
        path = modules()[name]
        for home in (path.stem, *path.relative_to(ROOT).parts[:-1]):
            defined.setdefault(home, set()).update(one.defined, {path.stem})
    wrong = [
        f"{module}: {name}"
        for module, one in seen().items()
        for text in one.docstrings
        for name in pointless(text, one.used, defined)
    ]
    assert not wrong, "\n".join(wrong)
    text = "See `gone.read`, `a.gone`, `a.b`, `x.y`, `math.inf`."
    assert pointless(text, {"x"}, {"a": {"b"}}) == ["gone.read", "a.gone"]
