"""FMUs with sources: compiled, they do what the FMU with binaries does; each mistake is told in one line."""

from __future__ import annotations

import ctypes
import zipfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import numpy as np
import pytest

import workbench as wb
from tests.fmi1_fmus import MODELS, describe, write_sources
from tests.fmi3_fmus import build_sized
from workbench.build.fmu import generate
from workbench.build.toolchain import host_only
from workbench.core.machine.files import pack
from workbench.errors import BuildError, FmuError, InputError

(HOST,) = host_only()
C = Path(__file__).parent / "c"
PREFIXED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Prefixed" guid="{{x}}">
  <CoSimulation modelIdentifier="prefixed" canHandleVariableCommunicationStepSize="true">{listed}</CoSimulation>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2" /></Outputs></ModelStructure>
</fmiModelDescription>
"""
LISTED = '<SourceFiles><File name="code/prefixed.c" /></SourceFiles>'


def without_binaries(fmu: str, target: Path) -> Path:
    """Write a bundled FMU without its binaries."""
    name, _, version = fmu.partition("@")
    found = Path(__file__).parent.parent / "fmus" / f"fmi{version}" / f"{name}.fmu"
    with zipfile.ZipFile(found) as archive:
        pack(target, {n: archive.read(n) for n in archive.namelist() if not n.startswith("binaries/")})
    return target


def prefixed(target: Path, *, listed: str = "", **changed: bytes | None) -> Path:
    """Write an FMU with the sources of tests/c/prefixed; a file that is None is left out."""
    files: Mapping[str, bytes | None] = {
        "prefixed.c": (C / "prefixed" / "prefixed.c").read_bytes(),
        "fmi2_stub.h": (C / "fmi2_stub.h").read_bytes(),
        "gain.h": b"#define GAIN 3.0\n",
        **{name.replace("__", "."): text for name, text in changed.items()},
    }
    sources = {f"sources/code/{name}": text for name, text in files.items() if text is not None}
    pack(target, {"modelDescription.xml": PREFIXED.format(listed=listed).encode(), **sources})
    return target


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_from_its_sources_does_what_the_one_with_binaries_does(version: int, tmp_path: Path) -> None:
    file = without_binaries(f"FirstOrderLag@{version}", tmp_path / "lag.fmu")
    with pytest.raises(FmuError, match=r"it has its sources, so make one: workbench build .*lag\.fmu$"):
        wb.load(file)
    before = set(zipfile.ZipFile(file).namelist())
    made = wb.compile_fmu(file)
    folder = HOST.name if version == 3 else HOST.name_2
    assert made.binaries == (f"binaries/{folder}/FirstOrderLag{HOST.suffix}",)
    assert set(zipfile.ZipFile(file).namelist()) == {*before, *made.binaries}
    assert [p.name for p in tmp_path.iterdir()] == ["lag.fmu"]
    u = {"u": wb.Constant(1.0)}
    with wb.load(file) as model, wb.load(f"fmu:FirstOrderLag@{version}") as same:
        runs = [wb.simulate(m, stop=5.0, interval=0.5, inputs=u) for m in (model, same)]
    assert np.array_equal(runs[0].signals["y"], runs[1].signals["y"])
    theirs = fmpy.simulate_fmu(str(file), stop_time=5.0, output_interval=0.5, start_values={"u": 1.0})
    assert theirs["y"][-1] == pytest.approx(runs[0].signals["y"][-1], rel=1e-4)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_functions_of_fmi_1_have_the_identifier_before_them(interface: str, tmp_path: Path) -> None:
    sources = generate(MODELS["FirstOrderLag"], "FirstOrderLag")
    code = tmp_path / "code"
    code.mkdir()
    compiled = set(write_sources(code, sources, interface))
    # FMI 1.0 lists no files: every one of C is compiled.
    (code / "identifier.h").write_text("")
    kept = [p for p in code.iterdir() if p.suffix == ".h" or p.name in compiled]
    file = tmp_path / "lag.fmu"
    description = describe(sources.descriptions[2], "FirstOrderLag", interface)
    pack(file, {"modelDescription.xml": description, **{f"sources/{p.name}": p.read_bytes() for p in kept}})
    assert set(wb.compile_fmu(file).sources) == compiled
    with wb.load(file) as model:
        run = wb.simulate(model, stop=2.0, interval=0.1, inputs={"u": wb.Constant(1.0)})
    assert run.signals["y"] == pytest.approx(1.0 - np.exp(-run.time), abs=1e-5)


@pytest.mark.parametrize("listed", ["", LISTED])
def test_a_prefix_for_static_linking_is_taken_away(listed: str, tmp_path: Path) -> None:
    file = prefixed(tmp_path / "p.fmu", listed=listed)
    made = wb.compile_fmu(file)
    with wb.load(file) as model:
        assert wb.simulate(model, stop=1.0, inputs={"u": wb.Constant(2.0)}).signals["y"][-1] == 6.0
    library = tmp_path / "library"
    library.write_bytes(zipfile.ZipFile(file).read(made.binaries[0]))
    functions = ctypes.CDLL(str(library))
    assert hasattr(functions, "fmi2DoStep")
    assert not hasattr(functions, "prefixed_fmi2DoStep")


def test_other_platforms_are_compiled_for_here(tmp_path: Path) -> None:
    file, out = prefixed(tmp_path / "p.fmu"), tmp_path / "all.fmu"
    made = wb.compile_fmu(file, out=out, platforms=["win64", "aarch64-darwin"])
    assert made.binaries == ("binaries/win64/prefixed.dll", "binaries/aarch64-darwin/prefixed.dylib")
    with zipfile.ZipFile(out) as archive:
        dll, dylib = (archive.read(name) for name in made.binaries)
    assert (dll[:2], dylib[:4]) == (b"MZ", b"\xcf\xfa\xed\xfe")
    for library in (dll, dylib):
        assert b"fmi2DoStep\0" in library
        assert b"prefixed_fmi2DoStep" not in library


MISTAKES: dict[str, tuple[dict[str, bytes | None], str, str]] = {
    "no sources": (
        {"prefixed__c": None, "fmi2_stub__h": None, "gain__h": None},
        "",
        r"it has no sources, .* ask its maker",
    ),
    "no C": ({"prefixed__c": None}, "", r"its folder sources holds no C files"),
    "missing header": (
        {"gain__h": None},
        "",
        r"prefixed\.c:5:10: fatal error: 'gain\.h' file not found \(gain\.h is neith",
    ),
    "an error": ({"gain__h": b"#define GAIN 3.0 +\n#error here\n"}, "", r"gain\.h:2:2: error: here"),
    "missing file": ({}, LISTED.replace("prefixed.c", "lost.c"), r"names 'code/lost\.c', which is not in the FMU"),
    "outside": ({}, LISTED.replace("code/prefixed.c", "../../x.c"), r"names '../../x\.c', which is not inside the FMU"),
    "undefined": (
        {"gain__h": b"double other(void);\n#define GAIN other()\n"},
        "",
        r"undefined symbol: _?other \(no source defines _?other; is a file missing",
    ),
    "no FMI": ({"prefixed__c": b"int answer(void) { return 42; }\n"}, "", r"they do not define fmi2Instantiate"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_told_in_one_line_and_nothing_is_written(name: str, tmp_path: Path) -> None:
    changed, listed, words = MISTAKES[name]
    file = prefixed(tmp_path / "p.fmu", listed=listed, **changed)
    before = file.read_bytes()
    with pytest.raises(BuildError, match=words) as told:
        wb.compile_fmu(file)
    assert "\n" not in str(told.value)
    assert str(tmp_path) not in str(told.value).removeprefix(str(file))
    assert file.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["p.fmu"]


def test_what_an_fmu_came_with_is_not_replaced_in_place(tmp_path: Path) -> None:
    file = prefixed(tmp_path / "p.fmu")
    wb.compile_fmu(file)
    with pytest.raises(InputError, match=r"it has binaries/.* already; to compile it anew, name another file to write"):
        wb.compile_fmu(file)
    again = wb.compile_fmu(file, out=tmp_path / "again.fmu")
    assert zipfile.ZipFile(again.file).namelist() == zipfile.ZipFile(file).namelist()
    with pytest.raises(InputError, match=r"no platform 'linux128'; there are: x86_64-linux"):
        wb.compile_fmu(file, out=tmp_path / "x.fmu", platforms=["linux128"])


BUILD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="sized" platform="riscv64-linux">
    <SourceFileSet><SourceFile name="nowhere.c" /></SourceFileSet>
  </BuildConfiguration>
  <BuildConfiguration modelIdentifier="{identifier}">
    <SourceFileSet language="C99" compilerOptions="-O3 -march=native">
      <SourceFile name="src/model.c" /><SourceFile name="include/fmi3_stub.h" />
      <PreprocessorDefinition name="ASKED" value="7" />
      <PreprocessorDefinition name="BESIDES" optional="true" />
      <IncludeDirectory name="include" />
    </SourceFileSet>
    {library}
  </BuildConfiguration>
</fmiBuildDescription>
"""
DEMANDS = b"""#if ASKED != 7 || defined(BESIDES)
#error the definitions are not those of the build description
#endif
"""


