"""The source report's figures, measured now: what is done."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from scripts.reproduce.registry import experiments
from scripts.reproduce.request import Reproduce, ReproduceCommand
from scripts.reproduce.result import ReproduceResult, TargetList, TargetResult
from scripts.reproduce.select import select
from scripts.reproduce.targets import PublishedTarget
from scripts.reproduce.work import ExperimentJob, Found, perform
from workbench.errors import InputError
from workbench.jobs.job import Job as RequestJob
from workbench.jobs.limits import cores
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost, Runner
from workbench.jobs.runner_choice import runner_for

__all__ = ["run", "run_command"]

_INTERRUPTED = Found(problem="interrupted before it was measured")


def run_command(selection: Sequence[str], asked: ReproduceCommand, job: RequestJob) -> ReproduceResult | TargetList:
    """Measure, or list what would be measured; see `ReproduceCommand`."""
    if not asked.only_list:
        return run(selection, asked, job)
    if asked.folder is not None:
        raise InputError("--list measures nothing; leave --pictures out")
    return TargetList(select(selection))


def run(selection: Sequence[str], asked: Reproduce, job: RequestJob) -> ReproduceResult:
    """Measure figures and tables of the source report; see `Reproduce`."""
    begin = time.monotonic()
    chosen = select(selection)
    into, where = _checked(asked.folder), asked.place
    experiments_asked = _jobs(chosen, everything=not selection, svg=asked.drawings, folder=into)
    measuring = {name: one for one in experiments_asked for name in one.targets}
    found: dict[str, Found] = {}
    processes = _processes(where)

    def result() -> ReproduceResult:
        done = {one.experiment: found.get(one.experiment, _INTERRUPTED) for one in experiments_asked}
        return ReproduceResult(
            outcomes=tuple(_outcome(t, measuring[t.name], done[measuring[t.name].experiment]) for t in chosen),
            drawings=tuple(drawing for one in done.values() for drawing in one.drawings),
            seconds=time.monotonic() - begin,
            processor_seconds={name: one.processor_seconds for name, one in done.items()},
            jobs=processes,
            interrupted=len(found) < len(done),
            selection=tuple(selection),
        )

    # The longest first, so that no long one is left for one process alone at the end.
    queue = deque(sorted(experiments_asked, key=lambda one: -experiments()[one.experiment].seconds))
    with _runner(where, into) as runner, job.ended_by(runner.end_soon):
        for reply in runner.run(perform, queue):
            name = reply.job.experiment
            found[name] = Found(problem=reply.reason) if isinstance(reply, Lost) else reply.value
            job.partial = result
            job.done(name, len(found), len(experiments_asked))
    return result()


def _checked(folder: str | Path | None) -> Path | None:
    if folder is None:
        return None
    path = Path(folder).resolve()
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: pictures cannot be written there: {error.strerror or error}") from None
    return path


def _jobs(
    chosen: Sequence[PublishedTarget], *, everything: bool, svg: bool, folder: Path | None
) -> list[ExperimentJob]:
    """Return what to run, in the order of the source report."""
    by_name = {t.name: t for t in chosen}
    figures = None if everything else frozenset(n for t in chosen for n in t.figures)
    found = []
    for experiment in experiments().values():
        wanted = tuple(name for name in experiment.targets if name in by_name)
        if wanted:
            chapter = by_name[wanted[0]].chapter
            job = ExperimentJob(
                experiment=experiment.name, targets=wanted, figures=figures, chapter=chapter, svg=svg, folder=folder
            )
            found.append(job)
    return found


def _runner(workers: Workers, folder: Path | None) -> Runner:
    if workers.executor is not None:
        raise InputError("the figures are measured in worker processes or on a cluster: no executor")
    if workers.scheduler is not None and folder is not None:
        raise InputError("pictures are written where they are measured: leave --pictures out with a scheduler")
    return runner_for(workers)


def _processes(workers: Workers) -> int:
    if workers.scheduler is not None:
        from workbench.jobs.cluster import Cluster  # noqa: PLC0415 - seldom needed

        return Cluster.at(workers).size
    return 1 if workers.in_process else workers.jobs or cores()


def _outcome(target: PublishedTarget, job: ExperimentJob, found: Found) -> TargetResult:
    measured, problem = found.values.get(target.name), found.problem
    if measured is None:
        problem = problem or f"experiment '{job.experiment}' did not measure it"
    else:
        try:
            target.accepts(measured)
        except InputError as error:  # not as many numbers as the target has
            measured, problem = None, str(error)
    return TargetResult(target, job.experiment, measured, found.remarks.get(target.name, ""), problem)
