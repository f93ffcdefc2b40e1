"""The loop transfer from a linearisation of the opened system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.analysis.lin.request import lin_result
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.task import Width
from workbench.analysis.loop.cut import PASSED, RETURNED, CutLoop
from workbench.analysis.loop.margins import margins_of
from workbench.analysis.loop.stability import Stability, stability_of
from workbench.analysis.nyquist.absolute import AbsoluteStability, absolute_stability
from workbench.core.decibels import unwrapped
from workbench.core.linear import Complex, LinearPart
from workbench.core.margins import Margins
from workbench.core.poles import natural_frequency_hz
from workbench.core.record import Part, entry
from workbench.session.base import Floats

__all__ = ["MANY", "LinearLoop", "linear_loop"]

MANY = 200  # frequencies that show a loop
_REST = 1e-6  # a derivative above this part of (value + 1) is motion


@dataclass(frozen=True, eq=False)
class LinearLoop(Part):
    """A loop at an operating point.

    Attributes:
        lin: of the opened system, from the signal passed on to the signal returned: minus L.
        transfer: L.
        stability: of the closed loop.
        margins: of L, exact.
        notes: one line each.
        absolute: sectors 0 … k that circle and Popov criterion prove for a characteristic at the opened connection;
            None: a sampled loop, or one with transport delays, of which they say nothing.
    """

    lin: LinResult
    transfer: LinearPart = field(metadata=entry(inline=True))
    stability: Stability
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

    def response(self, frequency_hz: Floats) -> Complex:
        """Return L at frequencies [Hz], shape (k,)."""
        return self.transfer.response(frequency_hz)


def linear_loop(cut: CutLoop, *, method: str = "auto", dx: Width = None, du: float | None = None) -> LinearLoop:
    """Linearise the opened system and close the loop again on paper.

    With all else as it is, a signal z passed on behind the cut comes back as y = R z; R is the return ratio and
    L = -R, wherever the loop's minus sign lies. Closed, the loop is 1/(1 - R) = 1/(1 + L).

    Args:
        cut: the loop.
        method: of `lin`.
        dx: widths of `lin` for the states.
        du: width of `lin` for the signal passed on.

    Raises:
        InputError: `lin` refuses, or the closed loop has no solution.
        SimulationError: the system cannot be evaluated.
    """
    point = cut.point
    with cut.opened() as model:
        result = lin_result(
            model,
            x0=None if point is None else {**point.x, **point.discrete},
            u0={**({} if point is None else point.u), PASSED: cut.value},
            inputs=[PASSED],
            outputs=[RETURNED],
            method=method,
            dx=dx,
            du=du,
            time=cut.time,
        )
    transfer = LinearPart(result.A, result.B, -result.C, -result.D, dt=result.dt)
    return LinearLoop(
        lin=result,
        transfer=transfer,
        stability=stability_of(transfer),
        margins=margins_of(transfer),
        notes=(*cut.notes, *result.notes, *_notes(cut, result)),
        absolute=None if transfer.dt > 0.0 or result.delayed else absolute_stability(transfer, name=cut.place.label),
    )


def _notes(cut: CutLoop, result: LinResult) -> list[str]:
    notes = [f"doubtful: {d.row} by {d.column}: {d.reason}" for d in result.doubts]
    if not _returns(result):
        notes.append(
            f"L is 0: what {cut.place.label} passes on does not return at this point (a limit is reached, or a "
            "path is open)"
        )
    moving = _moving(result.operating_point.dx, result.operating_point.x) if result.dt == 0.0 else []
    if moving:
        notes.append(
            f"the point is not an equilibrium ({', '.join(moving[:3])} move); margins are those of this instant"
        )
    if result.dt > 0.0 and not (cut.place.discrete or (result.intersample is not None and result.intersample.sampled)):
        notes.append(
            f"{cut.place.source} is continuous and acts between the samples too; opened there, L holds it over "
            f"{result.dt:.6g} s, a delay that the closed loop does not have: open the loop at a sampled signal instead"
        )
    return notes


def _returns(result: LinResult) -> bool:
    """Whether anything comes back: one of the Markov parameters is not zero."""
    if np.any(result.D != 0.0):
        return True
    state = result.B
    for _ in range(len(result.A)):
        if np.any(result.C @ state != 0.0):
            return True
        state = result.A @ state
        state = state / (np.abs(state).max(initial=0.0) or 1.0)
    return False


def _moving(dx: Mapping[str, float], x: Mapping[str, float]) -> list[str]:
    sizes = list(x.values())
    return [name for k, (name, rate) in enumerate(dx.items()) if abs(rate) > _REST * (1.0 + abs(sizes[k]))]
