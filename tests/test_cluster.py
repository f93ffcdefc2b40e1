"""A Dask cluster: isolated workers, batches, proof of the same state, and what is lost when parts of it die."""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from tests.misbehaving_fmus import build_misbehaving
from tests.platforms import needs, posix_signals
from tests.programs import ended
from tests.worker_tasks import obey
from workbench.cli.app import run
from workbench.jobs import cluster as at_client
from workbench.jobs.cluster import Cluster, OnCluster
from workbench.jobs.in_cluster import do_batch, proof
from workbench.jobs.local_cluster import LocalCluster, started
from workbench.jobs.options import Limits, Workers
from workbench.jobs.pool import Pool
from workbench.jobs.runner import InProcess, Lost, Reply, Runner
from workbench.jobs.runner_choice import choose
from workbench.jobs.version import Stamp, stamp
from workbench.model import Model
from workbench.model.load import FmuRecipe

pytestmark = [
    needs("distributed", "cluster"),
    posix_signals,
    pytest.mark.filterwarnings("default"),
]

STUDY = """
models.lag = "fmu:FirstOrderLag"
grid = {"lag.tau" = [0.5, 1.0, 2.0]}
[analyses.rest]
command = "trim"
model = "lag"
u0 = {u = 2.0}
[[requirements]]
name = "gain"
analysis = "rest"
kind = "value"
path = "y.y"
equal = 2.0
tolerance = 1e-9
"""

SAY = [("say", k, k + 1) for k in range(40)]


@pytest.fixture(scope="module")
def model() -> Iterator[wb.DescribedModel]:
    with wb.load("fmu:FirstOrderLag") as loaded:
        yield loaded


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    with Cluster("local:2") as connected:
        yield connected


def values(runner: Runner, *jobs: tuple[Any, ...]) -> dict[tuple[Any, ...], list[Any]]:
    found: dict[tuple[Any, ...], list[Any]] = {job: [] for job in jobs}
    with runner:
        for event in runner.run(obey, deque(jobs)):
            found[event.job].append(event.value if isinstance(event, Reply) else event.reason)
    return found


def on(cluster: Cluster, model: wb.DescribedModel, limits: Limits | None = None) -> OnCluster:
    return OnCluster(cluster, model.recipe, limits=limits or Limits())


# -- the same as on one machine ----------------------------------------------------------------


def test_what_misbehaves_costs_its_own_job_and_says_the_same_as_on_one_machine(
    model: wb.DescribedModel, cluster: Cluster
) -> None:
    limits = Limits(timeout=2.0)
    bad = [("segfault",), ("exit", 3), ("endless_in_c",)]
    jobs = [*SAY[:5], *bad, *SAY[5:]]
    there = values(on(cluster, model, limits), *jobs)
    with Pool(model.recipe, jobs=2, limits=limits) as pool:
        here = values(pool, *jobs)
    assert there == here
    assert "segmentation fault" in there["segfault",][0]


def test_an_error_of_a_job_is_raised_and_the_cluster_goes_on(model: wb.DescribedModel, cluster: Cluster) -> None:
    with pytest.raises(wb.SimulationError, match="fmi2DoStep"):
        values(on(cluster, model), ("fail",), *SAY)
    assert values(on(cluster, model), *SAY) == {job: list(job[1:]) for job in SAY}


def test_stop_ends_soon_and_frees_the_workers(model: wb.DescribedModel, cluster: Cluster) -> None:
    with on(cluster, model) as runner:
        events = runner.run(obey, deque([("say", 1), ("sleep", 90.0), ("sleep", 90.5)]))
        next(events)
        runner.stop()
        with pytest.raises(KeyboardInterrupt):
            next(events)
    begin = time.monotonic()
    assert values(on(cluster, model), ("say", 2)) == {("say", 2): [2]}
    assert time.monotonic() < begin + 60.0  # not behind the sleep


def silence(dask_scheduler: Any) -> None:  # noqa: ANN401 - distributed is untyped
    """Let no worker be told any more that nobody waits for a task of its."""
    for channel in dask_scheduler.stream_comms.values():
        channel.send = partial(_all_but_ends, channel.send)


