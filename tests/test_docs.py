"""The documentation: its examples run and show what the pages say; its tables hold what the code has.

A difference after a change that was meant: `python -m docs.tools.update` writes what is shown now into the pages.
"""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

import workbench as wb
from docs.tools.command_pages import command_names, command_page
from docs.tools.examples import blocks_of, compare, pictures_of, run_page
from docs.tools.given import provide
from docs.tools.python_pages import grouped_names
from docs.tools.study_pages import requirements_page
from workbench.signals import parse_signal
from workbench.study import schema as study_schema
from workbench.study.kinds import KINDS
from workbench.system import toml_schema

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
LARGEST = 150_000  # bytes of a picture
NEEDS_BUILD = {"tutorials/identification.md"}  # they export an FMU
HEADING = re.compile(r"^## (?P<title>.+)\n(?P<text>(?:(?!^## ).*\n?)*)", re.MULTILINE)
ENVELOPE = {"command", "version", "seconds"}


def pages() -> list[str]:
    return sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


def first_column(text: str) -> list[str]:
    """Names in backticks in the first column of the tables of a text."""
    cells = (line.split("|")[1] for line in text.splitlines() if line.startswith("|"))
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


def with_examples() -> list[str]:
    return [p for p in pages() if any(b.language in {"sh", "python"} for b in blocks_of(text_of(p)))]


@pytest.mark.parametrize("page", with_examples())
def test_examples_show_what_the_page_says(page: str, tmp_path: Path) -> None:
    text = text_of(page)
    if page in NEEDS_BUILD and importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs the extra build")
    if not provide(text, tmp_path):
        pytest.skip("needs the package gemseo-fmu and Linux on x86_64")
    shown = run_page(text, tmp_path)
    assert shown
    assert list(compare(shown)) == []
    for owner, picture in pictures_of(text):
        assert owner == Path(page).stem, f"{page} shows a picture of another page"
        assert (tmp_path / picture).is_file(), f"{page} does not make {picture}"
    if page == "reference/json.md":
        check_json(text, tmp_path)


def check_json(text: str, folder: Path) -> None:
    """Each section names its keys in a table, and makes a file of its own name."""
    for found in HEADING.finditer(text):
        file = folder / f"{found['title']}.json"
        keys = json.loads(file.read_text(encoding="utf-8")).keys() - ENVELOPE
        assert sorted(first_column(found["text"])) == sorted(keys), f"keys of {found['title']}"
    written = set(command_names()) - {"build", "export"}  # a list of files
    assert written == set(re.findall(r"^## (.+)$", text, re.MULTILINE))


def test_pictures_are_there_and_small() -> None:
    shown = {(owner, name) for page in pages() for owner, name in pictures_of(text_of(page))}
    there = {(p.parent.name, p.name) for p in (DOCS / "pictures").rglob("*") if p.is_file()}
    assert there == shown
    assert [p for p in (DOCS / "pictures").rglob("*.png") if p.stat().st_size > LARGEST] == []


def test_navigation_names_every_page() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    generated = {"reference/requirements.md", "reference/targets.md"}
    assert set(re.findall(r"[\w/-]+\.md", navigation)) == {*pages(), *generated}


@pytest.mark.parametrize("name", command_names())
def test_command_pages_name_every_option(name: str) -> None:
    page = command_page(name)
    assert page.startswith(f"# {name}\n")
    assert "## Options" in page
    assert "**Example" in page, "the help of the command shows no example"
    assert f"workbench {name}" in page


def test_python_pages_name_every_public_name_once() -> None:
    groups = grouped_names()
    names = [name for found in groups.values() for name in found]
    assert sorted(names) == sorted(wb.__all__)


def table_keys(module: object) -> set[str]:
    """Every key of every table that a module's classes read."""
    kinds = [v for v in vars(module).values() if isinstance(v, type) and issubclass(v, toml_schema.Table)]
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


def test_signals_page_names_every_key() -> None:
    page = text_of("reference/signals.md")
    for kind, keys in {"sine": "frequency", "step": "time", "prbs": "hold"}.items():
        with pytest.raises(wb.InputError) as refused:
            parse_signal(f"{kind}:nosuch=1")
        assert f"`{kind}:…`" in page
        assert f"`{keys}`" in page
        for key in re.findall(r"\w+", str(refused.value).partition("known:")[2]):
            assert f"`{key}`" in page, f"{kind}: {key}"


def source_text() -> str:
    """The package's source, strings that follow each other joined, blanks in one form."""
    text = "\n".join(p.read_text(encoding="utf-8") for p in sorted((ROOT / "workbench").rglob("*.py")))
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
