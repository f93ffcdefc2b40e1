"""Releases: what is cheap to check of them; `scripts/dev.py release` builds and checks the real files."""

from __future__ import annotations

import json
import re
import tarfile
import zipfile
from dataclasses import replace
from email import message_from_string
from email.message import Message
from importlib.util import find_spec
from pathlib import Path

import pytest
from cyclonedx.model.bom import Bom
from cyclonedx.output.json import JsonV1Dot6
from hatchling.metadata.core import ProjectMetadata
from hatchling.metadata.spec import construct_metadata_file_2_4
from hatchling.plugin.manager import PluginManager
from packaging.tags import parse_tag
from packaging.utils import parse_wheel_filename
from trove_classifiers import classifiers

import workbench as wb
from scripts.release.__main__ import ReleaseError, different, unpack, wheel_for
from scripts.release.bom import invalid, source_parts
from scripts.release.natives import faults, library_faults
from workbench.build.toolchain import PLATFORMS, Platform, host_only
from workbench.kernel.library import kernel_path

ROOT = Path(__file__).parent.parent
FMU = ROOT / "fmus" / "fmi2" / "FirstOrderLag.fmu"


def wheel(folder: Path, platform_name: str, library: bytes, **more: bytes) -> Path:
    path = folder / "fmi_workbench-0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"workbench/kernel/lib/{platform_name}/{kernel_path().name}", library)
        for name, data in more.items():
            archive.writestr(f"workbench/{name}.fmu", data)
    return path


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda p: p.name)
def test_a_tag_says_what_the_compiler_compiles_for(platform: Platform) -> None:
    tag, target = platform.wheel, platform.target
    (parsed,) = parse_tag(f"py3-none-{tag}")
    assert parse_wheel_filename(f"fmi_workbench-1.0.0-py3-none-{tag}.whl")[3] == {parsed}
    oldest = re.search(r"(?:gnu|macos)\.(\d+)\.(\d+)$", target)
    system = {"linux": "manylinux", "macos": "macosx", "windows": "win"}[re.split(r"[-.]", target)[1]]
    machine = target.split("-")[0]
    numbers = f"_{oldest[1]}_{oldest[2]}" if oldest else ""
    machine = {"win": "amd64", "macosx": machine.replace("aarch64", "arm64")}.get(system, machine)
    assert tag == f"{system}{numbers}_{machine}"


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda p: p.name)
def test_binaries_of_a_bundled_fmu_are_for_their_platform_and_no_other(platform: Platform) -> None:
    with zipfile.ZipFile(FMU) as archive:
        name = next(n for n in archive.namelist() if n.startswith(f"binaries/{platform.name_2}/"))
        data = archive.read(name)
    assert library_faults(data, platform) == []
    for other in PLATFORMS:
        if other is not platform:
            assert library_faults(data, other)


def test_a_newer_c_library_than_the_tag_says_and_a_folder_of_the_builder_are_faults() -> None:
    with zipfile.ZipFile(FMU) as archive:
        data = archive.read("binaries/linux64/FirstOrderLag.so")
        mac = archive.read("binaries/darwin64/FirstOrderLag.dylib")
    linux = replace(PLATFORMS[0], wheel="manylinux_2_1_x86_64")
    assert any(fault.startswith("needs GLIBC_2.") for fault in library_faults(data, linux))
    older = replace(PLATFORMS[3], wheel="macosx_10_9_x86_64")
    assert "needs macOS 11.0.0" in library_faults(mac, older)
    assert any("/home/someone" in fault for fault in library_faults(data + b"\0/home/someone/x.c\0", PLATFORMS[0]))


def test_a_wheel_has_the_kernel_of_its_platform_alone(tmp_path: Path) -> None:
    (here,) = host_only()
    library = kernel_path().read_bytes()
    assert faults(wheel(tmp_path, here.name, library, lag=FMU.read_bytes()), here) == []
    other = next(p for p in PLATFORMS if p is not here)
    assert any("has the kernels" in fault for fault in faults(wheel(tmp_path, other.name, library), here))


