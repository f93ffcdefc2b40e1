"""The health card: every check on every interface of an FMU, or of the FMUs of a system."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from workbench.analysis.check.job import CheckJob, Done
from workbench.analysis.check.registry import CHECKS, FILE, VALIDATION, choose
from workbench.analysis.check.result import Finding, HealthCard, HealthLine
from workbench.analysis.check.validation import validation
from workbench.errors import FmuError, InputError, WorkbenchError
from workbench.fmi.description import Description
from workbench.fmi.platforms import binary_path
from workbench.fmi.variable import Value
from workbench.model.fmu_model import FmuModel
from workbench.model.load import load
from workbench.model.recipe import content_hash
from workbench.origin import with_origin
from workbench.system.description import FmuComponent, SystemDescription
from workbench.system.read import is_system_file, read_system
from workbench.workers import Lost, Reply, Workers, perform
from workbench.workers import choose as choose_runner

__all__ = ["DEFAULT_PATIENCE", "check"]

DEFAULT_PATIENCE = 60.0  # [s] for one check

Progress = Callable[[float, str], None]

_V = TypeVar("_V")

_HANG = "such points are lost after --timeout; chattering or a solver in trouble shows in simulate, too"
_CRASH = "it takes its process with it: leave the worker processes on (never --in-process); such points are lost"


@dataclass(frozen=True, kw_only=True)
class _Part:
    """One FMU to be checked, with what `load` is told about it."""

    component: str
    file: str
    interface: str
    solver: str = "auto"
    step: float | None = None
    tolerance: float | None = None
    start: float | None = None
    start_values: Mapping[str, Value] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)


@with_origin()
def check(
    path: str | Path,
    *,
    interface: str = "auto",
    only: Iterable[str] | None = None,
    skip: Iterable[str] | None = None,
    solver: str = "auto",
    step: float | None = None,
    tolerance: float | None = None,
    start: float | None = None,
    start_values: Mapping[str, Value] | None = None,
    bias: Mapping[str, float] | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> HealthCard:
    """Check whether an FMU keeps its promises, and say what that means for the analyses here.

    The FMU runs in worker processes; a crash or a hang becomes a line, and the other checks go on in a new worker.
    After a run that fails on its way, the other checks look at a tenth of it. Of a system each FMU is checked by
    itself, with the start values and steps of the system.

    Not a proof: a check sees test runs near the start values. What it calls broken was seen to be.

    Args:
        path: an FMU, as for `load`, or a system: .toml, .ssp.
        interface: "me", "cs", or "auto": both, where the FMU offers them.
        only: names of checks (`CHECKS`); None: all.
        skip: names of checks to leave out.
        solver: of model exchange, see `load`.
        step: natural communication step [s] in place of the FMU's.
        tolerance: relative tolerance of the integration, see `load`.
        start: time at which runs begin [s], see `load`.
        start_values: parameters and start values by name; in a system "component.variable".
        bias: constants added to inputs by name, likewise.
        workers: where and under which limits; None: worker processes, 60 s for each check.
        progress: called with the part that is done, 0 … 1, and the check that was last.

    Returns:
        The card; `card.passed` tells whether no promise is broken.

    Raises:
        InputError: no such file, an unknown name, a value out of range.
        FmuError: the file cannot be read, or has no binary for this platform.
    """
    names = choose(only, skip)
    given = _Given(solver, step, tolerance, start, dict(start_values or {}), dict(bias or {}))
    where = workers or Workers(timeout=DEFAULT_PATIENCE)
    system = read_system(path) if is_system_file(path) else None  # an .ssp stays unpacked as long as this lives
    if system is not None:
        parts = _parts_of(system, path, interface, given)
    else:
        parts = [_Part(component="", file=str(path), interface=interface, **vars(given))]
    tell = progress or _silent
    cards = [
        _card(part, names, where, lambda done, text, k=k: tell((k + done) / len(parts), text))  # type: ignore[misc]
        for k, part in enumerate(parts)
    ]
    return _joined(str(path), cards)


@dataclass(frozen=True)
class _Given:
    solver: str
    step: float | None
    tolerance: float | None
    start: float | None
    start_values: dict[str, Value]
    bias: dict[str, float]


def _silent(done: float, text: str) -> None:
    """Tell nobody."""


def _parts_of(system: SystemDescription, path: str | Path, interface: str, given: _Given) -> list[_Part]:
    """Return each FMU of a system; the interface that the system names, unless the user names one."""
    found = [c for c in system.components if isinstance(c, FmuComponent)]
    if not found:
        raise InputError(f"{path}: the system has no FMU that could be checked")
    return [
        _Part(
            component=c.name,
            file=c.file,
            interface=c.interface if interface == "auto" else interface,
            solver=c.solver if given.solver == "auto" else given.solver,
            step=given.step or c.step,
            tolerance=given.tolerance,
            start=given.start,
            start_values={**c.set, **_own(c.name, given.start_values)},
            bias=_own(c.name, given.bias),
        )
        for c in found
    ]


def _own(component: str, values: Mapping[str, _V]) -> dict[str, _V]:
    head = f"{component}."
    return {name.removeprefix(head): value for name, value in values.items() if name.startswith(head)}


# -- one FMU ------------------------------------------------------------------------------------


def _card(part: _Part, names: tuple[str, ...], where: Workers, progress: Progress) -> HealthCard:
    model = load(
        part.file,
        part.interface,
        part.solver,
        step=part.step,
        tolerance=part.tolerance,
        start=part.start,
        start_values=part.start_values,
        bias=part.bias,
    )
    with model:
        interfaces = _interfaces(model, part.interface)
        wanted = {i: tuple(n for n in names if i in CHECKS[n].interfaces) for i in interfaces}
        lines = [_validated(model)] if VALIDATION in names else []
        total = len(lines) + sum(map(len, wanted.values()))
        for line in _run(model, wanted, where):
            lines.append(line)
            progress(len(lines) / total, f"{part.component} {line.interface} {line.name}".strip())
        about = model.description
        order = {(FILE, VALIDATION): 0} | {(i, n): k for k, (i, n) in enumerate(_pairs(wanted), 1)}
        return HealthCard(
            model=about.model_name,
            source=part.file,
            sha256=content_hash(Path(model.recipe.source)),
            fmi_version=about.fmi_version,
            generation_tool=about.generation_tool or "unknown tool",
            interfaces=tuple(interfaces),
            checks=tuple(
                replace(line, component=part.component)
                for line in sorted(lines, key=lambda c: order[c.interface, c.name])
            ),
            notes=_notes(about, interfaces),
        )


def _pairs(wanted: Mapping[str, tuple[str, ...]]) -> list[tuple[str, str]]:
    return [(interface, name) for interface, names in wanted.items() for name in names]


def _interfaces(model: FmuModel, wanted: str) -> list[str]:
    """Return the interfaces to check: those offered, with a binary for this platform."""
    if wanted != "auto":
        return [wanted]
    about = model.description
    return [i for i in ("me", "cs") if i in about.interfaces and _runs_here(model, about.interfaces[i].identifier)]


def _runs_here(model: FmuModel, identifier: str) -> bool:
    try:
        binary_path(Path(model.recipe.folder), identifier, source=model.source)
    except FmuError:
        return False
    return True


def _notes(about: Description, interfaces: list[str]) -> tuple[str, ...]:
    missing = [i for i in about.interfaces if i not in interfaces]
    return tuple(f"interface {i} is offered but was not checked" for i in missing)


def _validated(model: FmuModel) -> HealthLine:
    begin = time.monotonic()
    finding = validation(Path(model.recipe.folder), model.description)
    return _line(FILE, Done(VALIDATION, finding, time.monotonic() - begin))


def _line(interface: str, done: Done) -> HealthLine:
    return HealthLine(interface=interface, name=done.name, seconds=round(done.seconds, 3), **vars(done.finding))


def _run(model: FmuModel, wanted: Mapping[str, tuple[str, ...]], where: Workers) -> Iterator[HealthLine]:
    """Yield the lines as they are finished; what a crash cuts off goes on in a new worker."""
    jobs = deque(CheckJob(interface=i, names=names) for i, names in wanted.items() if names)
    open_names = {i: list(names) for i, names in wanted.items()}
    runner, _ = choose_runner(model, where)
    with runner:
        try:
            for event in runner.run(perform, jobs):
                job = event.job
                if isinstance(event, Reply) and isinstance(event.value, Done):
                    open_names[job.interface].remove(event.value.name)
                    yield _line(job.interface, event.value)
                elif isinstance(event, Lost):
                    yield from _lost(event, open_names[job.interface], jobs)
        except WorkbenchError as error:
            for interface, names in open_names.items():
                yield from (_line(interface, Done(n, Finding("broken", str(error), _CRASH), 0.0)) for n in names)


def _lost(event: Lost, names: list[str], jobs: deque[CheckJob]) -> Iterator[HealthLine]:
    """Yield the line of the check in which a worker was lost; queue the others."""
    job: CheckJob = event.job
    lost = names.pop(0)
    yield _line(job.interface, Done(lost, _loss(lost, event.reason), 0.0))
    again = job.after_loss(lost)
    if again is None:
        return
    if not again.hopeless:
        jobs.append(again)
        return
    reason = f"given up after {again.crashes} crashes or hangs"
    while names:
        yield _line(job.interface, Done(names.pop(0), Finding("not applicable", reason), 0.0))


def _loss(name: str, reason: str) -> Finding:
    """Return what is said of a check in which the worker was lost; one that takes too long after `runs` may be slow."""
    if not reason.startswith("time limit"):
        return Finding("broken", reason, _CRASH)
    return Finding("broken" if name == "runs" else "watch", reason, _HANG)


# -- all of them --------------------------------------------------------------------------------


def _joined(source: str, cards: list[HealthCard]) -> HealthCard:
    """Return one card of one or several FMUs."""
    if len(cards) == 1 and not any(line.component for line in cards[0].checks):
        return cards[0]
    return HealthCard(
        model=Path(source).name,
        source=source,
        sha256=", ".join(dict.fromkeys(c.sha256 for c in cards)),
        fmi_version=", ".join(dict.fromkeys(c.fmi_version for c in cards)),
        generation_tool=", ".join(dict.fromkeys(c.generation_tool for c in cards)),
        interfaces=tuple(dict.fromkeys(i for c in cards for i in c.interfaces)),
        checks=tuple(line for c in cards for line in c.checks),
        notes=tuple(dict.fromkeys(n for c in cards for n in c.notes)),
    )
