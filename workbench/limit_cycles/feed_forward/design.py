"""From H/G to a filter: reduce, join, cancel, mirror, turn the sign, low-pass."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.core.values.poles import natural_frequency_hz
from workbench.limit_cycles.feed_forward.design_step import FilterComparison, FilterStep
from workbench.limit_cycles.feed_forward.request import FeedForward
from workbench.limit_cycles.feed_forward.result import Design
from workbench.point.reduction.balanced import BalancedReduction, balanced_reduction
from workbench.point.reduction.band_error import band_error
from workbench.point.reduction.cancel import cancel, mirror
from workbench.point.reduction.factored import Factored, factored, low_pass, to_state_space

__all__ = ["design"]

_AXIS = 1e-6


def design(G: LinearPart, H: LinearPart, request: FeedForward, judge: FilterComparison) -> Design:
    """Return the filter F ≈ H/G that is stable and small.

    Args:
        G: from the control input to the block's input; stable, or its unstable poles are kept.
        H: from the block's output, sign turned, to the block's input.
        request: how.
        judge: what the steps are compared with.

    Raises:
        InputError: an order or tolerance out of range, G has fewer zeros at infinity than H: F is not a proper filter.
        SimulationError: a decomposition failed.
    """
    g_order, h_order = request.orders or (None, None)
    hankel = request.hankel if request.orders is None else None
    g = balanced_reduction(G, order=g_order, tolerance=hankel, method=request.method)
    h = balanced_reduction(H, order=h_order, tolerance=hankel, method=request.method)
    steps = [_reduced(g, h, judge)]

    def add(name: str, now: Factored, remark: str) -> None:
        steps.append(judge.step(name, now.response(judge.frequency), now.order, now.unstable_poles, remark))

    F = factored(h.part).over(factored(g.part))
    add("joined", F, f"G of order {g.order}, H of order {h.order}")
    F, cancelled = cancel(F, tolerance=request.cancel)
    add("cancelled", F, f"{len(cancelled)} pairs within {request.cancel:g}")
    turned = mirror(F)
    F = turned.factored
    add("mirrored", F, _mirrored(turned.poles, judge.band[1]))
    change = request.sign == "change" or (request.sign == "auto" and turned.dc_sign < 0)
    F = F.negated() if change else F
    why = "an odd" if turned.dc_sign < 0 else "an even"
    add("sign", F, f"{'changed' if change else 'kept'}: {why} number of real poles mirrored")
    if request.low_pass_order:
        F = F.times(low_pass(request.low_pass, order=request.low_pass_order))
        add("low-pass", F, f"Butterworth of order {request.low_pass_order} at {request.low_pass:g} Hz")
    return Design(
        G=g,
        H=h,
        band_errors=(band_error(G, g.part, judge.band), band_error(H, h.part, judge.band)),
        steps=tuple(steps),
        factored=F,
        part=to_state_space(F),
        mirrored=turned.poles,
        notes=_notes(turned.on_axis, cancelled, turned.poles),
    )


def _reduced(g: BalancedReduction, h: BalancedReduction, judge: FilterComparison) -> FilterStep:
    with np.errstate(all="ignore"):
        response = h.part.response(judge.frequency) / g.part.response(judge.frequency)
    remark = f"G {g.full_order} → {g.order}, H {h.full_order} → {h.order}"
    return judge.step("reduced", response, g.order + h.order, np.zeros(0, dtype=np.complex128), remark)


def _mirrored(poles: Complex, edge: float) -> str:
    inside = int(np.sum(natural_frequency_hz(poles) <= edge))
    return f"{len(poles)} poles, {inside} below {edge:g} Hz" if len(poles) else "none"


def _notes(on_axis: Complex, cancelled: Complex, mirrored: Complex) -> tuple[str, ...]:
    notes = []
    if len(mirrored):
        listed = ", ".join(f"{float(natural_frequency_hz(p)):.3g}" for p in mirrored[mirrored.imag >= 0.0].tolist())
        notes.append(
            f"poles were mirrored at {listed} Hz; near these frequencies the phase of the filter differs from that "
            "of H/G"
        )
    if len(on_axis):
        notes.append(
            f"the filter keeps {len(on_axis)} poles on the imaginary axis, such as an integrator: its output can drift"
        )
    hidden = cancelled[cancelled.real > _AXIS * np.maximum(1.0, np.abs(cancelled))]
    if len(hidden):
        notes.append(f"{len(hidden)} of the cancelled poles lie right of the imaginary axis")
    return tuple(notes)
