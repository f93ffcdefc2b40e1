"""The model in the units of the record, delays included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.analysis.identified.model import IdentifiedModel
from workbench.analysis.subspace.data import Record
from workbench.analysis.subspace.delays import with_chains
from workbench.analysis.subspace.simulated import InputFit
from workbench.analysis.subspace.states import Noise
from workbench.session.base import Floats

__all__ = ["model_of"]


def model_of(
    A: Floats, C: Floats, fit: InputFit, noise: Noise, *, record: Record, delays: tuple[int, ...], dt: float
) -> IdentifiedModel:
    """Return the identified model.

    Args:
        A: shape (n, n).
        C: shape (p, n), of outputs of size one.
        fit: B, D, x0 and constant part of channels of size one.
        noise: likewise.
        record: with the sizes of the channels.
        delays: of the inputs [samples].
        dt: sampling interval [s].
    """
    su, sy = record.u_scale, record.y_scale
    B, C, D = fit.B / su, sy[:, None] * C, sy[:, None] * fit.D / su
    m, p, chain = len(su), len(sy), sum(delays)
    A, B, C, D = with_chains((A, B, C, D), delays)
    model = IdentifiedModel(
        A=A, B=B, C=C, D=D, K=np.vstack([noise.K / sy, np.zeros((chain, p))]),
        x0=np.append(fit.x0, np.zeros(chain)), dt=dt, u0=np.zeros(m), y0=sy * fit.offset,
        covariance=sy[:, None] * noise.covariance * sy, delay=delays if chain else (),
        input_names=tuple(f"u{k + 1}" for k in range(m)), output_names=tuple(f"y{k + 1}" for k in range(p)),
        input_units=(None,) * m, output_units=(None,) * p,
    )  # fmt: skip
    return replace(model, x0=model.initial_state(record.u * su, record.y * sy)) if chain else model
