"""The pages of limit cycles: all of a loop, a branch of them, a run from rest."""

from __future__ import annotations

from workbench.limit_cycles.limit_cycle.branch import Branch, BranchPoint
from workbench.limit_cycles.limit_cycle.free_run import FreeRun
from workbench.limit_cycles.limit_cycle.result import LimitCycle, LimitCycleResult, SimulatedCycle
from workbench.loops.nyquist.page import STABLE, absolute_section, crossings_section
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number, sampled_rows, sentence
from workbench.show.verdicts import Verdict

__all__ = ["branch_page", "free_run_page", "limit_cycle_page"]

_KINDS = {
    "period doubling": "period doubling: the motion repeats after two periods",
    "Neimark-Sacker": "Neimark-Sacker: a second frequency sets in",
    "branch point": "branch point: another family of cycles crosses",
}
_ROUNDING = 1e-6  # of the amplitude: a mean below it is the integration's error
_MOST_ROWS = 60  # of a curve; the others are in the data of the page


def limit_cycle_page(result: LimitCycleResult) -> Page:
    """Return the page of an analysis of limit cycles: crossings, cycles by each method, simulation, branches."""
    return Page(
        title=f"Limit cycles of {result.model}",
        lead=_lead(result),
        facts={
            "nonlinear block": f"{result.block}: {bracketed(result.input, result.input_unit)} → {result.output}",
            **({"balanced with": ", ".join(result.blocks[1:])} if result.blocks[1:] else {}),
            "open loop": f"{counted(result.nyquist.unstable_open, 'pole')} of the linear part in the right half-plane",
        },
        sections=[
            Section(
                "Crossings and motion", figures=[(result.plot, "L(jω) with −1/N(A), the crossings, and the motion.")]
            ),
            _crossings(result),
            _cycles(result),
            *([] if result.absolute is None else [absolute_section(result.absolute)]),
            *([] if result.simulated is None else [_simulated(result.simulated, result.input_unit)]),
            *([] if result.free_run is None else [_free_run(result.free_run)]),
            *(_branch(b, result.units.get(b.parameter), result.input_unit) for b in result.branches),
        ],
        summary=_verdicts(result),
        notes=result.notes,
        kind="limit-cycle",
    )


def _crossings(result: LimitCycleResult) -> Section:
    """Return the crossings; L has no unit where that of the block's output is not known."""
    told = (result.input_unit, result.units[result.output]) if result.output in result.units else (None, None)
    return crossings_section(result.nyquist, result.input_unit, of=told)


def _lead(result: LimitCycleResult) -> str:
    none = result.none_predicted()
    if none:
        return sentence(none)
    stable = [c for c in result.limit_cycles if c.stable]
    if not stable:
        return f"{counted(len(result.crossings), 'crossing')}, and none of them is a stable limit cycle."
    best = stable[-1]
    size = f"{best.amplitude:.4g}{behind(result.input_unit)}"
    where = f"{best.frequency_hz:.5g} Hz with amplitude {size} of {result.input}"
    return f"A stable limit cycle at {where} (by {best.method})."


def _verdicts(result: LimitCycleResult) -> list[Verdict]:
    """Return one line for each crossing; a limit cycle is a fact, no violation: only what is doubtful is coloured."""
    best = {c.crossing: c for c in result.limit_cycles}  # the methods come in rising order of trust
    verdicts = [Verdict(STABLE[c.stable] + " cycle", _cycle_words(c, result.input_unit)) for c in best.values()]
    if result.simulated is not None and not result.simulated.steady:
        verdicts.append(Verdict("watch", "the simulation was not steady at its end"))
    verdicts += [
        Verdict("watch", f"{_followed(b)} was not followed to its end: {'; '.join(dict.fromkeys(b.ends))}")
        for b in result.branches
        if b.truncated
    ]
    return verdicts


def _cycle_words(c: LimitCycle, unit: str | None) -> str:
    size = f"{c.amplitude:.4g}{behind(unit)}"
    place = "free run" if c.crossing is None else f"crossing {c.crossing + 1}"
    return f"{place}, {c.method}: {c.frequency_hz:.5g} Hz, amplitude {size}"


def _mean(mean: float, amplitude: float) -> str:
    """Return the mean, 0 where it is rounding beside the amplitude."""
    return "0" if abs(mean) < _ROUNDING * abs(amplitude) else f"{mean:.3g}"


def _cycles(result: LimitCycleResult) -> Section:
    headings: tuple[str, ...] = (
        "crossing", "method", "frequency [Hz]",
        *(bracketed(n, result.input_unit) for n in ("amplitude", "fundamental", "mean")),
        "multiplier", "residual", "cycle",
    )  # fmt: skip
    rows: list[tuple[str, ...]] = [
        (
            c.number, c.method, f"{c.frequency_hz:.6g}", f"{c.amplitude:.5g}", f"{c.fundamental:.5g}",
            _mean(c.mean, c.amplitude), number(c.multiplier, ".4g"), number(c.residual, ".2g"), STABLE[c.stable],
        )
        for c in result.limit_cycles
    ]  # fmt: skip
    words = f"Amplitude: half the peak-to-peak value of {result.input}; mean: its mean value."
    inputs = tuple(f"{block}." for block in result.blocks)
    every = dict.fromkeys(n for c in result.limit_cycles for n in c.amplitudes if n.startswith(inputs))
    further = [n for n in every if n != result.input]
    if further:
        units = {} if result.simulated is None else result.simulated.units
        headings += tuple(bracketed(f"amplitude of {n}", units.get(n)) for n in further)
        rows = [
            (*row, *(number(c.amplitudes.get(n), ".5g") for n in further))
            for row, c in zip(rows, result.limit_cycles, strict=True)
        ]
    right = (0, *range(2, 8), *range(9, len(headings)))
    return Section("Limit cycles by method", paragraphs=[words], tables=[PageTable(headings, rows, right=right)])


