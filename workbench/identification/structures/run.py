"""Identify a linear block with static blocks; see `IdentifyStructure`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identify.data import chosen, cut
from workbench.identification.identify.request import Identify
from workbench.identification.identify.result import IdentifyResult
from workbench.identification.identify.run import run as identify_linear
from workbench.identification.prediction.innovations import Innovations
from workbench.identification.prediction.start import plant_alone
from workbench.identification.structures.refine import Fitted, PiecewiseLinearBlock, WienerHammersteinModel, fitted
from workbench.identification.structures.request import IdentifyCommand, IdentifyStructure
from workbench.identification.structures.result import StructureResult, Tried
from workbench.identification.structures.start import (
    placed,
    rescaled,
    starts_before,
    straight,
    with_before,
    with_behind,
)
from workbench.identification.structures.table import StaticTable
from workbench.identification.subspace.record import advance, with_chains
from workbench.jobs.job import Job

__all__ = ["run", "run_command"]

_KNOTS = (4, 6, 8, 11, 15, 20)  # that auto tries
_EACH = 20  # samples a knot at least, where orders are compared
_IN_A_ROW = 2  # without an improvement that end a search; two, as a pair of poles may be worth what one pole is not

# Share of the innovations' variance that a further state must explain, beside its price in the Bayesian criterion: with
# little noise what is left is the difference of a table and a curve, and any state explains some of that. So orders are
# compared with many knots, too.
_WORTH = 0.02


def run(data: Experiment | str | Path, request: IdentifyStructure, job: Job) -> StructureResult:
    """Identify the blocks; see `IdentifyStructure`."""
    names = [None if name is None else [name] for name in (request.input, request.output)]
    record = cut(chosen(data, names[0], names[1], request.dt), request.settle)
    _check(record, request)
    linear = _linear(record, request, request.order)
    scaled = _Scaled.of(record, request.delay)
    counts = _KNOTS if request.knots == "auto" else (int(request.knots),)
    many = max((n for n in counts if n * _EACH <= len(scaled.u)), default=counts[0])
    search = _StructureSearch(scaled, linear.model, request)
    orders = range(1, min(search.order + _IN_A_ROW, request.max_order) + 1) if request.order == "auto" else ()
    steps = 1 + len(orders) + len(counts)
    job.done("linear model", 1, steps)
    with one_thread():
        alone = Tried(order=search.order, knots=0, criterion=search.alone())
        of_orders, best = _searched(
            (
                None if s is None else s.trial(many, job, k, steps)
                for k, s in enumerate(_of_orders(orders, scaled, record, request), 2)
            ),
            _WORTH * len(scaled.u),
        )
        search = search if best is None else best.search
        of_knots, _ = _searched(search.trial(n, job, k, steps) for k, n in enumerate(counts, 2 + len(orders)))
    trials = list(dict.fromkeys([*of_orders, *of_knots]))
    result = [t.fit for t in trials if t.search is search]
    if not result:
        raise InputError(f"{record.name}: no model of this structure has a finite output on these data")
    tried = sorted((t.tried for t in trials), key=lambda t: (t.order, t.knots))
    return _result(min(result, key=lambda fit: fit.criterion), [alone, *tried], scaled, linear, request)


def _of_orders(
    orders: Iterable[int], scaled: _Scaled, record: Experiment, request: IdentifyStructure
) -> Iterator[_StructureSearch | None]:
    """Yield a search for each order; None: the input does not excite enough for a linear model of this order."""
    for n in orders:
        try:
            yield _StructureSearch(scaled, _linear(record, request, n).model, request)
        except InputError:
            yield None


def _linear(record: Experiment, request: IdentifyStructure, order: int | Literal["auto"]) -> IdentifyResult:
    """Return the linear model of the data that have no static block."""
    return Identify(
        order=order, validation=request.validation, max_order=request.max_order, feedthrough=request.feedthrough,
        delay=request.delay, dt=request.dt,
    ).run(record, Job())  # fmt: skip


def run_command(data: Experiment | str | Path, request: IdentifyCommand, job: Job) -> IdentifyResult | StructureResult:
    """Identify a linear model, or one with static blocks; see `IdentifyCommand`."""
    return identify_linear(data, request, job) if request.structure is None else run(data, request.blocks, job)


def _check(record: Experiment, request: IdentifyStructure) -> None:
    if record.n_inputs != 1 or record.n_outputs != 1:
        raise InputError(
            f"{record.name}: {request.structure} is for one input and one output, not {record.n_inputs} and "
            f"{record.n_outputs}; name one of each"
        )
    levels = len(np.unique(np.round(record.u[:, 0] / max(float(np.ptp(record.u)), 1e-300), 6)))
    if request.structure != "wiener" and levels < 3:
        raise InputError(
            f"{record.name}: the input {record.input_names[0]} has {levels} levels, which show {levels} points of a "
            "static block before the linear one; excite with more (multisine, or several amplitudes)"
        )


@dataclass(frozen=True, eq=False)
class _Scaled:
    """The record with mean 0 and size 1, the delay taken out.

    Attributes:
        u, y: shape (N,).
        means: of input and output.
        sizes: standard deviations.
    """

    u: Floats
    y: Floats
    means: tuple[float, float]
    sizes: tuple[float, float]

    @classmethod
    def of(cls, record: Experiment, delay: int) -> _Scaled:
        means = float(record.u.mean()), float(record.y.mean())
        sizes = float(record.u.std()), float(record.y.std())
        u, y = advance((record.u - means[0]) / sizes[0], (record.y - means[1]) / sizes[1], (delay,))
        return cls(u[:, 0], y[:, 0], means, sizes)


@dataclass(frozen=True, eq=False)
class _OrderTrial:
    """What was found with one order and number of knots.

    Attributes:
        search: of this order.
        knots: how many.
        fit: the best one.
    """

    search: _StructureSearch
    knots: int
    fit: Fitted

    @property
    def tried(self) -> Tried:
        """What the result tells of it."""
        return Tried(order=self.search.order, knots=self.knots, criterion=self.fit.criterion)


def _searched(trials: Iterable[_OrderTrial | None], worth: float = 0.0) -> tuple[list[_OrderTrial], _OrderTrial | None]:
    """Return the trials, made until so many in a row gain nothing, and the best of them.

    Args:
        trials: from simple to rich; None: there is no fit.
        worth: what one must gain in its criterion to be better than a simpler one.
    """
    made: list[_OrderTrial] = []
    best, worse = None, 0
    for trial in trials:
        if trial is not None:
            made.append(trial)
            better = best is None or trial.fit.criterion < best.fit.criterion - worth
            best, worse = (trial, 0) if better else (best, worse + 1)
        if worse >= _IN_A_ROW:
            break
    return made, best


class _StructureSearch:
    """Fits of one structure with a linear block of one order."""

    def __init__(self, scaled: _Scaled, model: IdentifiedModel, request: IdentifyStructure) -> None:
        self.u, self.y, self.asked = scaled.u, scaled.y, request
        core, (su, sy) = model.undelayed(), scaled.sizes
        self.order = len(core.A)
        self._made: dict[int, _OrderTrial | None] = {}
        free = request.feedthrough
        self.linear = plant_alone((core.A, core.B * su, core.C / sy, core.D * su / sy), feedthrough=free)
        powers = starts_before(len(core.A), self.u, self.y, feedthrough=free)
        self.blocks: tuple[Innovations, ...] = (self.linear,) if powers is None else (self.linear, powers)

    def alone(self) -> float:
        """Return the criterion of the linear block alone."""
        result = fitted(WienerHammersteinModel(None, self.linear, None), self.u, self.y)
        return float("inf") if result is None else result.criterion

    def trial(self, count: int, job: Job, done: int, steps: int) -> _OrderTrial | None:
        """Return the best fit with so many knots; None: there is none.

        Args:
            count: of knots.
            job: is told.
            done: steps that are then done.
            steps: of all.
        """
        if count not in self._made:
            result = [fit for fit in _FITS[self.asked.structure](self, count) if fit is not None]
            best = min(result, key=lambda fit: fit.criterion, default=None)
            self._made[count] = None if best is None else _OrderTrial(self, count, best)
        job.done(f"order {self.order}, {count} knots", done, steps)
        return self._made[count]

    def hammerstein(self, count: int) -> Iterator[Fitted | None]:
        """Yield fits with a block before the linear one, from each start."""
        for block in self.blocks:
            yield fitted(with_before(block, self.u, self.y, count), self.u, self.y)

    def wiener(self, count: int) -> Iterator[Fitted | None]:
        """Yield fits with a block behind the linear one, the last with knots where its input is."""
        first = fitted(with_behind(self.linear, self.u, self.y, count), self.u, self.y)
        if first is not None:
            yield self._placed(first, count)

    def both(self, count: int) -> Iterator[Fitted | None]:
        """Yield fits with both, each from the one with one block only."""
        starts = [placed(fit.chain, self.u, self.y, count) for fit in self.hammerstein(count) if fit is not None]
        behind = [fit.chain for fit in self.wiener(count) if fit is not None]
        starts += [replace(chain, before=straight(self.u, count)) for chain in behind]
        for start in starts:
            first = fitted(start, self.u, self.y)
            if first is not None:
                yield self._placed(first, count)

    def _placed(self, first: Fitted, count: int) -> Fitted | None:
        """Return the fit with knots where the last block's input is, its scale that of the data it ends with."""
        result = fitted(placed(first.chain, self.u, self.y, count), self.u, self.y)
        return None if result is None else fitted(rescaled(result.chain, self.u), self.u, self.y)


