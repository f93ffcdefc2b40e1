"""What a point of a frequency response states beside the truth, and how often it holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Trial", "held", "kept", "lines"]


@dataclass(frozen=True)
class Trial:
    """One plant measured: what is stated and what is true, both relative to the true response."""

    status: str
    stated: float
    true: float
    periods: int


def lines(found: Sequence[Trial]) -> Iterator[str]:
    """Return the table: one line for each status."""
    for status in ("settled", "averaged", "failed"):
        of = [t for t in found if t.status == status]
        known = [t for t in of if np.isfinite(t.stated)]
        if not of:
            continue
        covered = sum(t.true <= t.stated for t in known)
        parts = [f"{status:>9}: {len(of):4}, error stated for {len(known):4}"]
        if known:
            ratio = np.median([t.stated / max(t.true, 1e-15) for t in known])
            parts.append(f"covers the truth {100.0 * covered / len(known):6.1f} %, median of stated / true {ratio:.3g}")
        parts.append(
            f"more than 1 % off {sum(t.true > 0.01 for t in of):4}, worst {100.0 * max(t.true for t in of):.3g} %"
        )
        parts.append(f"periods (median) {np.median([t.periods for t in of]):.0f}")
        yield "; ".join(parts)


def held(found: Sequence[Trial]) -> bool:
    """Whether settled points hold the truth in 95 % of cases."""
    settled = [t for t in found if t.status == "settled"]
    return sum(t.true <= t.stated for t in settled) >= 0.95 * len(settled)


def kept(found: Sequence[Trial]) -> bool:
    """Whether settled points hold the truth in 95 % of cases, and all are good to 1 %."""
    return held(found) and not any(t.true > 0.01 for t in found if t.status == "settled")
