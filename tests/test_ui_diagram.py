"""The diagram of a system: what is drawn is what the workbench reads, and an edit leaves the rest of the text alone."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from workbench.errors import InputError
from workbench.system.files.read import read_system
from workbench.ui.root import ServedFolder

pytest.importorskip("tomlkit", reason="the extra 'ui' is not installed")

from workbench.ui.diagram import BLOCKS, PALETTE, drawn, edited

ROOT = Path(__file__).resolve().parents[1]
BUNDLED = sorted(path.stem for path in (ROOT / "systems").glob("*.toml"))

# Everything that stands in more lines than one, and both ways to write a connection.
SPREAD = """# head
name = "spread"  # of the system

[components]  # parts
plant = {model = "fmu:Rudder", set = {loopGain = 0.5}}  # the plant
lag = {numerator = [
    1.0,  # one
    2.0,
  ], denominator = [1.0, 3.0], inputs = ["a"], outputs = [
    "b",
  ]}
error = {sum = "+-"}

[components.gain]
gain = 2.0

# about connections
[connections]
plant.delC = {from = "gain.y", gain = -1.0}
"lag.a" = "error.y"  # back
"gain.u" = "lag.b"
"error.u2" = \'plant.del\'
# last remark

[inputs]
both = [
  "error.u1",   # first
  "plant.mH",
]

[outputs]
del = "plant.del"

