"""How a parameter of an envelope spreads: its distribution, its ends, its values on a grid."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import Field
from scipy import stats

from workbench.errors import InputError
from workbench.study.requirements.base import Scalar
from workbench.system.files.toml_schema import TomlTable, read_table

__all__ = ["KINDS", "Spread", "read_spread"]


# The part of a distribution without ends that grids, maps and the search cover.
_COVERED = 0.998


class SpreadTable(TomlTable):
    """A parameter of the envelope; one of the distributions, and what goes with it.

    Attributes:
        range: uniform: lowest and highest value.
        normal: mean and standard deviation.
        lognormal: median, and standard deviation of the natural logarithm.
        triangular: lowest, most likely and highest value.
        discrete: values.
        weights: of the discrete values, in proportion to their probabilities; by default equal.
        between: ends at which a distribution is cut off.
        steps: number of values on a grid.
    """

    range: list[float] | None = None
    normal: list[float] | None = None
    lognormal: list[float] | None = Field(default=None, alias="log-normal")
    triangular: list[float] | None = None
    discrete: list[Scalar] | None = None
    weights: list[float] | None = None
    between: list[float] | None = None
    steps: int = Field(default=5, ge=2, le=10_000)


KINDS = ("range", "normal", "log-normal", "triangular", "discrete")


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How one parameter spreads.

    Attributes:
        name: "model.parameter".
        kind: one of `KINDS`.
        numbers: of the distribution: ends; mean and standard deviation; median and standard deviation of the logarithm;
            low, most likely and high. Empty for values.
        values: of a discrete one.
        weights: their probabilities.
        low, high: ends of what grids and the search cover, and of what is sampled where `cut` is true.
        steps: number of values on a grid.
        cut: whether the distribution is cut off at its ends.
    """

    name: str
    kind: str
    numbers: tuple[float, ...] = ()
    values: tuple[Scalar, ...] = ()
    weights: tuple[float, ...] = ()
    low: float = 0.0
    high: float = 0.0
    steps: int = 5
    cut: bool = False

    LENGTHS: ClassVar[Mapping[str, int]] = {"range": 2, "normal": 2, "log-normal": 2, "triangular": 3}

    @property
    def discrete(self) -> bool:
        """Whether it has values instead of a range."""
        return self.kind == "discrete"

    @property
    def middle(self) -> Scalar:
        """The value that stands for it where only others are varied: the median, or the likeliest value."""
        return self.values[int(np.argmax(self.weights))] if self.discrete else self.at(0.5)

    @property
    def words(self) -> str:
        """The distribution in words."""
        if self.discrete:
            return ", ".join(f"{v} ({100.0 * w:.4g} %)" for v, w in zip(self.values, self.weights, strict=True))
        n = [f"{x:g}" for x in self.numbers]
        words = {
            "range": lambda: f"uniform, {n[0]} … {n[1]}",
            "normal": lambda: f"normal, mean {n[0]}, standard deviation {n[1]}",
            "log-normal": lambda: f"log-normal, median {n[0]}, standard deviation of the logarithm {n[1]}",
            "triangular": lambda: f"triangular, {n[0]} … {n[2]}, most likely {n[1]}",
        }[self.kind]()
        return words if not self.cut else f"{words}, cut off at {self.low:g} and {self.high:g}"

    def at(self, share: float) -> Scalar:
        """Return the value below which a share of the distribution lies.

        Args:
            share: in 0 … 1.
        """
        if self.discrete:
            k = int(np.searchsorted(np.cumsum(self.weights), share, side="right"))
            return self.values[min(k, len(self.values) - 1)]
        law = _law(self.kind, self.numbers)
        if self.cut:
            below, above = law.cdf(self.low), law.cdf(self.high)
            share = float(below + share * (above - below))
        result = float(law.ppf(share))
        return min(max(result, self.low), self.high) if self.cut or self.kind in _ENDED else result

    def across(self, place: float) -> Scalar:
        """Return the value at a place between the ends, which does not ask how likely it is.

        Args:
            place: in 0 … 1 from the lower end to the upper; of a discrete one, along its values.
        """
        if self.discrete:
            return self.values[min(int(place * len(self.values)), len(self.values) - 1)]
        return min(max(self.low + place * (self.high - self.low), self.low), self.high)

    def place(self, value: Scalar) -> float:
        """Return the place of a value between the ends, the inverse of `across`."""
        if self.discrete:
            return (self.values.index(value) + 0.5) / len(self.values)
        return (float(value) - self.low) / (self.high - self.low)

    @property
    def grid(self) -> tuple[Scalar, ...]:
        """Values of a grid: equidistant, both ends among them; of a discrete one, all."""
        return self.values if self.discrete else tuple(float(x) for x in np.linspace(self.low, self.high, self.steps))


