"""The pages of a Nyquist curve and of absolute stability."""

from __future__ import annotations

import math

from workbench.loops.nyquist.absolute import AbsoluteStability
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted, number, sentence

__all__ = ["STABLE", "absolute_page", "absolute_section", "crossings_section", "nyquist_page"]

STABLE = {True: "stable", False: "unstable", None: "not known"}


def crossings_section(
    result: NyquistResult, unit: str | None = None, *, of: tuple[str | None, str | None] = (None, None)
) -> Section:
    """Return the section of the crossings.

    Args:
        result: with the crossings.
        unit: of the amplitude; None: not known, or none.
        of: units of the block's input and of its output, between which L is a ratio; the same: L has none.
    """
    above, below = (name or "1" for name in of)
    there, inverse = (None, None) if above == below else (f"{above} per {below}", f"{below} per {above}")
    headings = (
        "crossing", "frequency [Hz]", bracketed("L there", there), bracketed("gain −1/L", inverse),
        bracketed("amplitude", unit),
        "unstable poles at less gain", "at more", "distortion [%]", "cycle",
    )  # fmt: skip
    rows = [_crossing(i, c) for i, c in enumerate(result.crossings, 1)]
    table = PageTable(headings, rows, right=range(8))
    return Section("Crossings", paragraphs=[sentence(result.criterion)], tables=[table])


def _crossing(i: int, c: Crossing) -> tuple[str, ...]:
    place = f"{c.real:.5g}" if not c.imag else f"{c.real:.4g} {c.imag:+.4g}j"
    distortion = None if c.distortion is None else 100.0 * c.distortion
    return (
        str(i), f"{c.frequency_hz:.6g}", place, f"{c.gain:.5g}", number(c.amplitude), str(c.unstable_below),
        str(c.unstable_above), number(distortion, ".3g"), "" if c.stable is None else STABLE[c.stable],
    )  # fmt: skip


def absolute_page(result: AbsoluteStability) -> Page:
    """Return the page of absolute stability."""
    return Page(
        title=f"Absolute stability of {result.name}",
        lead=_proven(result),
        facts={},
        sections=[absolute_section(result)],
        kind="absolute-stability",
    )


def _proven(result: AbsoluteStability) -> str:
    if result.refused:
        return sentence(f"nothing is proven: {result.refused}")
    if result.sector is None:
        return "The sectors of characteristics for which the loop is stable."
    where = (
        "" if result.sector.reach is None else f", as long as the block's input stays within ±{result.sector.reach:g}"
    )
    if result.proven_by:
        return sentence(f"the loop with the block is proven stable by the {_CRITERIA[result.proven_by]}{where}")
    return "Neither criterion proves the loop with the block stable; they are sufficient, not necessary."


_CRITERIA = {"circle": "circle criterion", "Popov": "criterion of Popov"}


def absolute_section(result: AbsoluteStability) -> Section:
    """Return the sectors by criterion, and by how much the block may be larger."""

    def row(name: str, k: float | None, words: str) -> tuple[str, ...]:
        high = math.inf if k is None else k
        own = None if result.sector is None or result.low != 0.0 else result.sector.high
        times = "" if not own else "∞" if k is None else f"{high / own:.4g}"
        return (name, f"{result.low:.5g}", "∞" if k is None else f"{k:.6g}", times, words)

    at = "" if result.circle_hz is None else f"decided at {result.circle_hz:.4g} Hz"
    q = "" if result.popov_s is None else f"q = {result.popov_s:.4g} s"
    rows = [] if result.refused else [
        row("circle", result.circle, "proven, also for a characteristic that changes with time; " + at if at else at),
        row("Popov", result.popov, "proven for a characteristic that does not; " + q if q else q),
        row("constant gain", result.linear, "below, the describing function predicts no cycle"),
    ]  # fmt: skip
    if result.sector is not None:
        reach = "at all inputs" if result.sector.reach is None else f"for inputs within ±{result.sector.reach:g}"
        high = result.sector.high
        end = "∞" if math.isinf(high) else f"{high:.6g}"
        rows.append(("the block itself", f"{result.sector.low:.5g}", end, "", reach))
    headings = ("criterion", "slopes from", "to", "times the block", "")
    return Section("Absolute stability", paragraphs=[_proven(result)], tables=[PageTable(headings, rows)])


def nyquist_page(result: NyquistResult) -> Page:
    """Return the page of a Nyquist curve and its crossings."""
    block = f" with {result.block}" if result.block else ""
    low, high = result.frequency_hz[0], result.frequency_hz[-1]
    return Page(
        title=f"Nyquist curve of {result.name}{block}",
        lead=f"{counted(len(result.crossings), 'crossing')} from {low:g} to {high:g} Hz.",
        facts={"open loop": f"{counted(result.unstable_open, 'pole')} in the right half-plane"},
        sections=[
            Section("Curve", figures=[(result.plot, "L(jω), −1/N(A), and the crossings numbered.")]),
            crossings_section(result),
        ],
        kind="nyquist",
    )