[experiment]
stop = 2.0
"""


def changed(before: str, after: str) -> list[str]:
    """Return the lines that were taken out (-) and put in (+)."""
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


def parts(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {part["name"]: part for part in found["components"]}


def test_what_stands_in_several_lines_is_drawn(tmp_path: Path) -> None:
    found = drawn(SPREAD, ServedFolder(tmp_path), "loop.toml")
    assert found["wrong"] == []
    assert {name: part["inputs"] for name, part in parts(found).items()} == {
        "plant": [], "lag": ["a"], "error": ["u1", "u2"], "gain": ["u"],
    }  # fmt: skip
    assert parts(found)["plant"]["model"] == "fmu:Rudder"
    assert parts(found)["lag"]["outputs"] == ["b"]
    assert [(c["from"], c["to"], c["more"]) for c in found["connections"]] == [
        ("gain.y", "plant.delC", "gain = -1.0"), ("error.y", "lag.a", ""), ("lag.b", "gain.u", ""),
        ("plant.del", "error.u2", ""),
    ]  # fmt: skip
    assert found["inputs"] == [["both", "error.u1"], ["both", "plant.mH"]]
    assert found["outputs"] == [["del", "plant.del"]]


@pytest.mark.parametrize("name", BUNDLED)
def test_the_picture_has_what_the_workbench_reads(tmp_path: Path, name: str) -> None:
    found = drawn(
        (ROOT / "systems" / f"{name}.toml").read_text(encoding="utf-8"), ServedFolder(tmp_path), f"system:{name}"
    )
    system = read_system(f"system:{name}")
    assert found["wrong"] == []
    assert [part["name"] for part in found["components"]] == [c.name for c in system.components]
    read = [(c.source, c.destination) for c in system.connections]
    assert [(c["from"], c["to"]) for c in found["connections"]] == read
    assert found["outputs"] == [list(pair) for pair in system.outputs.items()]


@pytest.mark.parametrize("text", [SPREAD, *((ROOT / "systems" / f"{n}.toml").read_text("utf-8") for n in BUNDLED)])
@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_is_one_line_more(tmp_path: Path, text: str, block: str) -> None:
    after = edited(text, "add", block)
    (line,) = changed(text, after)
    name = line[2:].partition(" ")[0]
    assert name not in tomllib.loads(text)["components"]
    found = parts(drawn(after, ServedFolder(tmp_path), "system:rudder_loop"))[name]
    assert found["inputs"] or found["model"]


def test_connections_are_made_and_cut_and_nothing_else_changes() -> None:
    assert changed(SPREAD, edited(SPREAD, "connect", "error.y", "plant.mH")) == ['+ "plant.mH" = "error.y"']
    assert changed(SPREAD, edited(SPREAD, "connect", "error.y", "plant.delC")) == [
        '- plant.delC = {from = "gain.y", gain = -1.0}', '+ "plant.delC" = "error.y"',
    ]  # fmt: skip
    assert changed(SPREAD, edited(SPREAD, "cut", "lag.a")) == ['- "lag.a" = "error.y"  # back']
    assert edited(SPREAD, "cut", "lag.nothing") == SPREAD


def test_a_component_goes_with_its_connections(tmp_path: Path) -> None:
    after = edited(SPREAD, "remove", "error")
    assert "error" not in after
    assert tomllib.loads(after)["inputs"] == {"both": ["plant.mH"]}
    assert "# about connections" in after
    assert parts(drawn(after, ServedFolder(tmp_path), "loop.toml")).keys() == {"plant", "lag", "gain"}
    assert "[components.gain]" not in edited(SPREAD, "remove", "gain")


def test_a_file_without_tables_gets_them() -> None:
    after = edited("", "add", "gain")
    assert tomllib.loads(edited(after, "connect", "gain.y", "gain.u")) == {
        "components": {"gain": 1.0}, "connections": {"gain.u": "gain.y"},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "change", "said"),
    [
        ("[components", ("add", "gain"), "not TOML yet"),
        ("components = 3", ("add", "gain"), "edit its text"),
        (SPREAD, ("add", "nonsense"), "edit its text"),
        (SPREAD, ("add",), "edit its text"),
        (SPREAD, ("remove", "nobody"), "edit its text"),
        (SPREAD, ("explode",), "must be one of"),
    ],
)
def test_what_cannot_be_done_is_one_line(text: str, change: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError) as told:
        edited(text, *change)
    assert said in str(told.value)
    assert len(str(told.value).splitlines()) == 1


def test_what_is_wrong_with_a_part_is_said_and_the_others_are_drawn(tmp_path: Path) -> None:
    text = '[components]\na = {sum = "x"}\nb = 2.0\nc = "../outside.fmu"\nd = {linear = "none.json"}'
    found = drawn(text, ServedFolder(tmp_path), "loop.toml")
    assert len(found["wrong"]) == 3
    assert parts(found)["b"]["outputs"] == ["y"]
    for wrong in ("x", "[components]\na = 1\n[connections]\n1", "components = 1"):
        with pytest.raises(InputError):
            drawn(wrong, ServedFolder(tmp_path), "loop.toml")


@pytest.mark.parametrize(
    ("entry", "label"),
    [
        ("2", "× 2"),
        ("{gain = -0.5}", "× -0.5"),
        ('{sum = "+-"}', "+ −"),
        ("{sum = [1.0, -2.0]}", "1.0 −2.0"),
        ("{numerator = [1.0], denominator = [0.1, 1.0]}", "1 / (0.1 s + 1)"),
        ("{numerator = [-0.05, 1.0], denominator = [1.0, 0.0, -2.0]}", "(−0.05 s + 1) / (s² − 2)"),
        ("{numerator = [2.0], denominator = [1.0, -0.5], dt = 0.1}", "2 / (z − 0.5)"),
        ("{A = [[0.0, 1.0], [0.0, 0.0]], B = [[0.0], [1.0]], C = [[1.0, 0.0]]}", "2 states"),
        ('"fmu:Rudder"', "fmu:Rudder"),
    ],
)
def test_a_box_says_what_is_in_it(tmp_path: Path, entry: str, label: str) -> None:
    found = drawn(f"[components]\npart = {entry}\n", ServedFolder(tmp_path), "loop.toml")
    assert found["wrong"] == []
    assert parts(found)["part"]["label"] == label


def test_the_palette_has_every_block_once_under_the_heading_of_the_list() -> None:
    assert sorted(kind for kinds in PALETTE.values() for kind in kinds) == sorted(BLOCKS)
    told = {block.kind: block.group for block in wb.blocks([]).blocks}
    for group, kinds in PALETTE.items():
        assert {told.get(kind, "linear") for kind in kinds} == {group}


@pytest.mark.parametrize(
    ("block", "wire"),
    [("gain", "plant.delC"), ("switch", "lag.a"), ("transfer_function", "error.u2"), ("sum", "gain.u")],
)
def test_a_block_is_put_into_a_wire_and_nothing_else_is_touched(block: str, wire: str) -> None:
    after = edited(SPREAD, "insert", block, wire)
    before, now = tomllib.loads(SPREAD), tomllib.loads(after)
    (name,) = now["components"].keys() - before["components"].keys()
    flat = {"plant.delC": now["connections"].get("plant", {}).get("delC"), **now["connections"]}
    was = {"plant.delC": before["connections"]["plant"]["delC"], **before["connections"]}
    assert flat[wire] == f"{name}.y"
    (first,) = [to for to in flat if to.startswith(f"{name}.")]
    assert flat[first] == was[wire]  # with its gain
    lost = [line for line in difflib.ndiff(SPREAD.splitlines(), after.splitlines()) if line.startswith("- ")]
    assert len(lost) == 1  # of the wire, whose source is another now


def test_a_block_is_put_into_no_wire_that_is_not_there() -> None:
    with pytest.raises(InputError, match="edit its text"):
        edited(SPREAD, "insert", "gain", "error.u1")