_ENOUGH = f"a further state would explain less than {_WORTH:.0%} of what the blocks leave"
_FITS: Mapping[str, Callable[[_StructureSearch, int], Iterator[Fitted | None]]] = {
    "hammerstein": _StructureSearch.hammerstein,
    "wiener": _StructureSearch.wiener,
    "hammerstein-wiener": _StructureSearch.both,
}


# -- back in the units of the data -----------------------------------------------------------------


def _result(
    best: Fitted, tried: list[Tried], scaled: _Scaled, linear: IdentifyResult, request: IdentifyStructure
) -> StructureResult:
    before, behind, record = best.chain.before, best.chain.behind, linear.data
    first = 0 if before is None else before.free.shape[1]
    last = len(best.covariance) - (0 if behind is None else behind.free.shape[1])
    root = np.linalg.cholesky(best.covariance + 1e-15 * np.trace(best.covariance) * np.eye(len(best.covariance)))
    other = None if request.validation is None else linear.validation.data
    result = StructureResult(
        structure=request.structure,
        before=_table(before, root[:first], scaled.means[0], scaled.sizes[0]),
        linear=_model(best, root[first:last], scaled, record, request.delay),
        behind=_table(behind, root[last:], scaled.means[1], scaled.sizes[1]),
        knots=max(len(t.knots) for t in (before, behind) if t is not None),
        tried=tuple(tried),
        order_reason="given" if request.order != "auto" else _ENOUGH,
        noise_order=len(best.colour),
        noise_rms=scaled.sizes[1] * float(np.sqrt(best.variance)),
        settled=best.settled,
        data=record,
        other=other,
        simulated=np.zeros(0),
        linear_fit_percent=linear.fit_percent,
        notes=tuple(record.notes),
    )
    judged = result.judged
    result = replace(result, simulated=result.simulate(judged.u[:, 0], judged.y[:, 0]))
    return replace(result, notes=(*result.notes, *_notes(result, tried, linear)))


