"""The pages of the documentation, and how their examples are tested.

A difference after a change that was meant: `python -m docs.tools.update` writes what is shown now into the pages.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from docs.tools.examples import blocks_of, compare, pictures_of, run_page
from docs.tools.given import provide
from tests.gemseo import WITHOUT_GEMSEO

__all__ = ["DOCS", "check_page", "first_column", "pages", "text_of", "with_examples"]

DOCS = Path(__file__).parents[1] / "docs"
NEEDS_BUILD = {"tutorials/identification.md"}  # they export an FMU


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


def check_page(page: str, folder: Path) -> None:
    """Run a page's examples in a folder, and compare."""
    text = text_of(page)
    if page in NEEDS_BUILD and importlib.util.find_spec("ziglang") is None:
        pytest.skip("the page builds an FMU, which needs ziglang: pip install 'fmi-workbench[build]'")
    if not provide(text, folder):
        pytest.skip(f"the page {WITHOUT_GEMSEO}")
    wrong = list(compare(run_page(text, folder)))
    for owner, picture in pictures_of(text):
        if owner != Path(page).stem or not (folder / picture).is_file():
            wrong.append(f"{picture} is not made here")
    if wrong:
        pytest.fail("\n".join([page, *wrong]), pytrace=False)
