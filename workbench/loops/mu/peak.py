"""Upper bound over all frequencies: intervals are proved one by one, so that no peak hides between points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, eigh

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import resolvent
from workbench.errors import SimulationError
from workbench.loops.mu.blocks import MuBlock, columns, scaled
from workbench.loops.mu.upper import Scaling, upper_bound

__all__ = ["Peak", "continued", "level_at", "peak", "response_at"]

_ROUNDS = 4000  # intervals at most
_CLOSE = 0.005  # relative: how near the level is to the least that the scalings prove
_AXIS = 1e-7  # an eigenvalue so near to the imaginary axis, relative to its size, is on it
_PROVED = 0.9  # a bound that leaves so much room is as good as a smaller one
_DOUBLED = 30  # changes of a level
_SHRUNK = 1e-3  # so much of a proved interval is left to the next one, at each end
_NARROW = 1e-10  # relative: of an interval that is narrower rounding leaves nothing


@dataclass(frozen=True)
class Peak:
    """The least level at which a system is proved to bear every perturbation, over a band of frequencies.

    Attributes:
        level: perturbations of the size 1/level are borne; 0: of any size; infinite: nothing is proved.
        frequency_hz: where the level is needed [Hz]; infinite: beyond all frequencies.
        intervals: number of intervals that were proved.
    """

    level: float
    frequency_hz: float
    intervals: int


def peak(
    system: Linear,
    blocks: Sequence[MuBlock],
    band_hz: tuple[float, float] = (0.0, math.inf),
    *,
    close: float = _CLOSE,
    least: float = 0.0,
    enough: float = math.inf,
) -> Peak:
    """Return the least level at which µ(M(jω) S) ≤ 1 is proved over a band; S divides the blocks that vary by it.

    At a frequency the scalings D, G of `upper_bound` prove a level. With them Mᴴ D M + j (G M - Mᴴ G) < D holds as
    far as no eigenvalue of a Hamiltonian matrix is jω: that interval is proved, with all that lies between its ends.
    What is left is proved in the same way; where a higher level is needed, it counts from there on.

    Args:
        system: M, stable; its inputs and outputs are those of the perturbation.
        blocks: of the perturbation.
        band_hz: lowest and highest frequency [Hz].
        close: how near the level is to the least one.
        least: level to begin with: a lower one is not told from it.
        enough: a level above this ends the search.

    Source: C. T. Lawrence, A. L. Tits, P. Van Dooren, A fast algorithm for the computation of an upper bound on the
    µ-norm, Automatica 36 (2000); G. Ferreres, J.-F. Magni, J.-M. Biannic, Robustness analysis of flexible structures:
    practical algorithms, Int. J. Robust and Nonlinear Control 13 (2003).
    """
    if not blocks:
        return Peak(0.0, math.nan, 0)
    m, warp = continued(system), _Warp(system.dt)
    low, high = (warp.there(2.0 * math.pi * f) for f in band_hz)
    own = np.abs(np.linalg.eigvals(m.A)) if len(m.A) else np.zeros(0)
    own = np.unique(own[(own > low) & (own < high)])
    level, where = _first_level(m, blocks, (low, high, *own.tolist()), least, close=close, enough=enough)
    if level > enough or math.isinf(level):
        return Peak(level, warp.back_hz(where), 0)
    level = max(level, 1e-9)  # where nothing is needed, what is proved is as good as any size
    todo, count = [(low, high)], 0
    while todo:
        begin, end = todo.pop()
        omega = _inside(begin, end, own)
        matrix = response_at(m, omega)
        proof = upper_bound(scaled(matrix, blocks, level), blocks, enough=_PROVED)
        if proof.bound >= 1.0 - 0.1 * close:
            level, where = max(level, level_at(matrix, blocks, level, close=close)) * (1.0 + close), omega
            if level > enough or math.isinf(level):
                return Peak(level, warp.back_hz(where), count)
            proof = upper_bound(scaled(matrix, blocks, level), blocks)
        first, last = _proved(m, blocks, level, proof, omega, limits=(begin, end))
        count += 1
        if count > _ROUNDS:
            raise SimulationError(f"robust: {count} intervals of frequency have not proved a level; give a band")
        if not last - first > _NARROW * omega:
            level, where = level * (1.0 + close), omega
            todo.append((begin, end))
            continue
        todo += [(a, b) for a, b in ((begin, first), (last, end)) if a < b]
    return Peak(0.0 if level <= 1e-9 else level, warp.back_hz(where), count)


def _first_level(
    m: Linear, blocks: Sequence[MuBlock], omegas: Sequence[float], least: float, *, close: float, enough: float
) -> tuple[float, float]:
    """Return the level that some frequencies need, and which of them [rad/s]; a level above `enough` ends the search.

    The largest matrix comes first: what it needs is mostly enough for the others.
    """
    level, where = least, omegas[0]
    found = [(omega, response_at(m, omega)) for omega in omegas]
    for omega, matrix in sorted(found, key=lambda pair: -float(np.linalg.norm(pair[1], 2))):
        needed = level_at(matrix, blocks, level, close=close)
        if needed > level:
            level, where = needed * (1.0 + close), omega
        if level > enough:
            break
    return level, where


def level_at(
    matrix: Complex,
    blocks: Sequence[MuBlock],
    known: float = 0.0,
    *,
    start: float = 1.0,
    rounds: int = 30,
    full: bool = True,
    close: float = _CLOSE,
) -> float:
    """Return the least level at one frequency; infinite: the blocks that do not vary are too large by themselves.

    The scalings that prove a level prove a lower one as well, and from there on others are found.

    Args:
        matrix: M there.
        blocks: the structure.
        known: a level that is needed anyway; where it suffices, it is returned.
        start: level to begin with, where none is known.
        rounds: most changes of the scalings.
        full: see `upper_bound`.
        close: relative: how near it is to the least one.
    """
    if all(b.varies for b in blocks):
        return max(known, upper_bound(matrix, blocks, enough=known, full=full).bound)
    level = known or start
    proof = upper_bound(scaled(matrix, blocks, level), blocks, enough=_PROVED, full=full)
    if proof.bound < 1.0 and known > 0.0:
        return known
    if proof.bound >= 1.0 and upper_bound(scaled(matrix, blocks, math.inf), blocks, full=full).bound >= 1.0:
        return math.inf
    for _ in range(_DOUBLED):
        if proof.bound < 1.0:
            break
        level *= max(1.2 * proof.bound, 1.5)
        proof = upper_bound(scaled(matrix, blocks, level), blocks, enough=_PROVED, full=full)
    else:
        return math.inf
    for turn in range(rounds):
        lower = _least(matrix, blocks, level, proof)
        if not lower < level * (1.0 - close):
            break
        level = max(lower * (1.0 + 0.1 * close), known)
        if level <= known or level < 1e-9 or turn == rounds - 1:
            break
        proof = upper_bound(scaled(matrix, blocks, level), blocks, full=full)
        if proof.bound >= 1.0:  # rounding: what was proved before stands
            break
    return level


def _least(matrix: Complex, blocks: Sequence[MuBlock], level: float, proof: Scaling) -> float:
    """Return the least level that scalings prove at a frequency, those for blocks that vary growing with it.

    Of Mᴴ D M + j (G M - Mᴴ G) ≤ diag(t² D of what varies, D of the rest) the rest is taken out by its Schur complement.
    """
    factor = 1.0 / columns(blocks, level)
    g, back = proof.g * factor[:, None], matrix.conj().T
    left = back @ proof.d @ matrix + 1j * (g @ matrix - back @ g)
    varies = np.concatenate([np.full(b.size, b.varies) for b in blocks])
    rest = left[np.ix_(~varies, ~varies)] - proof.d[np.ix_(~varies, ~varies)]
    across, own = left[np.ix_(~varies, varies)], left[np.ix_(varies, varies)]
    try:
        if float(np.linalg.eigvalsh(rest)[-1]) >= 0.0:
            return level
        own = own - across.conj().T @ np.linalg.solve(rest, across)
        largest = float(eigh(own, proof.d[np.ix_(varies, varies)], eigvals_only=True)[-1])
    except (LinAlgError, np.linalg.LinAlgError, ValueError):
        return level
    return math.sqrt(max(largest, 0.0))


def response_at(system: Linear, omega: float) -> Complex:
    """Return M(jω) of a continuous system.

    Args:
        system: M.
        omega: [rad/s]; infinite: its direct part.
    """
    if math.isinf(omega) or not len(system.A):
        return system.D.astype(np.complex128)
    return np.asarray(system.C @ resolvent(system.A, system.B, np.array([1j * omega]))[0] + system.D)


def continued(system: Linear) -> Linear:
    """Return a sampled system as a continuous one, z = (1 + s)/(1 - s): its values on the unit circle are the same.

    Args:
        system: continuous ones stay.
    """
    if system.dt == 0.0:
        return system
    n = len(system.A)
    inverse = np.linalg.inv(system.A + np.eye(n))
    root = math.sqrt(2.0)
    return Linear(
        inverse @ (system.A - np.eye(n)), root * inverse @ system.B, root * system.C @ inverse,
        system.D - system.C @ inverse @ system.B,
    )  # fmt: skip


@dataclass(frozen=True)
class _Warp:
    """Angular frequencies of a system, and of its continuous twin."""

    dt: float

    def there(self, omega: float) -> float:
        """Return the twin's [rad/s]."""
        if self.dt == 0.0:
            return omega
        return math.inf if omega * self.dt >= math.pi * (1.0 - 1e-12) else math.tan(0.5 * omega * self.dt)

    def back_hz(self, omega: float) -> float:
        """Return the system's frequency [Hz]."""
        if self.dt == 0.0:
            return omega / (2.0 * math.pi)
        return 2.0 * math.atan(omega) / self.dt / (2.0 * math.pi)