def _table(table: PiecewiseLinearBlock | None, root: Floats, mean: float, size: float) -> StaticTable | None:
    if table is None:
        return None
    spread = np.linalg.norm(table.free @ root, axis=1)
    return StaticTable(x=mean + size * table.knots, y=mean + size * table.values, spread=size * spread)


def _model(best: Fitted, root: Floats, scaled: _Scaled, record: Experiment, delay: int) -> IdentifiedModel:
    """Return the linear block between the units of input and output."""
    fit, (su, sy), (mu, my) = best.chain.linear, scaled.sizes, scaled.means
    n, count = len(fit.A), root.shape[1]
    every = np.zeros((sum(part.size for part in fit.parts), count))
    every[best.chain.entries()] = best.coordinates @ root
    sizes = np.cumsum([0, *(part.size for part in fit.parts)])
    A, B, _, C, D = (every[a:b] for a, b in pairwise(sizes[:6]))
    spread = np.concatenate([A, B / su, sy * C, sy / su * D])
    matrices = with_chains((fit.A, fit.B / su, sy * fit.C, sy / su * fit.D), (delay,))
    return IdentifiedModel(
        A=matrices[0], B=matrices[1], C=matrices[2], D=matrices[3], K=np.zeros((n + delay, 1)),
        x0=np.append(fit.x0, np.zeros(delay)), dt=record.dt, u0=np.array([mu]), y0=my + sy * fit.offset,
        covariance=np.array([[sy**2 * best.variance]]), input_names=record.input_names,
        output_names=record.output_names, input_units=record.input_units, output_units=record.output_units,
        delay=(delay,) if delay else (), name=record.name, spread=spread,
    )  # fmt: skip


def _notes(result: StructureResult, tried: list[Tried], linear: IdentifyResult) -> Iterator[str]:
    """Yield what a user should know."""
    if not result.pays and not result.failed:
        yield "the linear model alone has the lower Bayesian criterion: these data show no static block of this kind"
    counts = {t.knots for t in tried if t.knots}
    if len(counts) > 1 and result.knots >= max(counts):
        yield f"{result.knots} knots are the most that were tried: the block may bend more than it can"
    if not result.settled:
        yield "the fit did not come to its end, or the data leave a parameter open; errors are those where it stopped"
    if linear.closed_loop:
        yield "the data come from a closed loop: the blocks are biased"
    if result.other is None:
        yield "judged on the data of the fit, which makes the model look too good; give other data (`validation`)"
