"""What one run of an analysis gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["Outcome"]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one run of an analysis gave.

    Attributes:
        result: the JSON of the command; None: there is none, `reason` says why.
        code: exit code of the command; 1: points of it failed.
        reason: why there is no result.
        bad_input: whether what was asked for cannot be done, rather than that it failed.
        notes: remarks of the command, one line each.
        seconds: that it took when it was measured.
        files: "csv" and further CSV files by what follows NAME_ → text; those that other analyses take.
        reused: whether it comes from the store.
    """

    result: Mapping[str, Any] | None = None
    code: int = 2
    reason: str = ""
    bad_input: bool = False
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    files: Mapping[str, str] = field(default_factory=dict)
    reused: bool = False

    @property
    def lasting(self) -> bool:
        """Whether it may be kept: what crashed or was interrupted is measured again."""
        return self.result is not None and self.code in (0, 1)

    def to_store(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {k: v for k, v in asdict(self).items() if k not in ("reused", "reason", "bad_input")}

    @classmethod
    def from_store(cls, data: Mapping[str, Any]) -> Outcome:
        """Return what `to_store` describes."""
        return cls(**{**data, "notes": tuple(data["notes"]), "reused": True})
