"""How many samples pass before an output feels an input?

Each output is regressed on its own past and on the inputs, the newest input last. One QR decomposition tests all
delays: the last column's share of the output is what u[k] adds to all that is older, the share of the one before is
what u[k − 1] adds to all that is older than it, and so on. The delay is the first lag with a share out of the noise.
The past outputs make the noise white, so the test holds for any noise and in closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import CHANCE, DataStudy
from workbench.data.long_arx import lagged

__all__ = ["delays", "judge_delay"]

_SIGNIFICANT = float(-special.ndtri(0.5 * CHANCE))  # standard deviations
_EXACT_SHARE = 3e-6  # of the output's size, where there is no noise
_MOST = 60  # samples
_FINE = 0.03  # of the impulse response's peak: coarser coefficients cannot show where it begins
_OWN = 1e-3  # of an input's size is new at each sample, or the delay cannot be seen
_ROUNDING = 1e-8


def delays(study: DataStudy) -> dict[tuple[str, str], int | None]:
    """Return by (input, output) how many samples the output waits; None where that cannot be seen.

    0: direct feedthrough; 1: what any sampled dynamic system without feedthrough has; more: a delay besides.
    """
    return {pair: result.delay for pair, result in _every(study).items()}


def judge_delay(study: DataStudy) -> Finding:
    """State the delay of each pair; one of two samples or more should be taken out before fitting."""
    every = _every(study)
    values = {f"{u} → {y}": r.delay for (u, y), r in every.items()}
    known = {pair: r.delay for pair, r in every.items() if r.delay is not None}
    deaf = [pair for pair, r in every.items() if not r.answers]
    if len(deaf) == len(every):
        return Finding(
            "delay", "poor", "no output responds to any input", "check the columns and the amplitude", values
        )
    if not known:
        evidence = "cannot be seen: noise, or an input that can be predicted from its past"
        return Finding("delay", "unknown", evidence, "a PRBS shows it best", values)
    evidence = ", ".join(f"{u} → {y} {_words(d, study.dt)}" for (u, y), d in known.items())
    if deaf:
        evidence += f"; {deaf[0][1]} does not respond to {deaf[0][0]}"
    least = min(known.values())
    if least >= 2 and len(known) + len(deaf) == len(every):
        return Finding(
            "delay", "watch", evidence, f"give delay={least - 1}  to the fit: it saves that many states", values
        )
    return Finding("delay", "good", evidence, "" if least == 0 else "no feedthrough is needed", values)


@dataclass(frozen=True)
class _Test:
    """What the shares say about one pair: whether the output answers at all, and since when."""

    answers: bool
    delay: int | None


def _words(delay: int, dt: float) -> str:
    if delay == 0:
        return "acts at once (feedthrough)"
    if delay == 1:
        return "acts at the next sample"
    return f"acts after {delay} samples ({delay * dt:.3g} s)"


def _every(study: DataStudy) -> dict[tuple[str, str], _Test]:
    return {
        (source, target): result
        for j, source in enumerate(study.experiment.input_names)
        for target, result in zip(study.experiment.output_names, _tests(study, j), strict=True)
    }


def _tests(study: DataStudy, column: int) -> list[_Test]:
    """Return a test for each output against one input."""
    n, own = len(study.u), study.arx.lags
    most = max(2, min(_MOST, n // 12))
    start = max(most, own)
    size = np.maximum(np.std(study.u, axis=0), 1e-300)
    u, y = study.u / size, study.y / study.spread
    others = [j for j in range(study.experiment.n_inputs) if j != column]
    parts = [np.ones((n - start, 1)), lagged(y, 1, own, start)]
    if others:
        parts.append(lagged(u[:, others], 0, own, start))
    newest_last = lagged(u[:, [column]], 0, most, start)[:, ::-1]
    q, r = np.linalg.qr(np.hstack([*parts, newest_last]))
    share = q.T @ y[start:]
    freedom = max(n - start - q.shape[1], 1)
    noise = np.sqrt(np.maximum(np.sum(y[start:] ** 2, axis=0) - np.sum(share**2, axis=0), 0.0) / freedom)
    new = np.abs(np.diag(r))[: -most - 2 : -1]  # how much of u[k − lag] is not foretold
    peaks = np.max(np.abs(study.arx.impulse(most + 1)[:, :, column]), axis=0) * size[column] / study.spread
    return [_test(np.abs(share[: -most - 2 : -1, i]), new, float(noise[i]), float(peaks[i])) for i in range(y.shape[1])]


def _test(shares: Floats, new: Floats, noise: float, peak: float) -> _Test:
    """Return the first lag with a share out of the noise.

    Args:
        shares: of the lags 0, 1, …, magnitudes.
        new: what is new in the input at each lag; what has next to nothing has a share of rounding only.
        noise: of a share, standard deviation.
        peak: of the impulse response.
    """
    largest = float(np.max(new, initial=0.0))
    shares = np.where(new > _ROUNDING * largest, shares, 0.0)
    noise = max(noise, 1e-12 * float(np.max(shares, initial=0.0)), 1e-300)
    chance = special.chdtrc(len(shares), float(np.sum((shares / noise) ** 2)))
    if np.max(shares) <= 1e-9 or chance > CHANCE:
        return _Test(answers=False, delay=None)
    floor = _EXACT_SHARE * float(np.sqrt(np.sum(shares**2)))
    out = np.flatnonzero(shares > max(_SIGNIFICANT * noise, floor))
    if not out.size:
        return _Test(answers=True, delay=None)
    first = int(out[0])
    visible = new[: first + 1] > _OWN * largest
    fine = visible[first] & visible[:first] & (noise < _FINE * peak * new[:first])
    return _Test(answers=True, delay=first if np.all(fine) else None)
