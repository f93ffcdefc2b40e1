"""Wiener, Hammerstein and Hammerstein–Wiener models from recorded data: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Annotated, Literal

from workbench.core.records.forms import FILE, File, word_or_number
from workbench.core.records.option import Options, option, options_of, recast
from workbench.errors import InputError
from workbench.identification.identify.request import Identify
from workbench.requests.request import Request, function

if TYPE_CHECKING:
    from workbench.data.experiment.experiment import Experiment
    from workbench.identification.identify.result import IdentifyResult
    from workbench.identification.structures.result import StructureResult

__all__ = ["STRUCTURES", "IdentifyCommand", "IdentifyStructure", "identify_structure"]

STRUCTURES = ("hammerstein", "wiener", "hammerstein-wiener")


_NUMBER = word_or_number("auto", what="a number")

if TYPE_CHECKING:
    _Number = int | Literal["auto"]
    _Data = Experiment | File
else:
    _Number = Annotated[object, _NUMBER]
    _Data = Annotated[object, FILE]


class _BlockOptions(Options):
    _: KW_ONLY
    knots: _Number = option(
        "Number of knots of the static blocks of --structure, at least 3; auto takes the smallest Bayesian criterion.",
        default="auto",
        group="Static blocks",
    )


class IdentifyStructure(_BlockOptions, Request["Experiment | File", "StructureResult"]):
    """Identify a linear block with static blocks before or behind it from recorded data of one input and one output.

    Hammerstein: y = G f(u) + n (an actuator that saturates); Wiener: y = g(G u) + n (a sensor that bends);
    Hammerstein–Wiener: y = g(G f(u)) + n. f and g are tables, linear between knots; G is a linear model of the order
    asked for, or of the order that `identify` finds. All parameters are fitted at once, with the disturbance n coloured
    by an equation of its own; their covariance gives errors of tables, poles and response.

    A scale can be moved from block to block: f keeps the mean of its input and the slope 1 of its regression on it, g
    the slope 1. So G has the gain of the best linear approximation.

    Not for: closed loops; noise before g; blocks with memory (backlash, rate limits); inputs of two levels, which show
    two points of f; a Wiener system whose g is even, in which no linear model finds a start.

    Returns:
        The blocks with their errors, and how well they follow beside the linear model.

    Raises:
        InputError: the data cannot be read, several inputs or outputs, an input of two levels.

    Source: E.-W. Bai, Automatica 34 (1998); L. Ljung, System Identification, 2nd ed., chapters 7 and 9; A. Wills et
    al., Automatica 49 (2013).

    Examples:
        >>> import numpy as np
        >>> u = np.random.default_rng(0).normal(size=1000)
        >>> y, v = np.zeros(1000), np.clip(u, -0.5, 0.5)
        >>> for k in range(999):
        ...     y[k + 1] = 0.8 * y[k] + v[k]
        >>> found = wb.identify_structure(wb.make_experiment(0.1, u, y), structure="hammerstein", order=1)
        >>> print(found.linear.poles.real.round(2), found.fit_percent > 95)
        [0.8] True
    """

    command = "identify"
    called = "identify_structure"
    algorithm = "workbench.identification.structures.run:run"
    in_shell = False
    example = "workbench identify data.csv --input u --output y --structure hammerstein --validate other.csv"
    counts = "fits"
    subject = Identify.subject

    _: KW_ONLY
    structure: str = option("Where the static blocks are.", choices=STRUCTURES)
    input: str | None = option("Column with the input; by default the one that the data name.", default=None)
    output: str | None = option("Column with the output; by default the one that the data name.", default=None)
    order: _Number = option(
        "Number of states of the linear block; auto takes the least that is enough.", default="auto"
    )
    validation: _Data | None = option("Other data from the same system.", flag="--validate", default=None)
    max_order: int = option("Largest order that auto considers.", least=1, default=20)
    feedthrough: bool = option("Estimate the direct feedthrough D of the linear block.", default=True)
    delay: int = option("Known delay of the input.", unit="samples", least=0, default=0)
    settle: float = option("Time to cut off at the beginning.", unit="s", least=0.0, default=0.0)
    dt: float | None = option("Sampling interval of a file without times.", unit="s", positive=True, default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.knots, int) and self.knots < 3:
            raise InputError(f"knots must be auto or 3 or more, not {self.knots!r}: with fewer a block is linear")


class IdentifyCommand(_BlockOptions, Identify):
    """Identify a discrete linear model from recorded data, judge the data, and validate the model.

    If requested, with static blocks before or behind it.
    """

    algorithm = "workbench.identification.structures.run:run_command"
    details = (
        "--structure hammerstein (an actuator that saturates), wiener (a sensor that bends) or hammerstein-wiener adds "
        "static blocks to the linear one, for one input and one output in an open loop."
    )

    _: KW_ONLY
    structure: str | None = option(
        "Identify static blocks before (hammerstein) or behind (wiener) the linear one, or both.",
        choices=STRUCTURES,
        default=None,
        group="Static blocks",
        first=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.structure is None:
            if self.knots != "auto":
                raise InputError("--knots belongs to --structure; add it, or leave --knots out")
            return
        taken = {d.name for d in options_of(IdentifyStructure)} | {"inputs", "outputs", "workers"}
        for declared in options_of(IdentifyCommand):
            if declared.name not in taken and getattr(self, declared.name) != declared.default:
                raise InputError(f"{declared.flag} is not for --structure {self.structure}; leave it out")
        if not isinstance(self.delay, int):
            raise InputError(f"--delay: --structure {self.structure} takes a number of samples, not {self.delay}")

    @property
    def blocks(self) -> IdentifyStructure:
        """What is asked for with static blocks."""
        return recast(IdentifyStructure, self, input=self._one("input"), output=self._one("output"))

    def _one(self, side: str) -> str | None:
        names = getattr(self, f"{side}s")
        if names is None:
            return None
        if len(names) != 1:
            raise InputError(f"--{side}: --structure {self.structure} takes one {side}, not {', '.join(names)}")
        name: str = names[0]
        return name

    def went_well(self, record: IdentifyResult | StructureResult) -> bool:
        """Return whether the model has a simulation on all data, and static blocks are of use.

        Args:
            record: of this request.
        """
        return not record.failed


identify_structure = function(IdentifyStructure)
