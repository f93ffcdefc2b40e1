"""The scalar form of a model: what the generator works on after arrays, loops and functions are gone."""

from __future__ import annotations

from dataclasses import dataclass, field

from workbench.build.expressions import ExpressionGraph
from workbench.build.ir import SourceLocation

TIME = 0  # value reference of the independent variable


@dataclass(frozen=True, slots=True)
class ScalarVariable:
    """One scalar; its place in the list is its value reference.

    `start` is the start value as an expression; it holds no variables unless it depends on parameters.
    """

    name: str
    type: str  # "real", "integer", "boolean", "enumeration"
    kind: str  # "time", "input", "parameter", "calculated", "constant", "state", "derivative", "algebraic", "discrete"
    output: bool
    start: int
    unit: str | None = None
    description: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    continuous: bool = True
    derivative_of: int | None = None
    literals: tuple[str, ...] = ()
    fixed: bool = False  # a parameter that must not change in a run: a delay depends on it
    place: SourceLocation | None = None


@dataclass(frozen=True, slots=True)
class Relation:
    """A frozen relation: an indicator z and the side on which the relation holds.

    A relation between time and values that only change at events has a deadline instead: it switches
    at that instant, which is a time event.
    """

    indicator: int
    holds_when_positive: bool  # z > 0, else z <= 0: FMI's two domains, so that z = 0 is never ambiguous
    deadline: int | None = None


@dataclass(frozen=True, slots=True)
class Quotient:
    """A frozen floor(argument)."""

    argument: int


@dataclass(frozen=True, slots=True)
class ResidualEquation:
    """A continuous equation 0 = expression."""

    expression: int
    place: SourceLocation


@dataclass(frozen=True, slots=True)
class ConditionalBranch:
    """A value that a discrete variable takes when `fires` holds; None: always."""

    fires: int | None
    value: int


@dataclass(slots=True)
class DiscreteEquation:
    """All branches of one discrete variable, first match wins; without a match it keeps its value."""

    target: int
    place: SourceLocation
    branches: list[ConditionalBranch] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Action:
    """What happens at the end of an event iteration when `fires` holds."""

    kind: str  # "reinit", "terminate", "assert"
    fires: int
    state: int | None = None
    value: int | None = None
    message: str = ""


@dataclass(frozen=True, slots=True)
class ModelClock:
    """Ticks at (phase + k·period), both rational numbers [s]."""

    period: tuple[int, int]
    phase: tuple[int, int]


@dataclass(slots=True)
class ScalarModel:
    """A model without arrays."""

    name: str
    description: str
    graph: ExpressionGraph
    variables: list[ScalarVariable] = field(default_factory=list)
    bindings: dict[int, int] = field(default_factory=dict)  # calculated parameter → expression
    residuals: list[ResidualEquation] = field(default_factory=list)
    discrete: list[DiscreteEquation] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    quotients: list[Quotient] = field(default_factory=list)
    conditions: list[int] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    clocks: list[ModelClock] = field(default_factory=list)
    delays: list[int] = field(default_factory=list)  # expressions that read them

    def references(self, *kinds: str) -> list[int]:
        """Return the value references of the variables of these kinds, in order."""
        return [vr for vr, variable in enumerate(self.variables) if variable.kind in kinds]

    @property
    def states(self) -> list[int]:
        """Return the value references of the continuous states, in FMI's order."""
        return self.references("state")

    @property
    def derivatives(self) -> dict[int, int]:
        """Return the value reference of each state → that of its derivative."""
        return {v.derivative_of: vr for vr, v in enumerate(self.variables) if v.derivative_of is not None}

    @property
    def n_indicators(self) -> int:
        """Return the number of event indicators: one a state relation, two a quotient."""
        return sum(r.deadline is None for r in self.relations) + 2 * len(self.quotients)
