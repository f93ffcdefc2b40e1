"""Record identification experiments on a model."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

from workbench.analysis.excite.assemble import assemble
from workbench.analysis.excite.design import Design
from workbench.analysis.excite.job import ExciteJob
from workbench.analysis.excite.prbs import PrbsDesign
from workbench.analysis.excite.result import ExciteResult
from workbench.analysis.excite.run import Begin, ExciteTask, Rows
from workbench.core.operating_point import At
from workbench.errors import SimulationError
from workbench.model import Model
from workbench.model.placing import find_point
from workbench.origin import with_origin
from workbench.workers import Remark, Reply, Workers, choose, perform

__all__ = ["Excitation", "excite"]


@with_origin("identification", "validation")
def excite(
    model: Model,
    inputs: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    samples: int,
    validation_samples: int | None = None,
    signal: Design | None = None,
    dt: float | None = None,
    at: At | None = None,
    settle: float = 0.0,
    verify_step: bool = True,
) -> ExciteResult:
    """Run an identification experiment.

    One session runs from the operating point: it settles, where asked, then the identification and the
    validation part are recorded one after the other. u[k] is held over an interval, y[k] is read right after u[k]
    took effect; in models that are sampled, after their sample.

    Not for an unstable model: close its loop first. A co-simulation FMU alone shows no sampling of its own: whether
    its outputs follow an input at once or one interval later is then its own affair.

    Args:
        model: what to run; it stays open.
        inputs: forced inputs; the others keep the operating point's values.
        outputs: recorded outputs, or any variables.
        samples: length of the identification part.
        validation_samples: length of the validation part; None: as long; 0: none.
        signal: `PrbsDesign` or `MultisineDesign`; None: a PRBS of amplitude 1, one bit a sample.
        dt: sampling interval [s]; None: the model's own period, where it has one.
        at: operating point: a point, a result that has one, or the file of either; None: the model's start values.
        settle: so long the inputs rest at their middles before [s].
        verify_step: co-simulation only: run the identification part again with half the communication step and note
            where the answer changes by more than 1 % of an output's range.

    Raises:
        InputError: unknown name, a design that does not fit the sampling, an operating point of another model.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running.

    Source: the source report, chapter 5.2; L. Ljung, System Identification, 2nd ed., chapter 13.
    """
    excitation = Excitation(
        model, inputs, outputs, samples=samples, validation_samples=validation_samples, signal=signal, dt=dt, at=at,
        settle=settle, verify_step=verify_step, workers=Workers(in_process=True),
    )  # fmt: skip
    for _ in excitation.run():
        pass
    return excitation.result()


class Excitation:
    """An experiment under way: what is recorded is kept, whatever ends it.

    Args:
        model: see `excite`, as for all but the last.
        inputs: forced inputs.
        outputs: recorded.
        samples: length of the identification part.
        validation_samples: of the validation part.
        signal: the design.
        dt: sampling interval [s].
        at: operating point.
        settle: [s].
        verify_step: co-simulation only.
        workers: where the FMU runs.

    Attributes:
        total: samples to be run, once the first item came.
        done: samples that were.
    """

    def __init__(
        self,
        model: Model,
        inputs: str | Sequence[str],
        outputs: str | Sequence[str],
        *,
        samples: int,
        validation_samples: int | None = None,
        signal: Design | None = None,
        dt: float | None = None,
        at: At | None = None,
        settle: float = 0.0,
        verify_step: bool = True,
        workers: Workers,
    ) -> None:
        self._model = model
        point, remarks = find_point(model, at)
        self.task = ExciteTask(
            inputs=_names(inputs),
            outputs=_names(outputs),
            design=PrbsDesign() if signal is None else signal,
            dt=dt,
            samples=samples,
            validation=samples if validation_samples is None else validation_samples,
            at=point,
            settle=settle,
        )
        self._verify = verify_step
        self._runner, notes = choose(model, workers)
        self._notes = (*remarks, *notes)
        self._begin: Begin | None = None
        self._pieces: list[Rows] = []
        self.total, self.done = samples, 0

    def stop(self) -> None:
        """Let `run` end soon; a signal handler may call it."""
        self._runner.stop()

    def run(self) -> Iterator[int]:
        """Run the experiment; yields how many samples are done.

        Raises:
            InputError, FmuError, SimulationError: see `excite`.
            KeyboardInterrupt: after `stop`.
        """
        with self._runner:
            for event in self._runner.run(perform, deque([ExciteJob(self.task, self._verify)])):
                if not isinstance(event, Reply):
                    raise SimulationError(event.reason)
                self._take(event.value)
                yield self.done

    def _take(self, item: object) -> None:
        if isinstance(item, Begin):
            self._begin = item
            again = self._model.interface == "cs" and self._verify
            self.total = item.total + (len(item.sequences.identification.values) if again else 0)
        elif isinstance(item, Rows):
            self._pieces.append(item)
            self.done += len(item.u)
        elif isinstance(item, int):
            self.done += item
        elif isinstance(item, Remark):
            self._notes = (*self._notes, item.text)

    @property
    def recorded(self) -> bool:
        """Whether there is something to make a result of."""
        skip = 0 if self._begin is None else self._begin.sequences.identification.skip
        return sum(len(piece.u) for piece in self._pieces) >= skip + 2

    @with_origin("identification", "validation")
    def result(self) -> ExciteResult:
        """Return what was recorded so far.

        Raises:
            SimulationError: nothing was, or it is not finite.
        """
        if self._begin is None or not self.recorded:
            raise SimulationError("nothing was recorded")
        return assemble(self._model, self.task, self._begin, self._pieces, notes=self._notes)


def _names(given: str | Sequence[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(dict.fromkeys(given))
