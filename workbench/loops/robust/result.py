"""What a robustness analysis returns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.loops.robust.family import UncertainParameter
from workbench.show.result import Result

__all__ = ["MuPoint", "Neglected", "RobustMargin", "RobustResult", "WorstDisk", "WorstGain", "WorstPlace"]


@dataclass(frozen=True, eq=False, kw_only=True)
class WorstPlace(RecordPart):
    """A parameter set at which the model was linearised.

    Attributes:
        parameters: parameter → value.
        size: largest deviation from the middle, in half the range.
        frequency_hz: frequency of the pole [Hz].
        pole: nearest to the border of stability, or beyond [1/s]; of a sampled model in z.
        poles: all of them, shape (n,).
        unstable: whether the pole is beyond the border, by more than its error.
    """

    parameters: Mapping[str, float]
    size: float
    frequency_hz: float
    pole: complex
    poles: Complex
    unstable: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class RobustMargin(RecordPart):
    """Up to which multiple of their ranges the parameters leave the model stable.

    Attributes:
        lower: it is stable for all parameters in the ranges times this: proved.
        upper: it is unstable at a parameter set of this size: `worst`; infinite: none was found.
        up_to: multiple up to which was looked.
        boxes: parts into which the ranges were divided for the proof.
        worst: the smallest unstable parameter set that was found; else that in the ranges with the slowest pole.
        approximate: transport delays are Padé approximations in all of this, which decides nothing of the model.
    """

    lower: float
    upper: float = field(metadata=entry(null=math.inf))
    up_to: float
    boxes: int
    worst: WorstPlace
    approximate: bool = False

    def derived(self) -> dict[str, Any]:
        """Return the verdict: "stable", "unstable", or "unknown"."""
        return {"verdict": self.verdict}

    @property
    def verdict(self) -> str:
        """On the ranges as they are given."""
        if self.approximate:
            return "unknown"
        if self.lower >= 1.0:
            return "stable"
        return "unstable" if self.upper <= 1.0 else "unknown"


@dataclass(frozen=True, kw_only=True)
class MuPoint(RecordPart):
    """Bounds of µ at one frequency, of the model over the ranges: the inverse of the margin there.

    Attributes:
        frequency_hz: [Hz].
        lower: without what is neglected, attained by a perturbation; 0: none was found.
        upper: with all that is neglected; infinite: the neglected rest is too large by itself.
    """

    frequency_hz: float
    lower: float
    upper: float = field(metadata=entry(null=math.inf))


@dataclass(frozen=True, eq=False, kw_only=True)
class WorstGain(RecordPart):
    """The largest gain over all frequencies of the band and all parameters in their ranges.

    Attributes:
        nominal: in the middle of the ranges.
        lower: at `parameters`, where the model was linearised.
        upper: it is proved that the gain is nowhere larger; infinite: nothing is proved.
        frequency_hz: of `lower` [Hz].
        parameters: parameter → value.
        band_hz: lowest and highest frequency [Hz].
        shown_hz: frequencies of the curves, shape (k,) [Hz].
        nominal_curve, worst_curve: gain in the middle of the ranges and at `parameters`, shape (k,).
    """

    nominal: float
    lower: float
    upper: float = field(metadata=entry(null=math.inf))
    frequency_hz: float
    parameters: Mapping[str, float]
    band_hz: tuple[float, float]
    shown_hz: Floats
    nominal_curve: Floats
    worst_curve: Floats


@dataclass(frozen=True, kw_only=True)
class WorstDisk(RecordPart):
    """The disk margin that is left for every parameter set in the ranges (skew 0): gain and phase may vary at once.

    Attributes:
        where: connections that are opened, at the same time.
        alpha: size of the disk that is proved.
        found: of the worst parameter set that was found.
        nominal: in the middle of the ranges.
        gain_db: the gain may rise or fall by so much [dB].
        phase_deg: or the phase may turn by so much either way [deg].
        frequency_hz: where the disk is smallest at the worst parameter set [Hz].
    """

    where: str
    alpha: float
    found: float
    nominal: float
    gain_db: float = field(metadata=entry(null=math.inf))
    phase_deg: float
    frequency_hz: float


@dataclass(frozen=True, kw_only=True)
class Neglected(RecordPart):
    """What the parameters do besides their fraction of low rank; the bounds have it as a block of any content.

    Attributes:
        relative: its size over the ranges, relative to all that the parameters do.
        models: number of linear models that were made.
        accuracy: to which their entries are known, relative to the size of the matrices.
        ranks: how often each parameter stands in the perturbation.
    """

    relative: float
    models: int
    accuracy: float
    ranks: tuple[int, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class RobustResult(Result):
    """What holds for all parameters in their ranges.

    Attributes:
        model, interface: what was analysed.
        parameters: with their ranges.
        stability: up to which multiple of the ranges the model is stable.
        mu: bounds over frequency, for the ranges as they are given.
        worst_gain: from inputs to outputs, or of S - T where a loop is opened; None: not asked for.
        disk_margins: of the loop that is opened; empty: none.
        neglected: what the bounds have besides.
        nominal_poles: in the middle of the ranges, shape (n,) [1/s]; of a sampled model in z.
        dt: period of a sampled model [s]; 0: continuous.
        trimmed: whether the equilibrium was found anew at each parameter set.
        command_line: that linearises the model at the worst parameter set; empty: it has none.
        notes: one line each.
        operating_point: in the middle of the ranges.
    """

    _page = "workbench.loops.robust.page:robust_page"
    _picture = "workbench.loops.robust.picture:plot_robust"

    model: str
    interface: str
    parameters: tuple[UncertainParameter, ...]
    stability: RobustMargin
    mu: tuple[MuPoint, ...]
    worst_gain: WorstGain | None
    disk_margins: tuple[WorstDisk, ...]
    neglected: Neglected
    nominal_poles: Complex
    dt: float
    trimmed: bool
    command_line: str = ""
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a robustness analysis", "robust"

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency."""
        yield ["frequency_hz", "lower", "upper"]
        yield from ([p.frequency_hz, p.lower, p.upper] for p in self.mu)
