"""A picture as SVG inside a page."""

from __future__ import annotations

import re
from collections import Counter
from html import escape
from typing import TYPE_CHECKING

from workbench.show.hover import points_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["svg_of"]


def svg_of(figure: Figure, prefix: str, words: str) -> str:
    """Return a picture as an SVG element.

    Args:
        figure: the picture.
        prefix: its names begin with it, so that several pictures fit into one page.
        words: what it shows, for those who hear the page.
    """
    from workbench.show.figure import svg_text  # noqa: PLC0415 - no pictures, no matplotlib

    text = svg_text(figure)
    points = "" if not hasattr(figure, "axes") else points_of(figure)
    text = text[text.index("<svg") :]
    # Names of vocabularies on the net: nothing would be fetched, but a page that stands alone need not have any.
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # Matplotlib names an image by its pixels, and two alike by the same name; nothing refers to either.
    met: Counter[str] = Counter()

    def named(match: re.Match[str]) -> str:
        met[match[1]] += 1
        again = f"-{met[match[1]]}" if met[match[1]] > 1 else ""
        return f'id="{prefix}-{match[1]}{again}"'

    text = re.sub(r'\bid="([^"]*)"', named, text)
    text = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", text)
    # The page gives the width; the view box keeps the proportions.
    label = re.sub(r'[<>"&]', " ", words)
    values = f' data-points="{escape(points)}"' if points else ""
    sized = r'<svg ([^>]*?)width="[^"]*" height="[^"]*"'
    return re.sub(sized, lambda match: f'<svg role="img" aria-label="{label}"{values} {match[1]}', text, count=1)
