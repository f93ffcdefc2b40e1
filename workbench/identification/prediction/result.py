"""What a refinement did, and what it tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.identification.prediction.model_selection import Candidate

__all__ = ["NOT_REFINED", "Refinement"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Refinement(RecordPart):
    """How a model was refined.

    Attributes:
        taken: the refined model is the one that is returned.
        reason: why, or why not, in one line.
        order: states of the plant.
        noise_order: states of the disturbance.
        shared: the disturbance has the plant's poles, and no states of its own.
        steps: of the last refinement.
        settled: a further step would change nothing.
        tried: other structures; the Bayesian criterion chose.
    """

    taken: bool
    reason: str
    order: int = 0
    noise_order: int = 0
    shared: bool = False
    steps: int = 0
    settled: bool = True
    tried: tuple[Candidate, ...] = ()

    @property
    def structure(self) -> str:
        """Its name in the literature."""
        if self.shared:
            return "innovations form (the disturbance has the plant's poles)"
        if not self.noise_order:
            return "output error (white disturbance)"
        return f"Box-Jenkins (disturbance of order {self.noise_order} with poles of its own)"

    @property
    def words(self) -> str:
        """What was done, in one line."""
        if not self.taken:
            return f"not refined: {self.reason}"
        end = "" if self.settled else f"; {self.steps} steps did not suffice to the end"
        return f"refined to the least prediction error, {self.structure}: {self.reason}{end}"

    def derived(self) -> dict[str, Any]:
        """Return the name of the structure."""
        return {"structure": self.structure if self.taken else None, "words": self.words}

    def table(self) -> Iterator[Sequence[str]]:
        """Yield a row for each structure that was tried, best first: plant, disturbance, numbers, criterion."""
        best = min((c.criterion for c in self.tried), default=0.0)
        for c in sorted(self.tried, key=lambda c: c.criterion):
            own = f"order {c.noise_order}" if c.noise_order else "white"
            noise = "the plant's poles" if c.shared else own
            yield str(c.order), noise, str(c.freedom), f"{c.criterion - best:.1f}"


NOT_REFINED = Refinement(taken=False, reason="not asked for")
