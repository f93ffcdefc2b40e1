"""The documentation: its tables, navigation, pictures and quotes against what the code has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import workbench as wb
from docs.tools.command_pages import command_names, command_page
from docs.tools.examples import pictures_of
from docs.tools.python_pages import grouped_names
from docs.tools.study_pages import requirements_page
from docs.tools.update import LARGEST
from tests.doc_pages import DOCS, first_column, pages, text_of
from workbench.commands import GROUPS
from workbench.signals import text as signal_text
from workbench.study import read as study_schema
from workbench.study.requirements import KINDS
from workbench.system.files import toml_schema

ROOT = Path(__file__).parents[1]


def test_pictures_are_there_and_small() -> None:
    shown = {(owner, name) for page in pages() for owner, name in pictures_of(text_of(page))}
    there = {(p.parent.name, p.name) for p in (DOCS / "pictures").rglob("*") if p.is_file()}
    assert there == shown
    made = [p for p in (DOCS / "pictures").rglob("*.png") if p.parent.name != "browser"]  # which are screenshots
    assert [p for p in made if p.stat().st_size > LARGEST] == []


def test_navigation_names_every_page() -> None:
    navigation = (ROOT / "properdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    generated = {"reference/requirements.md", "reference/targets.md"}
    assert set(re.findall(r"[\w/-]+\.md", navigation)) == {*pages(), *generated}


def test_commands_are_grouped_as_their_help_is() -> None:
    groups: dict[str, list[str]] = {}
    for line in text_of("reference/commands.md").splitlines():
        if found := re.match(r"\| \*\*(.+)\*\* \|", line):
            groups[found[1]] = []
        elif found := re.match(r"\| \[`([\w-]+)", line):
            groups[list(groups)[-1]].append(found[1])
    assert groups == {title: list(commands) for title, commands in GROUPS.items()}
    assert re.findall(r"^\| \*\*(.+)\*\* \|", text_of("methods/index.md"), re.MULTILINE) == list(GROUPS)
    methods = (
        (ROOT / "properdocs.yml").read_text(encoding="utf-8").partition("- Methods:")[2].partition("- Reference:")[0]
    )
    assert re.findall(r"^ {6}- ([\w ]+):$", methods, re.MULTILINE) == list(GROUPS)


def test_the_tables_of_models_name_everything_that_is_bundled_once() -> None:
    folders = {"fmu": "fmus/fmi2/*.fmu", "system": "systems/*.toml", "study": "studies/*.toml"}
    bundled = [f"{kind}:{path.stem}" for kind, pattern in folders.items() for path in ROOT.glob(pattern)]
    assert sorted(first_column(text_of("reference/models.md"))) == sorted(bundled)


@pytest.mark.parametrize("name", command_names())
def test_command_pages_name_every_option(name: str) -> None:
    page = command_page(name)
    assert page.startswith(f"# {name}\n")
    assert "## Options" in page or name == "schema"  # which has none
    assert "**Example" in page, "the help of the command shows no example"
    assert f"workbench {name}" in page


def test_python_pages_name_every_public_name_once() -> None:
    groups = grouped_names()
    names = [name for found in groups.values() for name in found]
    assert sorted(names) == sorted(wb.__all__)


def table_keys(module: object) -> set[str]:
    """Every key of every table that a module's classes read."""
    owners = [v for v in vars(module).values() if isinstance(v, type) and issubclass(v, toml_schema.TomlTable)]
    kinds = [k for k in owners if k.__module__ == vars(module)["__name__"]]
    return {field.alias or name for kind in kinds for name, field in kind.model_fields.items()}


def test_system_files_page_names_every_key() -> None:
    named = set(first_column(text_of("reference/system-files.md")))
    assert table_keys(toml_schema) - named == set()


def test_study_files_page_names_every_key() -> None:
    named = set(first_column(text_of("reference/study-files.md")))
    assert table_keys(study_schema) - named == set()


def test_requirements_page_says_something_about_every_key() -> None:
    page = requirements_page()
    assert re.findall(r"^## (.+)$", page, re.MULTILINE) == list(KINDS)
    assert re.findall(r"^\| `\w+` \|\s*\|.*$", page, re.MULTILINE) == []


@pytest.mark.parametrize("kind", signal_text._KEYS)
def test_signals_page_names_every_key(kind: str) -> None:
    row = next(line for line in text_of("reference/signals.md").splitlines() if line.startswith(f"| `{kind}:"))
    for key in signal_text._KEYS[kind]:
        assert re.search(rf"`{key}`", row) or (kind == "sine" and key in row), key


def source_text() -> str:
    """The package's source and the kernel's, strings that follow each other joined, blanks in one form."""
    files = [*sorted((ROOT / "workbench").rglob("*.py")), *sorted((ROOT / "workbench" / "kernel").glob("*.c"))]
    text = "\n".join(p.read_text(encoding="utf-8") for p in files)
    joined = re.sub(r"[\"']\s*\n?\s*f?[\"']", "", text)
    return re.sub(r"\s+", " ", joined)


def test_messages_that_pages_quote_are_messages_of_the_code() -> None:
    source = source_text()
    for page in ("troubleshooting.md", "methods/integration.md"):
        text = re.sub(r"^```.*?^```", "", text_of(page), flags=re.MULTILINE | re.DOTALL)
        for quote in re.findall(r"(?<![*\w])\*([^*]{12,}?)\*(?!\*)", re.sub(r"\s+", " ", text)):
            for part in filter(None, (p.strip() for p in quote.split("…"))):
                if not re.fullmatch(r"[A-Z][\w -]*", part):  # titles of books
                    assert part in source, f"{page} quotes '{part}', which the code does not say"
