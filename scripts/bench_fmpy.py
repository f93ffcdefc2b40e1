"""The other sides of scripts/bench.py: FMPy's calls in Python, FMPy's solver, and a bare loop in C."""

from __future__ import annotations

import ctypes
import math
import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import lru_cache
from io import StringIO
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType
from typing import Any, Self

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from workbench.build.fmu import build_fmu
from workbench.build.toolchain import compile_library, host_only
from workbench.fmi.platforms import host

DATA = Path(__file__).resolve().parent / "bench_data"


@lru_cache(maxsize=1)
def _folder() -> Path:
    return Path(mkdtemp(prefix="workbench-bench-"))


@lru_cache(maxsize=1)
def seventy_one() -> Path:
    """Build a model of 71 states and 2 inputs; return the FMU (FMI 2.0)."""
    couplings = [f"  der(x[{i}]) = -{i}*x[{i}] + 0.1*x[{i % 71 + 1}] + u[{i % 2 + 1}];" for i in range(1, 72)]
    source = _folder() / "SeventyOne.mo"
    head = (
        "model SeventyOne\n  input Real u[2];\n  output Real y = sum(x);\n  Real x[71](each fixed = true);\nequation\n"
    )
    source.write_text(head + "\n".join(couplings) + "\nend SeventyOne;\n", encoding="utf-8")
    return build_fmu([source], out=_folder() / "SeventyOne.fmu", platforms=[host()]).files[0]


def gain() -> Path:
    """Return a static gain, the FMU whose step costs nothing."""
    return build_fmu([DATA / "Gain.mo"], out=_folder() / "Gain.fmu", platforms=[host()]).files[0]


class _Loop(ctypes.Structure):
    """`Loop` of bench_data/loop.c."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("component", "set", "step", "get", "slopes")),
        *((name, ctypes.c_uint) for name in ("u", "y")),
        *((name, ctypes.c_double) for name in ("size", "omega")),
        ("n", ctypes.c_size_t),
    )


@lru_cache(maxsize=2)
def c_loops(source: str) -> ctypes.CDLL:
    """Return the compiled functions of a file of bench_data."""
    (platform,) = host_only()
    library = (_folder() / source).with_suffix(platform.suffix)
    compile_library(DATA, [source], platform, library)
    return ctypes.CDLL(str(library))


class Slave:
    """A co-simulation slave of FMI 2.0 in FMPy's hands; inputs `u`, output `y`."""

    def __init__(self, file: Path) -> None:
        self.folder = fmpy.extract(str(file))
        description = fmpy.read_model_description(self.folder)
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.interpolates = bool(description.coSimulation.canInterpolateInputs)
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="bench",
        )
        self.fmu.instantiate()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _start(self) -> None:
        self.fmu.reset()
        self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def python_loop(self, n: int, step: float, frequency: float) -> float:
        """Make n steps the way an FMPy script does; return the last output."""
        self._start()
        fmu, omega, value = self.fmu, 2.0 * math.pi * frequency, 0.0
        u, y = [self.references["u"]], [self.references["y"]]
        for i in range(n):
            t = i * step
            fmu.setReal(u, [math.sin(omega * t)])
            fmu.doStep(currentCommunicationPoint=t, communicationStepSize=step)
            value = fmu.getReal(y)[0]
        return value

    def c_loop(self, name: str, n: int, step: float, frequency: float) -> float:
        """Make the same steps with a function of bench_data/loop.c; return the last output."""
        self._start()
        outputs = np.empty(n)
        names = ("SetReal", "DoStep", "GetReal", "SetRealInputDerivatives")
        functions = [address_of(getattr(self.fmu.dll, f"fmi2{f}")) for f in names]
        if not self.interpolates:
            functions[-1] = None
        u, y = self.references["u"], self.references["y"]
        loop = _Loop(self.fmu.component, *functions, u, y, step, 2.0 * math.pi * frequency, n)
        status = getattr(c_loops("loop.c"), name)(ctypes.byref(loop), ctypes.c_void_p(outputs.ctypes.data))
        if status > 1:
            raise RuntimeError(f"the loop in C ended with status {status}")
        return float(outputs[-1])


def address_of(function: Any) -> int | None:
    """Return where a function of a library begins."""
    return ctypes.cast(function, ctypes.c_void_p).value


class Exchange:
    """`fmpy.simulate_fmu` with its CVode on a model exchange FMU; unpacked and parsed beforehand.

    Attributes:
        points: times at which the output is wanted [s].
    """

    def __init__(
        self, file: Path, input_name: str, output: str, points: np.ndarray, signal: Callable[[float], float]
    ) -> None:
        self.folder = fmpy.extract(str(file), unzipdir=str(_folder() / file.stem))
        self.description = fmpy.read_model_description(self.folder)
        self.input_name, self.output, self.points, self.signal = input_name, output, points, signal

    def run(self, tolerance: float, interval: float) -> np.ndarray:
        """Return the output at `points`; its input is a table as fine as `interval`."""
        with redirect_stdout(StringIO()):  # it prints which inputs are not forced
            result = fmpy.simulate_fmu(
                self.folder,
                validate=False,
                stop_time=float(self.points[-1]),
                relative_tolerance=tolerance,
                output_interval=interval,
                fmi_type="ModelExchange",
                input=self._table(interval),
                output=[self.output],
                model_description=self.description,
            )
        at = np.searchsorted(result["time"], self.points - 1e-9, side="left")
        return np.asarray(result[self.output][np.minimum(at, len(result) - 1)])

    @lru_cache(maxsize=8)  # noqa: B019  there is one of it in a run
    def _table(self, interval: float) -> np.ndarray:
        times = np.arange(0.0, float(self.points[-1]) + 0.5 * interval, interval)
        rows = [(t, self.signal(t)) for t in times]
        return np.array(rows, dtype=[("time", np.float64), (self.input_name, np.float64)])
