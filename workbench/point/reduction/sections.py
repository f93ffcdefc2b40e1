"""A factored transfer function as a state-space system: sections of first and second order in a row."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.point.reduction.factored import Factored

__all__ = ["to_state_space"]

_LEAST = 1e-6  # [1/s] smaller roots count as this in the pairing and the scaling


@dataclass
class _Group:
    """One or two poles (a complex pair, or two real ones), and the zeros that go with them."""

    poles: list[complex]
    zeros: list[complex] = field(default_factory=list)

    @property
    def room(self) -> int:
        return len(self.poles) - len(self.zeros)


def to_state_space(found: Factored) -> LinearPart:
    """Return a realisation; poles and zeros keep their digits, unlike in one polynomial of all of them.

    Each pole pair gets zeros near it; the states are scaled so that the matrix is balanced.

    Source: L. B. Jackson, Digital Filters and Signal Processing, chapter 11 (pairing and ordering of sections).

    Args:
        found: at least as many poles as zeros, complex ones in conjugate pairs.

    Raises:
        InputError: more zeros than poles: no system that can be simulated.
    """
    if len(found.zeros) > len(found.poles):
        raise InputError(
            f"{len(found.zeros)} zeros and {len(found.poles)} poles: differentiators cannot be realised; add a low-pass"
        )
    groups = _paired(found)
    sections = [_section(g) for g in groups]
    scale = found.gain * float(np.prod([k for _, k in sections]))
    return _cascade([s for s, _ in sections], scale)


def _grouped(roots: Complex) -> list[list[complex]]:
    """Return complex pairs, real roots two by two, and the one that may be left."""
    pairs = [[complex(r), complex(r).conjugate()] for r in roots[roots.imag > 0.0].tolist()]
    real = sorted((complex(r) for r in roots[roots.imag == 0.0].tolist()), key=abs)
    return pairs + [real[k : k + 2] for k in range(0, len(real), 2)]


def _paired(found: Factored) -> list[_Group]:
    """Give each group of poles zeros near it, so that the sum of distances on a logarithmic scale is least."""
    groups = [_Group(p) for p in _grouped(found.poles)]
    zeros = _grouped(found.zeros)
    split = [z for z in zeros if len(z) == 1]
    for some in ([z for z in zeros if len(z) == 2], split):
        open_ = [g for g in groups if some and g.room >= len(some[0])]
        cost = [[_distance(g.poles, z) for g in open_] for z in some]
        if not cost:
            continue
        rows, columns = linear_sum_assignment(np.array(cost).reshape(len(some), len(open_)))
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            open_[j].zeros += some[i]
    return groups


def _distance(poles: list[complex], zeros: list[complex]) -> float:
    """Return how far the upper members lie apart: ratio of their sizes, and their angles."""
    p, z = (max(roots, key=lambda r: r.imag) for roots in (poles, zeros))
    sizes = math.log(max(abs(p), _LEAST) / max(abs(z), _LEAST))
    return abs(complex(sizes, np.angle(p) - np.angle(z)))


def _section(group: _Group) -> tuple[LinearPart, float]:
    """Return one section of unit size, and the factor it must be multiplied by."""
    w = max(*(abs(p) for p in group.poles), _LEAST)
    a = np.real(np.poly([p / w for p in group.poles]))
    b = np.real(np.poly([z / w for z in group.zeros])) if group.zeros else np.ones(1)
    n = len(group.poles)
    b = np.concatenate([np.zeros(n + 1 - len(b)), b])
    D = float(b[0])
    rest = (b - D * a)[1:]
    A = w * np.vstack([np.eye(n, k=1)[: n - 1], -a[:0:-1]])
    B = np.zeros(n)
    B[-1] = w
    return LinearPart(A, B, rest[::-1].copy(), D), w ** (len(group.zeros) - n)


def _cascade(sections: list[LinearPart], gain: float) -> LinearPart:
    """Return the sections one behind the other."""
    whole = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    for section in sections:
        whole = section.behind(whole)
    return _balanced(replace(whole, C=gain * whole.C, D=gain * whole.D))


def _balanced(part: LinearPart) -> LinearPart:
    """Return the system in states of such units that rows and columns of A, and B and C, are alike in size."""
    even = part.balanced()
    b, c = float(np.linalg.norm(even.B)), float(np.linalg.norm(even.C))
    unit = math.sqrt(c / b) if b and c else 1.0
    return replace(even, A=even.A + 0.0, B=even.B * unit + 0.0, C=even.C / unit + 0.0)  # no zeros with a sign
