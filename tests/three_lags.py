"""A loop of three lags over a limited gain, as the text of a system file."""

from __future__ import annotations

__all__ = ["three_lags"]


def three_lags(gain: float) -> str:
    """Return r → k → limits of ±1 → three lags of 1 s each → y, which is fed back."""
    return _SYSTEM.replace("GAIN", repr(gain))


_SYSTEM = """
name = "three lags"
[components]
e = {sum = "+-"}
k = {gain = GAIN}
s = {model = "fmu:Saturation", set = {"C[1]" = 0.0, "C[2]" = 0.0, D = 1.0}}
a = "fmu:FirstOrderLag"
b = "fmu:FirstOrderLag"
c = "fmu:FirstOrderLag"
[connections]
"k.u" = "e.y"
"s.u" = "k.y"
"a.u" = "s.y"
"b.u" = "a.y"
"c.u" = "b.y"
"e.u2" = "c.y"
[inputs]
r = "e.u1"
[outputs]
y = "c.y"
"""
