"""Where stability changes along lines of the map: critical values that `modes` and `limit-cycle` find."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from workbench.study.description import Envelope, GridPoint, Study
from workbench.study.envelope.result import Border
from workbench.study.envelope.sampling import point_of

__all__ = ["border_points", "borders_in"]

_MODES = {"flutter": "Hopf", "divergence": "real pole"}


def border_points(study: Study, envelope: Envelope) -> list[GridPoint]:
    """Return the points at which the analyses of borders run: lines of the map, all other parameters in their middle.

    Args:
        study: that it belongs to.
        envelope: what it asks for.
    """
    first, *second = envelope.axes
    along = [float(x) for x in np.linspace(0.0, 1.0, envelope.lines)] if second else [0.0]
    result = []
    failures: list[str | None] = [*study.configurations] or [None]
    for failure in failures:
        for place in along:
            values = [s.across(place) if s.name in second else s.middle for s in envelope.spreads]
            point = point_of(study, envelope.spreads, failure, values)
            kept = {name: value for name, value in point.values.items() if name != first}
            result.append(GridPoint(configuration=failure, values=kept))
    return result


def borders_in(result: Mapping[str, Any], analysis: str, point: GridPoint, axes: Sequence[str]) -> Iterator[Border]:
    """Yield the borders in a result.

    Args:
        result: of `modes` or of `limit-cycle`, as JSON has it.
        analysis: its name.
        point: where it was run.
        axes: of the map.
    """
    given = point.values[axes[1]] if len(axes) > 1 else None
    line = float(given) if given is not None else None

    def border(kind: str, at: float, words: str) -> Border:
        failure = point.configuration
        return Border(analysis=analysis, failure=failure, kind=kind, at=at, line=line, words=words)

    for modes in result.get("sets", [])[:1]:  # the others are what it was compared with
        for c in modes["critical"]:
            frequency = f"{c['frequency_hz']:.4g} Hz, " if c["frequency_hz"] else ""
            yield border(_MODES[c["kind"]], c["value"], f"mode {c['mode']}, {frequency}becomes {c['becomes']}")
    for branch in result.get("branches", []):
        for key, kind in (("folds", "fold"), ("hopf", "cycle born"), ("bifurcations", "")):
            for p in branch[key]:
                yield border(
                    kind or p["kind"], p["value"], f"{p['frequency_hz']:.4g} Hz, amplitude {p['amplitude']:.4g}"
                )
