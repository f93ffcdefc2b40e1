"""The estimator of a bootstrap: the poles that the same identification finds in another record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.identification.subspace.data import prepare
from workbench.identification.subspace.delays import advance, as_tuple
from workbench.identification.subspace.hankel import factorise
from workbench.identification.subspace.matrices import shifted_observability
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.subspace.states import fit_states
from workbench.identification.subspace.weightings import project, subspace

__all__ = ["Estimator", "same_settings"]


# Of u (N, m) and y (N, p), operating point taken off → poles, shape (n,).
Estimator = Callable[[Floats, Floats], Complex]


def same_settings(result: SubspaceEstimate) -> Estimator:
    """Return what identifies poles as `result` was made: method, basis, order, horizon, delay, bias.

    Of the identification only what the poles need is done, which is several times quicker. The horizon is that
    which was taken; replicates do not search for one again. Poles outside the unit circle stay there, also where the
    result's were moved: a region that reaches across the circle is to be seen.

    Args:
        result: of the subspace identification.
    """
    return _SameSettings(
        delays=as_tuple(result.model.delay or 0, len(result.model.u0)),
        horizon=result.horizon,
        method=result.method,
        basis=result.basis,
        biased=result.biased,
        order=result.order,
    )


@dataclass(frozen=True, kw_only=True)
class _SameSettings:
    """Identifies poles; see `same_settings`."""

    delays: tuple[int, ...]
    horizon: int
    method: str
    basis: str
    biased: bool
    order: int

    def __call__(self, u: Floats, y: Floats) -> Complex:
        record = prepare(u, y)
        factor = factorise(*advance(record.u, record.y, self.delays), self.horizon)
        space = subspace(project(factor), self.method, self.basis)
        if self.biased:
            A = fit_states(factor, space.memory[: self.order], feedthrough=True).A
        else:
            A, _ = shifted_observability(space.observability[:, : self.order], factor.outputs)
        found = np.linalg.eigvals(A).astype(np.complex128)
        return np.append(found, np.zeros(sum(self.delays)))
