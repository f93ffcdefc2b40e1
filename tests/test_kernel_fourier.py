"""Fourier sums in compiled code against NumPy on the same rows."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from tests.oracle.fourier import period_by_numpy
from workbench.errors import InputError
from workbench.kernel.library import kernel
from workbench.kernel.native_record import NativeFourier
from workbench.model.load import load
from workbench.session.base import Recorded
from workbench.session.compiled import CompiledSession
from workbench.signals.kinds import Prbs, Sine


def random_rows(mean: float) -> Recorded:
    """Rows over one period of 0.5 s from 3.0 s on, unequal steps, with jumps as two rows at one time."""
    random = np.random.default_rng(5)
    inside = 3.0 + 0.5 * np.sort(random.random(300))
    time = np.sort(np.concatenate([[3.0], inside, inside[::7], [3.5]]))
    y = mean + np.sin(4.0 * np.pi * time) + 0.3 * random.standard_normal(time.size)
    return Recorded(time=time, values={"y": y}, inputs={"u": np.sin(4.0 * np.pi * (time - 3.0))})


@pytest.mark.parametrize("mean", [0.0, 1e7])
@pytest.mark.parametrize("orders", [1, 5, 10])
def test_equal_to_numpy(mean: float, orders: int) -> None:
    record = random_rows(mean)
    period = period_by_numpy(record, u="u", y="y", begin=3.0, frequency=2.0, orders=orders)
    rows = np.column_stack([record.time, record.inputs["u"], record.values["y"]])
    sums = NativeFourier(kernel(), [1, 2], begin=3.0, frequency=2.0, orders=orders)
    u, y = sums.of_rows(rows)
    swing = np.max(np.abs(record.values["y"] - mean))
    assert y == pytest.approx(period.harmonics, rel=1e-14, abs=1e-14 * orders * swing + 1e-16 * mean)
    assert complex(u[1], u[2]) == pytest.approx(period.drive, abs=1e-14)
    assert sums.largest[1] == period.size
    assert np.array_equal(sums.of_rows(rows), np.array([u, y]))


@pytest.mark.parametrize(
    ("name", "interface", "u", "y"), [("Rudder", "me", "delC", "del"), ("TwoRateQuantizer", "cs", "u", "y")]
)
def test_a_session_sums_what_it_would_record(name: str, interface: str, u: str, y: str) -> None:
    sine = Sine(amplitude=0.5, frequency=5.0)
    points = np.arange(1, 201) / 1000.0
    with load(f"fmu:{name}", interface, step=1e-3 if interface == "cs" else None) as model:
        with model.open_session(signals={u: sine}) as session:
            record = session.advance(0.2, signals={u: sine}, record=[y], points=points)
        with model.open_session(signals={u: sine}) as session:
            assert isinstance(session, CompiledSession)
            found = session.harmonics(
                0.2, signals={u: sine}, record=[y], begin=0.0, frequency=5.0, orders=10, points=points
            )
            assert session.time == 0.2
            later = session.advance(0.25, signals={u: sine}, record=[y])
    nodes = points if interface == "me" else None
    period = period_by_numpy(record, u=u, y=y, begin=0.0, frequency=5.0, orders=10, points=nodes)
    assert found.values[y] == pytest.approx(period.harmonics, abs=1e-13)
    assert complex(found.inputs[u][1], found.inputs[u][2]) == pytest.approx(period.drive, abs=1e-13)
    assert found.largest[y] == period.size
    assert later.time[0] == 0.2


def test_an_even_grid_with_jumps_is_summed_as_by_numpy() -> None:
    random = np.random.default_rng(6)
    points = 3.0 + 0.5 * np.arange(1, 41) / 40
    # Jumps between the points, two of them in one interval, one at a point; and where nothing jumps.
    events = np.repeat([3.003, 3.017, 3.018, 3.1, points[10], 3.4], 2)
    time = np.sort(np.concatenate([[3.0], points[points != points[10]], events]))
    y = 5.0 + np.sin(4.0 * np.pi * time) + 0.3 * random.standard_normal(time.size)
    y[np.flatnonzero(time == 3.4)] = 1.0
    record = Recorded(time=time, values={"y": y}, inputs={"u": np.sin(4.0 * np.pi * (time - 3.0))})
    period = period_by_numpy(record, u="u", y="y", begin=3.0, frequency=2.0, orders=4, points=points)
    sums = NativeFourier(kernel(), [1, 2], begin=3.0, frequency=2.0, orders=4)
    sums.aim(begin=3.0, frequency=2.0, known=(points, None), grid=True)
    u, found = sums.of_rows(np.column_stack([time, record.inputs["u"], y]))
    np.testing.assert_allclose(found, period.harmonics, rtol=1e-13, atol=1e-14)
    assert complex(u[1], u[2]) == pytest.approx(1.0, abs=1e-14)
    assert period.drive == pytest.approx(1.0, abs=1e-14)


def test_a_basis_that_is_known_at_some_rows_gives_the_same() -> None:
    record = random_rows(1.0)
    rows = np.column_stack([record.time, record.inputs["u"], record.values["y"]])
    sums = NativeFourier(kernel(), [1, 2], begin=3.0, frequency=2.0, orders=3)
    expected = sums.of_rows(rows)
    # Known at every third row, and at times between rows, where it must not be taken.
    times = np.unique(np.concatenate([record.time[::3], 0.5 * (record.time[1:] + record.time[:-1])]))
    angles = 4.0 * np.pi * np.outer(times - 3.0, np.arange(1, 4))
    basis = np.ones((times.size, 7))
    basis[:, 1::2], basis[:, 2::2] = np.sin(angles), np.cos(angles)
    sums.aim(begin=3.0, frequency=2.0, known=(times, basis))
    np.testing.assert_allclose(sums.of_rows(rows), expected, rtol=1e-13, atol=1e-14)
    sums.aim(begin=3.0, frequency=2.0)
    assert np.array_equal(sums.of_rows(rows), expected)


def test_a_basis_of_another_shape_is_refused() -> None:
    points = np.arange(1, 11) / 10.0
    with load("fmu:FirstOrderLag") as model, model.open_session() as session:
        assert isinstance(session, CompiledSession)
        with pytest.raises(InputError, match=r"basis has shape \(10, 5\), not \(10, 7\)"):
            session.harmonics(
                1.0,
                signals={"u": Sine(frequency=1.0)},
                record=["y"],
                begin=0.0,
                frequency=1.0,
                orders=3,
                points=points,
                basis=np.ones((10, 5)),
            )


def test_fourth_of_the_rows_is_kept_where_that_is_asked_for() -> None:
    points = np.arange(1, 101) / 100.0
    signal = {"u": Prbs(hold=0.25, order=4)}
    with load("fmu:FirstOrderLag") as model:
        with model.open_session() as session:
            whole = session.advance(1.0, signals=signal, record=["y"], points=points)
        with model.open_session() as session:
            assert isinstance(session, CompiledSession)
            session.recording.every = 4
            some = session.advance(1.0, signals=signal, record=["y"], points=points)
    kept = np.isin(whole.time, some.time)
    assert np.array_equal(whole.values["y"][kept], some.values["y"])
    breaks = np.unique(whole.time[:-1][np.diff(whole.time) == 0.0])
    assert set(breaks) <= set(some.time)
    assert (some.time[0], some.time[-1]) == (0.0, 1.0)
    assert 25 <= some.time.size <= 26 + 2 * breaks.size


def test_the_structure_is_as_large_as_the_kernels() -> None:
    library = kernel()
    sums = NativeFourier(library, [1], begin=0.0, frequency=1.0, orders=1)
    assert library.kernel_sizeof(b"Fourier") == ctypes.sizeof(sums.structure)
    assert library.kernel_sizeof(b"nothing") == 0