def _all_but_ends(send: Callable[..., None], *messages: dict[str, Any]) -> None:
    send(*(message for message in messages if message["op"] != "free-keys"))


def test_a_job_ends_that_is_not_told_that_nobody_waits_for_it(model: wb.DescribedModel) -> None:
    with Cluster("local:1") as cluster:
        cluster.client.run_on_scheduler(silence)
        with on(cluster, model) as runner:
            events = runner.run(obey, deque([("say", 1), ("sleep", 90.0)]))
            next(events)
            runner.stop()
            with pytest.raises(KeyboardInterrupt):
                next(events)
        with on(cluster, model) as runner:
            events = runner.run(obey, deque([("say", 2), ("sleep", 0.0)]))
            begin = time.monotonic()
            assert isinstance(next(events), Reply)
            assert time.monotonic() < begin + 60.0  # likewise


def where(model: Model, _job: object) -> Iterator[tuple[int, str]]:
    """Say in which worker of the cluster this runs, and where the FMU lies there."""
    assert isinstance(model.recipe, FmuRecipe)
    yield os.getppid(), model.recipe.folder


def test_an_fmu_goes_to_each_worker_once_whatever_is_varied_of_it(model: wb.DescribedModel, cluster: Cluster) -> None:
    folders: dict[int, set[str]] = {}
    for tau in (1.0, 2.0, 3.0):
        varied = replace(model.recipe, start_values={"tau": tau})
        with OnCluster(cluster, varied, limits=Limits()) as runner:
            for event in runner.run(where, deque(range(20))):
                assert isinstance(event, Reply)
                folders.setdefault(event.value[0], set()).add(event.value[1])
    assert all(len(some) == 1 for some in folders.values())
    assert isinstance(model.recipe, FmuRecipe)
    assert model.recipe.folder not in set().union(*folders.values())


# -- records -----------------------------------------------------------------------------------


def test_records_are_those_of_a_local_run(cluster: Cluster, tmp_path: Path) -> None:
    there, here = Workers(scheduler=cluster), Workers(in_process=True)
    with wb.load("fmu:FirstOrderLag") as lag:
        for ask in (
            lambda w: wb.nfr(lag, "u", "y", [0.1, 1.0], [1.0, 2.0], workers=w),
            lambda w: wb.lin_over(lag, {"tau": [0.5, 1.0, 2.0]}, workers=w),
        ):
            assert ask(there).to_dict() == ask(here).to_dict()
    study = tmp_path / "lag.toml"
    study.write_text(STUDY)
    results = [wb.run_study(study, store=None, scheduler=scheduler).to_dict() for scheduler in (cluster, None)]
    assert results[0]["requirements"] == results[1]["requirements"]
    assert [r["passed"] for r in results[0]["requirements"]] == [True, True, True]


