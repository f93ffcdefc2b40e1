"""Compare what an example shows with what its page says: words exactly, numbers to the digits printed.

A number agrees within two units of the last digit that the page prints, a whole number up to 20 only with itself.
Numbers below 1e-5 are what rounding leaves, and agree with each other. Blanks and rules of tables do not count.
"""

from __future__ import annotations

import re
from itertools import takewhile, zip_longest

__all__ = ["difference"]

_NUMBER = re.compile(r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE)
_RULE = re.compile(r"[─━═-]{3,}|[▁▂▃▄▅▆▇█░]+")
_UNITS = 2.0
_ROUNDING = 1e-5
_COUNTS = 20
_ANY = "…"
_REST = " …"


def difference(expected: str, shown: str) -> str:
    """Return the first difference in words, or "" where there is none.

    Args:
        expected: as the page has it; a line `…` stands for any number of lines, ` …` at its end for the rest of it.
        shown: by the run.
    """
    wanted, got = _lines(expected), _lines(shown)
    if _ANY not in wanted:
        return next((_words(w, g) for w, g in zip_longest(wanted, got) if not _same(w, g)), "")
    return _with_gaps(wanted, got)


def _with_gaps(wanted: list[str], got: list[str]) -> str:
    """Find the stretches between the gaps one after the other."""
    begin, gap = 0, False
    for stretch in _stretches(wanted):
        if stretch is None:
            gap = True
            continue
        place = _find(stretch, got, begin, anywhere=gap)
        if place is None:
            return _nearest(stretch, got[begin:], anywhere=gap)
        begin, gap = place + len(stretch), False
    return "" if gap or begin == len(got) else _words(None, got[begin])


def _stretches(lines: list[str]) -> list[list[str] | None]:
    """Return the lines between the gaps; None is a gap."""
    found: list[list[str] | None] = []
    for line in lines:
        if line == _ANY:
            found.append(None)
        elif found and found[-1] is not None:
            found[-1].append(line)
        else:
            found.append([line])
    return found


def _find(stretch: list[str], got: list[str], begin: int, *, anywhere: bool) -> int | None:
    last = len(got) - len(stretch) if anywhere else begin
    for place in range(begin, last + 1):
        part = got[place : place + len(stretch)]
        if len(part) == len(stretch) and all(map(_same, stretch, part)):
            return place
    return None


def _nearest(stretch: list[str], got: list[str], *, anywhere: bool) -> str:
    """Say what differs first where most lines before it agree."""
    places = range(len(got) + 1 if anywhere else 1)
    agreeing = [sum(1 for _ in takewhile(lambda p: _same(*p), zip(stretch, got[b:], strict=False))) for b in places]
    most = max(agreeing)
    line = agreeing.index(most) + most
    return _words(stretch[most], got[line] if line < len(got) else None) + (
        " (or below)" if anywhere and not most else ""
    )


def _words(wanted: str | None, got: str | None) -> str:
    return f"the page has {wanted!r}, shown was {got!r}"


def _lines(text: str) -> list[str]:
    """Lines with their blanks and rules brought to one form; empty ones left out."""
    plain = (" ".join(_RULE.sub("─", line).split()) for line in text.splitlines())
    return [line for line in plain if line.strip("─ ")]


def _same(wanted: str | None, got: str | None) -> bool:
    if wanted is None or got is None:
        return wanted is got
    if wanted.endswith(_REST):
        words = wanted.removesuffix(_REST).split()
        wanted, got = " ".join(words), " ".join(got.split()[: len(words)])
    if _NUMBER.sub("#", wanted) != _NUMBER.sub("#", got):
        return False
    pairs = zip(_NUMBER.findall(wanted), _NUMBER.findall(got), strict=True)
    return all(_close(a, b) for a, b in pairs)


def _close(wanted: str, got: str) -> bool:
    if wanted == got:
        return True
    a, b = (float(text.replace("−", "-")) for text in (wanted, got))
    return abs(a - b) <= _UNITS * _last_digit(wanted) * (1.0 + 1e-9) or max(abs(a), abs(b)) < _ROUNDING


def _last_digit(text: str) -> float:
    """Return what one unit of the last digit printed is worth; 0 of a small whole number, which is a count."""
    mantissa, _, exponent = text.lower().replace("−", "-").partition("e")
    decimals = len(mantissa.partition(".")[2])
    if not decimals and not exponent and abs(float(mantissa)) <= _COUNTS:
        return 0.0
    return float(10.0 ** (int(exponent or 0) - decimals))
