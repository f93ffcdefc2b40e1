"""The health card: every check on every interface of an FMU, or of the FMUs of a system."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from workbench.core.records.option import options_of
from workbench.errors import FmuError, InputError, Mistake, TimedOutError, WorkbenchError
from workbench.fmi.description import ModelDescription
from workbench.fmi.platforms import binary_path
from workbench.health.check.job import UNLOADED, CheckJob, CheckReply, adapted
from workbench.health.check.processes import processes
from workbench.health.check.registry import CHECKS, FILE, PROCESSES, VALIDATION, choose
from workbench.health.check.request import Check
from workbench.health.check.result import AND, Answer, HealthCard, HealthLine
from workbench.health.check.subject import CheckedFmu
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost, Reply, perform
from workbench.jobs.runner_choice import at_work
from workbench.model.content_hash import content_hash
from workbench.model.load import FmuModel, load_fmu
from workbench.model.loading import Loading
from workbench.system.description import FmuComponent, SystemDescription
from workbench.system.files.read import is_system_file, read_system

__all__ = ["run", "validation"]

_V = TypeVar("_V")

_HANG = "such points are lost after `timeout`; simulate also shows chattering or a solver in trouble"
_SLOW = "not checked, so that the card is not passed: give it longer (`timeout`), or leave {name} out (`skip`)"
_UNKNOWN = Answer("not applicable", "another check lost the process that it ran in", finished=False)
_LOST = "an input, output, state or start value may be lost, and no check sees it: mend modelDescription.xml"
_CRASH = "it ends its process: keep the worker processes (never `in_process`); such points are lost"


@dataclass(frozen=True, kw_only=True)
class _CheckedInterface:
    """One FMU to be checked, and how it is loaded."""

    path: str  # that was named
    component: str  # in the card
    file: str
    loading: Loading
    called: str = ""  # see `FmuComponent`


def run(path: str | Path | Sequence[str | Path], request: Check, job: Job) -> HealthCard:
    """Check an FMU, or the FMUs of a system, or several of them; see `Check`."""
    names = choose(request.only, request.skip)
    given = Loading(**{d.name: getattr(request, d.name) for d in options_of(Loading)})
    paths = [str(path)] if isinstance(path, str | Path) else [str(one) for one in path]
    if not paths:
        raise InputError("check takes at least one model")
    unread: dict[str, InputError | FmuError] = {}
    systems: dict[str, SystemDescription] = {}  # an .ssp stays unpacked as long as its description lives
    parts = [part for one in paths for part in _readable(one, given, systems, unread)]
    if len(paths) > 1:
        parts = [replace(part, component=f"{part.path} {part.component}".rstrip()) for part in parts]
    cards: list[HealthCard] = []
    for number, part in enumerate(parts, 1):
        job.stage(number, len(parts))
        joined = partial(_joined, paths, tuple(cards))
        try:
            if part.path in unread:
                raise unread[part.path]
            cards.append(_card(part, names, request.place, job, joined))
        except (InputError, FmuError) as error:
            if len(paths) == 1:
                raise
            unread[part.path] = error
            cards.append(_unread(part, error))
    card = _joined(paths, tuple(cards[:-1]), cards[-1])
    if unread:
        job.partial = lambda: card  # the others have their verdicts
        raise InputError("; ".join(map(str, unread.values())), [Mistake(str(e), path) for path, e in unread.items()])
    return card


def _readable(
    path: str, given: Loading, systems: dict[str, SystemDescription], unread: dict[str, InputError | FmuError]
) -> list[_CheckedInterface]:
    """Return the parts of a model; of a system that cannot be read the one that stands in `unread`."""
    try:
        if is_system_file(path):
            systems[path] = read_system(path)
        return _parts(path, systems.get(path), given)
    except (InputError, FmuError) as error:
        unread[path] = error
        return _parts(path, None, given)


def _parts(path: str, system: SystemDescription | None, given: Loading) -> list[_CheckedInterface]:
    """Return each FMU of a system; the interface that the system names, unless the user names one. Or the one FMU."""
    if system is None:
        return [_CheckedInterface(path=path, component="", file=path, loading=given)]
    result = [c for c in system.components if isinstance(c, FmuComponent)]
    if not result:
        raise InputError(f"{path}: the system contains no FMU to check")
    return [
        _CheckedInterface(
            path=path,
            component=c.name,
            file=c.file,
            called=c.called,
            loading=replace(
                given,
                interface=c.interface if given.interface == "auto" else given.interface,
                solver=c.solver if given.solver == "auto" else given.solver,
                step=given.step or c.step,
                start_values={**c.set, **_own(c.name, given.start_values)},
                bias=_own(c.name, given.bias),
            ),
        )
        for c in result
    ]


def _own(component: str, values: Mapping[str, _V]) -> dict[str, _V]:
    head = f"{component}."
    return {name.removeprefix(head): value for name, value in values.items() if name.startswith(head)}


# -- one FMU ------------------------------------------------------------------------------------


def _card(
    part: _CheckedInterface,
    names: tuple[str, ...],
    where: Workers,
    job: Job,
    joined: Callable[[HealthCard], HealthCard],
) -> HealthCard:
    with load_fmu(part.file, part.loading, part.called) as model:
        interfaces = _interfaces(model, part.loading.interface)
        wanted = {i: tuple(n for n in names if i in CHECKS[n].interfaces) for i in interfaces}
        lines = [_validated(model)] if VALIDATION in names else []
        total = len(lines) + sum(map(len, wanted.values()))
        about = model.description
        order = {(FILE, VALIDATION): 0} | {(i, n): k for k, (i, n) in enumerate(_pairs(wanted), 1)}

        def card() -> HealthCard:
            return HealthCard(
                model=about.model_name,
                source=part.called or part.file,
                sha256=content_hash(model.recipe.path),
                fmi_version=about.fmi_version,
                generation_tool=about.generation_tool or "unknown tool",
                interfaces=tuple(interfaces),
                checks=tuple(
                    replace(line, component=part.component)
                    for line in sorted(lines, key=lambda c: order[c.interface, c.name])
                ),
                notes=_notes(about, interfaces),
            )

        for line in _run(model, wanted, where, job):
            lines[:] = [one for one in lines if (one.interface, one.name) != (line.interface, line.name)]
            lines.append(line)  # what comes after the last check may tell more of it
            job.partial = lambda: joined(card())
            job.done(f"{part.component} {line.interface} {line.name}".strip(), len(lines), total)
        return card()


def _unread(part: _CheckedInterface, error: WorkbenchError) -> HealthCard:
    """Return the card of one of several models that cannot be read."""
    line = Answer("broken", str(error), "nothing of it was checked", finished=False)
    return HealthCard(
        model=Path(part.path).name,
        source=part.path,
        sha256="",
        fmi_version="",
        generation_tool="",
        interfaces=(),
        checks=(replace(_line(FILE, CheckReply(VALIDATION, line, 0.0)), component=part.component),),
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


def _notes(about: ModelDescription, interfaces: list[str]) -> tuple[str, ...]:
    missing = [i for i in about.interfaces if i not in interfaces]
    return tuple(f"interface {i} is available but was not checked" for i in missing)


def _validated(model: FmuModel) -> HealthLine:
    begin = time.monotonic()
    finding = validation(model.description)
    return _line(FILE, CheckReply(VALIDATION, finding, time.monotonic() - begin))


def _line(interface: str, done: CheckReply) -> HealthLine:
    return HealthLine(interface=interface, name=done.name, seconds=round(done.seconds, 3), **vars(done.finding))


def _run(model: FmuModel, wanted: Mapping[str, tuple[str, ...]], where: Workers, job: Job) -> Iterator[HealthLine]:
    """Yield the lines as they are finished; what a crash cuts off goes on in a new worker."""
    open_names = {i: [n for n in names if n != PROCESSES] for i, names in wanted.items()}
    jobs = deque(CheckJob(interface=i, names=tuple(names)) for i, names in open_names.items() if names)
    subjects, unknown = {i: CheckedFmu(model) for i in wanted}, dict[str, Answer]()
    with at_work(model, where, job) as runner:
        try:
            for event in runner.run(perform, jobs):
                of = event.job
                if isinstance(event, Reply) and isinstance(event.value, CheckReply):
                    open_names[of.interface].remove(event.value.name)
                    subjects[of.interface] = adapted(subjects[of.interface], event.value)
                    if event.value.finding == UNLOADED:
                        unknown[of.interface] = UNLOADED
                    yield _line(of.interface, event.value)
                elif isinstance(event, Lost):
                    unknown[of.interface] = _UNKNOWN
                    yield from _lost(event, open_names[of.interface], jobs)
        except WorkbenchError as error:
            for interface, names in open_names.items():
                yield from (
                    _line(interface, CheckReply(n, Answer("broken", str(error), _CRASH, finished=False), 0.0))
                    for n in names
                )
    for interface, subject in subjects.items():
        if PROCESSES in wanted[interface]:
            begin = time.monotonic()
            answer = unknown.get(interface) or processes(subject, interface, where, job)
            yield _line(interface, CheckReply(PROCESSES, answer, time.monotonic() - begin))


def _lost(event: Lost, names: list[str], jobs: deque[CheckJob]) -> Iterator[HealthLine]:
    """Yield the line of the check in which a worker was lost; queue the others."""
    job: CheckJob = event.job
    if not names:  # all checks were done: its library ends the process, or keeps it for ever, as it is unloaded
        late = Answer("broken", f"after its last check: {event.reason}", _CRASH, finished=False)
        yield _line(job.interface, CheckReply(job.names[-1], late, 0.0))
        return
    lost = names.pop(0)
    yield _line(job.interface, CheckReply(lost, _loss(lost, event), 0.0))
    again = job.after_loss(lost)
    if again is None:
        return
    if not again.hopeless:
        jobs.append(again)
        return
    reason = f"stopped after {again.crashes} crashes or hangs"
    while names:
        yield _line(job.interface, CheckReply(names.pop(0), Answer("not applicable", reason, finished=False), 0.0))


def _loss(name: str, lost: Lost) -> Answer:
    """Return what is said of a check in which the worker was lost; one that takes too long after `runs` may be slow."""
    if not isinstance(lost.error, TimedOutError):
        return Answer("broken", lost.reason, _CRASH, finished=False)
    if name == "runs":
        return Answer("broken", lost.reason, _HANG, finished=False)
    return Answer("watch", lost.reason, _SLOW.format(name=name), finished=False)


# -- all of them --------------------------------------------------------------------------------


def _joined(paths: Sequence[str], before: tuple[HealthCard, ...], last: HealthCard) -> HealthCard:
    """Return one card of one or several FMUs."""
    cards = [*before, last]
    if len(cards) == 1 and not any(line.component for line in cards[0].checks):
        return cards[0]
    return HealthCard(
        model=AND.join(Path(path).name for path in paths),
        source=AND.join(paths),
        sha256=AND.join(dict.fromkeys(c.sha256 for c in cards if c.sha256)),
        fmi_version=AND.join(dict.fromkeys(c.fmi_version for c in cards if c.fmi_version)),
        generation_tool=AND.join(dict.fromkeys(c.generation_tool for c in cards if c.generation_tool)),
        interfaces=tuple(dict.fromkeys(i for c in cards for i in c.interfaces)),
        checks=tuple(line for c in cards for line in c.checks),
        notes=tuple(dict.fromkeys(n for c in cards for n in c.notes)),
    )


# -- the description ---------------------------------------------------------------------------


def validation(description: ModelDescription) -> Answer:
    """Compare modelDescription.xml with the standard: schema, names, start values, causalities, units, model structure.

    Watch: rules are bent; the workbench reads the file nevertheless, and `consequence` says what it made of it. Broken:
    the file does not tell what a variable is (causality, variability, type, value reference, derivative, start value
    and the like), or has none. A file that cannot be read at all never gets a card: the command ends with the reason.

    Args:
        description: as the workbench read it, leniently.
    """
    problems = [*description.problems]
    if description.lost or not description.variables:
        first = description.lost[0] if description.lost else "it declares no variables"
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        return Answer("broken", first + more, _LOST, {"problems": (problems or [first])[:100]})
    if not problems:
        text = f"FMI {description.fmi_version}: {len(description.variables)} variables, no rule violated"
        return Answer("good", text, numbers={"problems": []})
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    notes = [n for n in description.notes if problems[0] not in n]  # it is the evidence already
    read = "; ".join(notes) or "it is read nevertheless; no variable is lost"
    return Answer("watch", problems[0] + more, read, {"problems": problems[:100]})
