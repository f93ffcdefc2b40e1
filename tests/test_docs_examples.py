"""The examples of the documentation outside of its tutorials, and the keys of the JSON that they write."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from docs.tools.record_keys import with_keys
from tests.doc_pages import check_page, first_column, text_of, with_examples
from workbench.commands import REQUESTS

HEADING = re.compile(r"^## (?P<title>.+)\n(?P<text>(?:(?!^## ).*\n?)*)", re.MULTILINE)
ENVELOPE = {"command", "version", "seconds", "asked"}


@pytest.mark.parametrize("page", [p for p in with_examples() if not p.startswith("tutorials/")])
def test_examples_show_what_the_page_says(page: str, tmp_path: Path) -> None:
    check_page(page, tmp_path)
    if page == "reference/json.md":
        check_json(with_keys(text_of(page)), tmp_path)


def check_json(text: str, folder: Path) -> None:
    """Each section names its keys in a table, and makes a file of its own name."""
    for found in HEADING.finditer(text):
        file = folder / f"{found['title']}.json"
        keys = json.loads(file.read_text(encoding="utf-8")).keys() - ENVELOPE
        assert sorted(first_column(found["text"])) == sorted(keys), f"docs/reference/json.md, table of {found['title']}"
    written = {*REQUESTS, "run"} - {"build", "compile"}  # these write a list of files
    sections = set(re.findall(r"^## (.+)$", text, re.MULTILINE))
    missing, idle = (", ".join(sorted(names)) or "none" for names in (written - sections, sections - written))
    assert written == sections, f"docs/reference/json.md: add sections {missing}; remove {idle}"
