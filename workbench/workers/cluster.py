"""An existing Dask cluster as the place where tasks run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from workbench.errors import InputError, one_line
from workbench.model.recipe import Recipe
from workbench.workers.child import Task
from workbench.workers.executor import OnExecutor
from workbench.workers.runner import Lost, Reply, Runner

__all__ = ["OnCluster"]

_CONNECT = "10s"


class OnCluster(Runner):
    """Runs tasks on the workers of a Dask scheduler, which need the workbench installed, not the FMU.

    The FMU's files are sent to the workers once. A worker that dies is the cluster's affair: it tries
    the task on another one and gives it up after some deaths (`distributed.scheduler.allowed-failures`).

    Args:
        address: of the scheduler, e.g. tcp://host:8786.
        recipe: of the model.

    Raises:
        InputError: `distributed` is not installed, no scheduler answers there, or its workers lack the workbench.
    """

    def __init__(self, address: str, recipe: Recipe) -> None:
        self._client = _connect(address)
        try:
            # One future for all tasks; the executor's workers get the recipe itself.
            shared = self._client.scatter(recipe.packed(), broadcast=True)
        except Exception as error:  # noqa: BLE001 - it passes on whatever its workers raise
            self._client.close()
            text = one_line(f"{type(error).__name__}: {error}")
            raise InputError(
                f"scheduler {address}: its workers cannot load the model ({text}); install the same workbench there"
            ) from None
        self._runner: Runner = OnExecutor(self._client.get_executor(pure=False), shared)

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        return self._runner.run(task, jobs)

    def stop(self) -> None:
        self._runner.stop()

    def close(self) -> None:
        self._runner.close()
        self._client.close()


def _connect(address: str) -> Any:  # noqa: ANN401 - distributed is untyped
    try:
        distributed = import_module("distributed")  # optional, slow to import, untyped
    except ImportError:
        raise InputError('a cluster needs distributed: pip install "fmi-workbench[cluster]"') from None
    try:
        client = distributed.Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"scheduler {address}: cannot be reached: {one_line(str(error))}") from None
    if not client.scheduler_info()["workers"]:
        client.close()
        raise InputError(f"scheduler {address}: has no workers; start some with: dask worker {address}")
    return client
