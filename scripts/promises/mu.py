"""Whether the bounds of µ hold the truth: random matrices whose µ is known in closed form, or by another method.

Five kinds: dyads with real numbers, complex numbers and full blocks (exact by the support function of what they can
reach); 2 × 2 with two complex numbers (by the phase between them); a real matrix with one number that is repeated (by
its real eigenvalues); real matrices with two to four real numbers (attained at a corner); one full block (largest
singular value).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.core.values.arrays import Complex
from workbench.loops.mu.blocks import MuBlock, places
from workbench.loops.mu.lower import lower_bound
from workbench.loops.mu.upper import upper_bound

_Case = tuple[Complex, list[MuBlock], float]
_ROUNDING = 1e-6  # relative: of the truth by another method


def run(*, cases: int = 200, seed: int = 1) -> int:
    """Print how near the bounds are to the truth; return 1 if one is on the wrong side, or the gap is often large.

    Args:
        cases: matrices.
        seed: of the first.
    """
    random = np.random.default_rng(seed)
    wrong, gaps = 0, []
    for name, make in itertools.islice(itertools.cycle(KINDS.items()), cases):
        matrix, blocks, truth = make(random)
        upper, lower = upper_bound(matrix, blocks).bound, lower_bound(matrix, blocks).bound
        holds = lower <= truth * (1.0 + _ROUNDING) + 1e-9 and truth <= upper * (1.0 + _ROUNDING) + 1e-9
        wrong += not holds
        gaps.append((name, lower, truth, upper))
        if not holds:
            print(f"{name}: {lower:.6g} ≤ {truth:.6g} ≤ {upper:.6g} does not hold")
    for name in KINDS:
        of = [g for g in gaps if g[0] == name]
        above = sorted(upper / truth - 1.0 if truth > 0.0 else upper for _, _, truth, upper in of)
        below = sorted(1.0 - lower / truth if truth > 0.0 else 0.0 for _, lower, truth, _ in of)
        if of:
            middle = len(of) // 2
            print(f"{name}: upper above the truth by {above[middle]:.2%} (worst {above[-1]:.2%}), "
                  f"lower below by {below[middle]:.2%} (worst {below[-1]:.2%})")  # fmt: skip
    close = sum(upper - lower <= 0.05 * max(upper, 1e-12) for _, lower, _, upper in gaps) / len(gaps)
    print(f"{wrong} of {cases} on the wrong side; gap ≤ 5 % in {close:.0%}")
    return int(wrong > 0 or close < 0.9)


def dyad(random: np.random.Generator) -> _Case:
    """Return M = u vᴴ with blocks of all kinds: det(I - M Δ) = 1 - vᴴ Δ u."""
    blocks = [
        MuBlock(size=int(random.integers(1, 3)), real=bool(random.integers(0, 2))) for _ in range(random.integers(1, 5))
    ]
    n = sum(b.size for b in blocks)
    u, v = (random.standard_normal(n) + 1j * random.standard_normal(n) for _ in range(2))
    reached, radius = list[complex](), 0.0
    for block, at in places(blocks):
        if block.real:
            reached.append(complex(np.vdot(v[at], u[at])))
        else:
            radius += float(np.linalg.norm(u[at]) * np.linalg.norm(v[at]))
    return np.outer(u, v.conj()), blocks, _support(reached, radius)


def _support(reached: list[complex], radius: float) -> float:
    """Return the largest real number in the sum of segments ± c and a disk: the least of its supports over cos θ."""

    def height(slope: float) -> float:
        return sum(abs(c.real + slope * c.imag) for c in reached) + radius * math.hypot(1.0, slope)

    corners = [-c.real / c.imag for c in reached if c.imag] or [0.0]
    reach = 10.0 * max(1.0, *(abs(x) for x in corners))
    found = minimize_scalar(height, bounds=(-reach, reach), method="bounded", options={"xatol": 1e-12})
    return min(float(found.fun), *(height(x) for x in (*corners, 0.0)))


def two_complex(random: np.random.Generator) -> _Case:
    """Return a 2 × 2 matrix with two complex numbers: µ is the largest ρ(M diag(1, e^jφ))."""
    m = random.standard_normal((2, 2)) + 1j * random.standard_normal((2, 2))

    def radius(phase: float) -> float:
        return float(np.abs(np.linalg.eigvals(m * np.array([1.0, np.exp(1j * phase)]))).max())

    grid = np.linspace(0.0, 2.0 * np.pi, 361)
    best = float(grid[np.argmax([radius(p) for p in grid])])
    found = minimize_scalar(lambda p: -radius(p), bounds=(best - 0.02, best + 0.02), method="bounded",
                            options={"xatol": 1e-12})  # fmt: skip
    return m, [MuBlock(size=1), MuBlock(size=1)], max(-float(found.fun), radius(best))


def repeated(random: np.random.Generator) -> _Case:
    """Return a real matrix with one real number that is repeated: µ is its largest real eigenvalue."""
    n = int(random.integers(2, 5))
    m = random.standard_normal((n, n))
    values = np.linalg.eigvals(m)
    real = np.abs(values[np.abs(values.imag) < 1e-9 * np.abs(values)])
    return m.astype(np.complex128), [MuBlock(size=n, real=True)], float(real.max(initial=0.0))


def corners(random: np.random.Generator) -> _Case:
    """Return a real matrix with real numbers: the determinant, linear in each, is first 0 at a corner."""
    n = int(random.integers(2, 5))
    m = random.standard_normal((n, n))
    best = 0.0
    for signs in itertools.product((-1.0, 1.0), repeat=n):
        values = np.linalg.eigvals(m * np.array(signs))
        best = max(best, float(np.abs(values[np.abs(values.imag) < 1e-9 * np.abs(values)]).max(initial=0.0)))
    return m.astype(np.complex128), [MuBlock(size=1, real=True)] * n, best


def full(random: np.random.Generator) -> _Case:
    """Return a matrix with one full complex block: µ is the largest singular value."""
    n = int(random.integers(1, 5))
    m = random.standard_normal((n, n)) + 1j * random.standard_normal((n, n))
    return m, [MuBlock(size=n)], float(np.linalg.norm(m, 2))


KINDS: Mapping[str, Callable[[np.random.Generator], _Case]] = {
    "dyad": dyad, "two complex": two_complex, "repeated": repeated, "corners": corners, "full": full,
}  # fmt: skip
