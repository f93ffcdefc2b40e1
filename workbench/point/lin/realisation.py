"""State-space models from Markov parameters, and from discrete to continuous time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["Realisation", "realise"]

LARGEST_BLOCK = 150  # rows and columns of blocks in the Hankel matrix
LARGEST_ORDER = 80
SMALLEST = 1e-8
PLATEAU = 20.0
LOUD = 0.02  # of a scaled response: outputs with more noise do not decide the order


@dataclass(frozen=True, eq=False)
class Realisation:
    """A discrete model that reproduces Markov parameters.

    Attributes:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (q, n).
        D: shape (q, m).
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats

    def truncated(self, order: int) -> Realisation:
        """Return the realisation of a lower order: the states of the largest singular values.

        Args:
            order: from 0 to that of the model.
        """
        return replace(self, A=self.A[:order, :order], B=self.B[:order], C=self.C[:, :order])


def realise(markov: Floats, *, noise: float | Floats, order: int | None = None) -> Realisation:
    """Return the model that reproduces Markov parameters: h(0) = D, h(k) = C A^(k−1) B.

    Every output and input is scaled to its own largest parameter; an output whose noise is far above the others' is
    scaled down to it, so that it does not hide what they show. The order is the number of singular values of the
    Hankel matrix above what errors of size `noise` in its elements can make of zero, above 20 times their median (a
    plateau is the solver's error, not dynamics) and above 1e-8 of the largest.

    Args:
        markov: shape (k, q, m), k ≥ 4.
        noise: error of the parameters, for each output and input, shape (q, m), or one for all.
        order: instead of the one chosen.

    Raises:
        InputError: an order that the parameters cannot carry.

    Source: J.-N. Juang and R. S. Pappa, An eigensystem realization algorithm for modal parameter identification and
    model reduction, J. Guidance 8 (1985); python-control's `eigensys_realization`.
    """
    import control  # noqa: PLC0415 - slow to import, and for co-simulation only

    k, q, m = markov.shape
    size = min(LARGEST_BLOCK, (k - 1) // 2)
    used = markov[: 2 * size + 1]  # of an unstable model, what comes later would make it look like nothing
    outer = _sizes(used, axis=(0, 2))
    inner = _sizes(used / outer[None, :, None], axis=(0, 1))
    own = (np.broadcast_to(noise, (q, m)) / outer[:, None] / inner).max(axis=1)
    quiet = own[own <= LOUD]
    level = float(quiet.max() if len(quiet) else own.min())
    outer = outer * np.maximum(1.0, own / max(level, np.finfo(float).tiny))
    scaled = used / outer[None, :, None] / inner[None, None, :]
    data = np.moveaxis(scaled, 0, -1)
    if not scaled[1:].any():
        return _static(markov)
    _, values = control.eigensys_realization(data, 1, m=size, n=size)
    values = np.asarray(values, dtype=np.float64)
    from_noise = max(level, 1e-14) * size * np.sqrt(q * m) * 2.0
    floor = max(from_noise, SMALLEST * values[0], PLATEAU * float(np.median(values)))
    chosen = int((values > floor).sum()) if order is None else order
    most = min(LARGEST_ORDER, size * min(q, m), len(values))
    if order is not None and not 0 < order <= most:
        raise InputError(f"order must be between 1 and {most} for {k} points, not {order}")
    chosen = min(chosen, most)
    if chosen == 0:
        return _static(markov)
    system, _ = control.eigensys_realization(data, chosen, m=size, n=size)
    A, B, C = (np.asarray(x, dtype=np.float64) for x in (system.A, system.B * inner, outer[:, None] * system.C))
    return Realisation(A, B, C, markov[0])


def _sizes(values: Floats, axis: tuple[int, ...]) -> Floats:
    largest = np.abs(values).max(axis=axis)
    result: Floats = np.where(largest > 0.0, largest, 1.0)
    return result


def _static(markov: Floats) -> Realisation:
    _, q, m = markov.shape
    return Realisation(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((q, 0)), markov[0])
