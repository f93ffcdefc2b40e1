"""Make experiments out of the samples that a run gave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import crest_factors, cross_correlation
from workbench.data.excite.recording import Begin, Samples
from workbench.data.excite.request import Excite
from workbench.data.excite.result import ExciteResult, SignalFacts
from workbench.data.experiment.experiment import Experiment, make_experiment
from workbench.model import Model
from workbench.model.names import declared_units

__all__ = ["assemble"]

CORRELATED = 0.2  # two inputs more alike than this are hard to tell apart


def assemble(
    model: Model, asked: Excite, begin: Begin, pieces: Sequence[Samples], *, notes: Sequence[str]
) -> ExciteResult:
    """Return the result of a run, also of one that ended early.

    Args:
        model: what ran.
        asked: the experiment.
        begin: what was known before.
        pieces: the samples, in their order; two of the identification part at least.
        notes: found out while it ran.
    """
    u, y = np.vstack([p.u for p in pieces]), np.vstack([p.y for p in pieces])
    # Times are told to the digits that are meant: 0.066, not 0.06600000000000002.
    rows = (np.round(begin.time + begin.sampling.dt * np.arange(len(u)), 12), u, y)
    first, second = begin.sequences.identification, begin.sequences.validation
    start = len(first.values)
    identification = _part(model, asked, rows, slice(first.skip, start))
    validation = None
    if second is not None and len(u) >= start + second.skip + 2:
        validation = _part(model, asked, rows, slice(start + second.skip, None))
    facts = _facts(begin, identification)
    every = [*begin.sampling.notes, *begin.sequences.notes, *begin.notes, *_doubts(facts), *_missing(begin, u), *notes]
    return ExciteResult(
        model=model.name,
        interface=model.interface,
        solver=model.solver,
        identification=identification,
        validation=validation,
        design=facts,
        u0=dict(zip(asked.inputs, begin.u0.tolist(), strict=True)),
        y0=dict(zip(asked.outputs, begin.y0.tolist(), strict=True)),
        notes=tuple(dict.fromkeys(every)),
        operating_point=begin.operating_point,
    )


def _part(model: Model, asked: Excite, rows: tuple[Floats, Floats, Floats], chosen: slice) -> Experiment:
    time, u, y = rows
    known = declared_units(model, [*asked.inputs, *asked.outputs])
    return make_experiment(
        time[chosen],
        u[chosen],
        y[chosen],
        input_names=asked.inputs,
        output_names=asked.outputs,
        input_units=[known[n] for n in asked.inputs],
        output_units=[known[n] for n in asked.outputs],
        name=model.name,
        loops=model.closed_loops([*asked.inputs, *asked.outputs], until=float(time[-1])),
    )


def _facts(begin: Begin, identification: Experiment) -> SignalFacts:
    sequences, dt = begin.sequences, begin.sampling.dt
    alike = cross_correlation(identification.u)
    return SignalFacts(
        kind=sequences.kind,
        dt=dt,
        period=sequences.period,
        clock=sequences.clock,
        order=sequences.order,
        lines=sequences.lines,
        band=sequences.band,
        amplitude=tuple((0.5 * np.ptp(identification.u, axis=0)).tolist()),
        crest_factor=crest_factors(identification.u),
        cross_correlation=None if alike is None else alike[0],
        cross_correlation_lag=None if alike is None else alike[1] * dt,
    )


def _doubts(facts: SignalFacts) -> list[str]:
    if facts.cross_correlation is None or facts.cross_correlation <= CORRELATED:
        return []
    where = f"{facts.cross_correlation:.2g} at a lag of {facts.cross_correlation_lag:.4g} s"
    return [f"two inputs are correlated ({where}): record longer, or use a higher rate"]


def _missing(begin: Begin, u: Floats) -> list[str]:
    return [] if len(u) == begin.total else [f"ended early: {len(u)} of {begin.total} samples were recorded"]
