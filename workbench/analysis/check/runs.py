"""Does the FMU instantiate, initialise and run?"""

from __future__ import annotations

from workbench.analysis.check.result import Finding
from workbench.analysis.check.subject import Subject
from workbench.errors import FmuError, SimulationError

__all__ = ["runs"]


def runs(subject: Subject) -> Finding:
    """Instantiate, initialise and run over the test run with every continuous input swinging.

    The swing is 5 % of the input's size (the larger of start value and nominal value) within its minimum and
    maximum, at least three periods. Broken: an error status, a value that is no finite number, an end that the FMU
    asks for, and (told by the worker) a crash or a hang. Watch: it runs, but only with its inputs at their start
    values.
    """
    try:
        found = subject.run(subject.sines())
    except (FmuError, SimulationError) as error:
        return _still(subject, str(error))
    moved = int((found.scale > 0.0).sum())
    text = f"{subject.span:.4g} s in {subject.steps} steps, {moved} of {len(subject.names)} variables move"
    text = "; ".join([text, *subject.model.remarks()])
    return Finding("good", text, numbers={"span": subject.span, "steps": subject.steps, "moving": moved})


def _still(subject: Subject, failure: str) -> Finding:
    """The same with the inputs at rest."""
    if subject.inputs:
        try:
            subject.run({})
        except (FmuError, SimulationError):
            pass
        else:
            evidence = f"with inputs changed by a twentieth of their size it fails: {failure}"
            return Finding("watch", evidence, "start from a trim point, with amplitudes for which the model is valid")
    return Finding("broken", failure, "no analysis gets beyond this point; the other checks use a shorter run")
