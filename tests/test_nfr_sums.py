"""A point measured by the kernel's Fourier sums is the point measured from rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from workbench.core.values.arrays import Floats
from workbench.model.load import load
from workbench.response.nfr.point import PointTask, run_point
from workbench.session import Recorded, Session, Snapshot
from workbench.session.compiled import CompiledSession
from workbench.signals.kinds import Signal


class Rows(Session):
    """A compiled session that only gives rows."""

    def __init__(self, session: Session) -> None:
        assert isinstance(session, CompiledSession)
        self._session = session
        self.time = session.time

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        found = self._session.advance(until, signals=signals, record=record, points=points)
        self.time, self.communication_step = self._session.time, self._session.communication_step
        return found

    def values(self, names: Sequence[str]) -> dict[str, float]:
        return self._session.values(names)

    def snapshot(self) -> Snapshot:
        return self._session.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        self._session.restore(snapshot)

    def close(self) -> None:
        self._session.close()


@pytest.mark.parametrize(
    ("name", "interface", "u", "y", "amplitude"),
    [
        ("Rudder", "me", "delC", "del", 4.0),
        ("Rudder", "cs", "delC", "del", 1.0),
        ("FirstOrderLag", "me", "u", "y", 1.0),
        ("FirstOrderLag", "cs", "u", "y", 1.0),
        ("TwoRateQuantizer", "me", "u", "y", 1.0),
        ("TwoRateQuantizer", "cs", "u", "y", 1.0),
    ],
)
def test_sums_are_rows(name: str, interface: str, u: str, y: str, amplitude: float) -> None:
    task = PointTask(input=u, output=y, frequency=1.3, amplitude=amplitude, errcrit=0.1, max_periods=8)
    with load(f"fmu:{name}", interface) as model:
        with model.open_session(step=1.0 / (1.3 * task.rows)) as session:
            summed = run_point(session, task)
        with Rows(model.open_session(step=1.0 / (1.3 * task.rows))) as session:
            recorded = run_point(session, task)
    assert summed.response == pytest.approx(recorded.response, rel=1e-11)
    assert summed.offset == pytest.approx(recorded.offset, rel=1e-9, abs=1e-12)
    assert summed.step == pytest.approx(recorded.step, rel=1e-12)
    assert (summed.periods, summed.status) == (recorded.periods, recorded.status)
    assert summed.certificate is not None
    assert recorded.certificate is not None
    assert summed.certificate.harmonics == pytest.approx(recorded.certificate.harmonics, abs=1e-9)
