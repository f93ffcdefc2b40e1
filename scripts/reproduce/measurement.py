"""What measures targets: an experiment, what it found, and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Measured", "Measurement", "Picture", "Reproduction"]

Measured = float | Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class Picture:
    """A picture that corresponds to figures of the source report.

    Attributes:
        figures: their numbers.
        words: what it shows.
        draw: makes it; called only where somebody wants to see it.
    """

    figures: tuple[int, ...]
    words: str
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class Measurement:
    """What an experiment found.

    Attributes:
        values: target → one number or several.
        remarks: target → what else was seen, in words.
        pictures: of it.
    """

    values: Mapping[str, Measured]
    remarks: Mapping[str, str] = field(default_factory=dict)
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Reproduction:
    """Something that is run once and measures several targets.

    Attributes:
        name: of the experiment.
        targets: that it measures.
        measure: runs it.
        seconds: about how long it takes; the long ones begin first.
    """

    name: str
    targets: tuple[str, ...]
    measure: Callable[[], Measurement]
    seconds: float = 0.5
