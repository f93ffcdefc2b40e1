"""Values, limits and verdicts for people."""

from __future__ import annotations

import math

from workbench.study.kinds.base import Compliance

__all__ = ["FAILED", "MISSED", "PASSED", "limit_words", "margin_words", "number", "said", "value_words", "verdict"]

PASSED, MISSED, FAILED = "passed", "violated", "failed"


def verdict(found: Compliance) -> str:
    """Return "passed", "violated", or "failed" where nothing was measured."""
    return PASSED if found.passed else FAILED if found.value is None else MISSED


def number(value: float | bool | str | None) -> str:  # noqa: FBT001 - a value
    """Return a value with five digits, and a word where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value
    return "infinite" if math.isinf(value) else f"{value:.5g}"


def value_words(found: Compliance) -> str:
    """Return the value with its unit."""
    return f"{number(found.value)}{_unit(found)}" if found.value is not None else "not measured"


def limit_words(found: Compliance) -> str:
    """Return the limit: "≥ 6 dB", "2 … 5 Hz", "1 ± 0.1"."""
    limit = found.limit
    if "equal" in limit:
        tolerance = f" ± {number(limit['tolerance'])}" if "tolerance" in limit else ""
        return f"{number(limit['equal'])}{tolerance}{_unit(found)}"
    if "min" in limit and "max" in limit:
        return f"{number(limit['min'])} … {number(limit['max'])}{_unit(found)}"
    if "min" in limit:
        return f"≥ {number(limit['min'])}{_unit(found)}"
    return f"≤ {number(limit['max'])}{_unit(found)}" if "max" in limit else ""


def said(found: Compliance) -> str:
    """Return how it came out: "-2.49 dB, limit ≥ -1 dB (2.5 Hz)", or why nothing was measured."""
    where = f" ({found.where})" if found.where else ""
    return found.reason or f"{value_words(found)}, limit {limit_words(found)}{where}"


def margin_words(found: Compliance) -> str:
    """Return the margin with its sign."""
    if found.margin is None:
        return ""
    return "infinite" if math.isinf(found.margin) else f"{found.margin:+.4g}"


def _unit(found: Compliance) -> str:
    if isinstance(found.value, str | bool) or not found.unit or found.unit == "1":
        return ""
    return f" {found.unit}"