def test_the_command_line_takes_an_address_and_an_analysis_without_parts_refuses_it(
    cluster: Cluster, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = ["lin", "fmu:FirstOrderLag", "--over", "tau=0.5,1,2"]
    for name, more in (("here", []), ("there", ["--scheduler", cluster.address])):
        assert run([*command, *more, "--json", str(tmp_path / name)]) == 0
    assert "note: scheduler tcp://127.0.0.1" in capfd.readouterr().err
    here, there = (json.loads((tmp_path / name).read_text()) for name in ("here", "there"))
    assert {k for k in here if here[k] != there[k]} <= {"asked", "seconds"}
    with wb.load("fmu:FirstOrderLag") as lag, pytest.raises(wb.InputError, match="has no parts"):
        wb.trim(lag, workers=Workers(scheduler=cluster))
    assert run(["trim", "fmu:FirstOrderLag", "--scheduler", cluster.address]) == 2
    assert "--scheduler: this command has no parts that could run on a cluster" in capfd.readouterr().err


def test_what_an_fmu_did_to_a_worker_of_the_cluster_is_in_the_record(cluster: Cluster, tmp_path: Path) -> None:
    with wb.load(build_misbehaving(tmp_path, "_arithmetic", "instantiate"), "me") as bad:
        found = wb.lin_over(bad, over={"u": [0.5, 1.0]}, workers=Workers(scheduler=cluster))
    assert any("the FMU changed the arithmetic of its process" in note for note in found.notes)


# -- who may work ------------------------------------------------------------------------------

OTHER = Stamp("0.0.1", "3", "f" * 64)


def test_a_worker_in_another_state_is_refused_before_it_gets_work(
    model: wb.DescribedModel, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(at_client, "stamp", lambda: OTHER)
    line = rf"{stamp()}; here is {OTHER}; install the same there"
    with pytest.raises(wb.InputError, match=line), Cluster(cluster.address):
        pass
    with pytest.raises(wb.InputError, match=line):  # one that came after the connection was made
        values(on(cluster, model), *SAY)


def test_a_batch_for_another_state_is_not_even_unpickled() -> None:
    assert do_batch(tuple(OTHER), b"no pickle") == (proof(), b"")
    assert do_batch.__module__.startswith("workbench.jobs")


# -- what dies ---------------------------------------------------------------------------------


def test_killed_workers_of_the_cluster_cost_nothing(model: wb.DescribedModel, cluster: Cluster) -> None:
    jobs = [("sleep", 0.1 + 0.001 * k) for k in range(20)]
    found: dict[tuple[Any, ...], list[Any]] = {job: [] for job in jobs}
    with on(cluster, model) as runner:
        victims = cluster.client.run(os.getpid)
        for event in runner.run(obey, deque(jobs)):
            found[event.job].append(event.value if isinstance(event, Reply) else event.reason)
            if victims:
                os.kill(victims.popitem()[1], signal.SIGKILL)
    assert found == {job: [job[1]] for job in jobs}


def test_the_scheduler_s_end_leaves_what_was_finished_and_one_line() -> None:
    with LocalCluster(1) as local, Cluster(local.address) as doomed, wb.load("fmu:FirstOrderLag") as lag:
        sweep = wb.NfrSweep(lag, "u", "y", [0.1, 0.2, 0.5, 1.0], [1.0, 2.0], workers=Workers(scheduler=doomed))
        points = sweep.run()
        next(points)
        os.kill(local.pid, signal.SIGKILL)
        with pytest.raises(wb.LostError, match=f"scheduler {local.address}: the connection was lost"):
            deque(points, 0)
        assert 1 <= sweep.done < sweep.total
        assert len(sweep.result().failed) == sweep.total - sweep.done


@pytest.fixture(params=[b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def somebody_else(request: pytest.FixtureRequest) -> Iterator[str]:
    """Address of a program that is no scheduler: it says nothing, or something else."""
    heard = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    heard.append(listener.accept()[0])
                    heard[-1].sendall(request.param)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        listener.shutdown(socket.SHUT_RDWR)
    thread.join()
    for connection in heard:
        connection.close()


SWEEP = ["nfr", "fmu:Rudder", "--input", "delC", "--output", "del", "--freq", "1", "--amplitude", "1"]


def refused(address: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what is said of an address, in Python and, with its options as flags, on the command line."""
    with pytest.raises(wb.InputError) as caught, Cluster(address):
        pass
    assert run([*SWEEP, "--scheduler", address]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("note: ")]
    assert lines == [f"workbench: {caught.value}".replace("`tls`", "--scheduler-tls")]
    return str(caught.value)


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("tcp://127.0.0.1:9", "cannot be reached: nobody listens at port 9 of 127.0.0.1"),
        ("tcp://nosuch.invalid:8786", "cannot be reached: there is no host 'nosuch.invalid'"),
        ("nonsense://x", "is not an address; give tcp://host:8786"),
        ("some words", "is not an address"),
        ("tcp://127.0.0.1", "is not an address"),
        ("local:x", "is not an address"),
        ("local:0", "at least 1 worker"),
        ("tls://127.0.0.1:9", "needs certificates"),
    ],
)
def test_a_cluster_that_is_not_there_is_one_line(address: str, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert why in refused(address, capsys)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "no such file; dask scheduler --scheduler-file"),
        ("{", "is not a scheduler file: it must be JSON with an entry address"),
        ("[1]", "is not a scheduler file"),
        ('{"type": "Scheduler"}', "is not a scheduler file"),
        ('{"address": 5}', "is not an address '5'"),
        ('{"address": "tcp://127.0.0.1:9"}', "nobody listens at port 9"),
    ],
)
def test_a_scheduler_file_that_leads_nowhere_is_one_line(
    content: str | None, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "scheduler.json"
    if content is not None:
        file.write_text(content)
    assert why in refused(str(file), capsys)


def test_who_listens_but_is_no_scheduler_is_told(
    somebody_else: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(at_client, "_CONNECT", 0.5)
    said = refused(somebody_else, capsys)
    assert "it does not answer" in said or "something else than a Dask scheduler listens there" in said


def test_a_cluster_checks_what_it_is_given() -> None:
    for patience in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(wb.InputError, match="is not a positive finite number"):
            Cluster("local:1", patience=patience)
    for place in (lambda: Workers(scheduler="tls://x", tls=("ca.pem",)), lambda: Cluster("tls://x", tls=("ca.pem",))):
        with pytest.raises(wb.InputError, match="three files"):
            place()


def test_a_place_where_no_cluster_can_begin_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(wb.InputError, match=f"cannot listen at 127.0.0.1:{port}: Address already in use; give"):  # noqa: SIM117
            with started(1, port=port):
                pass
    for tls, why in ((["ca.pem"], "three files"), (["ca.pem", "own.pem", "own.key"], "ca.pem: no such file")):
        with pytest.raises(wb.InputError, match=why), started(1, tls=tls):
            pass


@posix_signals
def test_a_cluster_that_does_not_end_by_itself_is_ended_soon_with_its_workers() -> None:
    """Ctrl-C ends a command within two seconds, also while its own cluster is busy or stopped."""
    psutil = import_module("psutil")  # distributed brings it
    cluster = LocalCluster(1)
    main = psutil.Process(cluster.pid)
    those = [main, *main.children(recursive=True)]
    assert len(those) > 1
    os.killpg(cluster.pid, signal.SIGSTOP)
    cluster.close()
    cluster.close()
    assert all(ended(p.pid) for p in those)


# -- batches -----------------------------------------------------------------------------------


def test_batches_are_worth_a_second_and_shrink_towards_the_end(model: wb.DescribedModel, cluster: Cluster) -> None:
    with on(cluster, model) as runner:
        runner._slots = 100
        assert runner._size(100_000) == 1  # nothing is known yet
        runner._times.append((10, 0.1))
        assert runner._size(100_000) == 100
        assert runner._size(10_000) == 50
        assert runner._size(2000) == 25  # no less: a task costs something, too
        assert runner._size(3) == 3
        runner._times.append((1, 60.0))
        assert runner._size(100_000) == 1


def test_the_table_of_places(model: wb.DescribedModel, cluster: Cluster) -> None:
    with choose(model, Workers(scheduler=cluster, timeout=7.0))[0] as runner:
        assert isinstance(runner, OnCluster)
    with pytest.raises(wb.InputError, match="leave jobs out"):
        Workers(scheduler=cluster, jobs=2)
    with ThreadPoolExecutor(1) as threads, pytest.raises(wb.InputError, match="choose one place"):
        Workers(scheduler=cluster, executor=threads)
    assert isinstance(choose(model, Workers(in_process=True))[0], InProcess)
    assert not issubclass(Lost, Reply)


@pytest.mark.skipif(sys.platform != "linux", reason="finds named semaphores in /dev/shm and /proc, which Linux has")
def test_a_cluster_that_does_not_end_leaves_no_semaphores() -> None:
    """Its processes have some with names, which stay in the system when all are killed at once."""

    def named() -> set[int]:
        return {path.stat().st_ino for path in Path("/dev/shm").glob("sem.mp-*")}  # noqa: S108 - as above

    with LocalCluster(1) as cluster:
        maps = Path(f"/proc/{cluster.pid}/maps").read_text().splitlines()
        own = {int(line.split()[4]) for line in maps if "/dev/shm/sem." in line} & named()  # noqa: S108 - as above
        assert own
        os.kill(cluster.pid, signal.SIGSTOP)
    assert not own & named()