_ENDED = ("range", "triangular")


def _law(kind: str, numbers: Sequence[float]) -> Any:  # noqa: ANN401 - scipy has no public type for it
    """Return the distribution as scipy has it."""
    if kind == "range":
        return stats.uniform(numbers[0], numbers[1] - numbers[0])
    if kind == "normal":
        return stats.norm(numbers[0], numbers[1])
    if kind == "log-normal":
        return stats.lognorm(numbers[1], scale=numbers[0])
    low, likely, high = numbers
    return stats.triang((likely - low) / (high - low), low, high - low)


def read_spread(name: str, given: object, where: str) -> Spread:
    """Return how a parameter spreads.

    Args:
        name: "model.parameter".
        given: the table, or a list of two numbers: a range.
        where: the table's name, for messages.

    Raises:
        InputError: an unknown key, two distributions or none, numbers that no distribution can have.
    """
    table = read_table(SpreadTable, {"range": given} if isinstance(given, list) else given, where)
    chosen = {kind: getattr(table, kind.replace("-", "")) for kind in KINDS}
    chosen = {kind: numbers for kind, numbers in chosen.items() if numbers is not None}
    if len(chosen) != 1:
        what = "has no distribution" if not chosen else f"{' and '.join(chosen)}: only one of them"
        raise InputError(f"{where}: {what}; give one of {', '.join(KINDS)}, as in {{range = [150.0, 420.0]}}")
    ((kind, numbers),) = chosen.items()
    if kind == "discrete":
        return _discrete(name, numbers, table, where)
    if table.weights is not None:
        raise InputError(f"{where}: weights belong to discrete values")
    _check(kind, numbers, where)
    low, high, cut = _ends(kind, numbers, table.between, where)
    return Spread(name=name, kind=kind, numbers=tuple(numbers), low=low, high=high, steps=table.steps, cut=cut)


def _check(kind: str, numbers: Sequence[float], where: str) -> None:
    length = Spread.LENGTHS[kind]
    if len(numbers) != length:
        raise InputError(f"{where}: {kind} takes {length} numbers, not {len(numbers)}")
    rising = kind in _ENDED
    if rising and not (numbers[0] < numbers[-1] and list(numbers) == sorted(numbers)):
        raise InputError(f"{where}: {kind}: the numbers must rise")
    if not rising and not numbers[1] > 0.0:
        raise InputError(f"{where}: {kind}: the standard deviation, its second number, must be above 0")
    if kind == "log-normal" and not numbers[0] > 0.0:
        raise InputError(f"{where}: log-normal: the median, its first number, must be above 0")


def _ends(kind: str, numbers: Sequence[float], between: list[float] | None, where: str) -> tuple[float, float, bool]:
    if between is None:
        tail = 0.0 if kind in _ENDED else (1.0 - _COVERED) / 2.0
        low, high = (float(x) for x in _law(kind, numbers).ppf([tail, 1.0 - tail]))
        return low, high, False
    if len(between) != 2 or not between[0] < between[1]:
        raise InputError(f"{where}: between takes two rising numbers, the ends at which the distribution is cut off")
    law = _law(kind, numbers)
    if not law.cdf(between[1]) - law.cdf(between[0]) > 0.0:
        raise InputError(f"{where}: nothing of the distribution lies between {between[0]:g} and {between[1]:g}")
    if kind in _ENDED and (between[0] < numbers[0] or between[1] > numbers[-1]):
        raise InputError(f"{where}: between {between[0]:g} and {between[1]:g} is wider than the {kind} itself")
    return between[0], between[1], True


def _discrete(name: str, values: Sequence[Scalar], table: SpreadTable, where: str) -> Spread:
    if table.between is not None:
        raise InputError(f"{where}: between belongs to a range or a distribution, not to discrete values")
    if not values or len(set(map(repr, values))) < len(values):
        raise InputError(f"{where}: discrete takes at least one value, each once")
    weights = table.weights or [1.0] * len(values)
    if len(weights) != len(values) or min(weights) < 0.0 or not math.fsum(weights) > 0.0:
        raise InputError(f"{where}: weights must be one for each value, not below 0, and not all 0")
    total = math.fsum(weights)
    return Spread(name=name, kind="discrete", values=tuple(values), weights=tuple(w / total for w in weights))
