"""Nonlinear frequency response: gain, phase and offset over frequency and amplitude."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Executor
from pathlib import Path

from workbench.analysis.nfr_point import NfrPoint
from workbench.analysis.nfr_result import NfrResult
from workbench.analysis.nfr_sweep import NfrSweep
from workbench.core.operating_point import At
from workbench.model import Model
from workbench.origin import with_origin
from workbench.session.base import Floats
from workbench.workers import Workers

__all__ = ["NfrSweep", "nfr"]

Progress = Callable[[NfrPoint, int, int], None]


@with_origin()
def nfr(
    model: Model,
    input: str,
    output: str,
    frequencies: Sequence[float] | Floats | None = None,
    amplitudes: Sequence[float] | Floats | float | None = None,
    *,
    at: At | None = None,
    band: tuple[float, float] | None = None,
    ratio: float = 1.2,
    errcrit: float = 0.1,
    max_periods: int = 20,
    carry: bool = False,
    step: float | None = None,
    verify: bool = False,
    drift_check: bool = True,
    workers: Workers | None = None,
    executor: Executor | None = None,
    store: str | Path | None = None,
    redo: Collection[str] = (),
    previous: NfrResult | None = None,
    progress: Progress | None = None,
) -> NfrResult:
    """Measure the nonlinear frequency response of a model.

    At each amplitude m and frequency f the input is m·sin(2πft) and the model is run one period at
    a time, each resumed from the last. With P = ∫ y sin dt and Q = ∫ y cos dt over a period the
    gain is 2·f·√(P² + Q²)/m and the phase atan2(Q, P); the offset is the mean of y. Periods
    are run until the response has settled, or up to `max_periods`, after which the mean of
    P, Q and offset over the last half of them is taken and the point is marked averaged. The
    phase is followed along the frequency.

    Where it departs from the source report, and why:
      - 200 rows per period, events as double rows, in place of 30: P and Q of a settled linear
        model are good to 1e-3.
      - The fundamental of the input that the model really saw takes the place of m (and of phase
        zero): a co-simulation holds its input over a step, which alone would cost half a step of delay.
      - A transient that can be identified is removed and the point is then settled; the published test
        alone stops while a slow or lightly damped transient still falsifies the value (see
        `workbench.analysis.settling.Settling` and `workbench.analysis.transient.remove_transient`).
      - Each point states its error (see `workbench.analysis.nfr_error`), and nothing is called settled whose error is
        above errcrit/10.
      - Co-simulation is repeated with smaller communication steps (see `workbench.analysis.nfr_step.refine`).

    Not for a model without a periodic response: an unstable one fails point by point, a limit
    cycle of the model's own gives averaged points that mean little. Gain and phase are those of the first
    harmonic; the others are in the certificates.

    Args:
        model: the model; its other inputs keep their start values, or those of `at`.
        input: name of the input to force.
        output: name of the output (or of a state) to measure.
        frequencies: [Hz], measured in rising order.
        amplitudes: of the sine, one or several, [unit of the input], outer loop, rising order.
        at: operating point: where each point begins, and about whose input the sine moves, the other inputs held at
            theirs: a point, a result that has one, or the file of either; None: where the model starts, the sine
            about 0 (and bias).
        band: (lowest, highest) frequency [Hz] in place of `frequencies`.
        ratio: of neighbouring frequencies in a band; the last one is the band's end itself.
        errcrit: error criterion: change of phase [rad] and ten times the change of gain between periods.
        max_periods: most periods at a point, at least 2.
        carry: keep the state from one frequency to the next in one session per amplitude, the
            input without a jump, in place of a fresh start at each point. Falling
            frequencies (a falling list, or a band from the top) are then measured in that order.
        step: communication step [s] to measure a co-simulation at, checked once with half of it; None:
            found by halving. Without effect for model exchange.
        verify: model exchange: measure each point once more with a hundredth of the tolerance, for its
            certificate; co-simulation is always checked, by half the step.
        drift_check: watch the model with zero input first and warn where it moves by itself.
        workers: where the FMU runs and under which limits; None: in one worker process per core, where a
            crash costs one point. A model that is no file runs in this process.
        executor: any `concurrent.futures.Executor` in place of worker processes; it stays open.
        store: folder that keeps every finished point; the same call again goes on where it was ended.
            A carried amplitude is kept as a whole: begun and not finished, it is measured again.
        redo: of "settled", "averaged", "failed": points of the store (or of `previous`) that ended so are measured
            again, with the present errcrit and max_periods; the others are kept as they are.
        previous: an earlier result, in place of a store or besides.
        progress: called after each point with the point, the number done and the number in all.

    Returns:
        The response; points that failed are NaN and listed with their reasons.

    Raises:
        InputError: unknown variable, a value out of its range.
        FmuError, SimulationError: the FMU cannot be started.

    Source: the source report, chapter 4 and appendix 11.2; the carried variant chapter 4.3.
    """
    sweep = NfrSweep(
        model,
        input,
        output,
        frequencies,
        amplitudes,
        at=at,
        band=band,
        ratio=ratio,
        errcrit=errcrit,
        max_periods=max_periods,
        carry=carry,
        step=step,
        verify=verify,
        drift_check=drift_check,
        workers=workers,
        executor=executor,
        store=store,
        redo=redo,
        previous=previous,
    )
    for point in sweep.run():
        if progress is not None:
            progress(point, sweep.done, sweep.total)
    return sweep.result()
