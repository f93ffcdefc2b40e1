"""Recorded input and output data: what identification works on."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.core.records.csv_file import write_csv
from workbench.core.records.parsing import from_json
from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.closed_loop import ClosedLoop
from workbench.core.values.conversion import known_unit, named_conversion
from workbench.data.experiment.checks import (
    EXACT,
    check_choice,
    check_finite,
    columns,
    filled,
    names_of,
    regular,
    times,
    units_of,
)
from workbench.data.experiment.formats import DataTable, read_columns
from workbench.errors import InputError, suggest

__all__ = ["Experiment", "make_experiment", "read_experiment", "read_pieces", "read_signals"]

Indices = NDArray[np.intp]

_SIDES = {"input": "u", "output": "y"}
_LOOP = "# closed loop "  # before its description as JSON, in a line of a CSV file
_TIME_NAMES = ("time", "t", "times", "zeit")
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True, eq=False)
class Experiment(RecordPart):
    """Equidistant samples of inputs and outputs.

    u[k] is held over [time[k], time[k+1]); y[k] is the output at time[k], right after u[k] took
    effect. Make one with `make_experiment` or `read_experiment`, which check the numbers.

    Attributes:
        time: shape (n,) [s].
        u: inputs, shape (n, m).
        y: outputs, shape (n, p).
        input_names, output_names: names of the columns.
        input_units, output_units: None where there is none.
        name: model or file the data come from.
        notes: what was bent or decided on the way.
        loops: closed loops of the system that the data come from, as far as is known.
    """

    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    u: Floats = field(metadata=entry(dims=("time", "input_names"), named=True))
    y: Floats = field(metadata=entry(dims=("time", "output_names"), named=True))
    input_names: tuple[str, ...] = field(metadata=entry(kept=False))
    output_names: tuple[str, ...] = field(metadata=entry(kept=False))
    input_units: tuple[str | None, ...] = field(metadata=entry(kept=False))
    output_units: tuple[str | None, ...] = field(metadata=entry(kept=False))
    name: str
    notes: tuple[str, ...] = ()
    loops: tuple[ClosedLoop, ...] = field(default=(), metadata=entry(key="closed_loops"))

    @property
    def dt(self) -> float:
        """The sampling interval [s]."""
        return float(f"{(self.time[-1] - self.time[0]) / (self.n_samples - 1):.12g}")

    @property
    def n_samples(self) -> int:
        """How many samples."""
        return len(self.time)

    @property
    def n_inputs(self) -> int:
        """How many inputs."""
        return int(self.u.shape[1])

    @property
    def n_outputs(self) -> int:
        """How many outputs."""
        return int(self.y.shape[1])

    @property
    def units(self) -> dict[str, str | None]:
        """Name of a column → unit."""
        return dict(zip(self.names, (*self.input_units, *self.output_units), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns, inputs first."""
        return (*self.input_names, *self.output_names)

    def part(self, first: int, last: int | None = None) -> Experiment:
        """Return the samples [first, last).

        Args:
            first: first of the samples that are kept, counted from 0.
            last: the first one after them; None: to the end.

        Raises:
            InputError: outside the data, or fewer than two samples left.
        """
        end = self.n_samples if last is None else last
        if not 0 <= first < end <= self.n_samples:
            raise InputError(f"{self.name}: there is no part {first} … {end} of {self.n_samples} samples")
        if end - first < 2:
            raise InputError(f"{self.name}: a part needs at least two samples, not {end - first}")
        chosen = slice(first, end)
        return replace(self, time=self.time[chosen], u=self.u[chosen], y=self.y[chosen])

    def select(self, inputs: Sequence[str], outputs: Sequence[str]) -> Experiment:
        """Return the experiment with these columns, in this order.

        A measured output may serve as the input of what comes behind it, and the other way round.

        Args:
            inputs: names of the columns that force.
            outputs: names of the columns that follow.

        Raises:
            InputError: no such column, none at all, a column both input and output.
        """
        check_choice(self.name, inputs, outputs, self.names)
        every = dict(zip(self.names, np.hstack([self.u, self.y]).T, strict=True))
        units = self.units
        return replace(
            self,
            u=np.column_stack([every[n] for n in inputs]),
            y=np.column_stack([every[n] for n in outputs]),
            input_names=tuple(inputs),
            output_names=tuple(outputs),
            input_units=tuple(units[n] for n in inputs),
            output_units=tuple(units[n] for n in outputs),
        )

    def in_units(self, units: Mapping[str, str | None]) -> Experiment:
        """Return the experiment in other units, its numbers converted; the notes tell which.

        A column without a unit is taken to be in the one that is wanted, which a note says.

        Args:
            units: column → unit that is wanted; None, or a column left out: its own.

        Raises:
            InputError: a unit that is not known, or not comparable with the column's own.

        Examples:
            >>> import numpy as np
            >>> data = wb.make_experiment(0.1, [0.0, 180.0], [0.0, 1.0], input_names=["u"], input_units=["deg"])
            >>> print((data.in_units({"u": "rad"}).u[1] / np.pi).round(9))
            [1.]
        """
        sides = {"input": self.u.copy(), "output": self.y.copy()}
        notes, result = [], {}
        for side, values in sides.items():
            named = zip(getattr(self, f"{side}_names"), getattr(self, f"{side}_units"), strict=True)
            for k, (name, own) in enumerate(named):
                wanted = result[name] = units.get(name) or own
                if own is None and wanted not in (None, "1"):
                    notes.append(f"{self.name}: {name} has no unit; it is taken to be in {wanted}")
                elif own != wanted and own is not None and wanted is not None:
                    factor, offset = self._conversion(name, own, wanted)
                    values[:, k] = factor * values[:, k] + offset
                    notes.append(f"{self.name}: {name} is converted from {own} to {wanted}")
        return replace(
            self, u=sides["input"], y=sides["output"], notes=(*self.notes, *notes),
            input_units=tuple(result[n] for n in self.input_names),
            output_units=tuple(result[n] for n in self.output_names),
        )  # fmt: skip

    def _conversion(self, name: str, own: str, wanted: str) -> tuple[float, float]:
        result = named_conversion(own, wanted)
        if result is None:
            unknown = [unit for unit in (own, wanted) if known_unit(unit) is None]
            why = f"the unit '{unknown[0]}' is not known" if unknown else "they do not measure the same"
            raise InputError(f"{self.name}: {name} is in '{own}', and is needed in '{wanted}': {why}; convert the data")
        return result

    def with_data(
        self, *, u: Floats | None = None, y: Floats | None = None, time: Floats | None = None, note: str | None = None
    ) -> Experiment:
        """Return the experiment with other numbers under the same names.

        Args:
            u: shape (n, m).
            y: shape (n, p).
            time: shape (n,) [s].
            note: what was done, added to the notes.

        Raises:
            InputError: as `make_experiment`.
        """
        return make_experiment(
            self.time if time is None else time,
            self.u if u is None else u,
            self.y if y is None else y,
            input_names=self.input_names,
            output_names=self.output_names,
            input_units=self.input_units,
            output_units=self.output_units,
            name=self.name,
            notes=self.notes if note is None else (*self.notes, note),
            loops=self.loops,
        )

    def derived(self) -> dict[str, Any]:
        """Return sampling interval and units."""
        return {"dt": self.dt, "units": self.units}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the names and units of the channels."""
        names = {f"{side}_names": tuple(data[key]) for side, key in _SIDES.items()}
        units = {f"{side}_units": [data["units"][name] for name in data[key]] for side, key in _SIDES.items()}
        return {**data, **names, **units}

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write time, inputs and outputs as columns headed "name [unit]".

        Data out of a closed loop say so in a remark before, a line that begins with "# closed loop".

        Args:
            path: path of the file, or an open stream.

        Raises:
            InputError: the file cannot be written.
        """
        remarks = [f"{_LOOP}{json.dumps(loop.to_dict(), ensure_ascii=False)}" for loop in self.loops]
        write_csv(path, self.rows(), remarks=remarks)

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each sample: time, inputs and outputs, headed "name [unit]"."""
        yield ["time [s]", *(n if unit is None else f"{n} [{unit}]" for n, unit in self.units.items())]
        yield from np.column_stack([self.time, self.u, self.y]).tolist()


def make_experiment(
    time_or_dt: ArrayLike | float,
    u: ArrayLike,
    y: ArrayLike,
    *,
    input_names: Sequence[str] | None = None,
    output_names: Sequence[str] | None = None,
    input_units: Sequence[str | None] | None = None,
    output_units: Sequence[str | None] | None = None,
    name: str = "data",
    notes: Sequence[str] = (),
    loops: Sequence[ClosedLoop] = (),
) -> Experiment:
    """Return checked data; nothing of the caller's is changed or kept.

    Args:
        time_or_dt: sampling interval [s], or the times themselves, shape (n,) [s].
        u: inputs, shape (n, m) or (n,).
        y: outputs, shape (n, p) or (n,).
        input_names: None: u1, u2, …; u alone where there is one.
        output_names: None: y1, y2, …; y alone where there is one.
        input_units: None: none.
        output_units: None: none.
        name: what the data come from, for messages.
        notes: remarks to keep with the data.
        loops: closed loops of the system that they come from.

    Raises:
        InputError: unequal lengths, fewer than two samples, a number that is not finite, times
            that are not equidistant, names or units not as many as columns, a name given twice.

    Examples:
        >>> data = wb.make_experiment(0.1, u=[0, 1, 1, 0], y=[0, 0, 2, 2], input_names=["u"], output_names=["y"])
        >>> print(data.n_samples, data.time[-1].round(3))
        4 0.3
    """
    inputs, outputs = columns("u", u), columns("y", y)
    if len(inputs) != len(outputs):
        raise InputError(f"{name}: u has {len(inputs)} samples and y {len(outputs)}; the numbers must be equal")
    if len(inputs) < 2:
        few = "1 sample is" if len(inputs) == 1 else f"{len(inputs)} samples are"
        raise InputError(f"{name}: {few} too few; at least two are needed")
    u_names = names_of("u", input_names, inputs.shape[1])
    y_names = names_of("y", output_names, outputs.shape[1])
    twice = sorted({n for n in (*u_names, *y_names) if (*u_names, *y_names).count(n) > 1})
    if twice:
        raise InputError(f"{name}: the name '{twice[0]}' is given twice")
    time, remark = times(name, time_or_dt, len(inputs))
    for kind, names, values in (("input", u_names, inputs), ("output", y_names, outputs)):
        check_finite(name, kind, names, values, time)
    return Experiment(
        time=time,
        u=inputs,
        y=outputs,
        input_names=u_names,
        output_names=y_names,
        input_units=units_of("input", input_units, inputs.shape[1]),
        output_units=units_of("output", output_units, outputs.shape[1]),
        name=name,
        notes=(*notes, *remark),
        loops=tuple(loops),
    )


def read_experiment(
    path: str | Path,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    dt: float | None = None,
) -> Experiment:
    """Read recorded data from a file: CSV, MATLAB, Parquet, Feather or MDF, see `formats.read_columns`.

    The first line of a CSV file names the columns, each with its unit: "time [s],stick [1],elevator [deg]".
    Files of other tools are read too: see `read_table`; what was bent is in `notes`.

    Args:
        path: path of the file.
        inputs: columns that force; None: all that are not outputs.
        outputs: columns that follow; None: all that are not inputs. Without both, the file must have
            two columns besides time: the first one is the input.
        dt: sampling interval [s]; needed where there is no time column. Where there is one with
            another spacing, the data are put on this grid: inputs held, outputs linear.

    Raises:
        InputError: no such file or column, no table, no time, not equidistant, a cell that is not a number.

    Examples:
        >>> data = wb.make_experiment(0.1, u=[0, 1, 1, 0], y=[0, 0, 2, 2], input_names=["u"], output_names=["y"])
        >>> data.to_csv("data.csv")
        >>> print(wb.read_experiment("data.csv").y[:, 0])
        [0. 0. 2. 2.]
    """
    return _read(path, inputs, outputs, dt, repair=False)[0]


def read_pieces(
    path: str | Path,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    dt: float | None = None,
) -> tuple[Experiment, ...]:
    """Read recorded data from a file in which samples are missing.

    Empty cells, NaN and left out rows are gaps. Short ones (5 samples) are filled, outputs linear and inputs held;
    longer ones divide the data.

    Args:
        path: path of the file.
        inputs: as for `read_experiment`.
        outputs: likewise.
        dt: likewise.

    Raises:
        InputError: as `read_experiment`; no piece is long enough.
    """
    return _read(path, inputs, outputs, dt, repair=True)


def _read(
    path: str | Path, inputs: Sequence[str] | None, outputs: Sequence[str] | None, dt: float | None, *, repair: bool
) -> tuple[Experiment, ...]:
    table = read_columns(path)
    name = Path(path).name
    notes = list(table.notes)
    clock, signals = _signals(table)
    chosen = _choose(name, signals, inputs, outputs, notes)
    time, keep = _clock(name, table, clock, dt, notes)
    u, y = (_take(table, names)[keep] for names in chosen)
    pieces = [(slice(0, len(u)), u, y)]
    if repair:
        time, every, absent = regular(time, np.hstack([u, y]))
        notes += [f"{name}: {absent} rows are missing"] if absent else []
        pieces, done = filled(name, every[:, : u.shape[1]], every[:, u.shape[1] :])
        notes += done
    units = dict(zip(table.names, table.units, strict=True))
    loops = [_loop(name, text) for text in table.remarks if text.startswith(_LOOP)]
    result = []
    for part, inside, outside in pieces:
        at, own, given, followed = time[part], list(notes), inside, outside
        if dt is not None and clock is not None and not _lies_on(name, at, dt):
            own.append(f"{name}: put on a grid of {dt:g} s, inputs held and outputs linear between the samples")
            at, given, followed = _on_grid(at, given, followed, dt)
        result.append(
            make_experiment(
                at if clock is not None else float(dt or 0.0),
                given,
                followed,
                input_names=chosen[0],
                output_names=chosen[1],
                input_units=[units[n] for n in chosen[0]],
                output_units=[units[n] for n in chosen[1]],
                name=name,
                notes=own,
                loops=loops,
            )
        )
    return tuple(result)


def _signals(table: DataTable) -> tuple[int | None, list[str]]:
    """Return which column is the time, None: there is none, and the names of the others."""
    clock = next((i for i, n in enumerate(table.names) if n.casefold() in _TIME_NAMES), None)
    return clock, [n for i, n in enumerate(table.names) if i != clock]


def read_signals(path: str | Path, *, dt: float | None = None) -> Experiment:
    """Read all signals of a file as outputs, as they are: NaN where one is missing, at the times that were recorded.

    Args:
        path: path of the file.
        dt: sampling interval [s] of a file without a time column.

    Raises:
        InputError: no such file, no table, no time; times that are not finite or do not rise.
    """
    table = read_columns(path)
    name = Path(path).name
    notes = list(table.notes)
    clock, names = _signals(table)
    time, keep = _clock(name, table, clock, dt, notes)
    if clock is None:
        time = time * float(dt or 1.0)
    if len(time) < 2 or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0.0):
        raise InputError(f"{name}: needs two times or more, finite and rising")
    units = dict(zip(table.names, table.units, strict=True))
    return Experiment(
        time=time, u=np.empty((len(time), 0)), y=_take(table, names)[keep], input_names=(), output_names=tuple(names),
        input_units=(), output_units=tuple(units[n] for n in names), name=name, notes=tuple(notes),
    )  # fmt: skip


def _loop(name: str, remark: str) -> ClosedLoop:
    try:
        return ClosedLoop.from_dict(from_json(remark.removeprefix(_LOOP)))
    except (ValueError, InputError):
        raise InputError(
            f"{name}: cannot read the comment '{remark}'; remove the line, or record the data again"
        ) from None


def _choose(
    name: str, known: Sequence[str], inputs: Sequence[str] | None, outputs: Sequence[str] | None, notes: list[str]
) -> tuple[list[str], list[str]]:
    if inputs is None and outputs is None:
        if len(known) != 2:
            listed = ", ".join(known[:8]) or "none"
            raise InputError(f"{name}: which columns are inputs? Name inputs and outputs; columns: {listed}")
        notes.append(f"{name}: '{known[0]}' is taken as the input and '{known[1]}' as the output")
        return [known[0]], [known[1]]
    for column in (*(inputs or ()), *(outputs or ())):
        if column not in known:
            raise InputError(f"{name}: there is no column '{column}'; {suggest(column, known)}")
    forcing = [c for c in known if c not in (outputs or ())] if inputs is None else list(inputs)
    following = [c for c in known if c not in forcing] if outputs is None else list(outputs)
    check_choice(name, forcing, following, known)
    return forcing, following


def _take(table: DataTable, names: Sequence[str]) -> Floats:
    return table.values[:, [table.names.index(n) for n in names]]


def _clock(
    name: str, table: DataTable, clock: int | None, dt: float | None, notes: list[str]
) -> tuple[Floats, Indices]:
    """Return the times [s] and the rows to keep: of two rows at one time (an event), the second."""
    if clock is None and dt is None:
        raise InputError(f"{name}: has no time column; give the sampling interval dt, or name a column 'time [s]'")
    if clock is None:
        return np.arange(len(table.values), dtype=np.float64), np.arange(len(table.values))
    unit = table.units[clock]
    factor = 1.0 if unit is None else _SECONDS.get(unit.casefold(), 0.0)
    if not factor:
        raise InputError(f"{name}: time is in '{unit}'; known: {', '.join(_SECONDS)}")
    if factor != 1.0:
        notes.append(f"{name}: time was converted from {unit} to s")
    time = factor * table.values[:, clock]
    keep = np.flatnonzero(np.append(np.diff(time) != 0.0, True))
    if len(keep) < len(time):
        again = np.flatnonzero(np.diff(time) == 0.0)
        others = np.delete(table.values, clock, axis=1)
        count = len(np.unique(time[again[~_same_rows(others[again], others[again + 1])]]))
        if count:
            rows = (
                "1 time appears twice with other values (an event); the later row is"
                if count == 1
                else f"{count} times appear twice with other values (events); the later rows are"
            )
            notes.append(f"{name}: {rows} used")
    return time[keep], keep


def _same_rows(a: Floats, b: Floats) -> NDArray[np.bool_]:
    return np.asarray(((a == b) | (np.isnan(a) & np.isnan(b))).all(axis=1), dtype=np.bool_)


def _lies_on(name: str, time: Floats, dt: float) -> bool:
    """Return whether the data have this spacing, or none that could be changed."""
    if not (math.isfinite(dt) and dt > 0.0):
        raise InputError(f"{name}: the sampling interval must be positive, not {dt:g} s")
    if len(time) < 2 or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0.0):
        return True  # refused with its place where times are checked
    return bool(np.max(np.abs(time - time[0] - dt * np.arange(len(time)))) <= EXACT * dt)


def _on_grid(time: Floats, u: Floats, y: Floats, dt: float) -> tuple[Floats, Floats, Floats]:
    count = math.floor((time[-1] - time[0]) / dt + 1e-9) + 1
    grid = time[0] + dt * np.arange(count)
    last = np.clip(np.searchsorted(time, grid + 1e-9 * dt, side="right") - 1, 0, len(time) - 1)
    return grid, u[last], np.column_stack([np.interp(grid, time, column) for column in y.T])
