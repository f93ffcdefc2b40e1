"""What scripts/bench.py measures: functions that prepare one side of a row, and return what is run.

Their `workbench` is that of the checkout that is measured. Options that they pass on are those of its functions.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack, redirect_stdout
from functools import lru_cache, partial
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import psutil
from fmpy.fmi2 import FMU2Slave
from scipy.linalg import expm

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.response.periodic.period_map import ROWS

Run = Callable[[], object]
Options = Mapping[str, Any]
LAG, FREQUENCY, STEP = "FirstOrderLag", 2.0, 1e-3  # FMU of inputs `u`, outputs `y`; [Hz], [s]


def machine() -> Callable[[], str]:
    """Tell what computes here."""
    pools = import_module("threadpoolctl").threadpool_info()
    blas = {f"{p['internal_api']} with {p['num_threads']} threads" for p in pools if p["user_api"] == "blas"}
    return lambda: f"NumPy {np.__version__}, {', '.join(sorted(blas))}"


# -- the models -------------------------------------------------------------------------------


def large(kind: str, n: int) -> Callable[[], str]:
    """Build an FMU of n states, see tests/large_fmus.py; "loop": the system around a rod."""
    builders = import_module("tests.large_fmus")
    rod = builders.build_large(Path.cwd(), "rod" if kind == "loop" else kind, n)
    file = builders.build_loop(rod) if kind == "loop" else rod
    return lambda: str(file)


def parameters(n: int) -> Callable[[], str]:
    """Write an FMU of n parameters."""
    each = "".join(
        f'<ScalarVariable name="part[{i // 100}].x[{i % 100}]" valueReference="{i}" causality="parameter" '
        f'variability="fixed" description="variable {i}"><Real start="{i}.5"/></ScalarVariable>'
        for i in range(n)
    )
    xml = (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="Big" guid="{big}" '
        'numberOfEventIndicators="0"><ModelExchange modelIdentifier="large"/>'
        f"<ModelVariables>{each}</ModelVariables><ModelStructure/></fmiModelDescription>"
    )
    file = import_module("tests.stub_fmus").write_stub(Path("parameters.fmu").resolve(), "large", xml)
    return lambda: str(file)


def ring(n: int, gain: float, *, feed_through: bool = False, **options: Any) -> wb.DescribedModel:
    """Connect n FMUs in a ring, closed by a gain; the first starts at 1, the others may have direct feed-through."""
    parts = {f"c{i}": "fmu:Saturation" if feed_through and i else f"fmu:{LAG}" for i in range(n)}
    wires = [(f"c{i}.y", f"c{i + 1}.u") for i in range(n - 1)]
    closing = (f"c{n - 1}.y", "c0.u", {"gain": gain})
    return wb.connect(parts, [*wires, closing], outputs={"y": f"c{n - 1}.y"}, start_values={"c0.x": 1.0}, **options)


# -- the workbench ----------------------------------------------------------------------------


def analysis(name: str, file: str, **asked: Any) -> Run:
    """One of the public functions, in this process."""
    return partial(getattr(wb, name), wb.load(file), in_process=True, **asked)


def simulation(
    file: str, stop: float, rows: int, *, by: str, opened: Options | None = None, **asked: Any
) -> Callable[[], wb.SimulationResult]:
    """A time history of so many rows, by "interval" or "points"."""
    when = {"interval": stop / rows} if by == "interval" else {"points": np.linspace(0.0, stop, rows + 1)[1:]}
    return partial(wb.simulate, wb.load(file, **(opened or {})), stop=stop, **when, **asked)


def ring_simulation(n: int, *, feed_through: bool) -> Run:
    """A time history of n FMUs in a ring."""
    model = ring(n, -0.5, feed_through=feed_through)
    return partial(wb.simulate, model, stop=100.0, interval=0.1, in_process=True)


def kernel_periods(file: str, frequency: float) -> Run:
    """Only advance a session over as many periods of the sine as nfr says that it ran, with as many rows of each."""
    with wb.load(file) as model:
        found = wb.nfr(model, "u", "y", frequencies=[frequency], amplitudes=[1.0], in_process=True)
    model, signals = wb.load(file), {"u": wb.Sine(frequency=frequency)}
    points = np.arange(1, 1 + ROWS * int(found.periods[0, 0])) / (ROWS * frequency)

    def run() -> None:
        with model.open_session() as session:
            session.advance(float(points[-1]), signals=signals, record=["y"], points=points)

    return run


def csv(rows: int, *, by: str) -> Run:
    """Write a record of three columns, by the record's "to_csv" or by "savetxt" of NumPy."""
    found = simulation(f"fmu:{LAG}", 1.0, rows, by="points", outputs=["y", "x"], in_process=True)()
    if by == "to_csv":
        return lambda: found.to_csv("out.csv")
    return lambda: np.savetxt("out.csv", np.column_stack([found.time, *found.signals.values()]), delimiter=",")


