"""The rows that a run records, as the kernel's structures."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.fmi.c_array import c_array
from workbench.fmi.variable import Variable
from workbench.kernel.native_access import join_access, native_access
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Fourier, RecordStruct

__all__ = ["NativeFourier", "NativeRecord"]

Recorded = tuple[Variable, int]  # variable, component


class NativeRecord:
    """What is recorded; made once for each list of variables. `close` frees its rows.

    Args:
        system: what is driven.
        variables: the components' variables.
        shown: what the session calls them; None: as the components do.
    """

    def __init__(
        self, system: NativeSystem, variables: Sequence[Recorded], shown: Sequence[Variable] | None = None
    ) -> None:
        self._library = system.library
        self.variables = tuple(variable for variable, _ in variables) if shown is None else tuple(shown)
        parts = []
        for owner in dict.fromkeys(c for _, c in variables):
            columns = [i for i, (_, c) in enumerate(variables) if c == owner]
            access = system.instances[owner].access([variables[i][0] for i in columns])
            parts.append(native_access(access, columns=columns, component=owner))
        native, self._kept = join_access(parts)
        self.structure = RecordStruct(access=native, n_values=len(variables), bound=math.inf, keep=1, every=1)
        self.address = ctypes.addressof(self.structure)
        self._declared = all(_no_feedthrough(system, variable, owner) for variable, owner in variables)

    def trust_declaration(self) -> None:
        """Let the kernel make use of what the file says about feed-through; it checks that in each run."""
        self.structure.no_feedthrough = self._declared

    def columns(self) -> Floats:
        """Return the rows as shape (1 + inputs + variables, n): time, forced inputs, recorded values."""
        table: Floats = np.empty((self.structure.width, self.structure.rows))
        self._library.kernel_record_columns(self.address, table.__array_interface__["data"][0])
        return table

    def close(self) -> None:
        """Free the rows."""
        self._library.kernel_record_free(self.address)

    def __del__(self) -> None:
        self.close()


def _no_feedthrough(system: NativeSystem, variable: Variable, owner: int) -> bool:
    """Whether the file says that an output follows its inputs by way of states only."""
    instance = system.instances[owner]
    if instance.event_mode or len(system.instances) > 1:
        return False
    if variable.causality != "output" or variable.dependencies is None:
        return False
    return instance.description.input_names.isdisjoint(variable.dependencies)


_NODES = 8  # of a signal, kept in `Fourier.nodes`


class NativeFourier:
    """Fourier sums over rows; the integrals of `workbench.response.periodic.fourier.measure_period`.

    Args:
        library: the kernel.
        columns: positions of the signals in a row; time is column 0.
        begin: time at which the phase is zero [s].
        frequency: [Hz].
        orders: number of harmonics.
    """

    def __init__(
        self, library: ctypes.CDLL, columns: Sequence[int], *, begin: float, frequency: float, orders: int
    ) -> None:
        self._library = library
        n, width = len(columns), 1 + 2 * orders
        self._columns = c_array(ctypes.c_size_t, columns)
        sizes = {"basis": width, "between": width, "weights": width, "sums": n * width}
        sizes |= {"first": n, "node": n, "last": n, "largest": n, "jumped": n, "nodes": _NODES * n, "rough": n}
        self._memory = {name: np.zeros(size) for name, size in sizes.items()}
        self._shape = (n, width)
        self._known: tuple[Floats, Floats | None] | None = None
        self.structure = Fourier(
            begin=begin,
            frequency=frequency,
            orders=orders,
            n=n,
            columns=ctypes.addressof(self._columns),
            **{name: array.ctypes.data for name, array in self._memory.items()},
        )
        self.address = ctypes.addressof(self.structure)

    def aim(
        self,
        *,
        begin: float,
        frequency: float,
        known: tuple[Floats, Floats | None] | None = None,
        grid: bool = False,
    ) -> None:
        """Take another begin [s] and frequency [Hz].

        Args:
            begin: time at which the phase is zero [s].
            frequency: [Hz].
            known: rising times, shape (m,) [s], and 1, sin, cos, sin 2, … there, shape (m, 1 + 2 orders), or None.
            grid: whether the first row and these times are an even grid, and rows between them only tell of jumps.
        """
        structure = self.structure
        structure.begin, structure.frequency = begin, frequency
        self._known = known  # must live as long as the kernel looks at it
        structure.n_known = 0 if known is None else len(known[0])
        structure.grid = grid and known is not None
        if known is not None:
            times, basis = known
            structure.known_times = times.__array_interface__["data"][0]
            structure.known = None if basis is None else basis.__array_interface__["data"][0]

    @property
    def gap(self) -> float:
        """Largest distance of two rows [s]."""
        return float(self.structure.longest)

    @property
    def largest(self) -> Floats:
        """Largest magnitude of each signal, shape (n,)."""
        return self._memory["largest"].copy()

    @property
    def rough(self) -> Floats:
        """What edges that were not resolved may put into a coefficient of each signal, shape (n,)."""
        result: Floats = np.empty(self._shape[0])
        self._library.kernel_fourier_rough(self.address, result.ctypes.data)
        return result

    def of_rows(self, rows: Floats) -> Floats:
        """Return the coefficients of `rows`, shape (rows, columns), as shape (n, 1 + 2 orders)."""
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        result: Floats = np.empty(self._shape)
        self._library.kernel_fourier(self.address, rows.ctypes.data, *rows.shape, result.ctypes.data)
        return result

    def result(self) -> Floats:
        """Return the coefficients of the rows seen in a run, shape (n, 1 + 2 orders)."""
        result: Floats = np.empty(self._shape)
        self._library.kernel_fourier_result(self.address, result.ctypes.data)
        return result
