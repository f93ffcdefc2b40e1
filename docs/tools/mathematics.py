"""Formulas as MathML, which every browser draws by itself: nothing is fetched when a page is read."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

__all__ = ["with_mathml"]

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">(?P<open>\\\(|\\\[)(?P<latex>.*?)(?:\\\)|\\\])</(?P=tag)>', re.DOTALL
)
# What browsers read another way than latex2mathml writes it: dots over letters, alignment of columns, bars and
# slashes that are set apart as if they were relations, names of functions likewise.
_REPAIRS = (
    (re.compile(r"<mover>(?=(?:<mi>[^<]*</mi>)<mo>&#x0*2D9;</mo>)"), '<mover accent="true">'),
    (
        re.compile(r"<mo(?P<how>[^>]*)>(?P<bar>/|\||&#x0*(?:2F|7C|2016);|‖)</mo>"),
        r'<mo\g<how> lspace="0" rspace="0">\g<bar></mo>',
    ),
    (re.compile(r"<mo>(?P<name>[A-Za-z]{2,})</mo>"), r'<mo lspace="0.17em" rspace="0.05em">\g<name></mo>'),
    (re.compile(r' columnalign="(left|right)"'), r' style="text-align: \1"'),
)
_UNKNOWN = re.compile(r"\\[A-Za-z]+")


def with_mathml(page: str) -> str:
    """Return a page with its formulas as MathML.

    Args:
        page: HTML with formulas as pymdownx.arithmatex leaves them (generic).

    Raises:
        ValueError: a formula holds a command that cannot be converted.
    """
    return _FORMULA.sub(_one, page)


def _one(found: re.Match[str]) -> str:
    latex = html.unescape(found["latex"]).strip()
    block = found["open"] == r"\["
    mathml = convert(latex, display="block" if block else "inline")
    left = _UNKNOWN.search(re.sub(r"<[^>]*>", " ", html.unescape(mathml)))
    if left is not None:
        raise ValueError(f"formula '{latex}': {left.group()} is not known to latex2mathml")
    for pattern, better in _REPAIRS:
        mathml = pattern.sub(better, mathml)
    return f'<{found["tag"]} class="formula" data-search-exclude>{mathml}</{found["tag"]}>'
