"""Points of a nonlinear frequency response on disk, and what of an earlier run is kept."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, suggest
from workbench.jobs.options import Limits
from workbench.jobs.store import Store
from workbench.jobs.version import stamp
from workbench.model import Model
from workbench.response.nfr.certificate import finite
from workbench.response.nfr.point import NfrPoint
from workbench.response.nfr.result import MISSING, FailedPoint, NfrResult
from workbench.response.nfr.zero_input import ZeroInput

__all__ = ["STATUSES", "NfrStore", "check_redo", "from_result"]

STATUSES = ("settled", "averaged", "failed")

# To be raised whenever a change of the code changes a measured number: results of both are not mixed.
_ALGORITHM = 8

_ZERO_INPUT = "zero input"
_STANDING = "operating point"
_SECOND = "second responses"  # of an amplitude over given frequencies

Key = tuple[float, float]


@dataclass(frozen=True, eq=False)
class NfrStore:
    """The store of one sweep.

    Attributes:
        store: where the points are.
        limits: of the present run: a point lost under other limits is measured again.
    """

    store: Store
    limits: Limits

    @classmethod
    def open(
        cls,
        folder: str | Path,
        model: Model,
        *,
        settings: Mapping[str, Any],
        effort: Mapping[str, Any],
        limits: Limits,
    ) -> Self:
        """Open the store in `folder`.

        Args:
            folder: made if it is not there.
            model: what is measured; its FMU's hash and settings become part of the key.
            settings: what else influences a point, ready for JSON.
            effort: likewise, but what a redo may change.
            limits: of the present run.

        Raises:
            InputError: the model is not a file, the folder cannot be used, its file is not a store.
        """
        if model.recipe is None:
            raise InputError(
                f"store: {model.name} is not a file; its results cannot be distinguished from another model's"
            )
        subject = {
            "analysis": "nfr",
            "algorithm": _ALGORITHM,
            **stamp().in_store,
            "model": model.recipe.identity(),
            "runs": [model.interface, model.solver],
            **settings,
        }
        return cls(Store(folder, subject=subject, effort=effort), limits)

    def finished(self, redo: Collection[str]) -> dict[Key, NfrPoint]:
        """Return the points that need not be measured, by amplitude and frequency.

        Args:
            redo: statuses that are measured again. With one, the newest measurement of each point
                counts, whatever its effort was; without, only those made with the present effort.
        """
        result = self.store.latest() if redo else self.store.load()
        with self.store.taken_apart():
            values = [v for k, v in result.items() if _is_point(k) and self._counts(v)]
            points = [_whole(NfrPoint.from_dict(v["point"])) for v in values]
        return {(p.amplitude, p.frequency): p for p in points if p.status not in redo}

    def _counts(self, value: Mapping[str, Any]) -> bool:
        return value["lost_under"] is None or value["lost_under"] == asdict(self.limits)

    def zero_input(self) -> ZeroInput | None:
        """Return how the model moves by itself, if that was watched already."""
        result = self.store.get(_ZERO_INPUT)
        with self.store.taken_apart():
            return None if result is None else ZeroInput.from_dict(result)

    def save(self, point: NfrPoint, *, lost: bool = False) -> None:
        """Keep a point; it is on disk when this returns.

        Args:
            point: what was measured.
            lost: whether it failed by a crash or limit of its process, not by what it computed.
        """
        value = {"point": point.to_dict(), "lost_under": asdict(self.limits) if lost else None}
        self.store.save(repr((point.amplitude, point.frequency)), value)

    def save_zero_input(self, result: ZeroInput) -> None:
        """Keep how the model moves by itself."""
        self.store.save(_ZERO_INPUT, result.to_dict())

    def standing(self) -> OperatingPoint | None:
        """Return where the model stood, if that was looked at already."""
        result = self.store.get(_STANDING)
        with self.store.taken_apart():
            return None if result is None else OperatingPoint.from_dict(result)

    def save_standing(self, result: OperatingPoint) -> None:
        """Keep where the model stood."""
        self.store.save(_STANDING, result.to_dict())

    def second(self, frequencies: Sequence[float]) -> dict[float, tuple[NfrPoint, ...]]:
        """Return what was found besides the measured responses, by amplitude, where it was looked for.

        Args:
            frequencies: of the sweep.
        """
        result = self.store.load()
        with self.store.taken_apart():
            rows = [v for k, v in result.items() if k.startswith(_SECOND)]
            return {
                row["amplitude"]: tuple(map(NfrPoint.from_dict, row["points"]))
                for row in rows
                if row["frequencies"] == sorted(frequencies)
            }

    def save_second(self, amplitude: float, frequencies: Sequence[float], points: Sequence[NfrPoint]) -> None:
        """Keep what was found besides the measured responses of an amplitude.

        Args:
            amplitude: of the input.
            frequencies: of the sweep.
            points: what was found; none is worth keeping, too.
        """
        row = {"amplitude": amplitude, "frequencies": sorted(frequencies), "points": [p.to_dict() for p in points]}
        self.store.save(f"{_SECOND} {amplitude!r} {row['frequencies']}", row)

    def close(self) -> None:
        """Close the file."""
        self.store.close()


def _whole(point: NfrPoint) -> NfrPoint:
    """Refuse a point that has neither a response nor the reason why there is none."""
    if point.reason is None and (point.response is None or not np.isfinite(point.response)):
        raise InputError(f"a point at {point.frequency:g} Hz has neither a response nor a reason")
    return point


def _is_point(key: str) -> bool:
    return key not in (_ZERO_INPUT, _STANDING) and not key.startswith(_SECOND)


def check_redo(redo: Collection[str]) -> frozenset[str]:
    """Return the statuses to measure again.

    Raises:
        InputError: one of them is unknown.
    """
    for status in redo:
        if status not in STATUSES:
            raise InputError(f"redo: '{status}' is not a status of a point; {suggest(status, STATUSES)}")
    return frozenset(redo)


def from_result(previous: NfrResult, redo: Collection[str]) -> dict[Key, NfrPoint]:
    """Return the points of an earlier result that need not be measured, by amplitude and frequency.

    Args:
        previous: the earlier result.
        redo: statuses that are measured again; what was not measured then is measured anyway.
    """
    failed = {(f.amplitude, f.frequency_hz): f for f in previous.failed}
    points = [
        _of_result(previous, i, j, failed.get((a, f)))
        for i, a in enumerate(previous.amplitude.tolist())
        for j, f in enumerate(previous.frequency_hz.tolist())
        if (a, f) not in failed or failed[a, f].reason != MISSING
    ]
    return {(p.amplitude, p.frequency): p for p in points if p.status not in redo}


def _of_result(previous: NfrResult, i: int, j: int, failed: FailedPoint | None) -> NfrPoint:
    step = float(previous.step[i, j])
    return NfrPoint(
        frequency=float(previous.frequency_hz[j]),
        amplitude=float(previous.amplitude[i]),
        response=complex(previous.response[i, j]) if failed is None else None,
        offset=float(previous.offset[i, j]) if failed is None else None,
        periods=int(previous.periods[i, j]),
        averaged=bool(previous.averaged[i, j]),
        error=finite(float(previous.error[i, j])),
        stable=bool(previous.stable[i, j]) if np.isfinite(previous.stable[i, j]) else None,
        step=step if step > 0.0 else None,
        reason=None if failed is None else failed.reason,
        kind=None if failed is None else failed.kind,
        certificate=previous.certificates[i][j],
    )
