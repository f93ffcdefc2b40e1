"""Connected models for scripts/bench.py: a loop of three FMUs beside FMPy's master, and what 50 FMUs cost."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from workbench.core.values.arrays import Floats

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from scipy.linalg import expm  # noqa: E402

import workbench as wb  # noqa: E402
from scripts.bench_fmpy import Slave  # noqa: E402
from workbench.session.compiled import CompiledMeSession  # noqa: E402

__all__ = ["SIZES", "FmpyLoop", "Growth", "OurLoop", "equal_step", "growth", "loop_error"]


FILE = ROOT / "fmus" / "fmi2" / "FirstOrderLag.fmu"
SIZES = (5, 10, 25, 50)
GAIN = -2.0  # of the loop of three: damped oscillation; the loop gets unstable at −8
STOP, GRID = 20.0, 0.1  # [s]


def grid(stop: float) -> Floats:
    """Return the points up to `stop` [s]."""
    return np.linspace(0.0, stop, round(stop / GRID) + 1)[1:]


POINTS = grid(STOP)


def ring(
    n: int, gain: float, *, feed_through: bool = False, solver: str = "auto", tolerance: float = 1e-6
) -> wb.SystemModel:
    """Connect n FMUs in a ring, the first of which starts at 1; `gain` is that of the connection that closes it.

    Args:
        n: how many.
        gain: of the ring.
        feed_through: all FMUs but the first are `Saturation` with direct feed-through, to be evaluated one after the
            other, instead of `FirstOrderLag`, whose outputs are states.
        solver: "vkm", "gear" or "auto".
        tolerance: relative.
    """
    rest = "fmu:Saturation" if feed_through else str(FILE)
    model = wb.connect(
        {"c0": str(FILE), **{f"c{i}": rest for i in range(1, n)}},
        [*((f"c{i}.y", f"c{i + 1}.u") for i in range(n - 1)), (f"c{n - 1}.y", "c0.u", {"gain": gain})],
        outputs={"y": f"c{n - 1}.y"},
        start_values={"c0.x": 1.0},
        solver=solver,
        tolerance=tolerance,
    )
    if not isinstance(model, wb.SystemModel):
        raise TypeError(f"model exchange was meant, not {type(model).__name__}")
    return model


# -- three FMUs -------------------------------------------------------------------------------


def loop_error(values: Floats) -> float:
    """Return the largest error of c2.y at POINTS against dx/dt = A x."""
    a = np.array([[-1.0, 0.0, GAIN], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    truth = [expm(a * t)[2, 0] for t in POINTS]
    return float(np.abs(values - truth).max())


class OurLoop:
    """The loop of three as one ordinary differential equation, compiled; each run is a new session."""

    def __init__(self, tolerance: float) -> None:
        self.model = ring(3, GAIN, tolerance=tolerance)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.model.close()

    def run(self) -> Floats:
        """Return c2.y at POINTS."""
        with self.model.open_session() as session:
            record = session.advance(STOP, signals={}, record=["y"], points=POINTS)
        return record.values["y"][-len(POINTS) :]


class FmpyLoop:
    """The same loop the way an FMPy script does it: the co-simulation sides, stepped in turn in Python.

    Each FMU gets the newest output of the one before it, so that only the connection that closes the loop is a whole
    step late (Gauss-Seidel): about two thirds of the error of a master that hands all values over at the step's end.
    """

    def __init__(self) -> None:
        self.undo = ExitStack()
        self.slaves = [self.undo.enter_context(Slave(FILE)) for _ in range(3)]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.undo.close()

    def _start(self) -> None:
        for k, slave in enumerate(self.slaves):
            slave.fmu.reset()
            slave.fmu.setupExperiment()
            if k == 0:
                slave.fmu.setReal([slave.references["x"]], [1.0])
            slave.fmu.enterInitializationMode()
            slave.fmu.exitInitializationMode()

    def run(self, per_point: int) -> Floats:
        """Return c2.y at POINTS; so many steps from one point to the next."""
        self._start()
        step = GRID / per_point
        a, b, c = (s.fmu for s in self.slaves)
        u, y = ([self.slaves[0].references[name]] for name in "uy")
        last, found = c.getReal(y)[0], []
        for i in range(len(POINTS) * per_point):
            t = i * step
            a.setReal(u, [GAIN * last])
            a.doStep(currentCommunicationPoint=t, communicationStepSize=step)
            b.setReal(u, a.getReal(y))
            b.doStep(currentCommunicationPoint=t, communicationStepSize=step)
            c.setReal(u, b.getReal(y))
            c.doStep(currentCommunicationPoint=t, communicationStepSize=step)
            last = c.getReal(y)[0]
            if (i + 1) % per_point == 0:
                found.append(last)
        return np.array(found)


def equal_step(loop: FmpyLoop, wanted: float) -> tuple[int, float]:
    """Return the fewest steps per point (within 5 %) with which FMPy's loop is as accurate, and its error."""
    count = 4
    error = loop_error(loop.run(count))
    while error > wanted:
        # The error falls with the first power of the step.
        count = max(count + 1, int(count * min(1.0 + 0.98 * (error / wanted - 1.0), 64.0)))
        error = loop_error(loop.run(count))
    return count, error


# -- three FMUs that step themselves ----------------------------------------------------------


# -- many FMUs --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Growth:
    """Cost of a right-hand side over the number of FMUs.

    Attributes:
        seconds: of one right-hand side, for each of SIZES, everything that a step needs included [s].
        slope: of the straight line through them (least squares of the relative deviations) [s/FMU].
        off_line: largest deviation from that line, relative.
        last_slope: from the last size but one to the last, over `slope`, less 1.
        per_fmu: the cost for one FMU at the last size over that at the second, less 1.
    """

    seconds: tuple[float, ...]
    slope: float
    off_line: float
    last_slope: float
    per_fmu: float


def growth(repeats: int, *, feed_through: bool = False, solver: str = "vkm", stop: float = 100.0) -> Growth:
    """Measure rings of SIZES in turns; the best of each, since what else the machine does only adds."""
    with ExitStack() as undo:
        models = [undo.enter_context(ring(n, -0.5, feed_through=feed_through, solver=solver)) for n in SIZES]
        sides = [partial(_evaluation, model, stop) for model in models]
        turns = [[side() for side in sides] for _ in range(repeats)]
        return _growth([min(values) for values in zip(*turns, strict=True)])


def _evaluation(model: wb.SystemModel, stop: float) -> float:
    points = grid(stop)
    with model.open_session() as session:
        begin = time.thread_time()
        session.advance(stop, signals={}, record=["y"], points=points)
        took = time.thread_time() - begin
        if not isinstance(session, CompiledMeSession):
            raise TypeError("a compiled session was meant: it counts right-hand sides")
        return took / session.evaluations


def _growth(seconds: Sequence[float]) -> Growth:
    n, cost = np.array(SIZES, dtype=float), np.array(seconds)
    weighted = np.column_stack([np.ones(len(n)), n]) / cost[:, None]
    line = np.linalg.lstsq(weighted, np.ones(len(n)), rcond=None)[0]
    slope = float(line[1])
    return Growth(
        seconds=tuple(seconds),
        slope=slope,
        off_line=float(np.abs(cost / (line[0] + slope * n) - 1.0).max()),
        last_slope=float((cost[-1] - cost[-2]) / (n[-1] - n[-2]) / slope - 1.0),
        per_fmu=float(cost[-1] / n[-1] / (cost[1] / n[1]) - 1.0),
    )
