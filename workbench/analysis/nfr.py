"""Nonlinear frequency response: gain, phase and offset over frequency and amplitude."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from workbench.analysis.frequency_grid import frequency_grid, positive_values
from workbench.analysis.nfr_point import NfrPoint, PointTask, run_fresh, run_point
from workbench.analysis.nfr_result import NfrResult, assemble
from workbench.analysis.nfr_step import at_step, refine
from workbench.errors import InputError, suggest
from workbench.model import Model, Variable
from workbench.session.base import Floats
from workbench.signals import Sine

__all__ = ["NfrSweep", "nfr"]

Progress = Callable[[NfrPoint, int, int], None]


def nfr(
    model: Model,
    input: str,
    output: str,
    frequencies: Sequence[float] | Floats | None = None,
    amplitudes: Sequence[float] | Floats | float | None = None,
    *,
    band: tuple[float, float] | None = None,
    ratio: float = 1.2,
    errcrit: float = 0.1,
    max_periods: int = 20,
    carry: bool = False,
    step: float | None = None,
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
      - Co-simulation is repeated with smaller communication steps (see `workbench.analysis.nfr_step.refine`).

    Not for a model without a periodic response: an unstable one fails point by point, a limit
    cycle of the model's own gives averaged points that mean little. The first harmonic alone is reported.

    Args:
        model: the model; its other inputs keep their start values.
        input: name of the input to force.
        output: name of the output (or of a state) to measure.
        frequencies: [Hz], measured in rising order.
        amplitudes: of the sine, one or several, [unit of the input], outer loop, rising order.
        band: (lowest, highest) frequency [Hz] in place of `frequencies`.
        ratio: of neighbouring frequencies in a band; the last one is the band's end itself.
        errcrit: error criterion: change of phase [rad] and ten times the change of gain between periods.
        max_periods: most periods at a point, at least 2.
        carry: keep the state from one frequency to the next in one session per amplitude, the
            input without a jump, in place of a fresh start at each point. Falling
            frequencies (a falling list, or a band from the top) are then measured in that order.
        step: communication step [s] to measure a co-simulation at, checked once with half of it; None:
            found by halving. Without effect for model exchange.
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
        band=band,
        ratio=ratio,
        errcrit=errcrit,
        max_periods=max_periods,
        carry=carry,
        step=step,
    )
    for point in sweep.run():
        if progress is not None:
            progress(point, sweep.done, sweep.total)
    return sweep.result()


class NfrSweep:
    """A nonlinear frequency response that can be stopped: what was measured until then is not lost.

    ```python
    sweep = NfrSweep(model, "u", "y", [1.0, 2.0], [1.0])
    try:
        for point in sweep.run():
            ...
    finally:
        result = sweep.result()      # points not reached are failed with that reason
    ```

    Args:
        model, input, output, frequencies, amplitudes, band, ratio, errcrit, max_periods, carry, step: see `nfr`.

    Raises:
        InputError: unknown variable, a value out of its range.
    """

    def __init__(
        self,
        model: Model,
        input: str,
        output: str,
        frequencies: Sequence[float] | Floats | None = None,
        amplitudes: Sequence[float] | Floats | float | None = None,
        *,
        band: tuple[float, float] | None = None,
        ratio: float = 1.2,
        errcrit: float = 0.1,
        max_periods: int = 20,
        carry: bool = False,
        step: float | None = None,
    ) -> None:
        _check_name("input", input, model.inputs, model)
        _check_name("output", output, (*model.outputs, *model.states), model)
        positive_values("errcrit", (errcrit,), unit="rad")
        if max_periods < 2:
            raise InputError(f"max periods: {max_periods} cannot show whether a response repeats; take at least 2")
        if step is not None:
            positive_values("step", (step,), unit="s")
        self._model, self._input, self._output = model, input, output
        self._frequencies = frequency_grid(frequencies, band, ratio, falling=carry)
        self._amplitudes = _amplitudes(amplitudes)
        self._errcrit, self._max_periods = errcrit, max_periods
        self._carry, self._step = carry, step
        self._points: list[NfrPoint] = []
        self._warnings: list[str] = []
        self._stopped = False

    @property
    def total(self) -> int:
        """Number of points."""
        return len(self._frequencies) * len(self._amplitudes)

    @property
    def done(self) -> int:
        """Number of points measured."""
        return len(self._points)

    def run(self) -> Iterator[NfrPoint]:
        """Measure point by point; may be run once.

        Raises:
            FmuError, SimulationError: the FMU cannot be started.
            KeyboardInterrupt: after `stop`.
        """
        for amplitude in self._amplitudes:
            tasks = [self._task(f, amplitude) for f in self._frequencies]
            groups = [tasks] if self._carry else [[t] for t in tasks]
            for group in groups:
                for point in self._measure(group):
                    self._points.append(point)
                    yield point

    def stop(self) -> None:
        """Let `run` end with KeyboardInterrupt after the period it is in; may be called by a signal handler."""
        self._stopped = True

    def result(self) -> NfrResult:
        """Return what was measured so far."""
        return assemble(
            self._model,
            input=self._input,
            output=self._output,
            frequencies=self._frequencies,
            amplitudes=self._amplitudes,
            points=self._points,
            warnings=self._warnings,
        )

    def _task(self, frequency: float, amplitude: float) -> PointTask:
        return PointTask(
            input=self._input,
            output=self._output,
            frequency=frequency,
            amplitude=amplitude,
            errcrit=self._errcrit,
            max_periods=self._max_periods,
            stopped=lambda: self._stopped,
        )

    def _measure(self, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
        if self._model.interface != "cs":
            yield from self._pass(tasks)
        elif self._step is None:
            yield from refine(tasks, lambda t: list(self._pass(t)))
        else:
            points, warnings = at_step(tasks, self._step, lambda t: list(self._pass(t)))
            self._warnings += warnings
            yield from points

    def _pass(self, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
        """Measure `tasks` once: each afresh, or all in one session."""
        if self._carry:
            return _carried(self._model, tasks)
        return (run_fresh(self._model, t) for t in tasks)


def _carried(model: Model, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
    """Measure in one session; after a failed point the next one begins in a new session."""
    rest = list(tasks)
    while rest:
        first = Sine(amplitude=rest[0].amplitude, frequency=rest[0].frequency)
        # One session serves all frequencies; the rows of each divide its period and bound the step.
        steps = [t.step for t in rest if t.step is not None]
        with model.open_session(signals={rest[0].input: first}, step=max(steps, default=None)) as session:
            while rest:
                task = rest.pop(0)
                point = run_point(session, task)
                yield point if model.interface == "cs" else replace(point, step=None)
                if point.reason is not None:
                    break


def _check_name(what: str, name: str, variables: Sequence[Variable], model: Model) -> None:
    if any(v.name == name for v in variables):
        return
    others = {v.name: kind for kind in ("inputs", "outputs", "states", "parameters") for v in getattr(model, kind)}
    if name in others:
        article = {"inputs": "an input", "outputs": "an output", "states": "a state", "parameters": "a parameter"}
        names = ", ".join(v.name for v in variables[:8]) or "none"
        raise InputError(f"{what}: '{name}' of {model.name} is {article[others[name]]}; its {what}s are: {names}")
    raise InputError(f"{what}: {model.name} has no '{name}'; {suggest(name, [v.name for v in variables])}")


def _amplitudes(amplitudes: Sequence[float] | Floats | float | None) -> tuple[float, ...]:
    if amplitudes is None:
        raise InputError("amplitude: none given; a nonlinear model's response depends on it")
    values = [amplitudes] if isinstance(amplitudes, int | float) else amplitudes
    return tuple(sorted(positive_values("amplitude", values, unit="unit of the input")))
