"""The loop transfer from a linearisation of the opened system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.core.records.forms import Widths
from workbench.core.records.option import values_of
from workbench.core.values.linear import LinearPart
from workbench.core.values.margins import Margins
from workbench.loops.loop.cut import PASSED, RETURNED, CutLoop
from workbench.loops.loop.delayed_loop import delayed_margins, delayed_stability
from workbench.loops.loop.lifted import Lifted, lifted, margins_of_lifted
from workbench.loops.loop.margins import margins_of, withheld
from workbench.loops.loop.result import LinearLoop
from workbench.loops.loop.stability import judged, same_poles, stability_of, unknown
from workbench.loops.nyquist.absolute import absolute_stability
from workbench.model.sample_rates import sampled
from workbench.point.lin.linearise import run
from workbench.point.lin.request import Lin, lin_result
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import make_task

__all__ = ["linear_loop"]

_REST = 1e-6  # a derivative above this part of (value + 1) is motion


def linear_loop(cut: CutLoop, *, method: str = "auto", dx: Widths | None = None, du: float | None = None) -> LinearLoop:
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
    x0, u0 = ({}, {}) if point is None else ({**point.x, **point.discrete}, dict(point.u))
    request = Lin(x0=x0, u0={**u0, PASSED: cut.value}, inputs=[PASSED], outputs=[RETURNED], method=method, dx=dx, du=du,
                time=cut.time)  # fmt: skip
    with cut.opened() as model:
        result = lin_result(model, **values_of(request))
        periodic = result.method == "kalman-bertram"
        whole = lifted(make_task(model, request), result) if periodic and not result.delayed else None
    transfer = LinearPart(result.A, result.B, -result.C, -result.D, dt=result.dt)
    notes = (*cut.notes, *result.notes, *_notes(cut, result))
    if periodic:
        transfer = (whole and whole.single) or transfer
        alone = replace(request, u0=u0, inputs=[], outputs=None, dx=None, du=None)
        closed = run(replace(make_task(cut.model, alone), explained=False), result.method)
        margins, more = _sampled(cut, result, transfer, whole, closed)
        return LinearLoop(result, transfer, judged(closed, transfer), margins, (*notes, *more, *_doubtful(closed)))
    rates = sampled(cut.model, cut.point)
    notes = (*notes, *rates.notes)
    if result.dt == 0.0 and (rates.periods or not rates.complete):
        stability = unknown(
            stability_of(transfer), "the system is sampled, but this linear model holds its discrete states"
        )
        return LinearLoop(result, transfer, stability, withheld(stability), notes)
    if result.delayed is not None:
        exact = result.delayed.negated()
        stability = delayed_stability(exact, transfer)
        return LinearLoop(result, transfer, stability, delayed_margins(exact, stability), notes)
    absolute = None if transfer.dt > 0.0 else absolute_stability(transfer, name=cut.place.label)
    return LinearLoop(result, transfer, stability_of(transfer), margins_of(transfer), notes, absolute)


def _sampled(
    cut: CutLoop, result: LinResult, transfer: LinearPart, whole: Lifted | None, closed: LinResult
) -> tuple[Margins, list[str]]:
    """Return the margins of a sampled loop, and what is to be said of them.

    The closed loop is known by itself, from its own map over a basic period. Margins are stated where the open loop,
    closed again, has its poles.
    """
    stability, source = judged(closed, transfer), cut.place.source
    # Poles alone do not tell: where the loop is weak, L held over the period has almost those of the loop as it is.
    once = result.delayed is not None if whole is None else whole.single is not None
    if once and same_poles(transfer.sensitivity().poles, closed.poles):
        return margins_of(transfer), []
    if whole is not None and same_poles(whole.closed(), closed.poles):
        note = (
            f"{source} acts {len(whole.D)} times in a basic period of {transfer.dt:.6g} s: the margins are those of a "
            "factor on it, for the phase of exp(−jφ); the curves of L, |S| and |T| show it held over the basic period, "
            "which it is not: open the loop where the signal acts once in that time, to see L"
        )
        return margins_of_lifted(whole, stability), [note]
    held = f"opened there, L holds it over {transfer.dt:.6g} s"
    if cut.place.discrete or (result.intersample is not None and result.intersample.sampled):
        why = f"{source} acts at several instants; {held}, and closed again it has other poles than the loop"
    else:
        why = f"{source} is continuous and acts between the samples too; {held}, a delay that the loop does not have"
    return withheld(stability), [f"{why}: there are no margins; open the loop at a sampled signal instead"]


def _notes(cut: CutLoop, result: LinResult) -> list[str]:
    notes = _doubtful(result)
    if not _returns(result):
        notes.append(
            f"L is 0: what {cut.place.label} passes on does not return at this point (a limit is reached, or a "
            "path is open)"
        )
    if result.dt == 0.0 and abs(size := float(result.D[0, 0])) >= 1.0:
        notes.append(
            f"|L| is {abs(size):.4g} at infinite frequency, not below 1: any delay, however short, makes "
            "infinitely many poles of the closed loop reach the border or pass it, so that the delay margin is 0"
        )
    moving = _moving(result.operating_point.dx, result.operating_point.x) if result.dt == 0.0 else []
    if moving:
        notes.append(
            f"the point is not an equilibrium ({', '.join(moving[:3])} move); margins are those of this instant"
        )
    return notes


def _doubtful(result: LinResult) -> list[str]:
    return [f"doubtful: {d.row} by {d.column}: {d.reason}" for d in result.doubts]


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
