"""Linear models beside a measured response: the result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.operating_point import OperatingPoint
from workbench.point.lin.result import LinResult
from workbench.response.compare_linear.interfaces import InterfaceDifference
from workbench.response.nfr.result import NfrResult
from workbench.show.result import Result

__all__ = ["LinComparison", "MethodAgreement"]


@dataclass(frozen=True)
class MethodAgreement(RecordPart):
    """One linear model against the measured response at one frequency.

    Attributes:
        method: which linear model.
        frequency_hz: [Hz].
        gain_db: gain of the model less the measured gain [dB]; −∞ where it has none; NaN where nothing was measured.
        phase_deg: phase of the model less the measured phase, within ±180 [deg]; NaN where either has no gain.
        agrees: within 0.5 dB and 5 deg; None where nothing was measured, or nothing moved.
        measured_gain: what was measured; NaN where nothing was.
    """

    method: str
    frequency_hz: float
    gain_db: float
    phase_deg: float
    agrees: bool | None
    measured_gain: float = math.nan

    def derived(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"word": self.word}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the difference to a model without any effect, −∞ dB, which JSON does not hold."""
        none = data["gain_db"] is None and data["agrees"] is not None
        return {**data, "gain_db": -math.inf} if none else data

    @property
    def word(self) -> str:
        """The verdict in one or two words."""
        if self.agrees is None:
            return "no effect" if self.measured_gain == 0.0 else "not measured"
        if self.gain_db == -math.inf:
            return "no linear effect"
        return "agrees" if self.agrees else "differs"

    @property
    def words(self) -> str:
        """The verdict, with the measured gain where the linear one is 0 and no ratio says it."""
        return f"{self.word}, measured gain {self.measured_gain:.4g}" if self.gain_db == -math.inf else self.word


@dataclass(frozen=True, eq=False)
class LinComparison(Result):
    """All methods on one model at one point, from one input to one output.

    Attributes:
        model, interface, solver: what was linearised.
        input, output: names.
        results: "method (interface)" → linear model.
        failed: name of a method → why it does not apply, one line.
        measured: frequency response of small amplitude; None where it could not be measured.
        verdicts: every model at every frequency.
        interfaces: co-simulation against model exchange; None where the FMU does not offer both.
        words: the comparison in sentences.
        operating_point: where the models were linearised.
        notes: what else should be known, one line each.
    """

    _page = "workbench.response.compare_linear.page:comparison_page"
    _picture = "workbench.response.compare_linear.picture:plot_comparison"

    model: str
    interface: str
    solver: str
    input: str
    output: str
    results: dict[str, LinResult]
    failed: dict[str, str] = field(metadata=entry(key="not_applicable"))
    measured: NfrResult | None
    verdicts: tuple[MethodAgreement, ...]
    interfaces: InterfaceDifference | None
    words: tuple[str, ...]
    operating_point: OperatingPoint
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a comparison of linear models", "lin --compare"

    @property
    def compared(self) -> bool:
        """Whether anything was measured that a model could agree with or differ from."""
        return any(v.agrees is not None for v in self.verdicts)

    @property
    def complete(self) -> bool:
        """Whether the models were compared with a measurement."""
        return self.compared

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each verdict."""
        names = ("method", "frequency_hz", "gain_db", "phase_deg", "agrees", "measured_gain", "word")
        yield names
        yield from ([getattr(v, name) for name in names] for v in self.verdicts)
