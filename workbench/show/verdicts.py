"""Verdict words and the three tones in which they are shown; each has a sign too, for those who see no colours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["TONES", "Verdict", "counted", "tone", "worst_first"]

# Tone → the words that have it. The order is that of the summary: what is violated comes first.
TONES: dict[str, tuple[str, ...]] = {
    "poor": ("poor", "fail", "failed", "violated", "broken", "error", "differs", "unstable", "missed", "no"),
    "watch": ("watch", "warn", "warning", "unknown", "averaged", "doubtful", "partly", "not reachable", "skipped"),
    "good": ("good", "pass", "passed", "met", "ok", "kept", "agrees", "stable", "settled", "converged", "yes"),
}
_TONE_OF = {word: tone for tone, words in TONES.items() for word in words}
_ORDER = [*TONES, ""]


@dataclass(frozen=True)
class Verdict:
    """One line of the summary at the top of a page.

    Attributes:
        word: of `TONES`, which colours the line; another word gives no colour.
        text: what it is about, with the value and the limit.
    """

    word: str
    text: str


def tone(word: str) -> str:
    """Return "good", "watch", "poor", or "" for a word without a tone."""
    return _TONE_OF.get(word.strip().lower(), "")


def worst_first(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Return the verdicts with the violated first, then those to watch, then the others, each in the order given."""
    return sorted(verdicts, key=lambda v: _ORDER.index(tone(v.word)))


def counted(verdicts: Sequence[Verdict]) -> str:
    """Return how many there are of each word, as in "1 × failed, 12 × passed"."""
    return ", ".join(f"{n} × {word}" for word, n in Counter(v.word for v in worst_first(verdicts)).items())
