"""The pages of linear models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.core.values.operating_point import told
from workbench.core.values.poles import (
    ON_BORDER,
    continuous,
    damping_ratio,
    natural_frequency_hz,
    sides,
    vanished,
)
from workbench.point.lin.delay_roots import delay_roots
from workbench.point.lin.grid import LinGrid, LinPoint
from workbench.point.lin.result import LinResult
from workbench.point.lin.step_check import StepCheck
from workbench.point.lin.varying_result import VaryingModel
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted, matrices, pole_table
from workbench.show.verdicts import Verdict

if TYPE_CHECKING:
    from workbench.point.lin.state_space import LinearModel  # python-control is slow to import

__all__ = ["grid_page", "lin_page", "linear_model_page", "step_check_page", "varying_page"]

_NOT_REACHED = (
    "the error asked for is not reached with the finest grid: narrow the ranges, ask for less, or look where the map "
    "has a ridge: the model switches there, poles meet, or its equilibrium is another one on either side"
)
_ROUNDING = 1e-9  # of the fastest pole of a continuous model: real parts below are that


def lin_page(result: LinResult) -> Page:
    """Return the page of a linear model: response, poles, matrices, point, what is doubtful and why rows are zero."""
    return Page(
        title=f"Linear model of {result.model}",
        lead=" ".join([_kind(result), *_motion(result), *_how_doubtful(result)]),
        facts=_facts(result),
        sections=[
            *_response(result),
            *_parts(result),
            _point(result),
        ],
        summary=_doubts(result),
        notes=result.notes,
        kind="lin",
        shown_by="--report",
    )


def linear_model_page(model: LinearModel) -> Page:
    """Return the page of the linearisation behind a python-control model."""
    return lin_page(model.result)


def _response(result: LinResult) -> list[Section]:
    if not result.input_names or not result.output_names:
        return []
    words = (
        "Bode picture, down to 80 dB below the largest gain, and step response; a curve for each pair of input and "
        "output."
    )
    return [Section("Response", figures=[(result.plot, words)])]


def _kind(result: LinResult) -> str:
    kind = f"Discrete, period {result.dt:.9g} s" if result.dt > 0.0 else "Continuous"
    sizes = (counted(len(result.state_names), "state"), counted(len(result.input_names), "input"))
    return f"{kind}: {', '.join(sizes)}, {counted(len(result.output_names), 'output')}."


def _motion(result: LinResult) -> list[str]:
    """Return in words whether it is stable, and the oscillation that is damped least."""
    seen, all_poles = _seen(result)
    poles, dt = seen[~vanished(seen, result.dt)], result.dt
    s = continuous(poles, dt)
    size, among = np.abs(s), "" if all_poles else " of those shown"
    rounding = 0.0 if dt > 0.0 else _ROUNDING * float(np.max(size, initial=0.0))
    beyond, border = sides(poles, dt, relative=ON_BORDER if dt > 0.0 else 0.0, rounding=rounding)
    where = ((beyond, "in the right half-plane"), (border, "on the boundary of stability"))
    words = [f"{counted(count, 'pole')}{among} {place}." for which, place in where if (count := int(np.sum(which)))]
    turning = (s.imag > 0.0) & (size > 0.0)
    if np.any(turning):
        least = s[turning][np.argmin(damping_ratio(s[turning]))]
        frequency, ratio = float(natural_frequency_hz(least)), float(damping_ratio(least))
        words.append(
            f"The oscillation{among} damped least is at {frequency:.4g} Hz (natural), damping ratio {ratio:.3g}."
        )
    return [text for text in (*words, *_with_delays(result)) if text]


def _seen(result: LinResult) -> tuple[Complex, bool]:
    """Return the poles that are described, those with the delays as they are if they are known; and whether all are."""
    exact = result.delay_poles
    return (exact, False) if len(exact) else (result.shown_poles, result.shows_all_poles)


def _with_delays(result: LinResult) -> list[str]:
    """Return in words what the delays themselves make of the stability, right of all that the poles tell."""
    if result.delayed is None:
        return []
    found = delay_roots(result.delayed, result.poles)
    if found.border or np.isnan(found.right.number):
        why = found.right.why or "a pole is on the border"
        return [f"With the delays as they are, whether it is stable is not known: {why}."]
    if not found.right.number:
        return ["With the delays as they are, it is stable."]
    many = "infinitely many poles" if np.isinf(found.right.number) else counted(int(found.right.number), "pole")
    return [f"With the delays as they are, {many} in the right half-plane."]


def _facts(result: LinResult) -> dict[str, str]:
    calls = ", ".join(f"{n} {kind}" for kind, n in result.calls.items())
    nothing = "; ".join(f"{source} → {target}" for source, target in result.without_effect)
    return {
        "inputs → outputs": f"{_names(result.input_names)} → {_names(result.output_names)}",
        "method": f"{result.method} ({result.why})",
        **({"no effect": nothing} if nothing else {}),
        **({"model calls": calls} if calls else {}),
    }


def _names(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _how_doubtful(result: LinResult) -> list[str]:
    return [f"{counted(len(result.doubts), 'entry', 'entries')} in doubt."] if result.doubts else []


def _doubts(result: LinResult) -> list[Verdict]:
    return [Verdict("doubtful", f"{d.row} by {d.column} = {d.value:.6g}: {d.reason}") for d in result.doubts]


def _parts(result: LinResult) -> list[Section]:
    values = (result.A, result.B, result.C, result.D)
    sections = [
        Section("Poles", tables=[_poles(result)]) if len(result.A) else None,
        matrices(values, result.state_names, result.input_names, result.output_names, units=result.units, dt=result.dt),
        Section("Rows and columns that are zero", items=[f"{z.kind} {z.name}: {z.reason}" for z in result.zeros])
        if result.zeros
        else None,
    ]
    return [s for s in sections if s is not None]


def _poles(result: LinResult) -> PageTable:
    if len(result.delay_poles):
        end = result.delay_poles_complete_to
        which = "the rightmost found, perhaps not all" if end is None else f"all right of {end:.4g} 1/s"
        return pole_table(result.delay_poles.tolist(), 0.0, f"with the delays as they are, {which}")
    if result.shows_all_poles:
        return pole_table(result.poles.tolist(), result.dt)
    shown = result.shown_poles
    return pole_table(shown.tolist(), 0.0, f"{len(shown)} of {len(result.A)}, the nearest to {result.about_hz:g} Hz")


def _point(result: LinResult) -> Section:
    point = result.operating_point
    groups = (("state", point.x), ("discrete state", point.discrete), ("input", point.u), ("output", point.y))
    rows = [
        (name, kind, f"{told(value):.8g}", point.units.get(name) or result.units.get(name) or "")
        for kind, values in groups
        for name, value in values.items()
    ]
    table = PageTable(("variable", "kind", "value", "unit"), rows, right=(2,))
    return Section("Operating point", paragraphs=[f"At {point.time:g} s."], tables=[table], folded=True)


# -- grids -------------------------------------------------------------------------------------


def grid_page(grid: LinGrid) -> Page:
    """Return the page of an array of linear models: one Bode picture, poles of each member."""
    good = [(p, p.result) for p in grid.points if p.result is not None]
    over = ", ".join(grid.over)
    return Page(
        title=f"Linear models{f' of {good[0][1].model}' if good else ''} over {over}",
        lead=f"{counted(len(grid.points), 'point')}, {len(grid.failed)} of them without a model.",
        facts={name: ", ".join(f"{v:g}" for v in values) for name, values in grid.over.items()},
        sections=[
            *(
                [Section("Response", figures=[(grid.plot, "First input to first output, one curve for each point.")])]
                if good
                else []
            ),
            Section("Linear models", parts=[_member(p, r) for p, r in good], folded=len(good) > 1),
        ],
        summary=[Verdict("failed", f"{p}: {p.reason}") for p in grid.failed]
        + [Verdict(v.word, f"{p}: {v.text}") for p, r in good for v in _doubts(r)],
        notes=tuple(dict.fromkeys([*grid.notes, *(note for _, r in good for note in r.notes)])),
        kind="lin",
    )


def _member(point: LinPoint, result: LinResult) -> Section:
    words = [f"{_kind(result)} Method: {result.method} ({result.why})."]
    return Section(str(point), paragraphs=words, parts=_parts(result))


# -- parameter-varying models ------------------------------------------------------------------


def varying_page(result: VaryingModel) -> Page:
    """Return the page of a parameter-varying model: its largest errors, their map, the grid."""
    errors, words = result.errors, "as asked for" if result.complete else "more than was asked for"
    kind = "Chebyshev polynomials" if result.interpolation == "chebyshev" else "cubic splines"
    about = "an equilibrium found at each point" if result.trimmed else "the given operating point"
    sizes = " × ".join(str(len(nodes)) for nodes in result.grid.values())
    names = ("poles", "frequency responses", "step responses", "operating point")
    rows = [(name, f"{value:.2g}") for name, value in zip(names, errors.values, strict=True)]
    scheduling = [
        (p.name, f"{p.low:g}", f"{p.high:g}", p.unit or "", ", ".join(f"{v:.6g}" for v in result.grid[p.name]))
        for p in result.scheduling
    ]
    return Page(
        title=f"Parameter-varying linear model of {result.model} over {', '.join(result.grid)}",
        lead=f"Largest error {errors.largest:.2g}, {words} ({result.asked_error:g}), by {kind} over a grid of "
        f"{sizes}; {counted(len(result.state_names), 'state')}.",
        facts={
            "inputs → outputs": f"{_names(result.input_names)} → {_names(result.output_names)}",
            "method": f"{result.method}, about {about}",
            "linear models": f"{result.linear_models}, {len(result.held_out)} of them held out",
        },
        sections=[
            Section("Errors over the ranges", figures=[(result.plot, "Errors at the points that were held out.")]),
            Section("Largest errors", tables=[PageTable(("of", "relative error"), rows, right=(1,))]),
            Section(
                "Scheduling parameters",
                tables=[PageTable(("parameter", "from", "to", "unit", "grid"), scheduling, right=(1, 2))],
            ),
        ],
        summary=[] if result.complete else [Verdict("failed", _NOT_REACHED)],
        notes=result.notes,
        kind="lin",
        shown_by="--report",
    )


# -- comparisons -------------------------------------------------------------------------------


def step_check_page(result: StepCheck) -> Page:
    """Return the page of one step on the model and on its linear model."""
    height, error = f"{result.height:g}", f"{100.0 * result.error:.3g} %"
    return Page(
        title=f"Step of {result.input}: linear model against the model",
        lead=f"After a step of {height} the linear {result.output} differs by {error} of its motion (rms).",
        facts={"input": result.input, "output": bracketed(result.output, result.unit), "height": height},
        sections=[Section("Step response", figures=[(result.plot, "Both responses to the same step.")])],
        kind="step check",
    )
