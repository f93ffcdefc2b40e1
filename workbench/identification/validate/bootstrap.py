"""Confidence of the poles by a moving-block bootstrap of the innovations."""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from workbench.core.machine.blas import one_thread
from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identified.recursion import march
from workbench.identification.validate.estimator import Estimator
from workbench.identification.validate.regions import PoleRegion, pole_regions
from workbench.jobs.options import Workers
from workbench.jobs.runner import InProcess, Reply, Runner
from workbench.jobs.runner_choice import runner_for
from workbench.requests.decorator import with_origin
from workbench.show.result import Result

__all__ = ["PoleBootstrap", "bootstrap_poles", "match", "match_clouds"]


# -- which pole of one model is which of another ---------------------------------------------------


REPLICATES = 200
LEAST = 20  # replicates that must have worked out
_AT_ONCE = 4_000_000  # numbers of simulated outputs and states held at a time


@dataclass(frozen=True, eq=False, kw_only=True)
class PoleBootstrap(Result):
    """Poles of many models identified from records like the one measured.

    Attributes:
        regions: region of each pole, in the order of the model's poles (without those of delays).
        replicates: shape (R, n), poles found, in the same order.
        confidence: confidence of the regions.
        joint: all regions together hold the true poles with this confidence, else each for itself.
        block: length of the blocks [samples].
        failed: replicates without a model.
        dt: sampling interval [s].
        seed: seed of the random numbers.
    """

    _page = "workbench.identification.validate.page:bootstrap_page"
    _picture = "workbench.identification.validate.picture_poles:plot_bootstrap"

    regions: tuple[PoleRegion, ...]
    replicates: Complex = field(metadata=entry(key="replicate_poles", dims=("replicate", "pole")))
    confidence: float
    joint: bool
    block: int
    failed: int
    dt: float
    seed: int

    @property
    def determined(self) -> int:
        """How many poles the data determine."""
        return sum(r.determined for r in self.regions)

    @property
    def words(self) -> tuple[str, ...]:
        """What was found, one line each."""
        level = f"{100.0 * self.confidence:g} %"
        if not self.regions:
            return ("a gain has no poles to bootstrap",)
        lines = [_words(r, level) for r in self.regions if r.pole.imag >= 0.0]
        loose = len(self.regions) - self.determined
        if loose:
            lines.append(
                f"order {len(self.regions)} is more than these data determine: {loose} of the poles may be anywhere; "
                f"try order {max(self.determined, 1)}"
            )
        if self.failed:
            lines.append(f"{self.failed} bootstrap replicates gave no model")
        return tuple(lines)

    def holds(self, pole: complex, z: complex) -> bool:
        """Return whether z lies in the region of the estimate nearest to `pole`.

        Args:
            pole: pole of the model.
            z: on the plane of discrete poles.
        """
        nearest = min(self.regions, key=lambda r: abs(r.pole - pole))
        return nearest.contains(z)

    def holds_all(self, poles: Complex) -> bool:
        """Return whether the poles of a system can be shared out so that each lies in a region of its own.

        Args:
            poles: shape (n,).
        """
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import

        outside = np.array([[not r.contains(complex(z)) for z in poles] for r in self.regions], dtype=np.float64)
        rows, columns = linear_sum_assignment(outside)
        return len(poles) == len(self.regions) and not np.any(outside[rows, columns])

    def derived(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"replicates": len(self.replicates), "words": self.words}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each replicate."""
        yield [f"{part} {k + 1}" for k in range(len(self.regions)) for part in ("real", "imaginary")]
        table = np.stack([self.replicates.real, self.replicates.imag], axis=-1)
        yield from table.reshape(len(self.replicates), -1).tolist()


@with_origin()
def bootstrap_poles(
    model: IdentifiedModel,
    data: Experiment,
    estimator: Estimator,
    *,
    replicates: int = REPLICATES,
    block: int | None = None,
    confidence: float = 0.95,
    joint: bool = True,
    seed: int = 0,
    workers: Workers | None = None,
) -> PoleBootstrap:
    """Return confidence regions of a model's poles.

    The one-step prediction errors of the model (its simulation errors, where the predictor does no better) are put
    together anew from blocks that begin anywhere in the record, and drive the model beside the measured input; from
    each such record the poles are identified again. What the estimator does to the true system it does to the model, so
    that the scatter of the replicates about the model's poles is that of the estimate about the true ones. Blocks keep
    what colour is left in the errors (Künsch, Annals of Statistics 17, 1989); the errors are scaled up by √(N/(N − k))
    for k fitted numbers for each output, since those of a fit are too small.

    Not for: an order above what the data determine (the result says so, see `regions`); an order too low, also for the
    disturbance: one with a pole of its own biases the poles of a model that has no room for it, and no bootstrap sees
    that (residuals that are not white do); unstable models; systems that are not linear, whose errors depend on the
    input: they are drawn as if they did not.

    Args:
        model: identified from `data`.
        data: recorded data with the model's channels.
        estimator: of u (N, m) and y (N, p) → poles, shape (n,), with the settings that the model was made with;
            `same_settings` makes it.
        replicates: R.
        block: length of the blocks [samples]; None: N^(1/3), as Künsch's theory has it.
        confidence: confidence of the regions.
        joint: all regions together hold the true poles with this confidence; False: each for itself.
        seed: seed of the random numbers.
        workers: where the replicates are identified; None: one after the other in this process.

    Raises:
        InputError: settings out of range, an estimator that cannot be sent to other processes, an unstable
            model, most replicates without a model of the same order.

    Examples:
        >>> import numpy as np
        >>> u, noise = np.random.default_rng(0).standard_normal((2, 500))
        >>> y = np.zeros(500)
        >>> for k in range(499):
        ...     y[k + 1] = 0.5 * y[k] + u[k] + 0.1 * noise[k]
        >>> def poles(u, y):
        ...     return np.linalg.eigvals(wb.estimate(u, y, 0.1, order=1).model.A)
        >>> data = wb.make_experiment(0.1, u, y)
        >>> found = wb.bootstrap_poles(wb.estimate(u, y, 0.1, order=1).model, data, poles, replicates=50)
        >>> print(found.regions[0].contains(0.5))
        True
    """
    _check(model, data, replicates, block, confidence)
    drawn = _ReplicateDrawing(replicates, block or max(1, round(data.n_samples ** (1.0 / 3.0))), seed)
    found = _again(model, data, estimator, drawn, workers or Workers(in_process=True))
    return _gathered(model, found, drawn, confidence=confidence, joint=joint)


@dataclass(frozen=True)
class _ReplicateDrawing:
    """How records are put together: how many, of blocks of which length [samples], by which seed."""

    replicates: int
    length: int
    seed: int


def _again(
    model: IdentifiedModel, data: Experiment, estimator: Estimator, drawn: _ReplicateDrawing, workers: Workers
) -> list[Complex]:
    """Return the poles that are identified from each record that has a model of the same order."""
    delays = sum(model.delay)
    if model.order == delays:
        return []
    with one_thread():
        every = _records(model, data, drawn.replicates, drawn.length, np.random.default_rng(drawn.seed))
        wanted, u = model.order - delays, data.u - model.u0
        jobs = (_Replicate(k, estimator, u, y, delays, wanted) for k, y in enumerate(every))
        return _identified(jobs, workers)


def _gathered(
    model: IdentifiedModel, found: list[Complex], drawn: _ReplicateDrawing, *, confidence: float, joint: bool
) -> PoleBootstrap:
    """Return the regions that the poles found make about those of the model."""
    poles = _without_delays(model.poles, sum(model.delay))
    if not len(poles):
        matched, failed = np.empty((0, 0), dtype=np.complex128), 0
    elif len(found) < max(LEAST, drawn.replicates // 2):
        words = f"only {len(found)} of {drawn.replicates} bootstrap replicates gave a model of order {len(poles)}"
        raise InputError(words)
    else:
        matched, failed = match_clouds(poles, np.array(found)), drawn.replicates - len(found)
    regions = pole_regions(poles, matched, confidence=confidence, joint=joint) if len(poles) else ()
    return PoleBootstrap(
        regions=regions, replicates=matched, confidence=confidence, joint=joint, block=drawn.length, failed=failed,
        dt=model.dt, seed=drawn.seed,
    )  # fmt: skip


def _check(model: IdentifiedModel, data: Experiment, replicates: int, block: int | None, confidence: float) -> None:
    if replicates < 2 * LEAST:
        raise InputError(f"replicates: {replicates} are too few; use at least {2 * LEAST}, usually {REPLICATES}")
    if block is not None and not 1 <= block <= data.n_samples // 2:
        raise InputError(f"block: {block} is not between 1 and half of the {data.n_samples} samples")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence must lie between 0 and 1, not {confidence:g}")
    if not model.is_stable:
        raise InputError("the model is unstable: it cannot be simulated for a bootstrap")


def _records(
    model: IdentifiedModel, data: Experiment, count: int, block: int, random: np.random.Generator
) -> Iterator[Floats]:
    """Yield outputs (N, p) like the measured one, without the operating point."""
    steady = model.simulate(data.u, model.initial_state(data.u, data.y))
    errors, gain = _errors(model, data, steady)
    n, (A, _, C, _, _) = len(errors), model.innovations()
    at_once = max(1, _AT_ONCE // (n * (model.order + errors.shape[1])))
    for first in range(0, count, at_once):
        rows = min(at_once, count - first)
        begins = random.integers(0, n - block + 1, size=(rows, -(-n // block)))
        order = (begins[:, :, None] + np.arange(block)).reshape(rows, -1)[:, :n]
        drawn = errors[order.T]  # (N, rows, p)
        states, _ = march(drawn @ gain.T, A.T, np.zeros((rows, len(A))))
        noise = states @ C.T + drawn
        for r in range(rows):
            yield steady - model.y0 + noise[:, r]


def _errors(model: IdentifiedModel, data: Experiment, simulated: Floats) -> tuple[Floats, Floats]:
    """Return what is drawn from, shape (N, p), without mean and of its true size, and the gain it enters by (n, p).

    These are the innovations, or the simulation errors with no gain where the predictor does no better.
    """
    errors, rest = data.y - model.predict(data.u, data.y), data.y - simulated
    gain = model.innovations()[-1]
    if np.linalg.norm(rest) <= np.linalg.norm(errors):
        errors, gain = rest, np.zeros_like(gain)
    n, (p, m) = len(errors), model.D.shape
    fitted = min((model.order * (2 * p + m) + p * m) / p, 0.5 * n)
    scaled: Floats = (errors - errors.mean(axis=0)) * np.sqrt(n / (n - fitted))
    return scaled, gain


@dataclass(frozen=True, eq=False)
class _Replicate:
    """A record like the measured one, for a worker.

    Attributes:
        number: of the replicate.
        estimator: finds the poles.
        u: shape (N, m), without the operating point.
        y: shape (N, p), likewise.
        delays: so many poles are those of known delays.
        wanted: so many others there are.
    """

    number: int
    estimator: Estimator
    u: Floats
    y: Floats
    delays: int
    wanted: int


def _identified(jobs: Iterator[_Replicate], workers: Workers) -> list[Complex]:
    """Return the poles of the replicates that gave a model, in their order."""
    runner = runner_for(workers)
    found: dict[int, Complex] = {}
    # In this process they are drawn as they are needed; elsewhere all are there.
    queues = (deque([job]) for job in jobs) if isinstance(runner, InProcess) else iter([deque(jobs)])
    with runner:
        for queue in queues:
            _check_portable(queue[0].estimator, runner)
            for event in runner.run(_estimated, queue):
                if isinstance(event, Reply) and event.value is not None:
                    found[event.job.number] = event.value
    return [found[number] for number in sorted(found)]


def _check_portable(estimator: Estimator, runner: Runner) -> None:
    if isinstance(runner, InProcess):
        return
    try:
        pickle.dumps(estimator)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"estimator: cannot be sent to other processes ({error}); take one that stands in a module, or no workers"
        ) from None


def _estimated(_model: None, job: _Replicate) -> Iterator[Complex | None]:
    """Identify one replicate; what a worker runs."""
    try:
        poles = _without_delays(np.asarray(job.estimator(job.u, job.y), dtype=np.complex128), job.delays)
    except (InputError, np.linalg.LinAlgError):
        yield None
        return
    yield poles if len(poles) == job.wanted and np.all(np.isfinite(poles)) else None


def _without_delays(poles: Complex, delays: int) -> Complex:
    """Return the poles without those of known delays, which lie at 0."""
    order = np.argsort(np.abs(poles), kind="stable")
    return poles[np.sort(order[delays:])] if delays else poles


def _words(region: PoleRegion, level: str) -> str:
    z = region.pole
    name = f"{z.real:.4g}" if abs(z.imag) < 1e-9 else f"{z.real:.4g} ± {abs(z.imag):.4g}i"
    if not region.determined:
        return f"pole {name}: not determined by the data"
    long, short = region.half_axes
    size = f"± {long:.2g}" if region.on_axis else f"half axes {long:.2g} and {short:.2g}"
    far = abs(region.bias) > 2.0 * region.spread
    doubt = f"; its replicates lie {abs(region.bias):.2g} beside it: biased, or the noise is not what the model says"
    return f"pole {name}: {level} region {size}{doubt if far else ''}"


_FAR = 20.0  # robust deviations beyond which a pole is just elsewhere
_PASSES = 2


def match(reference: Complex, poles: Complex) -> Complex:
    """Return `poles` in the order of `reference`, the sum of all distances smallest.

    Args:
        reference: shape (n,).
        poles: shape (n,).
    """
    return _assigned(np.abs(poles[None, :] - reference[:, None]), poles)


def match_clouds(reference: Complex, replicates: Complex) -> Complex:
    """Return replicates of a set of poles in the order of `reference`, shape (R, n).

    First by distance; then again by distance in units of each cloud's own (robust) spread from its median, so that a
    pole that is found anywhere does not take a well known one's place.

    Args:
        reference: shape (n,).
        replicates: shape (R, n).
    """
    ordered = np.array([match(reference, row) for row in replicates])
    for _ in range(_PASSES):
        middle = np.median(ordered.real, axis=0) + 1j * np.median(ordered.imag, axis=0)
        spread = np.maximum(np.median(np.abs(ordered - middle), axis=0), 1e-9)
        ordered = np.array([_assigned(_cost(row, middle, spread), row) for row in ordered])
    return ordered


def _cost(poles: Complex, middle: Complex, spread: Floats) -> Floats:
    cost: Floats = np.minimum(np.abs(poles[None, :] - middle[:, None]) / spread[:, None], _FAR)
    return cost


def _assigned(cost: Floats, poles: Complex) -> Complex:
    chosen: Complex = poles[linear_sum_assignment(cost)[1]]
    return chosen
