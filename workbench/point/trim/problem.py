"""What is unknown in a trim and what must hold: the sets the user gave, counted and explained by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.names_in_text import check_names
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.point.trim.balance import Balance, Slot

__all__ = ["Equation", "TrimProblem", "TrimSets", "TrimUnknown", "pose"]

_NAMES_SHOWN = 8


@dataclass(frozen=True, kw_only=True)
class TrimSets:
    """What the user said about single variables; see `workbench.trim`.

    Attributes:
        free: inputs to find.
        fix: state, input or output → the value it must have.
        bound: state, input or output → (lowest, highest) value it may have.
        floating: states whose derivative need not vanish.
        x0, u0: state or input → where the search begins.
    """

    free: Sequence[str] = ()
    fix: Mapping[str, float] = field(default_factory=dict)
    bound: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    floating: Sequence[str] = ()
    x0: Mapping[str, float] = field(default_factory=dict)
    u0: Mapping[str, float] = field(default_factory=dict)

    @property
    def guess(self) -> Mapping[str, float]:
        """State or input → where the search begins."""
        return {**self.x0, **self.u0}


@dataclass(frozen=True, kw_only=True)
class TrimUnknown:
    """One number to find.

    Attributes:
        slot: the state or input.
        column: its place in (states, inputs).
        start: where the search begins, within the bounds.
        low, high: bounds, infinite where there are none.
    """

    slot: Slot
    column: int
    start: float
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, kw_only=True)
class Equation:
    """One number that must vanish: what is at `row` of (rates, outputs), less the interval [low, high].

    Attributes:
        name: as the user reads it.
        row: place in (rates, outputs).
        low, high: the wanted value twice, or an interval.
        unit: of the residual.
        nominal: magnitude of the residual where no unknown moves it.
        required: False for a floating derivative.
    """

    name: str
    row: int
    low: float = 0.0
    high: float = 0.0
    unit: str | None = None
    nominal: float = 1.0
    required: bool = True

    def residual(self, value: float) -> float:
        """Return how far `value` lies outside [low, high]."""
        return value - min(max(value, self.low), self.high)


@dataclass(frozen=True, kw_only=True)
class TrimProblem:
    """Find the unknowns such that every required equation holds.

    Attributes:
        balance: the model.
        unknowns: what is to be found.
        equations: what must hold.
        floating: derivatives that need not vanish.
        base: shape (n + m,), all states and inputs; the unknowns stand at their start.
    """

    balance: Balance
    unknowns: tuple[TrimUnknown, ...]
    equations: tuple[Equation, ...]
    floating: tuple[Equation, ...]
    base: Floats

    @cached_property
    def columns(self) -> NDArray[np.intp]:
        """Places of the unknowns in (states, inputs), shape (k,)."""
        return np.array([k.column for k in self.unknowns], dtype=np.intp)

    def at(self, values: Floats) -> tuple[Floats, Floats]:
        """Return all states and inputs with the unknowns at `values`, shape (len(unknowns),)."""
        whole = self.base.copy()
        whole[self.columns] = values
        n = len(self.balance.states)
        return whole[:n], whole[n:]

    def evaluate(self, values: Floats) -> Floats:
        """Return rates and outputs in one array with the unknowns at `values`."""
        return np.concatenate(self.balance.evaluate(*self.at(values)))

    def degrees(self, *, left_open: int | None) -> str:
        """Return what unknowns and equations there are, and what is missing; "" if they are as many.

        Args:
            left_open: number of directions along which there are other solutions; None: there is no solution.
        """
        n, m = len(self.unknowns), len(self._counting())
        if n == m and not left_open:
            return ""
        names = _listed([k.slot.name for k in self.unknowns]) or "none"
        counted = f"{n} unknown{_s(n)} ({names}), {m} equation{_s(m)} ({_listed(self._counting()) or 'none'})"
        return f"{counted}: {self._advice(n - m, left_open)}"

    def _counting(self) -> list[str]:
        """Return the equations that count: not intervals, nor what holds by itself as the state cannot be set."""
        own = [not s.settable for s in self.balance.states]
        return [e.name for e in self.equations if e.low == e.high and not (e.row < len(own) and own[e.row])]

    def _advice(self, spare: int, left_open: int | None) -> str:
        if spare > 0 and left_open == 0:
            return "no direction is left open here all the same: the solution is isolated"
        if spare > 0 and left_open is None:
            return f"under-determined by {spare}"
        if spare > 0 or (spare == 0 and left_open):
            spare = left_open or spare  # the rank of the Jacobian tells it better than the numbers
            return f"under-determined by {spare}; fix {_more(spare)}; otherwise one of many solutions is chosen"
        if left_open is not None:
            return f"over-determined by {-spare}; they hold together nevertheless"
        held = [
            s.name for s in self.balance.inputs if not s.whole and s.name not in {k.slot.name for k in self.unknowns}
        ]
        free = f"free {_listed(held)}, " if held else ""
        return (
            f"over-determined by {-spare}; {free}float a state or remove a fixed value; otherwise there may be no "
            "solution"
        )


def pose(balance: Balance, sets: TrimSets) -> TrimProblem:
    """Return the problem that `sets` pose for a model.

    By default every state is unknown, every derivative must vanish and every input is held.

    Raises:
        InputError: an unknown name, a name in sets that exclude each other, a value that is not a number.
    """
    _check(balance, sets)
    n = len(balance.states)
    slots = (*balance.states, *balance.inputs)
    searched = {*(s.name for s in balance.states if s.settable), *sets.free, *sets.bound} - set(sets.fix)
    unknowns = tuple(_unknown(s, i, sets) for i, s in enumerate(slots) if s.name in searched)
    base = np.array([sets.fix.get(s.name, sets.guess.get(s.name, s.start)) for s in slots], dtype=np.float64)
    base[[k.column for k in unknowns]] = [k.start for k in unknowns]
    rates = [_rate(balance, s, i, sets) for i, s in enumerate(balance.states)]
    named = {*sets.fix, *sets.bound} - {s.name for s in slots}  # an output may be a state under the same name
    outputs = [_output(s, n + i, sets) for i, s in enumerate(balance.outputs) if s.name in named]
    return TrimProblem(
        balance=balance,
        unknowns=unknowns,
        equations=(*(r for r in rates if r.required), *outputs),
        floating=tuple(r for r in rates if not r.required),
        base=base,
    )


def _unknown(slot: Slot, column: int, sets: TrimSets) -> TrimUnknown:
    low, high = sets.bound.get(slot.name, (-math.inf, math.inf))
    start = min(max(sets.guess.get(slot.name, slot.start), low), high)
    return TrimUnknown(slot=slot, column=column, start=start, low=low, high=high)


def _rate(balance: Balance, state: Slot, row: int, sets: TrimSets) -> Equation:
    return Equation(
        name=balance.derivative.format(state.name),
        row=row,
        unit=balance.rate_unit(state),
        nominal=state.nominal,
        required=state.name not in sets.floating,
    )


def _output(output: Slot, row: int, sets: TrimSets) -> Equation:
    if output.name in sets.fix:
        value = float(sets.fix[output.name])
        nominal = max(abs(value), output.nominal)
        return Equation(
            name=f"{output.name} = {value:g}", row=row, low=value, high=value, unit=output.unit, nominal=nominal
        )
    low, high = sets.bound[output.name]
    name = f"{low:g} ≤ {output.name} ≤ {high:g}"
    return Equation(name=name, row=row, low=low, high=high, unit=output.unit, nominal=output.nominal)


# -- checks -------------------------------------------------------------------------------


def _check(balance: Balance, sets: TrimSets) -> None:
    states, inputs, outputs = (
        {s.name: s for s in group} for group in (balance.states, balance.inputs, balance.outputs)
    )
    slots = {"state": states, "input": inputs, "output": outputs}
    for what, names, kinds in (
        ("free", sets.free, ("state", "input", "output")),
        ("fix", sets.fix, ("state", "input", "output")),
        ("bound", sets.bound, ("state", "input", "output")),
        ("floating", sets.floating, ("state",)),
        ("x0", sets.x0, ("state", "input")),
        ("u0", sets.u0, ("state", "input")),
    ):
        others = {name: kind for kind, group in slots.items() if kind not in kinds for name in group}
        given = what in {"x0", "u0"}  # co-simulation may show states only
        accepted = [n for kind in kinds for n in slots[kind] if not given or slots[kind][n].settable]
        check_names(names, accepted, kinds=kinds, what=what, others=others)
    for one, other, first, second in (
        ("fix", "free", sets.fix, sets.free),
        ("fix", "bound", sets.fix, sets.bound),
    ):
        for name in set(first) & set(second):
            raise InputError(f"'{name}' is in both {one} and {other}; choose one")
    for name in (*sets.free, *sets.bound):
        if name in inputs and inputs[name].whole:
            raise InputError(f"input '{name}' has only whole numbers; it can be fixed, but not found")
    for name in (*sets.free, *sets.bound, *sets.guess, *sets.fix):
        if name in states and not states[name].settable:
            raise InputError(f"state '{name}' of this model can only be observed, not set")
    _check_values(sets)


def _check_values(sets: TrimSets) -> None:
    for what, values in (("fix", sets.fix), ("x0", sets.x0), ("u0", sets.u0)):
        for name, value in values.items():
            if not math.isfinite(value):
                raise InputError(f"{what}: {name} must be a finite number, not {value:g}")
    for name, (low, high) in sets.bound.items():
        if not low < high:
            raise InputError(f"bound: {name} needs LO below HI, not {low:g}:{high:g}; use fix for one value")


def _listed(names: Sequence[str]) -> str:
    more = f", … {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return ", ".join(names[:_NAMES_SHOWN]) + more


def _more(count: int) -> str:
    return "one more value" if count == 1 else f"{count} more values"


def _s(count: int) -> str:
    return "" if count == 1 else "s"
