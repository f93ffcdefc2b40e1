"""What a loop analysis returns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.analysis.loop.linear import LinearLoop
from workbench.analysis.loop.margins import Margins
from workbench.analysis.loop.measured import LoopCurve
from workbench.analysis.loop.place import Place
from workbench.core.operating_point import OperatingPoint, point_in_json
from workbench.core.poles import natural_frequency_hz
from workbench.core.record import Record
from workbench.errors import InputError
from workbench.session.base import Floats

if TYPE_CHECKING:
    from control import StateSpace

__all__ = ["LoopResult"]

_COLUMNS = (
    "how", "amplitude", "frequency_hz", "gain", "gain_db", "phase_deg", "sensitivity", "complementary", "mean",
    "thd_passed", "thd_returned", "injected", "balance", "status", "failed",
)  # fmt: skip
_MANY = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopResult(Record):
    """A loop opened at one place: loop transfer L, sensitivities, margins.

    Convention: negative feedback. Where the signal passed on at the place is z and y comes back, L = -Y/Z, so that the
    closed loop is S = 1/(1 + L) and T = L/(1 + L) wherever the minus sign of the loop lies.

    Attributes:
        system: its name.
        place: the connections that are opened.
        value: of the signal there at the operating point [unit of the source].
        linear: from `lin` at that point; None where it failed, `notes` say why.
        curves: measured at amplitudes, in the order of measurement and amplitude; empty: none were asked for.
        why: why it was measured so; empty without amplitudes.
        notes: one line each.
        operating_point: of the closed loop; None: not known.
    """

    system: str
    place: Place
    value: float
    linear: LinearLoop | None
    curves: tuple[LoopCurve, ...] = ()
    why: str = ""
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

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

    def frequencies(self, count: int = _MANY) -> Floats:
        """Return frequencies that show the linear loop, shape (count,), rising [Hz].

        Args:
            count: how many.
        """
        transfer = self._linear().transfer
        poles = np.concatenate([transfer.continuous_poles, transfer.sensitivity().continuous_poles])
        every = np.concatenate([natural_frequency_hz(poles), self._linear().margins.crossovers_hz])
        every = every[(every > 1e-6 * every.max(initial=0.0)) & np.isfinite(every) & (every > 0.0)]
        if not len(every):
            every = np.array([0.05 / transfer.dt if transfer.dt > 0.0 else 1.0])
        high = min(every.max() * 10.0, transfer.highest_hz * (1.0 - 1e-6))
        band: Floats = np.geomspace(min(every.min() / 10.0, high / 100.0), high, count)
        return band

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON."""
        return {
            "model": self.system,
            "at": self.place.source,
            "connections": [f"{self.place.source} -> {d}" for d in self.place.destinations],
            "unit": self.place.unit,
            "value": self.value,
            "convention": "negative feedback: L is minus the return ratio, the closed loop is 1/(1 + L)",
            "linear": None if self.linear is None else self._linear_dict(self.linear),
            "measured": [c.to_dict() for c in self.curves],
            "why": self.why,
            "notes": list(self.notes),
            **point_in_json(self.operating_point),
        }

    def _linear_dict(self, linear: LinearLoop) -> dict[str, Any]:
        f, transfer = self.frequencies(), linear.transfer
        response = linear.response(f)
        return {
            "method": linear.lin.method,
            "why": linear.lin.why,
            "dt": transfer.dt,
            "A": transfer.A.tolist(),
            "B": transfer.B.tolist(),
            "C": transfer.C.tolist(),
            "D": transfer.D.tolist(),
            "state_names": list(linear.lin.state_names),
            "stability": linear.stability.to_dict(),
            "margins": linear.margins.to_dict(),
            "frequency_hz": f.tolist(),
            "gain": np.abs(response).tolist(),
            "phase_deg": np.degrees(np.unwrap(np.angle(response))).tolist(),
            "sensitivity": np.abs(1.0 / (1.0 + response)).tolist(),
            "complementary": np.abs(response / (1.0 + response)).tolist(),
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
        db = float(20.0 * np.log10(abs(value)))
        s = float(abs(np.divide(1.0, 1.0 + value)))
    return [abs(value), db, float(np.degrees(np.angle(value))), s, s * abs(value)]
