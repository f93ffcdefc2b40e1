"""The tutorials: their commands run and show what the pages say, and make the pictures."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doc_pages import check_page, with_examples


@pytest.mark.parametrize("page", [p for p in with_examples() if p.startswith("tutorials/")])
def test_the_commands_show_what_the_page_says(page: str, tmp_path: Path) -> None:
    check_page(page, tmp_path)
