"""Releases: what is cheap to check of them; `scripts/dev.py release` builds and checks the real files."""

from __future__ import annotations

import json
import re
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from cyclonedx.model.bom import Bom
from cyclonedx.output.json import JsonV1Dot6
from packaging.tags import parse_tag
from packaging.utils import parse_wheel_filename

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
    assert parse_wheel_filename(f"fmi_workbench-0.1.0-py3-none-{tag}.whl")[3] == {parsed}
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
