"""What came of measuring the targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from scripts.reproduce.targets import BASES, MET, MISSED, NOT_REACHABLE, VERDICTS, PublishedTarget
from workbench.core.records.record import RecordPart, entry
from workbench.show.result import Result

__all__ = ["Drawing", "ReproduceResult", "TargetList", "TargetResult", "plain"]

_MOST = 4  # numbers shown one by one; more as a range


@dataclass(frozen=True)
class TargetResult(RecordPart):
    """One target and what was measured.

    Attributes:
        target: from the data file.
        experiment: that measured it.
        measured: one number or several; None: nothing was measured.
        remark: what else was seen.
        problem: why nothing was measured; "": it was.
    """

    target: PublishedTarget = field(metadata=entry(kept=False))
    experiment: str
    measured: float | tuple[float, ...] | None
    remark: str = ""
    problem: str = ""

    @property
    def passed(self) -> bool:
        """Whether it was measured and is within the tolerance."""
        return self.measured is not None and self.target.accepts(self.measured)

    @property
    def verdict(self) -> str:
        """One of "met", "missed", "not reachable".

        A measurement that failed, or left what the target says is measured instead, is a miss whatever its reason.
        """
        if self.passed:
            return MET
        return NOT_REACHABLE if self.target.reason is not None and self._as_told else MISSED

    @property
    def known(self) -> bool:
        """Whether it is missed by what the target says, for the cause that it names."""
        return not self.passed and self.target.shortfall is not None and self._as_told

    @property
    def _as_told(self) -> bool:
        """Whether what was measured is what the target says is measured instead."""
        return (
            self.measured is not None and self.target.instead is not None and self.target.instead.accepts(self.measured)
        )

    @property
    def reason(self) -> str | None:
        """Why it is not met; None: it is."""
        if self.passed:
            return None
        t = self.target
        if self.problem:
            return self.problem
        outside = f"{self.text} measured, outside {t.text} ({t.tolerance})"
        if t.instead is None:
            return outside
        if not self._as_told:
            return f"{outside} and outside {t.instead.text}, which is to be measured instead: {t.instead.why}"
        seen = f"; {self.remark}" if self.remark else ""
        return f"{self.text} measured; {t.reason or t.shortfall}{seen}"

    @property
    def text(self) -> str:
        """What was measured, in words; many numbers as a range."""
        if self.measured is None:
            return "–"
        found = [self.measured] if isinstance(self.measured, float) else list(self.measured)
        if len(found) > _MOST and not isinstance(self.target.value, list):
            shown = " … ".join(dict.fromkeys(f"{x:.6g}" for x in (min(found), max(found))))
        else:
            shown = ", ".join(f"{x:.7g}" for x in found)
        return f"{shown} {self.target.unit}".strip()

    def derived(self) -> dict[str, Any]:
        """Return the target's own keys, and how the measurement compares with it."""
        t = self.target
        return {
            **t.model_dump(include={"name", "chapter", "figures", "what", "unit", "origin", "note"}),
            **t.model_dump(include={"basis", "fmu", "fitted_by"}),
            "target": t.value if t.value is not None else t.text,
            "tolerance": t.model_dump(include={"absolute", "relative", "low", "high"}, exclude_none=True),
            "passed": self.passed,
            "verdict": self.verdict,
            "known": self.known,
            "reason": self.reason,
            "published": t.model_dump(),
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the target as its file has it."""
        return {**data, "target": PublishedTarget.model_validate(data["published"])}


@dataclass(frozen=True)
class Drawing:
    """A picture that was drawn where it was measured.

    Attributes:
        figures: numbers in the source report.
        words: what it shows.
        chapter: of the source report.
        svg: the picture, not in JSON; empty: only files were written.
        files: that were written.
    """

    figures: tuple[int, ...]
    words: str
    chapter: str
    svg: str = field(default="", metadata=entry(kept=False))
    files: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class ReproduceResult(Result):
    """The source report's figures beside what was measured now.

    Attributes:
        outcomes: of the targets that were chosen, in the order of the source report.
        drawings: pictures that correspond to its figures.
        seconds: that all of it took [s].
        processor_seconds: experiment → time that it kept a processor busy, pictures included [s].
        jobs: processes at a time.
        selection: what was asked for; empty: all.
        interrupted: whether Ctrl-C ended it before all was measured.
    """

    _page = "scripts.reproduce.page:reproduce_page"

    outcomes: tuple[TargetResult, ...] = field(metadata=entry(key="targets"))
    drawings: tuple[Drawing, ...] = field(metadata=entry(key="pictures"))
    seconds: float = field(metadata=entry(key="wall_seconds"))
    processor_seconds: Mapping[str, float] = field(metadata=entry(key="experiments"))
    jobs: int
    selection: tuple[str, ...] = ()
    interrupted: bool = False

    _WHAT, _COMMAND = "a result of reproduce", "reproduce"

    @property
    def missed(self) -> tuple[TargetResult, ...]:
        """Targets that are missed without a reason in the source report."""
        return tuple(o for o in self.outcomes if o.verdict == MISSED)

    @property
    def unexpected(self) -> tuple[TargetResult, ...]:
        """Missed targets without those of which the bundled model is known to fall short."""
        return tuple(o for o in self.missed if not o.known)

    @property
    def counts(self) -> Mapping[str, Mapping[str, int]]:
        """Basis → verdict → number of targets; predictions come first."""
        count: Counter[tuple[str, str]] = Counter((o.target.basis, o.verdict) for o in self.outcomes)
        return {b: {v: count[b, v] for v in VERDICTS} for b in BASES}

    @property
    def words(self) -> str:
        """The whole in one line, predictions first."""
        parts = [
            f"{sum(found.values())} {basis}: " + ", ".join(f"{n} {verdict}" for verdict, n in found.items() if n)
            for basis, found in self.counts.items()
            if any(found.values())
        ]
        if self.missed and not self.unexpected:
            parts.append("what is missed is known")
        processes = "1 process" if self.jobs == 1 else f"{self.jobs} processes"
        return f"{'; '.join(parts)}; {self.seconds:.1f} s with {processes}"

    def outcome(self, name: str) -> TargetResult:
        """Return what came of one target.

        Args:
            name: of the target.

        Raises:
            KeyError: it was not asked for.
        """
        for found in self.outcomes:
            if found.target.name == name:
                return found
        raise KeyError(name)

    def derived(self) -> dict[str, Any]:
        """Return the whole in one line, the counts, and whether nothing is missed but what is known to be."""
        return {"words": self.words, "counts": self.counts, "passed": not self.unexpected}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each target."""
        yield ("name", "chapter", "figures", "what", "basis", "target", "tolerance", "measured", "verdict", "reason")
        for o in self.outcomes:
            t = o.target
            figures = " ".join(map(str, t.figures))
            yield (t.name, t.chapter, figures, t.what, t.basis, t.text, t.tolerance, o.text, o.verdict, o.reason)


@dataclass(frozen=True)
class TargetList(Result):
    """Targets that are to be measured.

    Attributes:
        targets: in the order of the source report.
    """

    _page = "scripts.reproduce.page:targets_page"

    targets: tuple[PublishedTarget, ...] = field(metadata=entry(kept=False))

    _WHAT, _COMMAND = "a list of targets", "reproduce --list"
    unexpected: ClassVar[tuple[TargetResult, ...]] = ()  # nothing was measured

    def derived(self) -> dict[str, Any]:
        """Return the targets as their file has them."""
        return {"targets": [t.model_dump() for t in self.targets]}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the targets as their file has them."""
        return {"targets": tuple(PublishedTarget.model_validate(t) for t in data["targets"])}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each target."""
        yield ("name", "chapter", "figures", "what", "basis", "target", "tolerance")
        for t in self.targets:
            yield (t.name, t.chapter, " ".join(map(str, t.figures)), t.what, t.basis, t.text, t.tolerance)


def plain(value: object) -> float | tuple[float, ...]:
    """Return what an experiment found as one number or a tuple of them.

    Args:
        value: number, sequence or array.
    """
    found = np.asarray(value, dtype=np.float64)
    return float(found) if found.ndim == 0 else tuple(float(x) for x in found.ravel())