def memory(file: str, rows: int, columns: int) -> Callable[[], float]:
    """Run a time history; return by how much it raised the peak of the memory, over its own size."""
    run = simulation(file, 1.0, rows, by="points", outputs=_temperatures(columns), in_process=True)
    process = import_module("resource")
    unit = import_module("bench_process").MIB / 1024.0**2

    def growth() -> float:
        before = process.getrusage(process.RUSAGE_SELF).ru_maxrss / unit
        found = run()
        size = found.time.nbytes + sum(values.nbytes for values in found.signals.values())
        return float((process.getrusage(process.RUSAGE_SELF).ru_maxrss / unit - before) / size)

    return growth


def _temperatures(n: int) -> list[str]:
    return [f"T[{i + 1}]" for i in range(n)]


def transport(file: str, rows: int, columns: int, *, in_process: bool) -> Run:
    """A time history of many numbers, from a worker or computed here."""
    return simulation(file, 1.0, rows, by="points", outputs=_temperatures(columns), in_process=in_process)


def cycles(count: int) -> Callable[[], float]:
    """Open, run and close FMUs; return by how much the resident memory grew [MB]."""

    def some(n: int) -> None:
        for i in range(n):
            with wb.load(f"fmu:{LAG}", ("me", "cs")[i % 2]) as model:
                wb.simulate(model, stop=1.0, inputs={"u": 1.0}, in_process=True)

    def run() -> float:
        some(count // 4)
        before = psutil.Process().memory_info().rss
        some(count)
        return float(psutil.Process().memory_info().rss - before) / 1e6

    return run


def sessions(count: int) -> Callable[[], float]:
    """Open sessions on one model, advance them all; return how many there were."""

    def run() -> float:
        with ExitStack() as stack:
            model = stack.enter_context(wb.load("fmu:Rudder"))
            opened = [stack.enter_context(model.open_session()) for _ in range(count)]
            for session in opened:
                session.advance(0.01, signals={"delC": wb.Sine(frequency=FREQUENCY)})
            return float(len(opened))

    return run


# -- FMPy -------------------------------------------------------------------------------------


class Slave:
    """A co-simulation slave of FMI 2.0 in FMPy's hands."""

    def __init__(self) -> None:
        file = Path(wb.__file__).resolve().parents[1] / "fmus" / "fmi2" / f"{LAG}.fmu"
        folder = fmpy.extract(str(file), tempfile.mkdtemp(dir=Path.cwd()))
        description = fmpy.read_model_description(folder)
        names = {v.name: v.valueReference for v in description.modelVariables}
        self.u, self.y, self.x = ([names[name]] for name in "uyx")
        identifier = description.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="bench"
        )
        self.fmu.instantiate()

    def start(self, x: float = 0.0) -> None:
        """Begin again, in a state."""
        self.fmu.reset()
        self.fmu.setupExperiment()
        self.fmu.setReal(self.x, [x])
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, t: float, size: float, u: float) -> float:
        """Make one step; return the output."""
        self.fmu.setReal(self.u, [u])
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=size)
        return float(self.fmu.getReal(self.y)[0])


def fmpy_steps(count: int) -> Run:
    """Make so many steps as an FMPy script does, and keep the outputs."""
    slave, omega = Slave(), 2.0 * math.pi * FREQUENCY

    def run() -> list[float]:
        slave.start()
        return [slave.step(i * STEP, STEP, math.sin(omega * i * STEP)) for i in range(count)]

    return run


_POINTS = np.linspace(0.0, 2.0, 201)[1:]  # [s]
_RUDDER: Options = {"inputs": {"delC": wb.Sine(frequency=FREQUENCY, amplitude=2.0)}, "outputs": ["del"]}


def exchange(*, solver: str = "gear", tolerance: float = 1e-6) -> Callable[[], wb.SimulationResult]:
    """The rudder at given points, in this process."""
    model = wb.load("fmu:Rudder", "me", solver, tolerance=tolerance)
    return partial(wb.simulate, model, stop=2.0, points=_POINTS, in_process=True, **_RUDDER)


def _rudder_error(time: Floats, values: Floats) -> float:
    """Return the largest error at the points, relative to the range."""
    truth = exchange(solver="vkm", tolerance=1e-11)()
    true = truth.signals["del"][np.searchsorted(truth.time, _POINTS, side="right") - 1]
    found = values[np.searchsorted(time, _POINTS + 1e-9, side="right") - 1]
    return float(np.abs(found - true).max() / np.ptp(true))


