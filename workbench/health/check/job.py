"""The checks of one interface as a job for a worker process, and what becomes of those that a crash cuts off."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from workbench.errors import WorkbenchError
from workbench.fmi.ended import end_now
from workbench.health.check.registry import CHECKS
from workbench.health.check.result import UNLOADABLE, Answer
from workbench.health.check.subject import CheckedFmu
from workbench.jobs.runner import WorkItem
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.model.load import FmuModel

__all__ = ["UNLOADED", "CheckJob", "CheckReply", "adapted"]

UNLOADED = Answer("not applicable", "its binary cannot be loaded", finished=False)

_NO_WAY = "no analysis is possible with this interface on this machine"
_SHORTER = 0.1  # of a test run, for the checks after a run that failed on its way
_LONG = 3.0  # [s] that a run may take; others make a dozen of them, and shorter ones where it takes longer
_PATIENCE = 3  # crashes of one interface, after which its other checks are given up


@dataclass(frozen=True)
class CheckReply:
    """One finished check.

    Attributes:
        name: of the check.
        finding: its answer.
        seconds: how long it took.
    """

    name: str
    finding: Answer
    seconds: float


@dataclass(frozen=True, kw_only=True)
class CheckJob(WorkItem):
    """Checks of one interface, one after the other.

    Attributes:
        interface: "me" or "cs".
        names: of the checks.
        shorten: factor on the length of test runs.
        crashes: so many workers were lost on this interface before.
    """

    interface: str
    names: tuple[str, ...]
    shorten: float = 1.0
    crashes: int = 0

    def run(self, model: Model) -> Iterator[CheckReply]:
        if not isinstance(model, DescribedModel):
            return
        solver = model.recipe.solver if self.interface == "me" else "auto"
        try:
            opened = replace(model.recipe, interface=self.interface, solver=solver).open()
        except WorkbenchError as error:
            yield from (
                CheckReply(name, Answer("broken", f"the FMU cannot be opened: {error}"), 0.0) for name in self.names
            )
            return
        with opened:
            yield from self._all(CheckedFmu(opened, self.shorten))

    def _all(self, subject: CheckedFmu) -> Iterator[CheckReply]:
        for name in self.names:
            done = _one(name, subject)
            subject = adapted(subject, done)
            if name == "runs":
                end_now()  # its instances: a crash then is this check's, and not told by nobody
            first_fails = name == self.names[0] and done.finding.verdict != "good"
            if first_fails and isinstance(subject.model, FmuModel) and (why := subject.model.why_not_loaded()):
                yield replace(done, finding=Answer("broken", why, _NO_WAY, {UNLOADABLE: True}))
                yield from (CheckReply(rest, UNLOADED, 0.0) for rest in self.names[1:])
                return
            yield done

    def after_loss(self, lost: str) -> CheckJob | None:
        """Return the job that does what comes after a check that took the worker with it; None: nothing is left.

        Args:
            lost: name of that check.
        """
        rest = self.names[self.names.index(lost) + 1 :]
        if not rest:
            return None
        shorten = self.shorten * (_SHORTER if lost == "runs" else 1.0)
        return replace(self, names=rest, shorten=shorten, crashes=self.crashes + 1)

    @property
    def hopeless(self) -> bool:
        """Whether too many workers were lost to try again."""
        return self.crashes >= _PATIENCE


def adapted(subject: CheckedFmu, done: CheckReply) -> CheckedFmu:
    """Return what the checks after this one look at: less of a run that fails or takes long, a step that converges.

    Args:
        subject: what this one looked at.
        done: it.
    """
    if done.name == "runs" and (done.finding.verdict == "broken" or "ended" in done.finding.numbers):
        return subject.shortened(_SHORTER)
    if done.name == "runs" and done.seconds > _LONG:
        return subject.shortened(max(_SHORTER, _LONG / done.seconds))
    if done.name == "step" and done.finding.numbers.get("diverges"):
        return replace(subject, refine=round(subject.step / float(done.finding.numbers["excursion_step"])))
    return subject


def _one(name: str, subject: CheckedFmu) -> CheckReply:
    begin = time.monotonic()
    check = CHECKS[name].run
    try:
        finding = Answer("not applicable", "not for an interface") if check is None else check(subject)
    except WorkbenchError as error:
        # What the FMU promised and did not keep is told by the check itself; the rest may be the model's nature.
        finding = Answer("watch", f"it fails: {error}", "analyses that need this fail in the same way")
    return CheckReply(name, finding, time.monotonic() - begin)
