"""Designs of identification signals as they are written on the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from workbench.data.excite.design import FilterDesign
from workbench.data.excite.multisine import MultisineDesign
from workbench.data.excite.prbs import PrbsDesign
from workbench.errors import InputError, suggest

__all__ = ["parse_design"]

_KEYS: Mapping[str, tuple[str, ...]] = {
    "prbs": ("amplitude", "rate", "order", "seed", "offset"),
    "multisine": ("amplitude", "band", "periods", "lines", "seed", "offset"),
}


def parse_design(kind: str, text: str) -> FilterDesign:
    """Return the design that a text like "amplitude=2,rate=50,order=11" describes.

    Args:
        kind: "prbs" or "multisine".
        text: KEY=VALUE pairs with commas between; several numbers as in band=0.1:20, or amplitude=2:0.5 for two inputs.

    Raises:
        InputError: unknown kind or key, a key twice, not a number, out of range.
    """
    if kind not in _MAKERS:
        raise InputError(f"signal '{kind}' is unknown; {suggest(kind, _MAKERS)}")
    return _MAKERS[kind](_pairs(kind, text))


def _prbs(k: Mapping[str, str]) -> FilterDesign:
    return PrbsDesign(
        amplitude=_one_or_each("prbs", "amplitude", k.get("amplitude", "1")),
        rate=_number("prbs", "rate", k["rate"]) if "rate" in k else None,
        order=_whole("prbs", "order", k["order"]) if "order" in k else None,
        seed=_whole("prbs", "seed", k.get("seed", "1")),
        offset=_one_or_each("prbs", "offset", k["offset"]) if "offset" in k else None,
    )


def _multisine(k: Mapping[str, str]) -> FilterDesign:
    if "band" not in k:
        raise InputError("multisine: band is missing; write band=LOW:HIGH in Hz")
    band = _numbers("multisine", "band", k["band"])
    if len(band) != 2:
        raise InputError(f"multisine: band must be LOW:HIGH in Hz, as in band=0.1:20, not '{k['band']}'")
    return MultisineDesign(
        amplitude=_one_or_each("multisine", "amplitude", k.get("amplitude", "1")),
        band=(band[0], band[1]),
        periods=_whole("multisine", "periods", k.get("periods", "4")),
        lines=_lines(k.get("lines", "all")),
        seed=_whole("multisine", "seed", k.get("seed", "1")),
        offset=_one_or_each("multisine", "offset", k["offset"]) if "offset" in k else None,
    )


_MAKERS: Mapping[str, Callable[[Mapping[str, str]], FilterDesign]] = {"prbs": _prbs, "multisine": _multisine}


def _pairs(kind: str, text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, value = (p.strip() for p in part.partition("="))
        if key not in _KEYS[kind]:
            raise InputError(f"{kind}: unknown option '{key}'; {suggest(key, _KEYS[kind])}")
        if not (equals and value):
            raise InputError(f"{kind}: {key} needs a value, as in {key}=1")
        if key in found:
            raise InputError(f"{kind}: {key} is given twice; several inputs' values go as in {key}=1:2")
        found[key] = value
    return found


def _number(kind: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{kind}: {key} needs a number, as in {key}=1.0, not '{text}'") from None


def _numbers(kind: str, key: str, text: str) -> tuple[float, ...]:
    return tuple(_number(kind, key, item) for item in text.split(":"))


def _one_or_each(kind: str, key: str, text: str) -> float | tuple[float, ...]:
    found = _numbers(kind, key, text)
    return found[0] if len(found) == 1 else found


def _whole(kind: str, key: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{kind}: {key} must be a whole number, not '{text}'") from None


def _lines(text: str) -> Literal["all", "odd"]:
    if text == "all":
        return "all"
    if text == "odd":
        return "odd"
    raise InputError(f"multisine: lines '{text}'; known: all, odd")
