"""Has the FMU the start values that its description declares, until they are set?"""

from __future__ import annotations

from workbench.fmi.variable import Variable
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.session.start_values import misses, unkept_in_words

__all__ = ["starts"]

_ACTS = "what `info` shows of it is not what acts: set it (`start_values`), or force it"


def starts(subject: CheckedFmu) -> Answer:
    """Start a session and read inputs, parameters and continuous states that nobody has set.

    FMI 2.0.4 (2.2.7) and 3.0 (2.4.7.5): an input that is not set has its start value, and what is declared with
    initial "exact", as parameters are, is initialised with it. Watch: one has another value; once it is set, nothing
    is wrong any more, so that no computed number is. Not judged: start values that are guesses (initial approx), and
    what changes at a clock's ticks. Not applicable: nothing of this kind declares a start value.
    """
    model = subject.model
    given = {*model.start_values, *model.bias, *model.description.clocked}
    state = {v.name for v in model.states}
    looked_at = [
        v for v in model.description.variables if v.name not in given and _promises(v, is_state=v.name in state)
    ]
    wanted = {v.name: v.start for v in looked_at if v.start is not None}
    if not wanted:
        return Answer("not applicable", "no input, parameter or state declares a start value")
    with subject.open() as session:
        found = misses(session.instance, looked_at, wanted)
    numbers = {"other": {m.name: [m.asked, m.found] for m in found}}
    if found:
        return Answer("watch", unkept_in_words(found), _ACTS, numbers)
    return Answer("good", f"{len(wanted)} start values are as declared", numbers=numbers)


def _promises(variable: Variable, *, is_state: bool) -> bool:
    if variable.start is None or variable.alias_of or not variable.is_number:
        return False
    if variable.causality in ("input", "parameter"):
        return variable.initial in (None, "exact")
    return is_state and variable.initial == "exact"
