"""What advances sessions in tests: the kernel, or the oracle in its place (`tests/oracle`)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import pytest

from tests.oracle.cs import OracleCsSession
from tests.oracle.group import OracleGroupSession
from tests.oracle.master.instance import OracleMasterInstance
from tests.oracle.master.session import OracleMasterSession
from tests.oracle.me import OracleMeSession
from workbench.model import described_model as described
from workbench.session.compiled import CompiledCsSession, CompiledMeSession
from workbench.session.fmu import FmuSession
from workbench.session.setup import Setup
from workbench.system.master import model as master_model
from workbench.system.master.group_unit import CompiledGroupSession
from workbench.system.master.instance import MasterInstance
from workbench.system.master.session import MasterSession

__all__ = ["DRIVERS", "GROUPS", "driven_by", "driver", "each_driver"]

# Driver → interface → session.
DRIVERS: Mapping[str, Mapping[str, Callable[[Setup], FmuSession]]] = {
    "compiled": {"me": CompiledMeSession, "cs": CompiledCsSession},
    "python": {"me": OracleMeSession, "cs": OracleCsSession},
}
MASTERS = {"compiled": (MasterInstance, MasterSession), "python": (OracleMasterInstance, OracleMasterSession)}
GROUPS = {"compiled": CompiledGroupSession, "python": OracleGroupSession}

fakes = "python"  # what advances the fakes of tests/hybrid_fmus.py; `driven_by` sets it, too


@contextmanager
def driven_by(name: str) -> Iterator[None]:
    """Let a driver advance the sessions that are opened inside, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "fakes", name)
        patch.setattr(described, "CompiledMeSession", DRIVERS[name]["me"])
        patch.setattr(described, "CompiledCsSession", DRIVERS[name]["cs"])
        instance, session = MASTERS[name]
        patch.setattr(master_model, "MasterInstance", instance)
        patch.setattr(master_model, "MasterSession", session)
        yield


@pytest.fixture
def driver(request: pytest.FixtureRequest) -> Iterator[str]:
    """The driver of all sessions of the test: `parametrize("driver", DRIVERS, indirect=True)`."""
    name: str = request.param
    with driven_by(name):
        yield name


@pytest.fixture(params=DRIVERS, autouse=True)
def each_driver(request: pytest.FixtureRequest) -> Iterator[str]:
    """Import it to run each test of a module once with each driver."""
    name: str = request.param
    with driven_by(name):
        yield name