def _simulated(cycle: SimulatedCycle, input_unit: str | None) -> Section:
    rows = [
        (
            name,
            cycle.units.get(name) or "",
            f"{cycle.amplitude[name]:.5g}",
            f"{cycle.fundamental[name]:.5g}",
            _mean(cycle.mean[name], cycle.amplitude[name]),
        )
        for name in cycle.amplitude
    ]
    began = f"{cycle.predicted_frequency_hz:.5g} Hz, amplitude {cycle.predicted_amplitude:.4g}{behind(input_unit)}"
    origin = "a free run" if cycle.crossing is None else "the predicted state"
    words = (
        f"From {origin} ({began}) over {counted(cycle.periods, 'period')}: it ends at "
        f"{cycle.frequency_hz:.6g} Hz{'' if cycle.steady else ', not steady yet'}."
    )
    table = PageTable(("variable", "unit", "amplitude", "fundamental", "mean"), rows, right=(2, 3, 4))
    return Section("Simulation", paragraphs=[words], tables=[table], folded=len(rows) > _MOST_ROWS)


def _free_run(run: FreeRun) -> Section:
    """Return the history of a run from rest; its picture is part of the result's."""
    rows = [
        (
            f"{x.begin:.4g}", f"{x.end:.4g}", number(x.frequency_hz),
            "–" if x.frequency_hz is None else f"{100.0 * x.scatter:.2g}", number(x.amplitude, ".4g"),
            number(x.growth, ".4g"),
        )
        for x in run.spans
    ]  # fmt: skip
    headings = (
        "from [s]", "to [s]", "frequency [Hz]", "scatter of the periods [%]",
        bracketed("largest amplitude", run.unit), "growth [1/s]",
    )  # fmt: skip
    return Section("Run from rest", paragraphs=[f"{run.signal}: {run.words()}."], tables=[PageTable(headings, rows)])


def free_run_page(run: FreeRun) -> Page:
    """Return the page of an oscillation's history."""
    return Page(
        title=f"{run.signal}: frequency and amplitude over time",
        lead=f"{run.words()}.",
        facts={"record": f"{run.time[0]:g} to {run.time[-1]:g} s, {counted(len(run.frequency_hz), 'period')}"},
        sections=[
            Section("History", figures=[(run.plot, "The signal; frequency and amplitude of each period.")]),
            _free_run(run),
        ],
        kind="limit-cycle",
    )


# -- branches ----------------------------------------------------------------------------------


def branch_page(branch: Branch) -> Page:
    """Return the page of limit cycles followed over a parameter."""
    return Page(
        title=f"Limit cycles over {branch.parameter}",
        lead=f"{counted(len(branch.points), 'point')} along the branch, {counted(len(branch.folds), 'fold')}.",
        facts={"begins": branch.ends[0], "ends": branch.ends[1]},
        sections=[_branch(branch)],
        kind="limit-cycle",
    )


def _followed(branch: Branch) -> str:
    start = branch.start
    if start is None:
        return f"over {branch.parameter}"
    return f"over {branch.parameter} from {start.frequency_hz:.4g} Hz, amplitude {start.amplitude:.4g}"


def _branch(branch: Branch, unit: str | None = None, input_unit: str | None = None) -> Section:
    rows = sampled_rows([_branch_point(p) for p in branch.points], _MOST_ROWS)
    sizes = (bracketed(n, input_unit) for n in ("amplitude", "fundamental", "mean"))
    headings = (bracketed(branch.parameter, unit), "frequency [Hz]", *sizes, "cycle")
    folds, hopf = ([_branch_point(p)[:-1] for p in result] for result in (branch.folds, branch.hopf))
    others = [(*_branch_point(p)[:-1], _KINDS.get(p.kind, p.kind)) for p in branch.bifurcations]
    shown = f"{len(rows)} of {len(branch.points)} points; JSON and CSV hold all."
    return Section(
        f"O{_followed(branch)[1:]}",
        figures=[(branch.plot, "Amplitude and frequency; unstable parts dashed; where something begins is marked.")],
        items=[f"begins: {branch.ends[0]}", f"ends: {branch.ends[1]}"],
        tables=[
            PageTable((*headings[:-1], "what begins")[: len(table[0])], table, title=title, right=range(5))
            for title, table in (("Folds", folds), ("Hopf points: the cycle is gone", hopf), ("Bifurcations", others))
            if table
        ],
        parts=[Section("Points", paragraphs=[shown], tables=[PageTable(headings, rows, right=range(5))], folded=True)],
    )


def _branch_point(p: BranchPoint) -> tuple[str, ...]:
    numbers = (p.value, p.frequency_hz, p.amplitude, p.fundamental)
    return (*(f"{x:.5g}" for x in numbers), _mean(p.mean, p.amplitude), STABLE[p.stable])


# -- crossings and describing functions --------------------------------------------------------
