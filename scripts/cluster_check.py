"""What a cluster is worth, measured on this machine: the same records, its cost, a hundred workers, and what dies.

Example: python scripts/cluster_check.py same cost hundred chaos
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import workbench as wb
from workbench.errors import WorkbenchError, suggest
from workbench.jobs import in_cluster
from workbench.jobs.cluster import Cluster, OnCluster
from workbench.jobs.local_cluster import LocalCluster, distributed
from workbench.jobs.options import Limits
from workbench.jobs.runner import InProcess, Lost, Reply

ROOT = Path(__file__).resolve().parents[1]
psutil: Any = import_module("psutil")  # distributed brings it; untyped

POINTS = 100  # frequencies and amplitudes: 10,000 points
SLEEP = 0.1  # [s]
_PLACE = ("seconds", "wall_seconds", "experiments", "words", "store", "jobs")
CRASHING = "import ctypes; ctypes.string_at(0)"


# -- the same records --------------------------------------------------------------------------


def same() -> None:
    """Run every analysis that has parts here and on a cluster, and compare the records."""
    with ExitStack() as stack:
        cluster = stack.enter_context(Cluster("local:2"))
        rudder, aircraft = (stack.enter_context(wb.load(name)) for name in ("fmu:Rudder", "system:failed_aileron"))
        here, there = wb.Workers(in_process=True), wb.Workers(scheduler=cluster)
        rudder_loop = stack.enter_context(wb.load("system:rudder_loop"))
        feedback: dict[str, Any] = {
            "source": "aircraft.outer_aileron_position",
            "target": "aircraft.inner_aileron",
            "count": 3,
        }
        asked: dict[str, Callable[[wb.Workers], Any]] = {
            "nfr": lambda w: wb.nfr(rudder, "delC", "del", band=(0.5, 20.0), amplitudes=[1.0, 4.0], workers=w),
            "nfr, carried": lambda w: wb.nfr(rudder, "delC", "del", [4.0, 2.0], [1.0, 4.0], carry=True, workers=w),
            "loop": lambda w: wb.loop(rudder_loop, "gain.y", amplitudes=[0.5], frequencies=[1.0, 2.0], workers=w),
            "lin_over": lambda w: wb.lin_over(rudder, {"mH": [0.0, 50.0, 100.0]}, inputs=["delC"], workers=w),
            "modes": lambda w: wb.modes(rudder, vary="mH", values=[1.0, 50.0, 100.0], workers=w),
            "modes, trimmed": lambda w: wb.modes(
                aircraft, vary="aircraft.airspeed", values=[200.0, 210.0], trimmed=True, workers=w
            ),
            "limit_cycle": lambda w: wb.limit_cycle(
                aircraft, block="damper", methods=["describing function"], workers=w
            ),
            "feedback": lambda w: wb.feedback(aircraft, settle=True, workers=w, **feedback),
            "excite": lambda w: wb.excite(rudder, "delC", "del", prbs="amplitude=2", dt=0.02, samples=600, workers=w),
        }
        for name, ask in asked.items():
            _told(name, ask(here), ask(there))
        studies = [wb.run_study("study:elevator_law", store=None, scheduler=s) for s in (None, cluster)]
        _told("run", *studies)
        from scripts.reproduce.request import reproduce  # noqa: PLC0415

        _told("reproduce", *(reproduce(["rate-crossings"], workers=w) for w in (wb.Workers(jobs=1), there)))


def _told(name: str, here: Any, there: Any) -> None:
    left, right = (json.dumps(_plain(record.to_dict()), sort_keys=True, default=repr) for record in (here, there))
    print(f"{name:20} {'identical' if left == right else 'DIFFERS'} ({len(left)} characters)", flush=True)


def _plain(found: Any) -> Any:
    """Return a record without what the time of day and the place decide."""
    if isinstance(found, Mapping):
        return {key: _plain(value) for key, value in found.items() if key not in _PLACE}
    return [_plain(value) for value in found] if isinstance(found, list | tuple) else found


# -- its cost ----------------------------------------------------------------------------------


def cost() -> None:
    """Compare the processor time of a sweep in two workers with that of one in two workers of a cluster."""
    grid = np.geomspace(0.5, 30.0, POINTS).tolist(), np.geomspace(0.1, 4.0, POINTS).tolist()
    with wb.load("fmu:Rudder") as rudder:

        def sweep(workers: wb.Workers, some: slice) -> None:
            found = wb.nfr(rudder, "delC", "del", grid[0][some], grid[1][some], workers=workers)
            if found.failed:
                print(f"{len(found.failed)} points failed, first: {found.failed[0]}")

        warm, every = slice(0, POINTS, 20), slice(None)
        alone = wb.Workers(jobs=2)
        sweep(alone, warm)
        before, begin = _spent(os.getpid()), time.monotonic()
        sweep(alone, every)
        local, seconds = _spent(os.getpid()) - before, time.monotonic() - begin
        print(
            f"local    {POINTS**2} points: {local:.1f} s CPU, {1e3 * local / POINTS**2:.3f} ms a point, {seconds:.0f} s"
        )
        with LocalCluster(2) as cluster, Cluster(cluster.address) as connected:
            there = wb.Workers(scheduler=connected)
            sweep(there, warm)
            before, scheduler = _spent(os.getpid()), _own(cluster.pid)
            begin = time.monotonic()
            sweep(there, every)
            spent, own = _spent(os.getpid()) - before, _own(cluster.pid) - scheduler
            seconds = time.monotonic() - begin
        print(
            f"cluster  {POINTS**2} points: {spent:.1f} s CPU, {1e3 * spent / POINTS**2:.3f} ms a point, {seconds:.0f} s"
        )
        print(f"efficiency {local / spent:.3f}; scheduler {1e6 * own / POINTS**2:.0f} µs a point")


def _spent(pid: int) -> float:
    """Return the processor time of a process and all below it, the ended ones included [s]."""
    process = psutil.Process(pid)
    own = process.cpu_times()
    return float(sum(own[:4])) + sum(sum(p.cpu_times()[:4]) for p in process.children(recursive=True))


def _own(pid: int) -> float:
    return float(sum(psutil.Process(pid).cpu_times()[:2]))


# -- a hundred workers -------------------------------------------------------------------------


def hundred(processes: int = 4, threads: int = 25, seconds: float = 40.0) -> None:
    """Let workers that only sleep, threads of a few processes, do what would take all of them some time."""
    workers = processes * threads
    count = round(workers * seconds / SLEEP)
    with (
        distributed().LocalCluster(n_workers=processes, threads_per_worker=threads, dashboard_address=None) as cluster,
        Cluster(cluster.scheduler_address) as connected,
        OnCluster(connected, None, limits=Limits()) as runner,
    ):
        connected.client.run(_without_processes)
        begin, own = time.monotonic(), time.process_time()
        done = sum(isinstance(event, Reply) for event in runner.run(doze, deque([SLEEP] * count)))
        took, own = time.monotonic() - begin, time.process_time() - own
    ideal = done * SLEEP / workers
    print(f"{workers} workers, {done} jobs of {1e3 * SLEEP:g} ms: {took:.1f} s, ideally {ideal:.1f} s")
    print(f"{100.0 * ideal / took:.1f} %; {own:.1f} s CPU for scheduler and client in one process")


def _without_processes() -> None:
    in_cluster._pool = lambda _recipe, _limits: InProcess(None)  # type: ignore[assignment,return-value]  # noqa: SLF001


def doze(_model: None, seconds: float) -> Iterator[float]:
    """Take time and nothing else."""
    time.sleep(seconds)
    yield seconds


# -- what dies ---------------------------------------------------------------------------------


def chaos() -> None:
    """Kill what can be killed, and tell what came of it."""
    with wb.load("fmu:FirstOrderLag") as lag:
        for name, act in _ACTS.items():
            begin = time.monotonic()
            try:
                text = act(lag)
            except WorkbenchError as error:
                text = f"{type(error).__name__}: {error}"
            print(f"{name}: {text} [{time.monotonic() - begin:.0f} s]", flush=True)


def _do(cluster: Cluster, model: Any, jobs: list[Any], task: Any, each: Callable[[int], None]) -> str:
    replies = losses = 0
    why = ""
    try:
        with OnCluster(cluster, model.recipe, limits=Limits(timeout=20.0)) as runner:
            for event in runner.run(task, deque(jobs)):
                replies += isinstance(event, Reply)
                if isinstance(event, Lost):
                    losses, why = losses + 1, f"; lost {event.job!r}: {event.reason}"
                each(replies)
    except WorkbenchError as error:
        why = f"; then {type(error).__name__}: {error}"
    return f"{replies} of {len(jobs)} done, {losses} lost{why}"


def work(_model: Any, job: float | str) -> Iterator[float | str]:
    """Sleep, or run a line of Python."""
    if isinstance(job, str):
        exec(job, {})  # noqa: S102 - the lines of this file
    else:
        time.sleep(job)
    yield job


def _killed_workers(model: Any) -> str:
    with Cluster("local:3") as cluster:
        victims = list(cluster.client.run(os.getpid).values())

        def kill(done: int) -> None:
            if victims and done % 20 == 10:
                os.kill(victims.pop(), signal.SIGKILL)

        return _do(cluster, model, [0.05 + 1e-6 * k for k in range(120)], work, kill)


def _killed_scheduler(model: Any) -> str:
    with LocalCluster(2) as local, Cluster(local.address) as cluster:
        return _do(cluster, model, [0.05 + 1e-6 * k for k in range(120)], work, lambda n: _kill_once(local.pid, n))


def _kill_once(pid: int, done: int) -> None:
    if done == 20:
        os.kill(pid, signal.SIGKILL)


def _crashing(model: Any) -> str:
    with Cluster("local:2") as cluster:
        jobs = [0.01 + 1e-6 * k for k in range(60)]
        return _do(cluster, model, [*jobs[:30], CRASHING, *jobs[30:]], work, lambda _: None)


def _crashing_worker(model: Any) -> str:
    """A job that takes the worker of the cluster itself down."""
    kill = "import os, psutil; psutil.Process(os.getppid()).kill(); import time; time.sleep(20)"
    with Cluster("local:2") as cluster:
        jobs = [0.01 + 1e-6 * k for k in range(60)]
        return _do(cluster, model, [*jobs[:30], kill, *jobs[30:]], work, lambda _: None)


def _other_version(_model: Any) -> str:
    with tempfile.TemporaryDirectory() as folder, LocalCluster(1) as local:
        shutil.copytree(ROOT / "workbench", Path(folder) / "workbench", ignore=shutil.ignore_patterns("__pycache__"))
        package = Path(folder) / "workbench" / "__init__.py"
        package.write_text(package.read_text(encoding="utf-8").replace("__version__ = ", '__version__ = "0.0.9"  # '))
        code = "from distributed.cli.dask_worker import main; main()"
        other = subprocess.Popen(
            [sys.executable, "-c", code, local.address, "--no-dashboard", "--nthreads", "1"],
            env={**os.environ, "PYTHONPATH": folder}, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            for _ in range(600):
                with Cluster(local.address):
                    time.sleep(0.1)
            return "was not refused"
        finally:
            other.terminate()
            other.wait()


_ACTS: Mapping[str, Callable[[Any], str]] = {
    "three workers killed (SIGKILL) during 120 jobs": _killed_workers,
    "scheduler killed (SIGKILL) after 20 of 120 jobs": _killed_scheduler,
    "one of 61 jobs crashes its process": _crashing,
    "one of 61 jobs kills each worker of the cluster that does it": _crashing_worker,
    "a worker of version 0.0.9 joins": _other_version,
}


def main() -> None:
    """Do what is named."""
    every = {f.__name__: f for f in (same, cost, hundred, chaos)}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", metavar="WHAT", help=f"{', '.join(every)}; by default all")
    what = parser.parse_args().what
    for name in what:
        if name not in every:
            parser.error(f"'{name}' is unknown; {suggest(name, every)}")
    for name in what or every:
        every[name]()


if __name__ == "__main__":
    import cluster_check  # type: ignore[import-not-found]  # itself, as a module that workers can import, too

    cluster_check.main()
