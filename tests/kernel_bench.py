"""Drives the kernel's solvers on the problems of tests/c/kernel_problems.c, and their Python twins on the same."""

from __future__ import annotations

import ctypes
import math
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.oracle.solvers import SOLVERS, Solver, Tolerance
from workbench.fmi.instance import DiscardError
from workbench.kernel.gear import gear_library

ROOT = Path(__file__).parents[1]
NAMES = ("vkm", "gear", "gear_banded", "banded", "grouped", "none", "locate")
KERNEL = ROOT / "workbench" / "kernel"
SOURCES = [str(ROOT / "tests" / "c" / "kernel_problems.c"), *(str(KERNEL / f"{n}.c") for n in NAMES)]
WARNINGS = ["-std=c11", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", f"-I{KERNEL}"]
SIZES = {
    "decay": (1, 0), "stiff": (2, 0), "van_der_pol": (2, 0), "oscillator": (2, 1), "smooth_oscillator": (2, 0),
    "time_only": (0, 2), "nothing": (0, 0), "rise": (1, 1), "walled": (1, 0), "near_wall": (1, 0),
    "not_a_number": (1, 0), "broken": (1, 0), "thrown": (2, 1), "three_levels": (1, 3), "until_one": (1, 1),
    "wall_for_indicators": (1, 1), "broken_indicator": (1, 1),
}  # fmt: skip

_P, _D, _B = ctypes.c_void_p, ctypes.c_double, ctypes.c_bool
_SIGNATURES: Mapping[str, tuple[Any, list[Any]]] = {
    "bench_open": (_P, [ctypes.c_char_p, ctypes.c_char_p, _D, _D, _P]),
    "bench_close": (None, [_P]),
    "bench_restart": (_B, [_P, _D, _P]),
    "bench_step": (_B, [_P, _D, _D, _P]),
    "bench_interpolate": (_B, [_P, _D, _P]),
    "bench_look": (None, [_P, _P, _P]),
    "bench_count": (None, [_P, _P]),
    "bench_message": (ctypes.c_char_p, [_P]),
    "bench_run": (ctypes.c_int, [_P, _D, _D]),
    "bench_evaluate": (ctypes.c_int, [ctypes.c_char_p, _D, _P, _P]),
    "bench_indicate": (ctypes.c_int, [ctypes.c_char_p, _D, _P, _P]),
}

Library = Any


def compile_with_zig(output: Path, *options: str) -> None:
    command = [sys.executable, "-m", "ziglang", "cc", "-O2", "-shared", "-fvisibility=hidden", *WARNINGS, *options]
    subprocess.run([*command, *SOURCES, "-o", str(output)], check=True, cwd=output.parent)


def load(path: Path) -> Library:
    library = ctypes.CDLL(str(path))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


class RefusedError(Exception):
    """The solver could not go on."""


class Bench:
    """One compiled solver on one problem; steps raise `RefusedError`."""

    def __init__(
        self, library: Library, solver: str, problem: str, *, rtol: float = 1e-6, scale: float = 1e-3,
        table: ctypes.Structure | None = None,
    ) -> None:  # fmt: skip
        self.library = library
        self.n = SIZES[problem][0]
        table = gear_library() if table is None else table
        self.bench = library.bench_open(solver.encode(), problem.encode(), rtol, scale, ctypes.byref(table))
        if not self.bench:
            raise RefusedError("not created")

    def check(self, good: bool) -> None:
        if not good:
            raise RefusedError(self.message)

    def restart(self, t: float, *x: float) -> None:
        begin = np.array(x, dtype=float)  # an address alone keeps no array: another thread may take its place
        self.check(self.library.bench_restart(self.bench, t, begin.ctypes.data))

    def step(self, stop: float, longest: float = math.inf) -> bool:
        event = _B()
        self.check(self.library.bench_step(self.bench, stop, longest, ctypes.byref(event)))
        return event.value

    def run(self, stop: float, longest: float = math.inf) -> int:
        events: int = self.library.bench_run(self.bench, stop, longest)
        self.check(events >= 0)
        return events

    def events(self, stop: float, longest: float = math.inf) -> list[float]:
        """Times of all events until `stop`, with a restart at each."""
        times = []
        while self.t < stop:
            if self.step(stop, longest):
                times.append(self.t)
                self.restart(self.t, *self.x)
        return times

    def interpolate(self, t: float) -> np.ndarray:
        x = np.zeros(max(self.n, 1))
        self.check(self.library.bench_interpolate(self.bench, t, x.ctypes.data))
        return x[: self.n]

    def look(self) -> tuple[np.ndarray, np.ndarray]:
        times, x = np.zeros(3), np.zeros(2)
        self.library.bench_look(self.bench, times.ctypes.data, x.ctypes.data)
        return times, x[: self.n]

    @property
    def t(self) -> float:
        return float(self.look()[0][0])

    @property
    def t_old(self) -> float:
        return float(self.look()[0][1])

    @property
    def furthest(self) -> float:
        return float(self.look()[0][2])

    @property
    def x(self) -> np.ndarray:
        return self.look()[1]

    @property
    def counts(self) -> dict[str, int]:
        counts = (ctypes.c_size_t * 5)()
        self.library.bench_count(self.bench, counts)
        return dict(zip(("evaluations", "steps", "rejected", "asked_for", "indicators"), counts, strict=True))

    @property
    def message(self) -> str:
        message: bytes = self.library.bench_message(self.bench)
        return message.decode()

    def close(self) -> None:
        if self.bench:
            self.library.bench_close(self.bench)
            self.bench = None


class TwinProblem:
    """The same C functions as the Python solvers want them."""

    def __init__(self, library: Library, name: str) -> None:
        self.library, self.name = library, name.encode()
        self.n, self.nz = SIZES[name]
        self.evaluations = 0
        self.x: np.ndarray
        self.dx: np.ndarray
        self.z: np.ndarray
        self._xbuf, self._dxbuf, self._zbuf = ((_D * max(k, 1))() for k in (self.n, self.n, self.nz))
        self.x, self.dx, self.z = (
            np.ctypeslib.as_array(b)[:k]
            for b, k in ((self._xbuf, self.n), (self._dxbuf, self.n), (self._zbuf, self.nz))
        )
        self.t = 0.0
        # What the oracle's CVODE touches of an FMU's instance.
        self.instance = SimpleNamespace(
            _xbuf=self._xbuf, _dxbuf=self._dxbuf, _zbuf=self._zbuf, get_indicators=self._get_indicators,
            description=SimpleNamespace(states=()),
        )  # fmt: skip

    def put_buffered(self, t: float) -> None:
        self.t = t

    def _get_indicators(self) -> None:
        self.library.bench_indicate(self.name, self.t, self._xbuf, self._zbuf)

    def rhs_buffered(self, t: float) -> np.ndarray:
        self.evaluations += 1
        if self.library.bench_evaluate(self.name, t, self._xbuf, self._dxbuf) != 0:
            raise DiscardError("refused")
        return self.dx

    def rhs(self, t: float, x: np.ndarray) -> np.ndarray:
        self.x[:] = x
        return self.rhs_buffered(t)

    def indicators(self, t: float, x: np.ndarray) -> np.ndarray:
        self.x[:] = x
        self.put_buffered(t)
        self._get_indicators()
        return self.z


class FixedTolerance(Tolerance):
    """Scales that do not grow, as the C solvers see them."""

    def __init__(self, rtol: float, scale: float, n: int) -> None:
        super().__init__(rtol, np.full(n, scale), np.full(n, np.inf))

    def grow(self, x: np.ndarray) -> None:
        """The kernel, not the solver, grows scales."""


def twin(library: Library, solver: str, problem: str, *, rtol: float = 1e-6, scale: float = 1e-3) -> Solver:
    """The Python solver of the same name on the same problem."""
    its: Any = TwinProblem(library, problem)
    return SOLVERS[solver](its, FixedTolerance(rtol, scale, its.n))