def _inside(begin: float, end: float, own: Floats) -> float:
    """Return a frequency inside an interval: a natural one, or the middle."""
    some = own[(own > begin) & (own < end)]
    if len(some):
        return float(some[len(some) // 2])
    if math.isinf(end):
        return 2.0 * begin if begin > 0.0 else 1.0
    return math.sqrt(begin * end) if begin > 0.0 else 0.5 * end


def _proved(
    m: Linear, blocks: Sequence[MuBlock], level: float, proof: Scaling, omega: float, *, limits: tuple[float, float]
) -> tuple[float, float]:
    """Return the ends of the interval around a frequency over which its scalings prove the level."""
    begin, end = limits
    crossed = _crossings(m, blocks, level, proof)
    if crossed is None:
        return omega, omega
    below, above = crossed[(crossed <= omega) & (crossed > begin)], crossed[(crossed >= omega) & (crossed < end)]
    first, last = begin, end
    if len(below):
        first = float(below.max()) + _SHRUNK * (omega - float(below.max()))
    if len(above):
        last = float(above.min()) - _SHRUNK * (float(above.min()) - omega)
    for at in (first, last, _inside(first, omega, np.zeros(0)), _inside(omega, last, np.zeros(0))):
        if first <= at <= last and not _holds(response_at(m, at), blocks, level, proof):
            if at < omega:
                first = max(first, 0.5 * (at + omega))
            else:
                last = min(last, 0.5 * (omega + at) if math.isfinite(at) else 2.0 * omega)
    return first, last


def _holds(matrix: Complex, blocks: Sequence[MuBlock], level: float, proof: Scaling) -> bool:
    """Whether the scalings prove the level at a frequency, as near as rounding tells at an interval's end."""
    f = scaled(matrix, blocks, level)
    back = f.conj().T
    left = back @ proof.d @ f + 1j * (proof.g @ f - back @ proof.g) - proof.d
    return bool(np.linalg.eigvalsh(left)[-1] <= 1e-9 * np.linalg.norm(proof.d))


def _crossings(m: Linear, blocks: Sequence[MuBlock], level: float, proof: Scaling) -> Floats | None:
    """Return the frequencies at which the scalings stop to prove the level, of both signs; None: they cannot be had.

    With M = C (sI - A)⁻¹ B + D they are the imaginary eigenvalues of the Hamiltonian matrix of the quadratic form
    (M, I)ᴴ Π (M, I), Π = [D, -jG; jG, -D].
    """
    factor = columns(blocks, level)
    b, direct = m.B * factor, (m.D * factor).astype(np.complex128)
    n = len(direct)
    pi = np.block([[proof.d, -1j * proof.g], [1j * proof.g, -proof.d]])
    through = np.vstack([direct, np.eye(n)])
    c = np.vstack([m.C, np.zeros_like(m.C)]).astype(np.complex128)
    r, s, q = through.conj().T @ pi @ through, c.conj().T @ pi @ through, c.conj().T @ pi @ c
    if not np.isfinite(r).all() or np.linalg.cond(r) > 1e13:
        return None
    solved = np.linalg.solve(r, np.hstack([s.conj().T, b.T.astype(np.complex128)]))
    k = len(m.A)
    by_state, by_costate = solved[:, :k], solved[:, k:]
    state = m.A - b @ by_state
    hamiltonian = np.block([[state, -b @ by_costate], [-q + s @ by_state, -state.conj().T]])
    values = np.linalg.eigvals(hamiltonian)
    near = np.abs(values.real) <= _AXIS * (np.abs(values) + 1e-3 * float(np.abs(np.diag(m.A)).max(initial=0.0)))
    return np.asarray(values[near].imag, dtype=np.float64)
