"""What `excite` returns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from workbench.core.records.record import entry
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.show.result import Result

__all__ = ["ExciteResult", "SignalFacts"]


@dataclass(frozen=True, kw_only=True)
class SignalFacts:
    """How good a signal is.

    Attributes:
        kind: "prbs" or "multisine".
        dt: sampling interval [s].
        period: after which the signal repeats [s].
        clock: how often the value may change [Hz]; None for a multisine.
        order: order of the shift register; None for a multisine.
        lines: excited frequencies of an input; None for a PRBS, which has all.
        band: lowest and highest frequency between which the spectrum of the sampled signal holds −3 dB [Hz].
        amplitude: half the range that each input covers in the identification part.
        crest_factor: peak over root mean square of each input about its mean.
        cross_correlation: largest correlation coefficient between two inputs over lags up to a quarter of the record;
            None for one input.
        cross_correlation_lag: where that is [s].
    """

    kind: str
    dt: float
    period: float
    clock: float | None
    order: int | None
    lines: int | None
    band: tuple[float, float]
    amplitude: tuple[float, ...]
    crest_factor: tuple[float, ...]
    cross_correlation: float | None
    cross_correlation_lag: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class ExciteResult(Result):
    """Recorded experiments.

    Attributes:
        model, interface, solver: what ran.
        identification: the data to fit.
        validation: the data to test with, from later in the same session; None: none were asked for.
        design: facts about the signal.
        u0: input → its middle.
        y0: output → its value before the first sample.
        notes: what was chosen, and doubts.
        operating_point: where the session began; None: not known.
    """

    _page = "workbench.data.excite.page:excite_page"
    _picture = "workbench.data.excite.picture:plot_excite"

    model: str
    interface: str
    solver: str
    identification: Experiment = field(metadata=entry(kept=False))
    validation: Experiment | None
    design: SignalFacts
    u0: dict[str, float]
    y0: dict[str, float]
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a recorded experiment", "excite"

    @property
    def not_in_stream(self) -> str:
        """What `to_csv` leaves out where it writes to a stream; empty: nothing."""
        if self.validation is None:
            return ""
        return "the validation data are not written; name a file, or use `validation_samples=0`"

    def rows(self) -> Iterator[Sequence[Any]]:
        """Return the samples of the identification part."""
        return self.identification.rows()

    def to_csv(self, path: str | Path | TextIO) -> tuple[Path, ...]:
        """Write the identification part to `path`, the validation part beside it as NAME_validation.

        Args:
            path: path of the first file, or an open text stream for the identification part alone.

        Returns:
            The files written.

        Raises:
            InputError: a file cannot be written.
        """
        if not isinstance(path, str | Path):
            self.identification.to_csv(path)
            return ()
        first = Path(path)
        if self.validation is None:
            self.identification.to_csv(first)
            return (first,)
        second = validation_path(first)
        self.identification.to_csv(first)
        self.validation.to_csv(second)
        return (first, second)

    def derived(self) -> dict[str, Any]:
        """Return the signals of the identification part.

        Keys:
            dt, time, u, y, units: the identification part.
            files: remarks; files written.
            data_name, data_notes: name of the data, and remarks on them.
            closed_loops: of a system: the `components` of each, and which signals are `acting` on it,
                `inside` it, `showing` it.
        """
        first = self.identification.to_dict()
        same = ("time", "u", "y", "units", "closed_loops")
        own = {"data_name": first["name"], "data_notes": first["notes"], "dt": self.design.dt, "files": ()}
        return {**{key: first[key] for key in same}, **own}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the identification part, whose signals stand among the keys."""
        first = {**data, "name": data["data_name"], "notes": data["data_notes"]}
        return {**data, "identification": Experiment.from_dict(first)}


def validation_path(path: Path) -> Path:
    """Return where the validation part is written beside the identification part at `path`.

    Raises:
        InputError: a folder is in its place.
    """
    second = path.with_name(f"{path.stem}_validation{path.suffix}")
    if second.is_dir():
        raise InputError(f"{second}: is a folder, but the validation data are written there; use another name")
    return second