def described_sources(folder: Path, *, library: str = "", identifier: str = "sized") -> Path:
    """Write an FMU of FMI 3.0 whose buildDescription.xml says how it is built."""
    with zipfile.ZipFile(build_sized(folder)) as archive:
        description = archive.read("modelDescription.xml")
    file = folder / "described.fmu"
    build = BUILD.format(library=library, identifier=identifier).encode()
    sources = {
        "buildDescription.xml": build,
        "src/model.c": DEMANDS + (C / "sized" / "sized.c").read_bytes(),
        "include/fmi3_stub.h": b"#define FMI3_FUNCTION_PREFIX sized_\n" + (C / "fmi3_stub.h").read_bytes(),
    }
    pack(file, {"modelDescription.xml": description, **{f"sources/{name}": text for name, text in sources.items()}})
    return file


def test_a_build_description_says_how_it_is_built(tmp_path: Path) -> None:
    file = described_sources(tmp_path)
    made = wb.compile_fmu(file)
    assert made.sources == ("src/model.c",)
    assert any("compiler options that the FMU asks for were left out: -O3 -march=native" in n for n in made.notes)
    with wb.load(file, start_values={"n": 1, "a": [2.0]}) as model:
        run = wb.simulate(model, stop=1.0, inputs={"u": [1.0]})
    assert run.signals["sum"][-1] == pytest.approx((1.0 - np.exp(-2.0)) / 2.0, rel=1e-5)


def test_a_build_description_without_this_platform_is_told(tmp_path: Path) -> None:
    file = described_sources(tmp_path, identifier="other")
    with pytest.raises(BuildError, match=r"says how sized is built for: riscv64-linux; not "):
        wb.compile_fmu(file)


def test_a_library_that_does_not_come_with_the_sources_is_named(tmp_path: Path) -> None:
    file = described_sources(tmp_path, library='<Library name="hdf5" /><Library name="m" />')
    with pytest.raises(BuildError, match=r"sized is linked with the library hdf5, which does not come with it"):
        wb.compile_fmu(file)
