"""Identification experiments: what can be asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, fields, replace
from typing import TYPE_CHECKING, Annotated, Any

from workbench.core.records.forms import ONE, Form, Names
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InWhole
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.data.excite.design import FilterDesign
    from workbench.data.excite.result import ExciteResult  # noqa: F401 - the record's type, below
    from workbench.data.excite.signals import MultisineDesign, PrbsDesign

__all__ = ["Excite", "excite"]


def _form(kind: str) -> Form:
    """Return how a design of one kind is written: KEY=VALUE pairs with commas between."""
    return Form(
        metavar="KEY=VALUE,..",
        read=lambda value: _design(kind, value),
        layout=replace(ONE, join=lambda value: [_written(value)]),
        items=("string", "object"),
    )


def _design(kind: str, value: FilterDesign | str | Mapping[str, Any]) -> FilterDesign:
    """Return the design that a text or a table of TOML describes."""
    from workbench.data.excite.signals import parse_design  # noqa: PLC0415  --help needs no numerics

    if isinstance(value, Mapping):
        texts = {k: ":".join(map(str, v)) if isinstance(v, list | tuple) else v for k, v in value.items()}
        value = ",".join(f"{key}={text}" for key, text in texts.items())
    return parse_design(kind, value) if isinstance(value, str) else value


def _written(design: FilterDesign) -> str:
    given = {f.name: getattr(design, f.name) for f in fields(design)}  # type: ignore[arg-type]
    texts = {k: v if isinstance(v, str) else ":".join(map(repr, v if isinstance(v, tuple) else (v,)))
             for k, v in given.items() if v is not None}  # fmt: skip
    return ",".join(f"{key}={text}" for key, text in texts.items())


if TYPE_CHECKING:
    _Prbs = PrbsDesign | str
    _Multisine = MultisineDesign | str
else:
    _Prbs = Annotated[object, _form("prbs")]
    _Multisine = Annotated[object, _form("multisine")]


class Excite(AtPoint, InWhole, ModelRequest["ExciteResult"]):
    """Record an identification experiment: force inputs by a PRBS or a multisine, from an operating point.

    One session starts at the operating point: it settles if requested, then the identification and the
    validation part are recorded one after the other. u[k] is held over an interval; y[k] is read right after u[k]
    took effect, in sampled models after their sample.

    Not for an unstable model: close its loop first. A single co-simulation FMU does not show its sampling, so its
    outputs may follow an input at once or one interval later.

    Returns:
        Both parts, and how good the signal is.

    Raises:
        InputError: unknown name, a design that does not fit the sampling, an operating point of another model.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running.

    Source: the source report, chapter 5.2; L. Ljung, System Identification, 2nd ed., chapter 13.

    Examples:
        A binary sequence has two levels.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     experiment = wb.excite(lag, "u", "y", prbs="amplitude=2", dt=0.1, samples=300)
        >>> print(experiment.identification.u.min(), experiment.identification.u.max())
        -2.0 2.0
    """

    command = "excite"
    written = "workbench.data.excite.written:ExciteFiles"
    algorithm = "workbench.data.excite.run:run"
    example = "workbench excite fmu:Rudder --input delC --output del --prbs amplitude=2 --step 0.01 --csv rudder.csv"
    # Tighter than for a time history: integration errors must stay far below the model's own noise.
    usual_tolerance = 1e-8
    counts = "samples"
    isolated = False  # what was recorded before a crash is kept
    parts = ("identification", "validation")

    inputs: Names = option(
        "Inputs to force. Other inputs keep their value at the operating point.",
        flag="--input",
        also="--inputs",
        metavar="U,..",
    )
    outputs: Names = option(
        "Outputs to record, or any other variables.", flag="--output", also="--outputs", metavar="Y,.."
    )
    _: KW_ONLY
    signal: FilterDesign | None = option(
        "PrbsDesign or MultisineDesign; by default a PRBS of amplitude 1 with one bit per sample.",
        python=True,
        default=None,
    )
    prbs: _Prbs | None = option(
        "Binary sequence: amplitude, rate [Hz] (default: one bit per sample), order (default: the shortest sequence "
        "that does not repeat), seed, offset (default: the operating point). Separate the values of several inputs by "
        "colons: amplitude=2:0.5.",
        default=None,
        first=True,
    )
    multisine: _Multisine | None = option(
        "Sum of sines: band=LOW:HIGH [Hz], amplitude (peak), periods, lines (all or odd), seed, offset. Separate the "
        "values of several inputs by colons.",
        default=None,
        first=True,
    )
    dt: float | None = option(
        "Sampling interval; by default the period of a sampled model.",
        unit="s",
        flag="--step",
        metavar="DT",
        positive=True,
        default=None,
        first=True,
    )
    samples: int = option("Length of the part for identification.", metavar="N", least=2, default=3000, first=True)
    validation_samples: int | None = option(
        "Length of the part for validation; by default the same length, 0 for none. It is written next to the CSV "
        "file, as NAME_validation.",
        flag="--validation",
        metavar="N",
        least=0,
        default=None,
    )
    settle: float = option(
        "Time for which the inputs rest at their mean values before the experiment.",
        unit="s",
        metavar="T",
        least=0.0,
        default=0.0,
    )
    verify_step: bool = option(
        "Co-simulation: repeat the identification part with half the communication step, and report outputs that "
        "change by more than 1 % of their range.",
        default=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self._designs) > 1:
            raise InputError(f"{' and '.join(self._designs)}: only one of them at a time")
        if self.signal is not None and not hasattr(self.signal, "sequences"):
            kind = type(self.signal).__name__
            raise InputError(f"signal: a {kind} is no design of an experiment; take PrbsDesign or MultisineDesign")
        if self.validation_samples == 1:
            raise InputError("validation samples: 1 is too few; take at least 2, or 0 for none")

    @property
    def _designs(self) -> dict[str, FilterDesign]:
        given: dict[str, Any] = {"signal": self.signal, "prbs": self.prbs, "multisine": self.multisine}
        return {name: design for name, design in given.items() if design is not None}

    @property
    def design(self) -> FilterDesign:
        """What kind of signal forces the inputs."""
        from workbench.data.excite.signals import PrbsDesign  # noqa: PLC0415  --help needs no numerics

        return next(iter(self._designs.values()), None) or PrbsDesign()

    @property
    def validation(self) -> int:
        """Length of the validation part [samples]."""
        return self.samples if self.validation_samples is None else self.validation_samples


excite = function(Excite)
