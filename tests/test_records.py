"""Records: JSON, tables and frames that are derived from the fields."""

# ruff: noqa: ANN401 - of any type
from __future__ import annotations

import csv
import io
import json
import pkgutil
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

import workbench
from tests.platforms import needs_module
from tests.record_examples import Maker
from workbench.core.records.record import RecordPart, entry
from workbench.errors import InputError
from workbench.point.lin.result import LinResult
from workbench.response.nfr.result import NfrResult
from workbench.show.result import Result


@dataclass(frozen=True, kw_only=True)
class Corner(RecordPart):
    frequency_hz: float
    pole: complex
    words: str = ""

    def derived(self) -> dict[str, Any]:
        return {"stable": self.pole.real < 0.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep(Result):
    names: tuple[str, ...]
    time: NDArray[np.float64] = field(metadata=entry(dims=("time",), unit="s"))
    signals: dict[str, NDArray[np.float64]] = field(metadata=entry(dims=("time",)))
    units: dict[str, str | None]
    matrix: NDArray[np.float64] = field(metadata=entry(dims=("names", "inputs")))
    inputs: tuple[str, ...]
    response: NDArray[np.complex128]
    corners: tuple[Corner, ...] = field(default=(), metadata=entry(key="corner_points"))
    nearest: Corner | None = field(default=None, metadata=entry(inline=True))
    limits: dict[float, float | None] = field(default_factory=dict)
    hidden: object = field(default=None, metadata=entry(kept=False))

    _WHAT, _COMMAND = "a sweep", "sweep"


@dataclass(frozen=True, eq=False, kw_only=True)
class Nodes(Result):
    nodes: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0), metadata=entry(dims=("nodes",)))

    _WHAT, _COMMAND = "a list of nodes", "nodes"


def sweep(**changed: Any) -> Sweep:
    given: dict[str, Any] = {
        "names": ("a", "b"),
        "inputs": (),
        "time": np.array([0.0, 1.0, 2.0]),
        "signals": {"x": np.array([1.0, np.nan, 3.0]), "y": np.array([0.0, 0.5, np.inf])},
        "units": {"x": "m", "y": None},
        "matrix": np.zeros((2, 0)),
        "response": np.array([1.0 + 2.0j, complex(np.nan, np.nan)]),
        "corners": (Corner(frequency_hz=2.0, pole=-1 + 3j), Corner(frequency_hz=np.nan, pole=1j, words="twice")),
        "limits": {0.5: 1.0, 2.0: None},
    }
    return Sweep(**{**given, **changed})


def written(record: Result) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(json.dumps(record.to_dict(), allow_nan=False))
    return data


def test_the_keys_are_those_of_the_fields() -> None:
    data = written(sweep())
    assert data["time"] == [0.0, 1.0, 2.0]
    assert data["signals"] == {"x": [1.0, None, 3.0], "y": [0.0, 0.5, None]}
    assert data["response"] == [[1.0, 2.0], [None, None]]
    assert data["corner_points"][0] == {"frequency_hz": 2.0, "pole": [-1.0, 3.0], "words": "", "stable": True}
    assert data["limits"] == {"0.5": 1.0, "2": None}
    assert not {"hidden", "corners", "nearest"} & set(data)


