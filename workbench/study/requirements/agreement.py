"""Requirements on two results: that they agree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from workbench.errors import InputError
from workbench.study.position_in_file import place
from workbench.study.requirements.base import Compliance, NotMeasured, Requirement, Result, judge, worst
from workbench.study.requirements.curves import Curve, curves
from workbench.study.requirements.response import OfResponse, Positive
from workbench.study.requirements.value import STEP_REMEDY, check_path, errors_at, numbers_at

__all__ = ["Agreement", "ResponseAgreement"]

_MODELS = ("lin", "identify")

_Limit = Annotated[float, Field(ge=0.0)]


class _ResultPair(Requirement):
    """Two analyses.

    Attributes:
        other: the other analysis, `with` in the file; None: the same.
    """

    other: str | None = Field(default=None, alias="with")

    @property
    def analyses(self) -> tuple[str, ...]:
        return (self.analysis, self.other or self.analysis)


class Agreement(_ResultPair):
    """Numbers at two paths agree.

    Attributes:
        path: in the result of `analysis`.
        with_path: in that of `with`; None: the same path.
        tolerance: largest difference.
        relative: likewise, as a fraction of the number in `with`.
    """

    path: str
    with_path: str | None = None
    tolerance: _Limit | None = None
    relative: _Limit | None = None

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if (self.tolerance is None) == (self.relative is None):
            raise InputError(f"{where}: has no limit; give tolerance, or relative as a fraction (one of them)")
        if self.other is None and self.with_path is None:
            raise InputError(f"{where}: would be compared with itself; give with = an analysis, or with_path")
        with place(where):
            check_path(self.path)
            check_path(self.with_path or self.path)

    def find(self, results: Sequence[Result]) -> Compliance:
        mine = numbers_at(results[0], self.path, self.name)
        theirs = numbers_at(results[1], self.with_path or self.path, self.name)
        if len(mine) != len(theirs):
            raise NotMeasured(f"{len(mine)} numbers at {self.path}, but {len(theirs)} to compare them with")
        found = [self._pair(where, a, b) for (where, a), (_, b) in zip(mine, theirs, strict=True)]
        errors = [
            errors_at(r, p, len(found)) for r, p in zip(results, (self.path, self.with_path or self.path), strict=False)
        ]
        for one, error in zip(found, map(sum, zip(*errors, strict=True)), strict=True):
            if one.passed and one.margin is not None and error > one.margin:
                raise NotMeasured(f"{one.where}: {one.value_words} apart, known to ± {error:.2g} only, {STEP_REMEDY}")
        return worst(found)

    def _pair(self, where: str, mine: float, theirs: float) -> Compliance:
        limit = self.tolerance if self.relative is None else self.relative * abs(theirs)
        words = f"{where + ': ' if where else ''}{mine:.6g} and {theirs:.6g}"
        return judge(abs(mine - theirs), {"max": limit or 0.0}, where=words)


class ResponseAgreement(_ResultPair, OfResponse):
    """Two frequency responses agree at the frequencies measured first, as far as the other one reaches.

    Attributes:
        db: largest difference of the gain [dB].
        deg: largest difference of the phase [deg], whole turns apart.
        band: frequencies that count [Hz]; None: all.
        with_amplitude: `amplitude` of the other response.
        with_source: `source` of the other response.
    """

    db: _Limit | None = None
    deg: _Limit | None = None
    band: list[Positive] | None = Field(default=None, min_length=2, max_length=2)
    with_amplitude: Positive | None = None
    with_source: Literal["linear", "measured"] | None = None

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if self.db is None and self.deg is None:
            raise InputError(f"{where}: has no limit; give db, deg or both")
        if self.band is not None and self.band[0] > self.band[1]:
            raise InputError(
                f"{where}: band {self.band[0]:g} to {self.band[1]:g} Hz falls; give the lower frequency first"
            )

    def find(self, results: Sequence[Result]) -> Compliance:
        mine, theirs = self._pair(results)
        low, high = self.band or (0.0, math.inf)
        mine.check_failed(low, high)
        shared = [f for f in mine.frequency if theirs.reaches(f) and low * (1.0 - 1e-9) <= f <= high * (1.0 + 1e-9)]
        if not shared:
            raise NotMeasured("the two responses share no frequency in the band")
        return worst([f for frequency in shared for f in self._at(mine, theirs, frequency)])

    def _pair(self, results: Sequence[Result]) -> tuple[Curve, Curve]:
        """Return both responses; a linear model is evaluated where the other one was measured."""
        first = self._curve(results[0], self.amplitude, self.source, ())
        second = self._curve(results[1], self.with_amplitude, self.with_source, first.frequency)
        if results[0]["command"] in _MODELS and results[1]["command"] not in _MODELS:
            first = self._curve(results[0], None, None, second.frequency)
            return first.only(second.frequency), second
        return first, second

    def _curve(self, result: Result, amplitude: float | None, source: str | None, at: Sequence[float]) -> Curve:
        names = {"input": self.input, "output": self.output} if result["command"] in _MODELS else {}
        responses = curves(result, at=at, amplitude=amplitude, source=source, plant=self.plant, **names)
        if len(responses) != 1:
            had = ", ".join(c.label for c in responses)
            raise InputError(f"{self.name}: the {result['command']} has several responses ({had}); name one amplitude")
        if not responses[0].frequency:
            raise NotMeasured("no point was measured")
        return responses[0]

    def _at(self, mine: Curve, theirs: Curve, frequency: float) -> list[Compliance]:
        result = []
        if self.db is not None:
            off = abs(mine.at("gain", frequency) - theirs.at("gain", frequency))
            result.append(judge(off, {"max": self.db}, unit="dB", where=mine.where(frequency)))
        if self.deg is not None:
            off = abs((mine.at("phase", frequency) - theirs.at("phase", frequency) + 180.0) % 360.0 - 180.0)
            result.append(judge(off, {"max": self.deg}, unit="deg", where=mine.where(frequency)))
        return result