def test_the_difference_of_two_builds_is_found_by_name(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
        (folder / "same.whl").write_bytes(b"same")
        (folder / "other.whl").write_bytes(folder.name.encode())
    (two / "more.whl").write_bytes(b"")
    assert different(sorted(one.iterdir()), sorted(two.iterdir())) == ["more.whl", "other.whl"]
    assert wheel_for([Path("a-py3-none-win_amd64.whl")], "win_amd64").name.startswith("a")
    with pytest.raises(ReleaseError, match="no wheel for win_arm64"):
        wheel_for([Path("a-py3-none-win_amd64.whl")], "win_arm64")


def test_source_archives_are_unpacked_inside_their_folder_only(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "x.tar", "w") as tar:
        tar.add(FMU, arcname="../outside.fmu")
    (tmp_path / "in").mkdir()
    with pytest.raises(tarfile.TarError):
        unpack(tmp_path / "x.tar", tmp_path / "in")


def test_a_bill_with_the_c_sources_fits_the_schema_and_a_wrong_one_does_not() -> None:
    bom = Bom()
    for component in source_parts(ROOT):
        bom.components.add(component)
    text = JsonV1Dot6(bom).output_as_string()
    assert invalid(text) == ""
    parts = {c["name"]: c for c in json.loads(text)["components"]}
    files = {part["name"] for part in parts["workbench_kernel"]["components"]}
    assert files == {f.relative_to(ROOT).as_posix() for f in (ROOT / "workbench" / "kernel").glob("*.[ch]")}
    assert any(p["name"] == "compiler" and "clang" in p["value"] for p in parts["workbench_kernel"]["properties"])
    assert "bomFormat" in invalid(text.replace('"bomFormat"', '"format"'))


def metadata() -> Message:
    """What an archive or a wheel says of itself, as its builder writes it."""
    return message_from_string(construct_metadata_file_2_4(ProjectMetadata(str(ROOT), PluginManager())))


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def as_line(text: str) -> str:
    return " ".join(text.split())


def test_metadata_citation_changes_and_pages_name_the_same_version() -> None:
    named = {
        "metadata": metadata()["Version"],
        "CITATION.cff": re.findall(r"^version: (.+)$", read("CITATION.cff"), re.MULTILINE)[0],
        "CHANGELOG.md": re.findall(r"^## (\d.*)$", read("CHANGELOG.md"), re.MULTILINE)[0],
        "docs/cluster.md": re.findall(r"^here is workbench ([^,]+),", read("docs/cluster.md"), re.MULTILINE)[0],
    }
    assert named == dict.fromkeys(named, wb.__version__)


def test_the_newest_changes_are_short_enough_to_be_read() -> None:
    newest = read("CHANGELOG.md").split("\n## ")[1]
    assert newest.startswith(wb.__version__)
    assert len(newest.split()) <= 600


def test_metadata_have_known_classifiers_and_no_invented_address() -> None:
    told = metadata()
    assert set(told.get_all("Classifier", [])) <= set(classifiers)
    assert told["License-Expression"] == "BSD-3-Clause"
    assert {"FMI", "FMU", "Modelica"} <= set(told["Keywords"].split(","))
    addresses = [line.partition(", ")[2] for line in told.get_all("Project-URL", [])]
    assert [url for url in addresses if not re.fullmatch(r"https://(?!.*(?:example|OWNER))\S+", url)] == []


def test_licences_of_what_others_wrote_come_with_the_files() -> None:
    assert metadata().get_all("License-File") == ["LICENSE", "NOTICE"]
    notice = as_line(read("NOTICE"))
    ours = {file.name for file in (ROOT / "workbench" / "build" / "runtime").iterdir()} | {"model.c"}
    with zipfile.ZipFile(FMU) as archive:
        names = [n for n in archive.namelist() if n.startswith("sources/") and Path(n).name not in ours]
        foreign = {Path(n).name: archive.read(n).decode() for n in names}
    assert len(foreign) == 6
    assert [name for name in foreign if not re.match(r"fmi[23]\w+\.h$", name)] == []
    for text in foreign.values():
        assert 'Modelica Association Project "FMI"' in text
    terms = as_line(foreign["fmi3Functions.h"]).partition("Redistribution and use")[2].partition("-----")[0]
    assert len(terms) > 1000
    assert terms.strip() in notice


def test_licences_of_what_the_compiler_adds_come_with_the_files() -> None:
    spec = find_spec("ziglang")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent
    for name in ("LICENSE", "lib/libc/mingw/COPYING"):
        assert as_line((folder / name).read_text(encoding="utf-8")) in as_line(read("NOTICE"))
