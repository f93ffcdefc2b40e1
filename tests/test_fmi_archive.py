"""Hostile and damaged archives: one clear line each, and nothing left behind."""

from __future__ import annotations

import gc
import os
import stat
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from workbench.core.machine.scratch import _Mine
from workbench.errors import FmuError, InputError
from workbench.fmi.archive import unpack
from workbench.fmi.platforms import binary_path, host
from workbench.fmi.reading import read_description
from workbench.model.load import load

XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="M" guid="{g}" numberOfEventIndicators="0">
  <ModelExchange modelIdentifier="M" canGetAndSetFMUstate="true"/>
  <UnitDefinitions><Unit name="m"/></UnitDefinitions>
  <LogCategories><Category name="logStatusError"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.02"/>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0"><Real unit="m" nominal="0.001"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="1"><Real derivative="1"/></ScalarVariable>
    <ScalarVariable name="k" valueReference="2" causality="parameter"
      variability="tunable"><Real start="2.5"/></ScalarVariable>
    <ScalarVariable name="on" valueReference="3" causality="input"
      variability="discrete"><Boolean start="true"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Derivatives><Unknown index="2" dependencies="1 3"/></Derivatives></ModelStructure>
</fmiModelDescription>
"""

Pack = Callable[..., Path]


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    def write(entries: dict[str, str | bytes], *, xml: str | bytes | None = XML) -> Path:
        path = tmp_path / "M.fmu"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            if xml is not None:
                archive.writestr("modelDescription.xml", xml)
            for name, content in entries.items():
                archive.writestr(name, content)
        return path

    return write


@pytest.fixture(autouse=True)
def _own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(_Mine, "folder", folder)
    monkeypatch.setattr(_Mine, "process", os.getpid())


def left_behind(tmp_path: Path) -> list[Path]:
    gc.collect()
    return list((tmp_path / "temporary").iterdir())


@pytest.mark.parametrize("name", ["../evil.txt", "/evil.txt", "a/../../evil.txt", "..\\evil.txt", "C:/evil.txt"])
def test_entries_that_would_leave_the_folder_are_refused(pack: Pack, tmp_path: Path, name: str) -> None:
    with pytest.raises(FmuError, match="would leave the target folder"):
        unpack(pack({name: "x"}))
    assert left_behind(tmp_path) == []
    assert not list(tmp_path.rglob("evil.txt"))


@pytest.mark.parametrize("entry", ["resources/", "resources\\", "./resources/"])
def test_an_empty_folder_is_unpacked(pack: Pack, entry: str) -> None:
    with unpack(pack({"./": "", entry: "", "sources/": "", "binaries/": ""})) as unpacked:
        assert sorted(p.name for p in unpacked.folder.iterdir() if p.is_dir()) == ["binaries", "resources"]


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_file_that_is_in_it_twice_is_refused_if_it_is_not_the_same(pack: Pack, tmp_path: Path) -> None:
    unpack(pack({"modelDescription.xml": XML})).close()
    with pytest.raises(FmuError, match=r"'modelDescription\.xml' is in it twice, with different contents"):
        unpack(pack({"modelDescription.xml": XML.replace("2.5", "3.5")}))
    assert not left_behind(tmp_path)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (
            {"resources/" + "x" * 300: ""},
            r"entry 'resources/x+…x+' cannot be unpacked: .*; pack it again with a shorter",
        ),
        ({"resources/a": "", "resources/a/b": ""}, "entry 'resources/a/b' is in conflict with another: one name is"),
        ({"resources/a/b": "", "resources/a": ""}, "entry 'resources/a' is in conflict with another: one name is"),
    ],
)
def test_what_cannot_be_unpacked_is_named_as_in_the_archive(
    pack: Pack, tmp_path: Path, entries: dict[str, str | bytes], words: str
) -> None:
    with pytest.raises(FmuError, match=words) as caught:
        unpack(pack(entries))
    assert "fmi-workbench-" not in str(caught.value)
    assert left_behind(tmp_path) == []


def test_symbolic_links_are_refused(pack: Pack, tmp_path: Path) -> None:
    path = pack({})
    link = zipfile.ZipInfo("binaries/link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(FmuError, match="symbolic link"):
        unpack(path)
    assert left_behind(tmp_path) == []


def test_zip_bombs_are_refused(pack: Pack) -> None:
    with pytest.raises(FmuError, match="zip bombs"):
        unpack(pack({"resources/zeros": bytes(80 << 20)}))


def test_what_is_no_fmu_is_refused(pack: Pack, tmp_path: Path) -> None:
    text = tmp_path / "text.fmu"
    text.write_text("no zip")
    with pytest.raises(FmuError, match="not a zip archive"):
        unpack(text)
    with pytest.raises(FmuError, match=r"no modelDescription\.xml"):
        unpack(pack({"a": "b"}, xml=None))
    with pytest.raises(FmuError, match=r"no modelDescription\.xml"):
        unpack(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        unpack(tmp_path / "missing.fmu")
    with pytest.raises(InputError, match="no bundled FMU of that name"):
        unpack("fmu:Nonsense")
    assert left_behind(tmp_path) == []


BOMB = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;">]><a>&c;</a>'


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        (BOMB, "entities"),
        (BOMB.encode("utf-16"), "entities"),
        ("<fmiModelDescription", "cannot be read"),
        ("", "cannot be read"),
        ("<a/>", "cannot be read"),
        (XML.replace('"2.0"', '"7.0"'), "cannot be read"),
        (XML.replace('index="2"', 'index="99"'), "cannot be read"),
    ],
)
def test_descriptions_that_cannot_be_used_are_refused(pack: Pack, tmp_path: Path, xml: str | bytes, words: str) -> None:
    with pytest.raises(FmuError, match=words) as caught:
        load(pack({}, xml=xml))
    assert "\n" not in str(caught.value)
    assert left_behind(tmp_path) == []


def test_missing_binary_says_what_there_is(pack: Pack, tmp_path: Path) -> None:
    binaries = {"darwin": "darwin64/M.dylib", "linux": "linux64/M.so", "windows": "win64/M.dll"}
    others = [name for system, name in binaries.items() if system != host().rpartition("-")[2]]
    path = pack({f"binaries/{name}": "x" for name in others})
    has = ", ".join(name.partition("/")[0] for name in others)
    with pytest.raises(FmuError, match=f"no binary M for this platform .*has: {has}"):
        load(path)
    assert left_behind(tmp_path) == []


def test_a_binary_of_another_name_and_the_identifier_are_both_told(pack: Pack) -> None:
    suffix = {"linux": "so", "windows": "dll", "darwin": "dylib"}[host().rpartition("-")[2]]
    with pytest.raises(FmuError, match=rf"modelIdentifier is M, .* \({host()}/Other\.{suffix}\); rename the file"):
        load(pack({f"binaries/{host()}/Other.{suffix}": "x"}))


def test_a_binary_for_web_assembly_is_named_as_such(pack: Pack) -> None:
    words = r"\(has: wasm32-wasip1 \(WebAssembly, which does not run here\)\); ask its maker for one$"
    with pytest.raises(FmuError, match=words):
        load(pack({"binaries/wasm32-wasip1/M.wasm": "x"}))


def test_an_fmu_without_any_binary_is_not_sent_to_another_platform(pack: Pack) -> None:
    with pytest.raises(FmuError, match=r"\(has: none at all\); ask its maker for one$"):
        load(pack({}))


def test_a_binary_that_cannot_be_loaded_is_one_line(pack: Pack) -> None:
    suffix = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}[host().rpartition("-")[2]]
    path = pack({f"binaries/{host()}/M{suffix}": "no library"})
    with load(path) as model, pytest.raises(FmuError, match="cannot load"):
        model.open_session()


def test_the_folder_is_removed_and_a_users_folder_is_not(pack: Pack, tmp_path: Path) -> None:
    path = pack({"resources/a.txt": "a", "sources/big.c": "not needed"})
    with unpack(path) as unpacked:
        assert (unpacked.folder / "resources/a.txt").is_file()
        assert not (unpacked.folder / "sources").exists()
    assert left_behind(tmp_path) == []
    forgotten = unpack(path)
    assert len(left_behind(tmp_path)) == 1
    del forgotten
    assert left_behind(tmp_path) == []
    users = tmp_path / "users"
    users.mkdir()
    (users / "modelDescription.xml").write_text(XML)
    unpack(users).close()
    assert (users / "modelDescription.xml").is_file()


def test_binaries_of_other_platforms_stay_in_the_archive_but_are_known(pack: Pack) -> None:
    others = ["binaries/x86_64-windows/M.dll", "binaries/darwin64/M.dylib", "binaries/aarch64-linux/M.so"]
    others = [name for name in others if host() not in name and not (host().endswith("darwin") and "darwin" in name)]
    odd = ["binaries/own-machine/M.so", "binaries/win32/readme.txt", "binaries/note.txt", "binaries/win32/deep/M.dll"]
    with unpack(pack(dict.fromkeys([*others, *odd], "x"))) as unpacked:
        files = {p.relative_to(unpacked.folder).as_posix() for p in unpacked.folder.rglob("*") if p.is_file()}
        found = read_description(unpacked.folder, source="M")
    assert not files.intersection(others)
    assert files >= {"binaries/own-machine/M.so", "binaries/note.txt"}
    assert found.platforms == tuple(sorted([*(name.split("/")[1] for name in others), "own-machine"]))


def test_the_description_as_dataclasses(pack: Pack) -> None:
    with unpack(pack({"binaries/linux64/M.so": "x"})) as unpacked:
        found = read_description(unpacked.folder, source="M")
    by_name = {v.name: v for v in found.variables}
    assert found.major == 2
    assert [s.name for s in found.states] == ["x"]
    assert found.derivatives[0].derivative_of == "x"
    assert found.derivatives[0].dependencies == ("x", "k")
    assert (by_name["x"].unit, by_name["x"].nominal) == ("m", 0.001)
    assert (by_name["k"].start, by_name["k"].causality) == (2.5, "parameter")
    assert by_name["on"].start is True
    assert not by_name["on"].is_continuous_input
    assert found.interfaces["me"].state
    assert found.experiment.step == 0.02
    assert found.platforms == ("linux64",)
    assert found.notes == ()


def test_bent_rules_become_notes(pack: Pack) -> None:
    bent = XML.replace("<LogCategories>", '<Unheard of="1"/><LogCategories>')
    with unpack(pack({}, xml=bent)) as unpacked:
        found = read_description(unpacked.folder, source="M")
    assert len(found.notes) == 1
    assert "violates the FMI standard" in found.notes[0]


def test_arrays_of_fmi_3_are_taken_apart(tmp_path: Path) -> None:
    (tmp_path / "modelDescription.xml").write_text(
        """<?xml version="1.0" encoding="UTF-8"?>
        <fmiModelDescription fmiVersion="3.0" modelName="A" instantiationToken="t">
          <ModelExchange modelIdentifier="A" providesDirectionalDerivatives="true"/>
          <ModelVariables>
            <Float64 name="u" valueReference="1" causality="input" start="1 2"><Dimension start="2"/></Float64>
            <Float64 name="A" valueReference="2" causality="parameter" variability="tunable" start="1 2 3 4 5 6">
              <Dimension start="2"/><Dimension start="3"/></Float64>
            <UInt8 name="n" valueReference="3" causality="input" start="7"/>
            <Float64 name="time" valueReference="4" causality="independent"/>
          </ModelVariables>
          <ModelStructure/>
        </fmiModelDescription>"""
    )
    found = read_description(tmp_path, source="A")
    assert [v.name for v in found.variables][:4] == ["u[1]", "u[2]", "A[1,1]", "A[1,2]"]
    by_name = {v.name: v for v in found.variables}
    assert by_name["A[2,3]"].start == 6.0
    assert by_name["A[2,3]"].element == 5
    assert by_name["n"].start == 7
    assert found.interfaces["me"].directional_derivatives


def test_binary_names_of_both_fashions_are_found(tmp_path: Path) -> None:
    old = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
    suffix = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}[host().rpartition("-")[2]]
    for folder in filter(None, (host(), old.get(host()))):
        path = tmp_path / folder / "binaries" / folder / f"M{suffix}"
        path.parent.mkdir(parents=True)
        path.touch()
        assert binary_path(tmp_path / folder, "M", source="M") == path