def test_a_record_reads_its_own_json() -> None:
    first = sweep(signals={"x": np.array([1.0, np.nan, 3.0])}, nearest=Corner(frequency_hz=3.0, pole=1j))
    again = Sweep.from_dict({"command": "sweep", "seconds": 0.1, **written(first)})
    assert again.corners[0] == first.corners[0]
    assert np.isnan(again.corners[1].frequency_hz)
    assert again.nearest == first.nearest
    assert again.limits == first.limits
    np.testing.assert_array_equal(again.response, first.response)
    np.testing.assert_array_equal(again.signals["x"], first.signals["x"])
    assert again.matrix.shape == (2, 0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"time": None}, "is not a sweep: 'time' must be a list, not null"),
        ({"names": "ab"}, "is not a sweep: 'names' must be a list, not \"ab\"; workbench sweep --json writes one"),
        ({"names": ["a"], "matrix": [[1.0], [2.0]]}, r"'matrix' has the shape \(2, 1\), not \(1, 1\)"),
        ({"corner_points": [{"frequency_hz": 1.0}]}, "'corner_points.pole' is missing"),
        ({"limits": {"0.5": "high"}}, "'limits.0.5' must be a number, not \"high\""),
        ({"limits": {"0.5": 10**400}}, "'limits.0.5' is too large for a number"),
        ({"time": [0.0, 1.0, 10**400]}, "'time' is not an array of numbers: int too large"),
        ({"time": []}, r"'signals.x' has the shape \(3,\), not \(0,\)"),
    ],
)
def test_a_wrong_key_is_named(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Sweep.from_dict({**written(sweep()), **changed})


def test_an_axis_that_is_left_out_has_its_default_length() -> None:
    assert len(Nodes.from_dict({"command": "nodes"}).values) == 0
    with pytest.raises(InputError, match=r"'values' has the shape \(2,\), not \(0,\)"):
        Nodes.from_dict({"command": "nodes", "values": [1.0, 2.0]})


def test_a_missing_key_is_named() -> None:
    data = written(sweep())
    del data["units"]
    with pytest.raises(InputError, match="is not a sweep: 'units' is missing; workbench sweep --json writes one"):
        Sweep.from_dict(data)


def test_arrays_over_the_same_axis_are_a_table() -> None:
    text = io.StringIO()
    _signals_only().to_csv(text)
    assert list(csv.reader(io.StringIO(text.getvalue()))) == [
        ["time [s]", "x"], ["0.0", "1.0"], ["1.0", ""], ["2.0", "3.0"]
    ]  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Signals(Result):
    time: NDArray[np.float64] = field(metadata=entry(dims=("time",), unit="s"))
    signals: dict[str, NDArray[np.float64]] = field(metadata=entry(dims=("time",)))


def _signals_only() -> Signals:
    return Signals(time=np.array([0.0, 1.0, 2.0]), signals={"x": np.array([1.0, np.nan, 3.0])})


def test_signals_are_found_by_name() -> None:
    record = _signals_only()
    assert record["x"] is record.signals["x"]
    with pytest.raises(InputError, match="Signals has no 'z'"):
        record["z"]


def test_a_frame_has_the_columns_of_the_table() -> None:
    needs_module("pandas", "frames")
    frame = _signals_only().to_dataframe()
    assert list(frame.columns) == ["time", "x"]
    np.testing.assert_array_equal(frame["x"], [1.0, np.nan, 3.0])


def test_a_data_set_has_coordinates_and_units() -> None:
    needs_module("xarray", "frames")
    data = sweep(signals={"x": np.array([1.0, np.nan, 3.0])}).to_xarray()
    assert data["x"].dims == ("time",)
    assert data["x"].attrs == {"unit": "m"}
    assert data["time"].attrs == {"unit": "s"}
    assert data["matrix"].dims == ("names", "inputs")


# -- every record of the package ---------------------------------------------------------------


def all_parts() -> list[type[RecordPart]]:
    """Return every class whose JSON the package writes and reads, none can be forgotten."""
    for module in pkgutil.walk_packages(workbench.__path__, "workbench."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    found: set[type[RecordPart]] = set()
    todo: list[type[RecordPart]] = [RecordPart]
    while todo:
        new = set(todo.pop().__subclasses__()) - found
        todo += new
        found |= new
    own = (kind for kind in found if kind.__module__.startswith("workbench.") and hasattr(kind, "__dataclass_fields__"))
    return sorted(own, key=lambda kind: f"{kind.__module__}.{kind.__qualname__}")


@pytest.mark.parametrize("kind", all_parts(), ids=lambda kind: kind.__name__)
def test_two_records_compare(kind: type[RecordPart]) -> None:
    """Whether by what they hold or by which they are; arrays in a generated __eq__ raise instead."""
    one, other = (Maker(empty=False).record(kind) for _ in range(2))
    assert isinstance(one == other, bool)
    assert one == one  # noqa: PLR0124 - that is the question


NO_TABLE = {
    "BalancedReduction", "BuildResult", "BuiltModels", "CompiledFmu", "ContainerResult", "DelayReport", "ExportResult",
    "FmuInfo", "NoDelays", "SubspaceEstimate", "SystemFile", "SystemInfo",
}  # fmt: skip

# What a file does not hold: of each gain the curve that a picture shows, whose block is not in the file either.
NOT_IN_FILES = {("CyclesLeft", "curve")}

PARTS = all_parts()
RECORDS = [kind for kind in PARTS if issubclass(kind, Result)]


def example(kind: type[RecordPart], *, empty: bool = False) -> Any:
    return Maker(empty=empty).record(kind)


def assert_same(found: Any, expected: Any, where: str) -> None:
    """Field by field: arrays by value, NaN equal."""
    if is_dataclass(expected):
        assert type(found) is type(expected), where
        for declared in fields(expected):
            held = getattr(expected, declared.name)
            if (type(expected).__name__, declared.name) in NOT_IN_FILES:
                held = declared.default
            assert_same(getattr(found, declared.name), held, f"{where}.{declared.name}")
    elif isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype, where
        np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=where)
    elif isinstance(expected, dict):
        assert list(found) == list(expected), where
        for name, held in expected.items():
            assert_same(found[name], held, f"{where}.{name}")
    elif isinstance(expected, tuple | list):
        assert len(found) == len(expected), where
        for k, held in enumerate(expected):
            assert_same(found[k], held, f"{where}[{k}]")
    else:
        assert type(found) is type(expected), where
        near = isinstance(expected, float | complex) and found == pytest.approx(expected, rel=1e-12, nan_ok=True)
        assert near or found == expected, where


@pytest.mark.parametrize("empty", [False, True], ids=["full", "empty"])
@pytest.mark.parametrize("kind", PARTS, ids=lambda kind: kind.__name__)
def test_every_record_reads_its_own_json(kind: type[RecordPart], empty: bool) -> None:
    first = example(kind, empty=empty)
    data = json.loads(json.dumps(first.to_dict(), allow_nan=False))
    again = kind.from_dict({**data, "command": "any", "version": "0"} if issubclass(kind, Result) else data)
    assert_same(again, first, kind.__name__)
    assert_same(again.to_dict(), first.to_dict(), kind.__name__)


def _headed(record: Result, names: Iterable[str], heading: list[str]) -> Iterator[tuple[str, str, str | None]]:
    """Yield the name of each column, its heading in the file, and its unit: a column that has one shows it there."""
    units = record.column_units()
    for name, shown in zip(names, heading, strict=True):
        unit = units.get(name)
        assert shown != name or unit in {None, "", "1"} or name.endswith(f"_{unit}".lower())
        yield name, shown, unit


@pytest.mark.parametrize("kind", RECORDS, ids=lambda kind: kind.__name__)
def test_every_record_has_a_table_or_says_that_there_is_none(kind: type[Result]) -> None:
    record, text = example(kind), io.StringIO()
    if kind.__name__ in NO_TABLE:
        with pytest.raises(InputError, match="has no table"):
            record.to_csv(text)
        return
    record.to_csv(text)
    heading, *rows = (row for row in csv.reader(io.StringIO(text.getvalue())) if not row[0].startswith("#"))
    assert rows
    assert all(len(row) == len(heading) for row in rows)
    frame = record.to_dataframe()
    assert all(shown in {name, f"{name} [{unit}]"} for name, shown, unit in _headed(record, frame.columns, heading))
    assert len(frame) == len(rows)
    assert all(frame[name].dtype == float for name in frame if frame[name].isna().all())


@pytest.mark.parametrize("kind", RECORDS, ids=lambda kind: kind.__name__)
def test_a_file_of_something_else_is_refused_in_one_line(kind: type[Result]) -> None:
    needed = [f for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]  # type: ignore[arg-type]
    if not needed:
        return
    with pytest.raises(InputError, match=r"^is not an? .*\w") as caught:
        kind.from_dict({"command": "info"})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", RECORDS, ids=lambda kind: kind.__name__)
def test_every_array_over_named_axes_goes_to_xarray(kind: type[Result]) -> None:
    record = example(kind)
    if not any(f.metadata.get("dims") for f in fields(kind)):  # type: ignore[arg-type]
        with pytest.raises(InputError, match="has no array over named axes"):
            record.to_xarray()
        return
    data = record.to_xarray()
    assert data.data_vars
    for name, array in data.data_vars.items():
        np.testing.assert_array_equal(array, record[name])


@pytest.mark.parametrize("kind", RECORDS, ids=lambda kind: kind.__name__)
def test_a_key_that_is_missing_or_wrong_is_an_input_error(kind: type[Result]) -> None:
    """Or it does not matter, since it follows from others; no other exception comes out."""
    data, refused = json.loads(json.dumps(example(kind).to_dict())), []
    for key in data:
        rest = {name: held for name, held in data.items() if name != key}
        for changed in (rest, {**data, key: "junk"}, {**data, key: None}, {**data, key: [["junk"]]}, {**data, key: {}}):
            try:
                kind.from_dict(changed)
            except InputError as error:
                refused.append(str(error))
    assert refused
    assert not any("\n" in message for message in refused)


def test_an_array_is_missing_whose_axis_is_there() -> None:
    """What was read without it could be written, and would be another when read again."""
    whole = Maker(empty=False).record(LinResult).to_dict()
    del whole["intersample"]["D_nodes"]
    with pytest.raises(InputError, match=r"intersample\.D_nodes' is missing"):
        LinResult.from_dict(whole)


def test_a_phase_is_finite() -> None:
    whole = Maker(empty=False).record(NfrResult).to_dict()
    whole["phase_deg"][0][0] = "inf"
    with pytest.raises(InputError, match="phase_deg is infinite"):
        NfrResult.from_dict(whole)


def test_the_table_of_a_frequency_response_counts_what_was_averaged() -> None:
    """0 and 1, as it always was: spreadsheets add them up."""
    text, record = io.StringIO(), Maker(empty=False).record(NfrResult)
    record.to_csv(text)
    heading, *rows = csv.reader(io.StringIO(text.getvalue()))
    column = [row[heading.index("averaged")] for row in rows]
    assert column == [str(int(x)) for x in record.averaged.ravel()]


def test_an_array_type_may_be_an_alias() -> None:
    """As `NDArray` is since NumPy 2.5, which Python 3.12 and newer get."""
    scalar = TypeVar("scalar", bound=np.generic)
    alias = TypeAliasType("alias", np.ndarray[tuple[Any, ...], np.dtype[scalar]], type_params=(scalar,))
    made: type[Result] = make_dataclass(
        "Aliased", [("time", alias[np.float64])], bases=(Result,), frozen=True, eq=False, kw_only=True
    )
    read = made.from_dict({"time": [1.0, 2.5]})
    np.testing.assert_array_equal(vars(read)["time"], [1.0, 2.5])
