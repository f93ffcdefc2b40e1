"""What several questions about the data need, computed once and when first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.long_arx import LongArx, fit_long_arx
from workbench.data.preprocess.outliers import remove_outliers
from workbench.data.preprocess.settle import TAME, settling_samples
from workbench.data.spectra.coherence import Coherence, coherence
from workbench.errors import InputError

__all__ = ["CHANCE", "DataStudy"]

CHANCE = 1e-5  # probability of a false alarm of each test
# More samples than these add nothing to a judgement.
_MOST_SAMPLES = 20_000
_FEWEST_SAMPLES = 40
_LONGEST_MEMORY = 2_000
_BEST_DB = 200.0
_ALL_BUT_PERFECT = 1e-4  # of the variance left over
_NOTHING = 0.9  # likewise: of an equation that explains next to nothing
_FEWER = (12, 6)  # lags
_EXCITED_DB = -30.0  # below the peak of an input's density: what is lower is not excitation


class DataStudy:
    """The data with their offsets removed, and estimates from them.

    Args:
        experiment: the data.
        order: of the model they are meant for; None: unknown.
        limits: output → lowest and highest value its hardware allows.
        feedthrough: the plant may have a direct feedthrough.

    Attributes:
        experiment: the data; of a long record the beginning, without what is still settling, outliers repaired so
            that one fault is not taken for another.
        raw: the same with the outliers.
        outliers: output → samples that stand out.
        settling: so many samples were left out at the beginning.
        order, limits, feedthrough: as given.
        u: inputs without their means, shape (n, m).
        y: outputs without their means, shape (n, p).
        varying_inputs, varying_outputs: columns that are not constant.

    Raises:
        InputError: too few samples to judge.
    """

    def __init__(
        self,
        experiment: Experiment,
        *,
        order: int | None,
        limits: Mapping[str, tuple[float, float]] | None,
        feedthrough: bool = True,
    ) -> None:
        if experiment.n_samples < _FEWEST_SAMPLES:
            raise InputError(
                f"{experiment.name}: {experiment.n_samples} samples are too few to judge; {_FEWEST_SAMPLES} at least"
            )
        first = experiment.part(0, min(experiment.n_samples, _MOST_SAMPLES))
        self.settling = _settled(first)
        self.raw = first.part(self.settling)
        repaired = remove_outliers(self.raw)
        self.outliers = {name: at for name, at in repaired.samples.items() if at}
        self.experiment = repaired.experiment
        self.order = order
        self.limits = dict(limits or {})
        self.feedthrough = feedthrough
        self.u = _centred(self.experiment.u)
        self.y = _centred(self.experiment.y)
        self.varying_inputs = _varying(self.u, self.experiment.u)
        self.varying_outputs = _varying(self.y, self.experiment.y)

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return self.experiment.dt

    @cached_property
    def spread(self) -> Floats:
        """Standard deviation of each output, shape (p,), at least the smallest normal number."""
        return np.asarray(np.maximum(np.std(self.y, axis=0), np.finfo(np.float64).tiny), dtype=np.float64)

    @cached_property
    def arx(self) -> LongArx:
        """The long difference equation."""
        return fit_long_arx(self.u, self.y)

    @cached_property
    def _simulated(self) -> tuple[LongArx, Floats]:
        """The equation that serves best for simulation, and the outputs by it, without their means.

        The best predictor may be wild at frequencies that the inputs do not contain, even unstable; then one that
        is left at 0 there simulates better. Where neither explains anything both may be unstable by what they have too
        much: fewer lags are tried.
        """
        best = self.arx, self._run(self.arx)
        for lags, enough in ((None, _ALL_BUT_PERFECT), (_FEWER[0], _NOTHING), (_FEWER[1], _NOTHING)):
            if self._left(best[1]) > enough:
                tame = fit_long_arx(self.u, self.y, truncate=TAME, lags=lags)
                best = min(best, (tame, self._run(tame)), key=lambda pair: self._left(pair[1]))
        return best

    def _run(self, equation: LongArx) -> Floats:
        simulated = equation.simulate(self.u)
        wild = ~np.isfinite(simulated).all(axis=0) | (
            np.nanmax(np.abs(simulated), axis=0) > 1e3 * np.ptp(self.y, axis=0)
        )
        tamed = np.where(wild, 0.0, np.nan_to_num(simulated, posinf=0.0, neginf=0.0))
        return np.asarray(tamed - tamed.mean(axis=0))

    def _left(self, simulated: Floats) -> float:
        return float(np.mean(np.var((self.y - simulated) / self.spread, axis=0)))

    @property
    def explained(self) -> Floats:
        """The outputs as far as the inputs explain them linearly, shape (n, p); zero where no equation is stable."""
        return self._simulated[1]

    @property
    def model(self) -> LongArx:
        """The long equation that serves best for simulation."""
        return self._simulated[0]

    @cached_property
    def memory(self) -> int:
        """Samples until less than 0.1 % of the energy of every impulse response is left."""
        count = min(_LONGEST_MEMORY, len(self.u))
        with np.errstate(over="ignore"):  # an unstable equation has no end of it, which the total tells
            energy = np.cumsum(self.model.impulse(count) ** 2, axis=0)
        total = energy[-1]
        if not np.all(np.isfinite(total)):
            return count
        over = np.all(energy >= 0.999 * total, axis=(1, 2))
        return int(np.argmax(over)) + 1

    @cached_property
    def excited(self) -> NDArray[np.bool_]:
        """Where any input has power, at the frequencies of `coherence`, shape (n_f,)."""
        power = self.coherence.input_density[:, self.varying_inputs]
        excited = np.any(power > 10.0 ** (0.1 * _EXCITED_DB) * power.max(axis=0, initial=1e-300), axis=1)
        excited[0] = False  # every segment's mean is taken out
        return np.asarray(excited)

    @cached_property
    def coherence(self) -> Coherence:
        """With segments four times as long as the memory where the record allows ten of them, at least 20 × 8."""
        n = len(self.u)
        longest = n // max(10, 3 * self.experiment.n_inputs)
        return coherence(self.experiment, length=max(min(max(4 * self.memory, n // 20), longest), 8))

    @cached_property
    def signal_to_rest_db(self) -> Floats:
        """10·log10 of explained over unexplained variance of each output, shape (p,) [dB]."""
        start = min(self.memory, len(self.u) // 4)
        rest = self.y[start:] - self.explained[start:]
        ratio = np.var(self.explained[start:], axis=0) / np.maximum(np.var(rest, axis=0), 1e-300)
        with np.errstate(divide="ignore"):
            return np.asarray(np.clip(10.0 * np.log10(ratio), -_BEST_DB, _BEST_DB))


def _settled(experiment: Experiment) -> int:
    """Return how many samples to leave out: what settles, unless that is most of the record."""
    count = settling_samples(experiment)
    return count if count <= 0.3 * experiment.n_samples else 0


def _centred(x: Floats) -> Floats:
    return np.asarray(x - x.mean(axis=0))


def _varying(centred: Floats, x: Floats) -> list[int]:
    size = np.max(np.abs(x), axis=0)
    return np.flatnonzero(np.max(np.abs(centred), axis=0) > 1e-12 * size).tolist()
