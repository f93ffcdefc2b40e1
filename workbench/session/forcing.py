"""The forced inputs of one session: evaluate their signals, write them, remember what was written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from workbench.core.records.names_in_text import check_names
from workbench.errors import InputError, article
from workbench.fmi.instance import Instance
from workbench.fmi.variable import EXACT_TO, FLOAT_TYPES, WHOLE_RANGES, Value, Variable
from workbench.signals.kinds import Constant, Signal, Table, levels_of

__all__ = ["Forcing", "convert"]

_JUMPS = 100  # of a signal that are looked at before the run


def fitting(variable: Variable, value: Value) -> Value:
    """Return a value as `convert` does; texts, and what is for a variable without numbers, as they are."""
    return value if isinstance(value, str) or not variable.is_number else convert(variable, value)


def convert(variable: Variable, value: float) -> Value:
    """Return `value` as the variable's type: numbers with a point are rounded for integers, Booleans are value ≥ 0.5.

    Raises:
        InputError: an integer that its type cannot hold (it would wrap around), or with more digits than a signal.
    """
    if variable.type in FLOAT_TYPES:
        return float(value)
    if variable.type == "Boolean":
        return value >= 0.5
    whole = round(value)
    least, largest = WHOLE_RANGES.get(variable.type, (whole, whole))
    if not least <= whole <= largest:
        raise InputError(
            f"input {variable.name}: {whole} is beyond what {article(variable.type)} can hold, {least} … {largest}"
        )
    if not isinstance(value, int):
        _check_exact(variable, whole)
    return whole


def _check_exact(variable: Variable, level: float) -> None:
    if abs(level) > EXACT_TO:
        raise InputError(
            f"input {variable.name}: signals are exact to ±2^53, and {round(level)} is beyond; a start value "
            "(`start_values`) is exact"
        )


def _check_held(variable: Variable, signal: Signal, bias: float) -> None:
    """Refuse a signal that jumps to what its input cannot hold, as far as its first jumps tell.

    A constant must be a value of the input's type; of other signals numbers between those are rounded. What a signal
    may round although the type has it is refused.
    """
    for level in levels_of(signal) if variable.type in WHOLE_RANGES else ():
        _check_exact(variable, level)
    if isinstance(signal, Constant) and convert(variable, held := signal.value + bias) != held:
        raise InputError(f"input {variable.name}: {held:g} is not a value that {article(variable.type)} can have")
    t = 0.0
    for _ in range(_JUMPS):
        t = signal.next_break(t)
        if not math.isfinite(t):
            return
        convert(variable, signal(t) + bias)


class Forcing:
    """The signals in force and the values last written to their inputs.

    Attributes:
        signals: input name → signal.
        written: what the FMU sees now, in the order of `signals`.
    """

    def __init__(
        self,
        instance: Instance,
        inputs: Mapping[str, Variable],
        bias: Mapping[str, float],
        signals: Mapping[str, Signal],
    ) -> None:
        self.signals = dict(signals)
        self.names = tuple(self.signals)
        variables = [_input(name, inputs) for name in self.names]
        self._pairs = [(self.signals[n], bias.get(n, 0.0)) for n in self.names]
        self._fast = [i for i, v in enumerate(variables) if v.is_continuous_input]
        self._slow = [i for i, v in enumerate(variables) if not v.is_continuous_input]
        self._variables = variables
        for variable, (signal, _) in zip(variables, self._pairs, strict=True):
            if isinstance(signal, Table) and signal.unit not in (None, variable.unit):
                raise InputError(
                    f"input {variable.name}: a session converts no units; give the table in {variable.unit}"
                )
        for i in self._slow:
            _check_held(variables[i], *self._pairs[i])
        self.continuous = instance.access([variables[i] for i in self._fast])
        self._discrete = instance.access([variables[i] for i in self._slow])
        self.written: list[float] = [math.nan] * len(variables)

    def inputs(self) -> list[tuple[Variable, Signal, float]]:
        """Return each forced input with its signal and its bias."""
        return [(v, s, b) for v, (s, b) in zip(self._variables, self._pairs, strict=True)]

    @property
    def longest_step(self) -> float:
        """The longest step [s] that cannot overlook a signal's shape."""
        return min((s.longest_step for s in self.signals.values()), default=math.inf)

    def at(self, t: float) -> list[float]:
        """Return all values at t, biased, as the FMU would see them."""
        return [float(convert(v, s(t) + b)) for v, (s, b) in zip(self._variables, self._pairs, strict=True)]

    def write_all(self, values: Sequence[float]) -> None:
        """Write every forced input; allowed in event mode and between co-simulation steps."""
        if self._fast:
            self.continuous.write([values[i] for i in self._fast])
        if self._slow:
            self._discrete.write([convert(self._variables[i], values[i]) for i in self._slow])
        self.written = list(values)


def _input(name: str, inputs: Mapping[str, Variable]) -> Variable:
    check_names([name], inputs, kinds=("input",))
    variable = inputs[name]
    if not variable.is_number:
        raise InputError(f"input '{name}' is a {variable.type}; a signal cannot force it")
    return variable
