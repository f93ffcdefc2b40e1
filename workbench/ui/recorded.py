"""Recorded data as a page looks at them: their channels, and the signals over any stretch of time."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import plain
from workbench.core.values.arrays import Floats
from workbench.ui.curves import of_response

# As in `curves`: the page is there before the readers are.
if TYPE_CHECKING:
    from workbench.data.experiment.experiment import Experiment

__all__ = ["Recordings", "thinned"]

_KEPT = 3  # files that are kept read
_BINS = 1000  # of a signal that has more samples, each with its smallest and largest value
_EVEN = 1e-6  # relative: intervals that differ by less are equal


class Recordings:
    """Files of recorded data, the last ones kept in memory."""

    def __init__(self) -> None:
        self._read: OrderedDict[tuple[Any, ...], Experiment] = OrderedDict()
        self._lock = threading.Lock()

    def told(
        self, path: Path, *, dt: float | None = None, channels: Sequence[str] = (), begin: float | None = None,
        end: float | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Return what a file holds, ready for JSON.

        `curves`: the frequency responses, where it is a table of such; else `time` (`begin`, `end`, `samples`, `dt`,
        None: not equidistant), `channels` (`name`, `unit`, `least`, `most`, `mean`, `missing`, `values`: number of
        different ones), `notes`, and `signals`: channel → `x` and `y` between `begin` and `end`, see `thinned`.

        Args:
            path: of the file.
            dt: sampling interval of a file without times [s].
            channels: whose signals are wanted.
            begin: of the stretch [s]; None: the first sample.
            end: of it; None: the last sample.

        Raises:
            InputError: it cannot be read, or has no times and dt is not given.
        """
        from workbench.identification.fit.reading import is_response, measured  # noqa: PLC0415 - as above
        from workbench.identification.fit.request import Fit  # noqa: PLC0415

        if is_response(path):
            responses = measured(path, Fit())
            curves = [of_response(c, f"{c.output or 'y'} by {c.input or 'u'}", "measured") for c in responses.curves]
            return {"curves": [plain(curve) for curve in curves]}
        data = self._data(path, dt)
        columns = dict(zip(data.output_names, data.y.T, strict=True))
        first = data.time[0] if begin is None else begin
        last = data.time[-1] if end is None else end
        signals = {n: thinned(data.time, columns[n], first, last) for n in channels if n in columns}
        result: dict[str, Any] = plain(
            {
                "time": _clock(data.time),
                "channels": [_channel(n, data.units[n], values) for n, values in columns.items()],
                "notes": data.notes,
                "signals": {n: {"x": x, "y": y} for n, (x, y) in signals.items()},
            }
        )
        return result

    def _data(self, path: Path, dt: float | None) -> Experiment:
        from workbench.data.experiment.experiment import read_signals  # noqa: PLC0415 - as above

        stat = path.stat()
        key = (path, stat.st_mtime_ns, stat.st_size, dt)
        with self._lock:
            if key not in self._read:
                self._read[key] = read_signals(path, dt=dt)
            self._read.move_to_end(key)
            while len(self._read) > _KEPT:
                self._read.popitem(last=False)
            return self._read[key]


def _clock(time: Floats) -> dict[str, Any]:
    steps = np.diff(time)
    mean = float(time[-1] - time[0]) / len(steps)
    even = bool(np.max(np.abs(steps - mean)) <= _EVEN * mean)
    return {"begin": time[0], "end": time[-1], "samples": len(time), "dt": float(f"{mean:.9g}") if even else None}


def _channel(name: str, unit: str | None, values: Floats) -> dict[str, Any]:
    known = values[np.isfinite(values)]
    numbers = {} if not known.size else {"least": known.min(), "most": known.max(), "mean": known.mean()}
    return {
        "name": name, "unit": unit or "", "least": None, "most": None, "mean": None, **numbers,
        "missing": len(values) - len(known), "values": len(np.unique(known[:100_000])),
    }  # fmt: skip


def thinned(time: Floats, values: Floats, begin: float, end: float, bins: int = _BINS) -> tuple[Floats, Floats]:
    """Return a signal between two times with the extremes of each of many bins, which a picture cannot tell from it.

    Of a stretch with fewer samples than two in each bin all are returned, and one beyond each end.

    Args:
        time: shape (n,), rising [s].
        values: shape (n,); NaN where one is missing.
        begin: of the stretch [s].
        end: of it [s].
        bins: how many.

    Examples:
        >>> import numpy as np
        >>> t = np.arange(1000.0)
        >>> x, y = thinned(t, np.where(t == 314.0, 9.0, 0.0), 0.0, 999.0, bins=10)
        >>> print(len(x), y.max(), x[y.argmax()])
        20 9.0 314.0
    """
    first = max(0, int(np.searchsorted(time, begin)) - 1)
    last = min(len(time), int(np.searchsorted(time, end, side="right")) + 1)
    t, v = time[first:last], values[first:last]
    if len(t) <= 2 * bins:
        return t, v
    edges = np.linspace(0, len(t), bins + 1).astype(np.intp)
    chosen = np.empty(2 * bins, dtype=np.intp)
    for k, (a, b) in enumerate(pairwise(edges)):
        part = v[a:b]
        ends = [a, a] if np.all(np.isnan(part)) else sorted((a + np.nanargmin(part), a + np.nanargmax(part)))
        chosen[2 * k : 2 * k + 2] = ends
    return t[chosen], v[chosen]
