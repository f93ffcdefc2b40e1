"""The public function: measure the source report's figures now."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from workbench.errors import InputError
from workbench.reproduce.registry import experiments
from workbench.reproduce.result import Outcome, ReproduceResult
from workbench.reproduce.select import select
from workbench.reproduce.targets import Target
from workbench.reproduce.work import Found, Job, perform
from workbench.study.worker import NoRecipe
from workbench.workers import InProcess, Lost, Runner, Workers
from workbench.workers.choose import cores
from workbench.workers.pool import Pool

__all__ = ["reproduce"]

_LONGEST = 600.0  # [s], of one experiment: a hundred times what it takes

Progress = Callable[[int, int, str], None]


def reproduce(
    selection: Sequence[str] = (),
    *,
    drawings: bool = False,
    folder: str | Path | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> ReproduceResult:
    """Measure figures and tables of the source report from the bundled FMUs, and hold them against their targets.

    Targets and tolerances stand in `targets.toml` beside this module. An experiment that fails is a miss of its
    targets, with its reason; the others go on. A target that the source report itself makes impossible says why.
    Ctrl-C ends it; what was measured until then is in the result.

    Args:
        selection: chapters ("3", "8.3"), figures ("fig31", "figure 48"), targets ("cycle-rate") or how their names
            begin ("rudder"); empty: all.
        drawings: make the pictures, for a page.
        folder: write the pictures into it, as png; None: no files.
        workers: how many experiments at a time, each in a process of its own; None: one per core.
        progress: called after each experiment with the number done, the number in all, and its name.

    Raises:
        InputError: a word that is no chapter, figure or target; a folder that is none; an executor or a cluster.
    """
    begin = time.monotonic()
    chosen = select(selection)
    into = _checked(folder)
    where = workers or Workers(timeout=_LONGEST)
    jobs = _jobs(chosen, everything=not selection, svg=drawings, folder=into)
    found = _run(jobs, where, progress)
    interrupted = len(found) < len(jobs)
    for job in jobs:
        found.setdefault(job.experiment, Found(problem="interrupted before it was measured"))
    measuring = {name: job for job in jobs for name in job.targets}
    return ReproduceResult(
        outcomes=tuple(_outcome(t, measuring[t.name], found[measuring[t.name].experiment]) for t in chosen),
        drawings=tuple(d for job in jobs for d in found[job.experiment].drawings),
        seconds=time.monotonic() - begin,
        processor_seconds={job.experiment: found[job.experiment].processor_seconds for job in jobs},
        jobs=_processes(where),
        interrupted=interrupted,
        selection=tuple(selection),
    )


def _checked(folder: str | Path | None) -> Path | None:
    if folder is None:
        return None
    path = Path(folder).resolve()
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: pictures cannot be written there: {error.strerror or error}") from None
    return path


def _jobs(chosen: Sequence[Target], *, everything: bool, svg: bool, folder: Path | None) -> list[Job]:
    """Return what to run, in the order of the source report."""
    by_name = {t.name: t for t in chosen}
    figures = None if everything else frozenset(n for t in chosen for n in t.figures)
    found = []
    for experiment in experiments().values():
        wanted = tuple(name for name in experiment.targets if name in by_name)
        if wanted:
            chapter = by_name[wanted[0]].chapter
            job = Job(
                experiment=experiment.name, targets=wanted, figures=figures, chapter=chapter, svg=svg, folder=folder
            )
            found.append(job)
    return found


def _run(jobs: Sequence[Job], workers: Workers, progress: Progress | None) -> dict[str, Found]:
    """Run the jobs, the longest first, so that no long one is left for one process alone at the end.

    What was found before Ctrl-C is kept.
    """
    known = experiments()
    queue = deque(sorted(jobs, key=lambda job: -known[job.experiment].seconds))
    found: dict[str, Found] = {}
    with _runner(workers) as runner, suppress(KeyboardInterrupt):
        for reply in runner.run(perform, queue):
            name = reply.job.experiment
            found[name] = Found(problem=reply.reason) if isinstance(reply, Lost) else reply.value
            if progress is not None:
                progress(len(found), len(jobs), name)
    return found


def _runner(workers: Workers) -> Runner:
    if workers.executor is not None or workers.scheduler is not None:
        raise InputError("the figures are measured on this machine: no executor and no cluster")
    if workers.in_process:
        return InProcess(NoRecipe().open())
    return Pool(NoRecipe(), jobs=_processes(workers), limits=workers.limits)


def _processes(workers: Workers) -> int:
    return 1 if workers.in_process else workers.jobs or cores()


def _outcome(target: Target, job: Job, found: Found) -> Outcome:
    measured, problem = found.values.get(target.name), found.problem
    if measured is None:
        problem = problem or f"experiment '{job.experiment}' did not measure it"
    else:
        try:
            target.accepts(measured)
        except InputError as error:  # not as many numbers as the target has
            measured, problem = None, str(error)
    return Outcome(target, job.experiment, measured, found.remarks.get(target.name, ""), problem)
