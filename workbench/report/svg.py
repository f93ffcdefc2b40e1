"""A picture as SVG inside a page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

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
    from workbench.plotting.figure import literal  # noqa: PLC0415 - no pictures, no matplotlib

    buffer = io.StringIO()
    literal(figure).savefig(buffer, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    # Names of vocabularies on the net: nothing would be fetched, but a page that stands alone need not have any.
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", text)
    # The page gives the width; the view box keeps the proportions.
    label = re.sub(r'[<>"&]', " ", words)
    sized = r'<svg ([^>]*?)width="[^"]*" height="[^"]*"'
    return re.sub(sized, lambda found: f'<svg role="img" aria-label="{label}" {found[1]}', text, count=1)