def fmpy_exchange(*, equal: str) -> Callable[[], str]:
    """FMPy's CVode on the rudder, at an equal "tolerance", or in the intervals of equal "accuracy" or its best."""
    folder = fmpy.extract(
        str(Path(wb.__file__).resolve().parents[1] / "fmus" / "fmi2" / "Rudder.fmu"), str(Path.cwd() / "rudder")
    )
    signal, description = _RUDDER["inputs"]["delC"], fmpy.read_model_description(folder)

    @lru_cache
    def table(interval: float) -> Any:
        rows = [(t, signal(t)) for t in np.arange(0.0, 2.0 + 0.5 * interval, interval)]
        return np.array(rows, dtype=[("time", np.float64), ("delC", np.float64)])

    def simulated(interval: float) -> Any:
        with redirect_stdout(StringIO()):  # it prints which inputs are not forced
            return fmpy.simulate_fmu(
                folder, validate=False, stop_time=2.0, relative_tolerance=1e-6, output_interval=interval,
                fmi_type="ModelExchange", input=table(interval), output=["del"], model_description=description,
            )  # fmt: skip

    def error(found: Any) -> float:
        return _rudder_error(found["time"], found["del"])

    ours = exchange()()
    own = _rudder_error(ours.time, ours.signals["del"])
    intervals = [0.01] if equal == "tolerance" else [0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4]
    errors = {i: error(simulated(i)) for i in intervals}
    interval = next((i for i, e in errors.items() if e <= 1.5 * own), min(errors, key=errors.__getitem__))
    words = f"errors {own:.1e} and {errors[interval]:.1e} of the range; FMPy's interval {interval:g} s"

    def run() -> str:
        simulated(interval)
        return words

    return run


_GAIN, _GRID, _COUNT = -2.0, 0.1, 200  # of the loop of three: the loop is a damped oscillation; [s]
_TIMES: Floats = _GRID * np.arange(1.0, _COUNT + 1)


def _loop_error(values: Floats) -> float:
    """Return the largest error of the loop of three at its points, against dx/dt = A x."""
    a = np.array([[-1.0, 0.0, _GAIN], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    return float(max(abs(y - expm(a * t)[2, 0]) for y, t in zip(values, _TIMES, strict=True)))


def loop_of_three() -> Callable[[], wb.SimulationResult]:
    """Three FMUs as one differential equation."""
    model = ring(3, _GAIN, tolerance=1e-4)
    return partial(wb.simulate, model, stop=float(_TIMES[-1]), points=_TIMES, in_process=True)


def fmpy_loop() -> Callable[[], str]:
    """The same loop in FMPy's hands, stepped in turn with the newest values, in the largest steps that are as exact."""
    slaves = [Slave() for _ in range(3)]

    def run(per_point: int) -> Floats:
        for k, slave in enumerate(slaves):
            slave.start(float(k == 0))
        step, last, found = _GRID / per_point, 0.0, []
        for i in range(_COUNT * per_point):
            value = _GAIN * last
            for slave in slaves:
                value = slave.step(i * step, step, value)
            last = value
            if (i + 1) % per_point == 0:
                found.append(last)
        return np.array(found)

    wanted, count = _loop_error(loop_of_three()().signals["y"][1:]), 4
    while (error := _loop_error(run(count))) > wanted:  # it falls with the first power of the step
        count = max(count + 1, int(count * min(1.0 + 0.98 * (error / wanted - 1.0), 64.0)))

    def loop() -> str:
        run(count)
        return f"errors {wanted:.1e} and {error:.1e}; FMPy's step {1e3 * _GRID / count:.3g} ms"

    return loop


# -- identification ---------------------------------------------------------------------------


def _records(samples: int) -> tuple[Floats, Floats]:
    """Return u and y of a model of six states, two inputs and outputs, with noise."""
    random = np.random.default_rng(1)
    a = np.zeros((6, 6))
    for k, (radius, angle) in enumerate(((0.95, 0.2), (0.9, 0.6), (0.8, 1.2))):
        cos, sin = radius * math.cos(angle), radius * math.sin(angle)
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[cos, sin], [-sin, cos]]
    b, c = random.standard_normal((6, 2)), random.standard_normal((2, 6))
    u, x, y = random.standard_normal((samples, 2)), np.zeros(6), np.empty((samples, 2))
    for k in range(samples):
        y[k], x = c @ x, a @ x + b @ u[k]
    return u, y + 0.01 * y.std(axis=0) * random.standard_normal(y.shape)


def identification(samples: int, *, by: str) -> Run:
    """Find a model of order 6 by the workbench, "sippy" or "nfoursid"."""
    u, y = _records(samples)

    def sippy() -> None:
        import_module("sippy_unipi").system_identification(y.T, u.T, "N4SID", SS_fixed_order=6, SS_f=20)

    def nfoursid() -> None:
        table = import_module("pandas").DataFrame(np.hstack([u, y]), columns=["u1", "u2", "y1", "y2"])
        found = import_module("nfoursid.nfoursid").NFourSID(table, ["y1", "y2"], ["u1", "u2"], num_block_rows=20)
        found.subspace_identification()
        found.system_identification(rank=6)

    if by in ("sippy", "nfoursid"):
        return sippy if by == "sippy" else nfoursid
    return partial(wb.identify, wb.make_experiment(0.1, u, y), order=6)
