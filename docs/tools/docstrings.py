"""Docstrings as Markdown: indices that are no links, lists that follow a line of text at once."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

__all__ = ["AsMarkdown", "as_markdown"]

_LIST_AFTER_TEXT = re.compile(r"^(?P<text>(?! *(?:-|\d+\.) )[^\n]*\S[^\n]*)\n(?= *(?:-|\d+\.) )", re.MULTILINE)


def as_markdown(text: str) -> str:
    """Return a docstring as Markdown reads it.

    `[amplitude][frequency]` would be a link, and a list needs an empty line before its first item.
    """
    return _LIST_AFTER_TEXT.sub(r"\g<text>\n\n", text.replace("][", "]\\["))


class AsMarkdown(Extension):
    """Prepares every docstring."""

    def on_object(self, *, obj: Object, **_: Any) -> None:  # noqa: ANN401 - griffe's own signature
        """Change the docstring of `obj`."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)
