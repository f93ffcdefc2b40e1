"""An operating point is one object and one file: it names its model, is refused elsewhere, and sessions start there."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from workbench.core.machine.bundled_files import bundled_files
from workbench.core.values.operating_point import OperatingPoint
from workbench.fmi.bundled import bundled_path
from workbench.model.operating_point import find_point, standing


@pytest.fixture(scope="module")
def rudder() -> Iterator[wb.DescribedModel]:
    with wb.load("fmu:Rudder") as model:
        yield model


@pytest.fixture(scope="module")
def trimmed(rudder: wb.DescribedModel) -> OperatingPoint:
    return wb.trim(rudder, u0={"delC": 2.0}, floating=["p1", "p2"]).operating_point


def test_a_point_names_its_model(rudder: wb.DescribedModel, trimmed: OperatingPoint) -> None:
    assert trimmed.model == "Rudder"
    assert trimmed.model_sha256 == rudder.recipe.content()
    assert trimmed.parameters == {}


def test_a_point_survives_json_in_every_form(
    rudder: wb.DescribedModel, trimmed: OperatingPoint, tmp_path: Path
) -> None:
    linear = wb.lin(rudder, at=trimmed, inputs=["delC"])
    for name, written in {
        "point": trimmed.to_dict(),
        "trim": wb.trim(rudder, u0={"delC": 2.0}, floating=["p1", "p2"]).to_dict(),
        "lin": linear.result.to_dict(),
    }.items():
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps(written), encoding="utf-8")
        read = OperatingPoint.read(file)
        assert (read.x, read.u, read.time) == (trimmed.x, trimmed.u, trimmed.time)
        assert (read.model, read.model_sha256) == (trimmed.model, trimmed.model_sha256)
        assert find_point(rudder, file) == (read, ())


def test_an_older_linear_model_is_a_point_too(rudder: wb.DescribedModel, trimmed: OperatingPoint) -> None:
    data = wb.lin(rudder, at=trimmed, inputs=["delC"]).result.to_dict()
    del data["operating_point"]
    read = OperatingPoint.from_dict(data)
    assert (read.x, read.u) == (trimmed.x, trimmed.u)


def test_sessions_start_at_the_point(rudder: wb.DescribedModel, trimmed: OperatingPoint) -> None:
    placed = rudder.placed(trimmed)
    found = standing(placed)
    assert found.x == pytest.approx(trimmed.x, rel=1e-12, abs=1e-15)
    assert found.u == trimmed.u
    assert placed.recipe.identity() != rudder.recipe.identity()
    with rudder.open_session(at=trimmed) as session:
        assert session.values(list(trimmed.x)) == found.x
    with placed.recipe.open() as again:  # as a worker does
        assert standing(again) == found


@pytest.mark.parametrize("taken", ["point", "result", "linear", "file"])
def test_at_takes_what_has_a_point(
    taken: str, rudder: wb.DescribedModel, trimmed: OperatingPoint, tmp_path: Path
) -> None:
    linear = wb.lin(rudder, at=trimmed, inputs=["delC"])
    file = tmp_path / "p.json"
    file.write_text(json.dumps(trimmed.to_dict()), encoding="utf-8")
    at: Any = {"point": trimmed, "result": linear.result, "linear": linear, "file": str(file)}[taken]
    point, notes = find_point(rudder, at)
    assert point is not None
    assert (point.x, notes) == (trimmed.x, ())


def test_a_file_whose_two_copies_of_the_point_differ_is_refused(trimmed: OperatingPoint) -> None:
    data = {**trimmed.to_dict(), "operating_point": trimmed.to_dict()}
    assert OperatingPoint.from_dict(data) == trimmed
    name = next(iter(trimmed.x))
    data["x"] = {**trimmed.x, name: trimmed.x[name] + 1.0}
    with pytest.raises(wb.InputError, match=f"two values of {name}"):
        OperatingPoint.from_dict(data)
    samples = {**data, "x": {name: [1.0, 2.0]}}  # of an experiment at the point
    assert OperatingPoint.from_dict(samples) == trimmed


def test_a_point_of_another_model_is_refused(trimmed: OperatingPoint) -> None:
    with (
        wb.load("fmu:SmallNonlinear") as other,
        pytest.raises(wb.InputError, match="belongs to another model, Rudder, not"),
    ):
        find_point(other, trimmed)


def test_a_system_refuses_the_point_of_its_component_and_the_other_way_round() -> None:
    with wb.load("system:rudder_loop") as system, wb.load("fmu:Rudder") as part:
        with pytest.raises(wb.InputError, match="belongs to another model, Rudder, not rudder_loop"):
            find_point(system, standing(part))
        with pytest.raises(wb.InputError, match="belongs to another model, rudder_loop, not Rudder"):
            find_point(part, standing(system))


def test_a_point_of_the_same_model_built_again_is_refused(tmp_path: Path) -> None:
    shutil.unpack_archive(bundled_path("fmu:SmallNonlinear"), tmp_path / "other", format="zip")
    text = tmp_path / "other" / "modelDescription.xml"
    text.write_text(
        text.read_text(encoding="utf-8").replace(
            "<fmiModelDescription", "<!-- built again -->\n<fmiModelDescription", 1
        )
    )
    with wb.load("fmu:SmallNonlinear") as model, wb.load(tmp_path / "other") as again:
        assert again.name == model.name
        with pytest.raises(wb.InputError, match="belongs to another version of SmallNonlinear: the SHA-256 is"):
            find_point(again, standing(model))


def test_the_hash_of_a_system_is_that_of_all_its_parts(tmp_path: Path) -> None:
    text = bundled_files("systems")["rudder_loop"].read_text(encoding="utf-8")
    (tmp_path / "same.toml").write_text(text, encoding="utf-8")
    (tmp_path / "other.toml").write_text(text.replace("gain = {gain = 2.0", "gain = {gain = 2.5"), encoding="utf-8")
    with (
        wb.load("system:rudder_loop") as a,
        wb.load(tmp_path / "same.toml") as b,
        wb.load(tmp_path / "other.toml") as c,
    ):
        assert a.recipe.content() == b.recipe.content() != c.recipe.content() != ""


def test_a_file_without_a_model_is_taken_with_a_note(
    rudder: wb.DescribedModel, trimmed: OperatingPoint, tmp_path: Path
) -> None:
    file = tmp_path / "by_hand.json"
    file.write_text(json.dumps({"x": trimmed.x, "u": {"delC": 2.0}}), encoding="utf-8")
    point, notes = find_point(rudder, file)
    assert point is not None
    assert point.u == {"delC": 2.0}
    assert notes == (f"{file}: does not name its model; it is assumed to belong to this one",)


def test_other_parameters_are_told() -> None:
    with wb.load("fmu:FirstOrderLag", start_values={"tau": 2.0}) as slow, wb.load("fmu:FirstOrderLag") as lag:
        point = wb.trim(slow, u0={"u": 1.0}).operating_point
        assert point.parameters == {"tau": 2.0}
        assert find_point(slow, point)[1] == ()
        tau = next(p.start for p in lag.parameters if p.name == "tau")
        (note,) = find_point(lag, point)[1]
        found = f"the operating point was found with tau = 2.0, but here tau = {tau}"
        assert note == f"{found}: it may not be an equilibrium"


def test_a_bias_that_contradicts_the_point_is_refused() -> None:
    words = "bias: u would be 1, but the operating point has 3 there; leave one of them out"
    with wb.load("fmu:FirstOrderLag", bias={"u": 1.0}) as model, pytest.raises(wb.InputError, match=words):
        find_point(model, OperatingPoint(x={"x": 3.0}, u={"u": 3.0}))


def test_the_point_counts_more_than_a_start_value_that_was_set() -> None:
    """A start value may be where trim began its search; that it does not count is told."""
    point = OperatingPoint(x={"x": 3.0}, u={"u": 3.0})
    with wb.load("fmu:FirstOrderLag", start_values={"x": 1.0}) as model:
        assert find_point(model, point)[1] == ("x starts at 3, as the operating point says, not at 1.0, which was set",)
        assert standing(model.placed(point)).x == {"x": 3.0}


def test_settings_that_say_the_same_are_no_contradiction() -> None:
    point = OperatingPoint(x={"x": 3.0}, u={"u": 3.0})
    with wb.load("fmu:FirstOrderLag", bias={"u": 3.0}, start_values={"x": 3.0}) as model:
        assert find_point(model, point)[0] == point
        assert standing(model.placed(point)).u == {"u": 3.0}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"x": {"piston": 0.0}},
            "has values for some states of Rudder, but not for p1, p2, spool, current, .*; add them",
        ),
        ({"u": {"delX": 0.0}}, "Rudder has no input 'delX'; did you mean delC"),
        ({"discrete": {"nosuch": 0.0}}, "Rudder has no state 'nosuch'"),
        ({"u": {"delC": float("nan")}}, "delC must be a finite number, not nan"),
    ],
)
def test_what_does_not_fit_is_refused(
    change: dict[str, Any], words: str, rudder: wb.DescribedModel, trimmed: OperatingPoint
) -> None:
    with pytest.raises(wb.InputError, match=words):
        find_point(rudder, replace(trimmed, **change))


def test_what_a_search_left_by_rounding_is_written_as_0() -> None:
    point = OperatingPoint(x={"speed": -5.57e-31, "charge": 1.6e-19}, u={}, units={"charge": "C"})
    assert point.words() == "speed = 0, charge = 1.6e-19 C; t = 0 s"
    assert OperatingPoint(x=dict.fromkeys("abcdef", 1e-30), u={}).words() == "all 6 states 0; t = 0 s"
    assert point.x["speed"] == -5.57e-31  # the point itself keeps what was found
