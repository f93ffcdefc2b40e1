"""Numerator and denominator of a state-space model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.session.base import Floats

__all__ = ["NumDen", "numden"]


@dataclass(frozen=True, eq=False)
class NumDen:
    """A transfer matrix with a common denominator, coefficients of falling powers.

    Attributes:
        num: shape (p, m, n + 1).
        den: shape (n + 1,), first coefficient 1.
    """

    num: Floats
    den: Floats


def numden(A: Floats, B: Floats, C: Floats, D: Floats) -> NumDen:
    """Return numerators and denominator.

    The numerator is the product of the denominator and the series of Markov parameters D, C B, C A B, …, which
    breaks off after n + 1 coefficients (Kailath 1980, section 2.3).

    Args:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (p, n).
        D: shape (p, m).
    """
    n = len(A)
    den = np.real(np.poly(A)) if n else np.ones(1)
    markov, reach = [D], B
    for _ in range(n):
        markov.append(C @ reach)
        reach = A @ reach
    h = np.array(markov)
    num = np.array([np.tensordot(den[: k + 1], h[k::-1], 1) for k in range(n + 1)])
    return NumDen(np.moveaxis(num, 0, -1), den)
