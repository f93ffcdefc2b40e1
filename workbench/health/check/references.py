"""Does the FMU reproduce the reference results that it carries?"""

from __future__ import annotations

from pathlib import Path

from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.health.references.declared import references_in
from workbench.health.references.replay import WRONG, ReplayedReference, replay
from workbench.model.load import FmuModel

__all__ = ["references"]

_OTHER = "it does not compute what its exporter saw: find out why before its numbers are used"
_USELESS = "that reference shows nothing, or not all it should; have it exported again"
_RANK = ("good", "watch", "broken")


def references(subject: CheckedFmu) -> Answer:
    """Run each experiment again whose results the FMU carries (FMI-LS-REF), and compare.

    Broken: a variable is more than 1 % of its range away from the reference, beyond what the integration of the
    reference explains, or the run fails. Watch: it is less but beyond tolerances, or with model exchange where the
    reference was computed by the FMU's own co-simulation; or the reference is incomplete, damaged, or of another model.
    Good: reproduced, or (see `replay`) within the error that the reference itself has.
    """
    model = subject.model
    if not isinstance(model, FmuModel):
        return Answer("not applicable", "a system carries none")
    found, _ = references_in(Path(model.recipe.folder))  # whose remarks `info` tells
    if not found:
        return Answer("not applicable", "it carries no reference results")
    replays = [replay(model, reference) for reference in found]
    both = len(model.description.interfaces) > 1
    verdicts = [_verdict(one, both=both) for one in replays]
    worst = max(verdicts, key=_RANK.index)
    told = [one.told for one, verdict in zip(replays, verdicts, strict=True) if verdict == worst]
    more = f" (and {len(told) - 1} more)" if len(told) > 1 else ""
    numbers = {"reference_results": [one.to_dict() for one in replays]}
    failed = any(one.passed is False for one in replays)
    consequence = "" if worst == "good" else _OTHER if failed else _USELESS
    return Answer(worst, told[0] + more, consequence, numbers)


def _verdict(one: ReplayedReference, *, both: bool) -> str:
    if one.passed is False:
        far = one.worst is None or one.worst - one.explained > WRONG
        return "broken" if far and not (both and one.interface == "me") else "watch"
    if one.passed is None and (one.problem and not one.explained):
        return "watch"
    return "good"
