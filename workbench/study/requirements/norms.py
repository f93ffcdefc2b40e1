"""Requirements on norms of a transfer; weights are blocks of the system."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from workbench.core.values.linear import Linear
from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Limited, NotMeasured, Result, Value

__all__ = ["H2Norm", "HInfinityNorm", "TransferNorm", "numbers_of"]


class TransferNorm(Limited):
    """A norm of the transfer from some inputs to some outputs of `workbench lin`.

    Attributes:
        inputs: by name; None: all of the linear model.
        outputs: likewise.
    """

    commands: ClassVar[tuple[str, ...]] = ("lin",)
    units = ("1",)

    inputs: list[str] | None = None
    outputs: list[str] | None = None

    def part(self, system: Linear) -> Linear:
        """Return the transfer that counts.

        Args:
            system: the linear model.

        Raises:
            InputError: no such input or output.
        """
        columns = numbers_of("input", self.inputs, system.input_names)
        rows = numbers_of("output", self.outputs, system.output_names)
        return Linear(system.A, system.B[:, columns], system.C[rows], system.D[np.ix_(rows, columns)], dt=system.dt)

    def values(self, result: Result) -> list[Value]:
        from workbench.point.lin.result import LinResult  # noqa: PLC0415 - slow to import

        linear = LinResult.from_dict(result)
        if linear.delayed is not None:
            raise NotMeasured("the model has transport delays: a norm of their approximations is not that of the model")
        return [self.norm(self.part(linear))]

    def norm(self, system: Linear) -> Value:
        """Return the norm.

        Raises:
            NotMeasured: a pole that is seen is not stable.
        """
        raise NotImplementedError


def numbers_of(what: str, wanted: Sequence[str] | None, names: Sequence[str]) -> list[int]:
    """Return the places of names, all without any.

    Args:
        what: they name, for the message.
        wanted: names; None: all.
        names: that there are.

    Raises:
        InputError: no such name.
    """
    for name in wanted or ():
        if name not in names:
            raise InputError(f"{what} '{name}' is unknown; {suggest(name, names)}")
    return [names.index(name) for name in wanted] if wanted is not None else list(range(len(names)))


class HInfinityNorm(TransferNorm):
    """The H∞ norm: the largest singular value of the transfer over all frequencies."""

    def norm(self, system: Linear) -> Value:
        import slycot  # noqa: PLC0415 - slow to import

        _check(system)
        n, (q, m) = len(system.A), system.D.shape
        if not n:
            return Value(value=float(np.linalg.norm(system.D, 2)), unit="1")
        size, at = slycot.ab13dd(
            "D" if system.dt > 0.0 else "C", "I", "S", "D", n, m, q, system.A, np.eye(n), system.B, system.C, system.D
        )
        hz = at / (2.0 * math.pi * (system.dt or 1.0))
        return Value(value=float(size), where=f"{hz:.4g} Hz", unit="1")


class H2Norm(TransferNorm):
    """The H2 norm: the root of the output's variance under white noise of density 1; a direct part has none."""

    def norm(self, system: Linear) -> Value:
        from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov  # noqa: PLC0415 - slow to import

        _check(system)
        if system.dt == 0.0 and np.any(system.D != 0.0):
            raise NotMeasured("the H2 norm is infinite: an input reaches an output directly")
        if not len(system.A):
            return Value(value=float(np.linalg.norm(system.D)), unit="1")
        noise = system.B @ system.B.T
        gramian = (
            solve_discrete_lyapunov(system.A, noise) if system.dt > 0.0 else solve_continuous_lyapunov(system.A, -noise)
        )
        square = float(np.trace(system.C @ gramian @ system.C.T + system.D @ system.D.T))
        return Value(value=math.sqrt(max(0.0, square)), unit="1")


def _check(system: Linear) -> None:
    if not system.is_stable:
        raise NotMeasured("the linear model is not stable: its norm is infinite")
