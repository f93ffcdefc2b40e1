"""A requirement that a record is still what it was."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, suggest
from workbench.study.position_in_file import place
from workbench.study.requirements.base import Compliance, NotMeasured, Requirement, Result, judge
from workbench.study.requirements.comparable import READERS, Comparable, single
from workbench.study.requirements.deviation import Deviation, Leeway, deviation
from workbench.study.requirements.value import check_path, numbers_at

__all__ = ["Baseline"]


class Baseline(Requirement):
    """The record is that of the baseline, a file that `workbench run STUDY --update-baselines` writes.

    A difference is judged by the error bar: the sum of the errors that both records state, of `tolerance`, and of
    `relative` times the baseline. The value is the difference in error bars at the worst place, and must not exceed 1.
    Records of `nfr` and `bla` state errors. A number whose error is not stated needs a tolerance; without one the
    requirement fails. To that of a linear model's response is added what rounding may do: the bound at that frequency,
    and ε = 2.2e-16 of the largest value, so that `relative` finds no difference where the response is next to nothing.

    Compared are the signals of `simulate`, complex responses of `nfr`, `bla`, `lin`, `identify` and `loop`, margins of
    `loop`, variables of `trim`, frequencies and amplitudes of `limit-cycle`; of other commands the numbers at `path`.
    Measured responses are compared at the frequencies of the baseline, each of which must be measured; linear models
    are evaluated there. Time histories are compared at all times of either one, between the rows of the other by a
    straight line and its error.

    Attributes:
        file: of the baseline, relative to the study; None: STUDY.baselines/ANALYSIS.json beside it. With several
            points of the grid each has a file, with the point in its name.
        only: names of what is compared, such as a signal, "del/delC" or "gain margin"; None: everything.
        path: numbers of the result that are compared, in place of the above; see [value](#value).
        tolerance: difference that is allowed, in the unit of the values.
        relative: likewise, as a fraction of the baseline's value; of a time history, of its largest one.
        shift: how far events of a time history may move [s].
    """

    file: str | None = Field(default=None, min_length=1)
    only: list[str] | None = Field(default=None, min_length=1)
    path: str | None = None
    tolerance: float = Field(default=0.0, ge=0.0)
    relative: float = Field(default=0.0, ge=0.0)
    shift: float = Field(default=0.0, ge=0.0)

    def baseline(self, usual: Path) -> Path:
        return usual if self.file is None else Path(self.file)

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if self.path is None and commands[0] not in READERS:
            raise InputError(f"{where}: of {commands[0]} only numbers can be compared: give their path")
        if self.path is not None:
            if self.only is not None:
                raise InputError(f"{where}: only and path: one of them")
            with place(where):
                check_path(self.path)

    def no_baseline(self, result: Result) -> str:
        try:
            every = self._quantities(result, None)
        except NotMeasured as error:
            return str(error)
        names = [q.name for q in every]
        self._check_names(names, names)
        chosen = [q for q in every if self.only is None or q.name in self.only]
        lost = ((q, at, why) for q in chosen if q.along for at, why in q.failed.items())
        for quantity, at, why in lost:
            return f"{quantity.name} at {at:.6g} {quantity.along}: {why}"
        if not any(np.any(~np.isnan(q.value)) for q in chosen):
            return "there is nothing to compare"
        try:
            self.compared([result, result])
        except NotMeasured as error:  # one that could not even be met by itself
            return str(error)
        return ""

    def find(self, results: Sequence[Result]) -> Compliance:
        found = max(self.compared(results), key=lambda a: float(a.ratio[a.worst]))
        return judge(float(found.ratio[found.worst]), {"max": 1.0}, where=found.where)

    def compared(self, results: Sequence[Result]) -> list[Deviation]:
        """Return all that is compared.

        Args:
            results: measured now; the baseline.

        Raises:
            NotMeasured: they cannot be compared.
            InputError: a name in `only`, or a path, that the result does not have.
        """
        mine, theirs = results
        if mine["command"] != theirs.get("command"):
            raise NotMeasured(f"the baseline is a result of {theirs.get('command')}, this one of {mine['command']}")
        if self.path is not None:  # a path that leads nowhere is a mistake of the study, not of the baseline
            numbers_at(mine, self.path, self.name)
        before = self._read_baseline(theirs)
        grid = before[0].at if before and before[0].along == "Hz" else None
        now = {q.name: q for q in self._quantities(mine, grid)}
        self._check_names(list(now), [q.name for q in before])
        allowed = Leeway(tolerance=self.tolerance, relative=self.relative, shift=self.shift)
        chosen = [q for q in before if self.only is None or q.name in self.only]
        known = [q for q in chosen if len(q.at) and (q.along or not q.failed or not now[q.name].failed)]
        if not known:
            raise NotMeasured("there is nothing to compare")
        return [deviation(now[q.name], q, allowed) for q in known]

    def _read_baseline(self, theirs: Result) -> list[Comparable]:
        try:
            return self._quantities(theirs, None)
        except (InputError, KeyError, TypeError, ValueError) as error:
            raise NotMeasured(f"the baseline cannot be read: {error}") from None

    def _quantities(self, result: Result, grid: Floats | None) -> list[Comparable]:
        if self.path is not None:
            return [single(f"{self.path}{at}", value) for at, value in numbers_at(result, self.path, self.name)]
        return list(READERS[str(result["command"])](result, grid))

    def _check_names(self, now: Sequence[str], before: Sequence[str]) -> None:
        for name in self.only or ():
            if name not in now and name not in before:
                raise InputError(f"{self.name}: '{name}' is not compared here; {suggest(name, now)}")
        wanted = self.only or [*before, *now]
        for holder, names, lacks in (("the baseline", before, now), ("the result", now, before)):
            missing = [name for name in names if name in wanted and name not in lacks]
            if missing:
                other = "the result" if lacks is now else "the baseline"
                more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
                raise NotMeasured(f"{holder} has {missing[0]}{more}, {other} has not")
