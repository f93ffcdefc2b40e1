"""Does the same run give the same numbers?"""

from __future__ import annotations

from workbench.analysis.check.compare import largest_gap
from workbench.analysis.check.result import Finding
from workbench.analysis.check.subject import Subject, same_bits

__all__ = ["determinism"]

_ROUNDING = 1e-12


def determinism(subject: Subject) -> Finding:
    """Make the same run twice, in new instances, with another run between them: equal to the last bit.

    The inputs swing as in `runs`; the run between swings the other way. Chaotic and unstable models pass: equal
    operations on equal numbers give equal results. Broken: the runs differ by more than 1e-12 of a range; watch:
    by less (sums whose order changes, as with threads). What differs only from one process to the next is not seen.
    """
    first = subject.run(subject.sines())
    subject.run(subject.sines(-1.0))
    second = subject.run(subject.sines())
    count = {"values": int(first.values.size)}
    if same_bits(first, second):
        return Finding("good", f"2 runs, {first.values.size} values each: equal to the last bit", numbers=count)
    gap = largest_gap(first, second, subject.names)
    verdict = "watch" if gap.relative <= _ROUNDING else "broken"
    return Finding(
        verdict,
        f"in a second run {gap.words}",
        "no result is repeatable; snapshots by replay go wrong, and periods may never settle",
        {**count, "relative": gap.relative},
    )
