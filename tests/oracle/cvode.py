"""`gear`: SUNDIALS CVODE, backward differentiation of variable step and order, for stiff models."""

from __future__ import annotations

import ctypes
import math
import weakref
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tests.oracle.cvode_library import ERROR_HANDLER, RHS, ROOTS, WEIGHTS, functions, why_missing
from tests.oracle.problem import Problem
from tests.oracle.solver import Solver, Tolerance
from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, SimulationError, one_line
from workbench.fmi.instance import DiscardError

__all__ = ["Gear"]

_BDF, _ONE_STEP, _ROOT_RETURN = 2, 2, 2
_RECOVERABLE, _FAILED = 1, -1
_TINY = 1e-300

# Errors of BDF add up to some multiple of what one step is allowed; asking for less makes the result as
# accurate as that of `vkm` at the same tolerance.
STRICTER = 0.3


class Gear(Solver):
    """CVODE with a dense Newton matrix by differences; Gear's method in its present form.

    The callbacks evaluate the inputs at the solver's own time. The absolute tolerance is
    rtol · scale (see `Tolerance`), never 0. No step passes `stop`.

    Source: C. W. Gear, Numerical Initial Value Problems in Ordinary Differential Equations, 1971;
    A. Hindmarsh et al., SUNDIALS, ACM TOMS 31 (2005).
    """

    def __init__(self, problem: Problem, tolerance: Tolerance) -> None:
        super().__init__(problem, tolerance)
        if why_missing():
            raise FmuError(f"solver gear is not available: {why_missing()}; use solver vkm")
        self._c = functions()
        self._error: BaseException | None = None
        self._words = ""
        self._longest = math.inf
        self._started = False
        self._x_address = ctypes.addressof(problem.instance._xbuf)
        self._dx_address = ctypes.addressof(problem.instance._dxbuf)
        self._z_address = ctypes.addressof(problem.instance._zbuf)
        self._create()

    def _create(self) -> None:
        c, n = self._c, self.problem.n
        self._context = ctypes.c_void_p()
        self._check(c["SUNContext_Create"](0, ctypes.byref(self._context)))
        # CVODE holds the addresses of these: they must live as long as it does.
        self._on_error = ERROR_HANDLER(self._take_words)
        self._on_rhs = RHS(self._rhs)
        self._on_roots = ROOTS(self._roots)
        self._on_weights = WEIGHTS(self._weights)
        c["SUNContext_ClearErrHandlers"](self._context)
        c["SUNContext_PushErrHandler"](self._context, self._on_error, None)
        self._y, self._dky = (c["N_VNew_Serial"](n, self._context) for _ in range(2))
        self._y_view, self._dky_view = (_view(c["N_VGetArrayPointer"](v), n) for v in (self._y, self._dky))
        self._matrix = c["SUNDenseMatrix"](n, n, self._context)
        self._linear = c["SUNLinSol_Dense"](self._y, self._matrix, self._context)
        self._memory = ctypes.c_void_p(c["CVodeCreate"](_BDF, self._context))
        self._free = weakref.finalize(self, _free, c, self._memory, self._context, self._owned())

    def _owned(self) -> tuple[tuple[str, Any], ...]:
        vectors = tuple(("N_VDestroy", v) for v in (self._y, self._dky))
        return (("SUNLinSolFree", self._linear), ("SUNMatDestroy", self._matrix), *vectors)

    def restart(self, t: float, x: Floats) -> None:
        self.t = self.t_old = t
        self.x = x.copy()
        self.tolerance.grow(self.x)
        self._y_view[:] = x
        if self._started:
            self._check(self._c["CVodeReInit"](self._memory, t, self._y))
        else:
            self._initialise(t)

    def _initialise(self, t: float) -> None:
        c, memory = self._c, self._memory
        self._check(c["CVodeInit"](memory, self._on_rhs, t, self._y))
        # A weight function, because new tolerance vectors in mid-run leave CVODE a null pointer.
        self._check(c["CVodeWFtolerances"](memory, self._on_weights))
        self._check(c["CVodeSetLinearSolver"](memory, self._linear, self._matrix))
        if self.problem.nz:
            self._check(c["CVodeRootInit"](memory, self.problem.nz, self._on_roots))
            self._check(c["CVodeSetNoInactiveRootWarn"](memory))
        self._started = True

    def step(self, stop: float, longest: float) -> bool:
        c = self._c
        if longest != self._longest:
            self._longest = longest
            bound = longest if math.isfinite(longest) else 0.0  # 0: no bound
            self._check(c["CVodeSetMaxStep"](self._memory, bound))
        self._check(c["CVodeSetStopTime"](self._memory, stop))
        reached = ctypes.c_double(self.t)
        flag = c["CVode"](self._memory, stop, self._y, ctypes.byref(reached), _ONE_STEP)
        self._check(flag)
        self.t_old, self.t = self.t, float(reached.value)
        self.x = self._y_view.copy()
        self.check_finite()
        self.tolerance.grow(self.x)
        return bool(flag == _ROOT_RETURN)

    def interpolate(self, t: float) -> Floats:
        if t == self.t:
            return self.x
        self._check(self._c["CVodeGetDky"](self._memory, t, 0, self._dky))
        return self._dky_view.copy()

    def close(self) -> None:
        self._free()

    # -- callbacks ------------------------------------------------------------------------

    def _rhs(self, t: float, y: int, ydot: int, _data: object) -> int:
        problem, pointer = self.problem, self._c["N_VGetArrayPointer"]
        try:
            ctypes.memmove(self._x_address, pointer(y), 8 * problem.n)
            dx = problem.rhs_buffered(t)
            ctypes.memmove(pointer(ydot), self._dx_address, 8 * problem.n)
        except DiscardError as error:
            self._error = error
            return _RECOVERABLE
        except BaseException as error:  # noqa: BLE001  C code lies between here and the caller
            self._error = error
            return _FAILED
        return 0 if math.isfinite(dx.sum()) else _RECOVERABLE

    def _roots(self, t: float, y: int, out: int, _data: object) -> int:
        problem = self.problem
        try:
            ctypes.memmove(self._x_address, self._c["N_VGetArrayPointer"](y), 8 * problem.n)
            problem.put_buffered(t)
            problem.instance.get_indicators()
            # FMI's domains are > 0 and ≤ 0; CVODE looks for changes of sign and stops on 0.
            z = problem.z
            if not z.all():
                z[z == 0.0] = -_TINY
            ctypes.memmove(out, self._z_address, 8 * problem.nz)
        except BaseException as error:  # noqa: BLE001  the same
            self._error = error
            return _FAILED
        return 0

    def _weights(self, y: int, out: int, _data: object) -> int:
        """Write 1/(rtol · (|y| + scale)); CVODE asks once a step."""
        n, pointer = self.problem.n, self._c["N_VGetArrayPointer"]
        _view(pointer(out), n)[:] = 1.0 / self.tolerance.allowed(STRICTER * self.tolerance.rtol, _view(pointer(y), n))
        return 0

    def _take_words(
        self, _line: int, _function: bytes, _file: bytes, message: bytes, _code: int, _user: object, _context: object
    ) -> None:
        self._words = one_line((message or b"").decode("utf-8", "replace"))

    def _check(self, flag: int) -> None:
        if flag >= 0:
            return
        error, self._error = self._error, None
        if error is not None:
            raise error
        words = self._words or f"error {flag}"
        raise SimulationError(f"gear: CVODE cannot continue: {words}", time=self.t)


def _view(address: int, n: int) -> Floats:
    array: Floats = np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), (n,))
    return array


def _free(
    c: Mapping[str, Callable[..., Any]],
    memory: ctypes.c_void_p,
    context: ctypes.c_void_p,
    owned: tuple[tuple[str, Any], ...],
) -> None:
    c["CVodeFree"](ctypes.byref(memory))
    for function, pointer in owned:
        c[function](pointer)
    c["SUNContext_Free"](ctypes.byref(context))
