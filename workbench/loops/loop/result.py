"""What a loop analysis returns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels, degrees
from workbench.core.values.margins import Margins
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.loops.loop.linear import MANY, LinearLoop
from workbench.loops.loop.measured import LoopCurve
from workbench.loops.loop.place import Opening
from workbench.show.result import Result

if TYPE_CHECKING:
    from control import StateSpace

__all__ = ["LoopResult"]

_COLUMNS = (
    "how", "amplitude", "frequency_hz", "gain", "gain_db", "phase_deg", "sensitivity", "complementary", "mean",
    "thd_passed", "thd_returned", "injected", "balance", "status", "failed",
)  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopResult(Result):
    """A loop opened at one place: loop transfer L, sensitivities, margins.

    Convention: negative feedback. Where the signal passed on at the place is z and y comes back, L = -Y/Z, so that the
    closed loop is S = 1/(1 + L) and T = L/(1 + L) wherever the minus sign of the loop lies.

    Attributes:
        system: name of the system.
        place: the connections that are opened.
        value: value of the signal there at the operating point [unit of the source].
        linear: result of `lin` at that point; None where it failed, `notes` say why.
        curves: measured at amplitudes, in the order of measurement and amplitude; empty: none were asked for.
        why: why it was measured so; empty without amplitudes.
        notes: one line each.
        operating_point: operating point of the closed loop; None: not known.
    """

    _page = "workbench.loops.loop.page:loop_page"
    _picture = "workbench.loops.loop.picture:plot_loop"

    system: str
    place: Opening
    value: float
    linear: LinearLoop | None
    curves: tuple[LoopCurve, ...] = field(default=(), metadata=entry(key="measured"))
    why: str = ""
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a loop", "loop"

    @property
    def margins(self) -> Margins:
        """Margins of the linear loop.

        Raises:
            InputError: there is none.
        """
        return self._linear().margins

    @property
    def loop(self) -> StateSpace:
        """L of the linear loop for python-control.

        Raises:
            InputError: there is no linear loop.
        """
        return self._linear().transfer.to_state_space(name="L")

    @property
    def sensitivity(self) -> StateSpace:
        """S = 1/(1 + L) of the linear loop, likewise."""
        return self._linear().transfer.sensitivity().to_state_space(name="S")

    @property
    def complementary(self) -> StateSpace:
        """T = L/(1 + L) of the linear loop, likewise."""
        return self._linear().transfer.complementary().to_state_space(name="T")

    def _linear(self) -> LinearLoop:
        if self.linear is None:
            raise InputError(f"{self.system}: there is no linear loop at {self.place.label}; see `notes`")
        return self.linear

    def curve(self, amplitude: float | None = None, how: str | None = None) -> LoopCurve:
        """Return one measured curve.

        Args:
            amplitude: may be left out where there is only one.
            how: "break" or "inject", likewise.

        Raises:
            InputError: there is no such curve, or several are.
        """
        found = [c for c in self.curves if amplitude is None or np.isclose(c.amplitude, amplitude, rtol=1e-9)]
        found = [c for c in found if how is None or c.how == how]
        if len(found) != 1:
            known = ", ".join(f"{c.how} {c.amplitude:g}" for c in self.curves) or "none"
            raise InputError(f"curve: {'several fit' if found else 'no such one'}; measured: {known}")
        return found[0]

    def frequencies(self, count: int = MANY) -> Floats:
        """Return frequencies that show the linear loop, shape (count,), rising [Hz].

        Args:
            count: how many.
        """
        return self._linear().frequencies(count)

    def derived(self) -> dict[str, Any]:
        """Return the place in words."""
        place = self.place
        return {
            "model": self.system,
            "at": place.source,
            "connections": [f"{place.source} -> {d}" for d in place.destinations],
            "unit": place.unit,
            "convention": "negative feedback: L is minus the return ratio, the closed loop is 1/(1 + L)",
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency: the linear loop, then each measured curve."""
        yield _COLUMNS
        if self.linear is not None:
            f = self.frequencies()
            for frequency, value in zip(f.tolist(), self.linear.response(f).tolist(), strict=True):
                yield ["linear", "", frequency, *_numbers(value), *[""] * 7]
        for curve in self.curves:
            for p in curve.points:
                rest = [p.mean, p.thd_passed, p.thd_returned, p.injected, p.balance]
                yield [curve.how, curve.amplitude, p.frequency_hz, *_numbers(p.value), *rest, p.status, p.reason]


def _numbers(value: complex | None) -> list[Any]:
    """Return gain, gain [dB], phase [deg], |S| and |T|."""
    if value is None:
        return [""] * 5
    with np.errstate(divide="ignore"):
        s = float(abs(np.divide(1.0, 1.0 + value)))
    return [abs(value), float(decibels(value)), float(degrees(value)), s, s * abs(value)]
