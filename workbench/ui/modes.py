"""Modes of a linear model: its poles, and which states take part in each."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.core.records.record import plain

__all__ = ["modes_of"]

_MOST = 300  # states of a model whose modes are told
_SHARE = 0.01  # of a mode: a state with less is left out


def modes_of(record: object) -> list[dict[str, Any]]:
    """Return the modes of a linear model, ready for JSON, in order of frequency; empty: the record is none.

    Each has `re` and `im` of its continuous pole [1/s], `hz` (natural frequency), `damping` (ratio) and `states`:
    [name, how much of the mode is in it], the largest first; magnitudes of the participation factors, their sum 1.

    Args:
        record: any.
    """
    from workbench.core.values.modal import poles_of  # noqa: PLC0415 - SciPy, which the first page does not wait for
    from workbench.core.values.poles import damping_ratio, natural_frequency_hz  # noqa: PLC0415
    from workbench.point.lin.result import LinResult  # noqa: PLC0415

    if not isinstance(record, LinResult) or not 0 < len(record.A) <= _MOST:
        return []
    names, poles = record.state_names, poles_of(record.A, dt=record.dt)
    shares = np.abs(poles.participation())
    shares = shares / np.sum(shares, axis=0)
    modes = [
        {
            "re": s.real, "im": s.imag, "hz": natural_frequency_hz(s), "damping": damping_ratio(s),
            "states": [[names[i], shares[i, k]] for i in np.argsort(-shares[:, k]) if shares[i, k] >= _SHARE],
        }
        for k, s in enumerate(poles.value)
    ]  # fmt: skip
    return list(plain(modes))
