"""A record of any class, made of the types of its fields; every axis has two elements, so that all shapes fit."""

# ruff: noqa: ANN401 - of any type
from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from scripts.reproduce.targets import PublishedTarget
from workbench.core.records.record import spelled_out
from workbench.response.compare.measures import Measure
from workbench.response.compare.result import Motion
from workbench.response.compare.units import DisplayedUnit


def linear(kind: str) -> dict[str, Any]:
    """Return matrices and names of a linear model that fit each other."""
    n = 1 if kind == "part" else 2
    return {
        "A": np.array([[-1.0, 0.5], [0.0, -2.0]]),
        "B": np.arange(2.0 * n).reshape(2, n) + 1.0,
        "C": np.arange(2.0 * n).reshape(n, 2) + 5.0,
        "D": np.arange(1.0 * n * n).reshape(n, n) + 0.25,
        "state_names": ("x1", "x2"),
        "input_names": ("u", "v")[:n],
        "output_names": ("y", "z")[:n],
    }


def _measure(size: float) -> Measure:
    return Measure(peak=size, peak_time=0.5, rms=0.1, mean=0.0, half_range=size)


RESPONSE = np.array([[1.0 + 1.0j, -2.0j], [3.0 - 0.5j, -4.0 + 0.1j]])
TARGET = PublishedTarget(
    name="gain", chapter="4.1", figures=[3], what="gain", value=2.0, relative=0.1, basis="predicted"
)
RECORDED = {
    "time": np.array([0.0, 1.0, 2.0]),
    "signals": {"handed to the target": np.array([0.0, 1.0, 0.5]), "watched": np.array([1.0, -0.5, 0.25])},
}
# Class → what cannot be made of the types of its fields alone.
GIVEN: dict[str, dict[str, Any]] = {
    "Certificate": {"harmonics": (0.125,) * 9},
    "Coherence": {"multiple": np.full((2, 2), 0.5), "ordinary": np.full((2, 2, 2), 0.25)},
    "FeedbackRun": {**RECORDED, "watch": "watched", "closes_at": 1.0, "frequency_hz": 1.0},
    "Drawing": {"svg": ""},
    "FeedbackResult": {"target_unit": "deg"},
    "Finding": {"topic": "feedback", "verdict": "good"},
    "FitResult": {**linear("whole"), "of_output": np.array([0, 1]), "of_input": np.array([0, 0])},
    "HealthLine": {"verdict": "good"},
    "IdentifiedModel": {**linear("whole"), "input_units": ("A", None), "output_units": ("m", "m")},
    "LinResult": linear("whole"),
    "LinearPart": linear("part"),
    "DelayFreePart": {
        "A": np.array([[-1.0, 0.5], [0.25, -2.0]]),
        "B": np.arange(6.0).reshape(2, 3) + 1.0,
        "C": np.arange(6.0).reshape(3, 2) + 5.0,
        "D": np.zeros((3, 3)),
        "times": np.array([0.25, 0.5]),
    },
    "MotionComparison": {
        "systems": ("one", "two"),
        "signals": ("x", "y"),
        "windows": ((0.0, 1.0), (1.0, 2.0)),
        "units": {"x": "m", "y": None},
        "shown": {"x": DisplayedUnit(unit="mm", factor=1000.0), "y": DisplayedUnit(unit=None, factor=1.0)},
        "motions": tuple(
            Motion(
                system=name,
                signal="x",
                window=0,
                measure=_measure(size),
            )
            for name, size in (("one", 2.0), ("two", 3.0))
        ),
        "histories": (),  # which files do not hold
    },
    "NfrResult": {
        "response": RESPONSE,
        "phase_deg": np.degrees(np.angle(RESPONSE)),
        "stable": np.array([[1.0, 0.0], [np.nan, 1.0]]),
    },
    "TargetResult": {"target": TARGET},
    "PoleRegion": {"shape": np.diag([4.0, 1.0])},
    "SettlingStudy": {"target_unit": "deg"},
    "SimulatedCycle": {"states": {}, "sizes": {}},  # which files do not hold
    "InitialMotion": {"signals": {}},
    "TargetList": {"targets": (TARGET,)},
    "VaryingModel": {
        "grid": {"p": (1.0, 2.0)},
        "state_names": ("x",),
        "input_names": ("u",),
        "output_names": ("y",),
        **{name: np.array([[[0.5]], [[1.5]]]) for name in "ABCD"},
        **{name: np.array([[2.5], [3.5]]) for name in ("x0", "u0", "y0")},
    },
    "WindowSettings": {"window": "hann", "length": 8, "overlap": 0.5, "averages": 3},
}


class Maker:
    """Makes values: all different, so that none can stand for another.

    Args:
        empty: None where that is allowed, and NaN for other numbers.
    """

    def __init__(self, *, empty: bool) -> None:
        self.empty = empty
        self._counter: Iterator[int] = itertools.count(1)
        self._around: list[Any] = []  # kinds that are being made: none holds one of its own kind

    def record(self, kind: Any, **given: Any) -> Any:
        """Return an instance of a dataclass, with some fields as they are given."""
        hints, given = get_type_hints(kind), {**GIVEN.get(kind.__name__, {}), **given}
        self._around.append(kind)
        made = {
            f.name: given[f.name] if f.name in given else self.value(hints[f.name], f.metadata)
            for f in fields(kind)
            if f.init
        }
        self._around.pop()
        return kind(**made)

    def value(self, kind: Any, said: Mapping[str, Any]) -> Any:  # noqa: PLR0911 - a type each
        """Return a value of a type; `said` is the metadata of its field."""
        kind = spelled_out(kind)
        base: Any = get_origin(kind) or kind
        inner = get_args(kind)
        if base in (Union, UnionType):
            if self.empty and NoneType in inner:
                return None
            return self.value(next(k for k in inner if k is not NoneType), said)
        if base is Literal:
            return inner[0]
        if base.__name__ == "ndarray":
            return self.array(np.dtype(get_args(inner[1])[0]), len(said.get("dims", ())) or 1)
        if is_dataclass(base):
            return self.record(base)
        if base is tuple:
            if inner[0] in self._around:
                return ()
            kinds = (inner[0], inner[0]) if inner[1:] == (...,) else inner
            return tuple(self.value(k, said) for k in kinds)
        if issubclass(base, Mapping):
            return {self.value(inner[0], {}): self.value(inner[1], said) for _ in range(2)}
        return self.simple(base)

    def simple(self, kind: Any) -> Any:
        """Return a number or a text."""
        number = next(self._counter)
        known: dict[Any, Any] = {
            float: number + 0.5,
            int: number,
            bool: bool(number % 2),
            str: f"text {number}",
            complex: complex(number, -number),
            Path: Path(f"file {number}"),
            object: number,
            Any: number,
        }
        return known[kind]

    def array(self, dtype: np.dtype[Any], ndim: int) -> Any:
        """Return an array with two elements along each axis; with `empty` the last number is NaN."""
        made = np.array([next(self._counter) + 0.25 for _ in range(2**ndim)]).reshape((2,) * ndim).astype(dtype)
        if dtype.kind == "c":
            made += 0.5j
        if self.empty and dtype.kind in "fc":
            made.flat[-1] = complex(math.nan, math.nan) if dtype.kind == "c" else math.nan
        return made
