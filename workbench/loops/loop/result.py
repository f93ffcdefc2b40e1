"""What a loop analysis returns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels, degrees, unwrapped
from workbench.core.values.linear import LinearPart
from workbench.core.values.margins import Margins
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import InputError
from workbench.loops.loop.measured import LoopCurve
from workbench.loops.loop.stability import ClosedLoopStability, same_poles
from workbench.loops.nyquist.absolute import AbsoluteStability
from workbench.point.lin.result import LinResult
from workbench.show.result import Result

if TYPE_CHECKING:
    from control import StateSpace

__all__ = ["MANY", "LinearLoop", "LoopDisk", "LoopResult", "Opening"]

MANY = 200  # frequencies that show a loop

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
        others: of the further places, each opened by itself.
        disk_margins: of several places, one at a time and at the same time; empty: one place, or there are none.
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
    others: tuple[LoopResult, ...] = ()
    disk_margins: tuple[LoopDisk, ...] = ()
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
        result = [c for c in self.curves if amplitude is None or np.isclose(c.amplitude, amplitude, rtol=1e-9)]
        result = [c for c in result if how is None or c.how == how]
        if len(result) != 1:
            known = ", ".join(f"{c.how} {c.amplitude:g}" for c in self.curves) or "none"
            raise InputError(f"curve: {'several fit' if result else 'no such one'}; measured: {known}")
        return result[0]

    def frequencies(self, count: int = MANY) -> Floats:
        """Return frequencies that show the linear loop, shape (count,), rising [Hz].

        Args:
            count: how many.
        """
        return self._linear().frequencies(count)

    def derived(self) -> dict[str, Any]:
        """Return the place in words.

        Keys:
            model, at, connections, unit: where it was opened, and the signal there.
            convention: in words: negative feedback.
        """
        place = self.place
        return {
            "model": self.system,
            "at": place.source,
            "connections": [f"{place.source} -> {d}" for d in place.destinations],
            "unit": place.unit,
            "convention": "negative feedback: L is minus the return ratio, the closed loop is 1/(1 + L)",
        }

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return dict.fromkeys(("amplitude", "mean", "injected"), self.place.unit)

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


@dataclass(frozen=True, kw_only=True)
class LoopDisk(RecordPart):
    """The disk margin (skew 0) of one place or several: gain and phase at each may vary at once, each by itself.

    Attributes:
        where: the places.
        alpha: size of the disk that is proved; for up to three places there is no larger one.
        gain_db: the gain may rise or fall by so much at each [dB].
        phase_deg: or the phase may turn by so much either way [deg].
        frequency_hz: where the disk is smallest [Hz].
    """

    where: str
    alpha: float
    gain_db: float = field(metadata=entry(null=math.inf))
    phase_deg: float
    frequency_hz: float = field(metadata=entry(null=math.inf))


@dataclass(frozen=True, eq=False)
class LinearLoop(RecordPart):
    """A loop at an operating point.

    Attributes:
        lin: of the opened system, from the signal passed on to the signal returned: minus L.
        transfer: L; transport delays are Padé approximations here, not in `response`, the stability and the margins.
        stability: of the closed loop.
        margins: of L, exact.
        notes: one line each.
        absolute: sectors 0 … k that circle and Popov criterion prove for a characteristic at the opened connection;
            None: a sampled loop, or one with transport delays, of which they say nothing.
    """

    lin: LinResult
    transfer: LinearPart = field(metadata=entry(inline=True))
    stability: ClosedLoopStability
    margins: Margins
    notes: tuple[str, ...]
    absolute: AbsoluteStability | None = None

    def derived(self) -> dict[str, Any]:
        """Return the method, and the loop with its sensitivities over frequency."""
        f = self.frequencies()
        response = self.response(f)
        return {
            "method": self.lin.method,
            "why": self.lin.why,
            "state_names": self.lin.state_names,
            "frequency_hz": f,
            "gain": np.abs(response),
            "phase_deg": unwrapped(response),
            "sensitivity": np.abs(1.0 / (1.0 + response)),
            "complementary": np.abs(response / (1.0 + response)),
        }

    def frequencies(self, count: int = MANY) -> Floats:
        """Return frequencies that show the linear loop, shape (count,), rising [Hz].

        Args:
            count: how many.
        """
        transfer = self.transfer
        poles = np.concatenate([transfer.continuous_poles, transfer.sensitivity().continuous_poles])
        every = np.concatenate([natural_frequency_hz(poles), self.margins.crossovers_hz])
        every = every[(every > 1e-6 * every.max(initial=0.0)) & np.isfinite(every) & (every > 0.0)]
        if not len(every):
            every = np.array([0.05 / transfer.dt if transfer.dt > 0.0 else 1.0])
        high = min(every.max() * 10.0, transfer.highest_hz * (1.0 - 1e-6))
        band: Floats = np.geomspace(min(every.min() / 10.0, high / 100.0), high, count)
        return band

    @property
    def closes(self) -> bool:
        """Whether the closed loop is 1/(1 + L): not of a sampled one whose signal acts several times in its period."""
        known = self.margins.everywhere and not any(math.isnan(c.delay_s) for c in self.margins.gain_crossovers)
        return self.transfer.dt == 0.0 or (
            known and same_poles(self.transfer.sensitivity().poles, self.stability.poles)
        )

    def response(self, frequency_hz: Floats) -> Complex:
        """Return L at frequencies [Hz], shape (k,); with its transport delays as they are."""
        exact = self.lin.delayed
        return self.transfer.response(frequency_hz) if exact is None else -exact.response(frequency_hz)[:, 0, 0]


@dataclass(frozen=True)
class Opening:
    """Connections of one source, cut together.

    Attributes:
        source: "component.output".
        unit: of the source, None where it names none.
        wires: positions among the system's wires.
        destinations: "component.input" of each.
        discrete: the source moves at events only; it holds its value between samples.
    """

    source: str
    unit: str | None
    wires: tuple[int, ...]
    destinations: tuple[str, ...]
    discrete: bool

    @property
    def label(self) -> str:
        """The place in words: "plant.y → a.u, b.u"."""
        return f"{self.source} → {', '.join(self.destinations)}"
