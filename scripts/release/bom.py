"""The bill of materials of a release, CycloneDX 1.6 in JSON.

`cyclonedx-py` lists the packages of the environment in which the wheel was tried, with versions, licences and their
dependencies on each other. Added are the files of the release, the C sources, and what made them.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import uuid
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from packageurl import PackageURL

from workbench.build.toolchain import FLAGS

__all__ = ["invalid", "source_parts", "write_bom"]

PACKAGE = "fmi-workbench"
OWN_LICENCE = "BSD-3-Clause"
UNDECLARED = {"FMPy": "BSD-2-Clause"}  # by the text of its licence; its metadata name none
BUILDERS = (("ziglang", "MIT"), ("hatchling", "MIT"))


def write_bom(files: Sequence[Path], source: Path, python: Path, *, epoch: int) -> Path:
    """Write the bill of materials beside the files of a release, and return it.

    Args:
        files: the source archive and the wheels.
        source: the unpacked source archive.
        python: of an environment with one of the wheels installed.
        epoch: time of the commit [s].

    Raises:
        ValueError: it does not fit CycloneDX's schema.
    """
    bom = of_environment(python, epoch)
    package = bom.metadata.component
    assert package is not None  # noqa: S101 - `of_environment` has put it there
    package.components.update(_file(file, file.parent) for file in files)
    kernel, runtime, headers = source_parts(source)
    builders = [_builder(name, licence) for name, licence in BUILDERS]
    for component in (kernel, runtime, headers, *builders):
        bom.components.add(component)
    bom.register_dependency(package, [kernel, runtime])
    bom.register_dependency(runtime, [headers])
    # No clock and no chance: the same files give the same bill.
    bom.serial_number = uuid.uuid5(uuid.NAMESPACE_OID, "".join(str(h.content) for f in files for h in _file(f).hashes))
    text = JsonV1Dot6(bom).output_as_string(indent=2) + "\n"
    wrong = invalid(text)
    if wrong:
        raise ValueError(f"the bill of materials does not fit CycloneDX 1.6: {wrong}")
    target = files[0].parent / f"{PACKAGE.replace('-', '_')}-{package.version}.cdx.json"
    target.write_text(text, encoding="utf-8")
    return target


def source_parts(source: Path) -> tuple[Component, Component, Component]:
    """Return what the native code is made of: the kernel, the runtime of FMUs, the standard's headers.

    Args:
        source: a checkout, or the unpacked source archive.
    """
    headers = Component(
        type=ComponentType.LIBRARY,
        name="fmi-headers",
        version="2.0 and 3.0",
        licenses=[LicenseFactory().make_from_string("BSD-2-Clause")],
        description="Headers of the FMI standard as FMPy has them; copies in the sources of the bundled FMUs.",
        bom_ref="fmi-headers",
    )
    return (
        _sources("workbench_kernel", "The inner loop; compiled in each wheel.", source, "workbench/kernel"),
        _sources("workbench-fmu-runtime", "C runtime of built FMUs.", source, "workbench/build/runtime"),
        headers,
    )


def of_environment(python: Path, epoch: int) -> Bom:
    """Return the packages of an environment, the workbench as what the bill is about."""
    done = subprocess.run(
        [sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible", "--sv", "1.6", str(python)],
        capture_output=True, text=True, check=True, env={"SOURCE_DATE_EPOCH": str(epoch)},
    )  # fmt: skip
    bom: Bom = Bom.from_json(json.loads(done.stdout))  # type: ignore[attr-defined]  # a decorator adds it
    (package,) = (c for c in bom.components if c.name == PACKAGE)
    bom.components.discard(package)
    package.purl = PackageURL("pypi", name=PACKAGE, version=package.version)  # not where this machine had its wheel
    package.external_references.clear()
    bom.metadata.component = package
    for component in bom.components:
        if not component.licenses and component.name in UNDECLARED:
            component.licenses.add(LicenseFactory().make_from_string(UNDECLARED[component.name]))
    return bom


def invalid(text: str) -> str:
    """Return why a bill does not fit CycloneDX's schema; empty if it does."""
    from cyclonedx.validation.json import JsonStrictValidator  # noqa: PLC0415 - a second, at each collection of tests

    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    return str(error) if error else ""


def _sources(name: str, description: str, source: Path, folder: str) -> Component:
    """Our own C sources in one folder, with the files as their parts."""
    files = sorted((source / folder).glob("*.[ch]"))
    return Component(
        type=ComponentType.LIBRARY,
        name=name,
        licenses=[LicenseFactory().make_from_string(OWN_LICENCE)],
        description=description,
        components=[_file(file, source) for file in files],
        properties=[
            Property(name="compiler", value=compiler()),
            Property(name="compiler flags", value=" ".join(FLAGS)),
        ],
        bom_ref=name,
    )


def _file(file: Path, root: Path | None = None) -> Component:
    name = file.relative_to(root or file.parent).as_posix()
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    hashes: Iterable[HashType] = [HashType(alg=HashAlgorithm.SHA_256, content=digest)]
    return Component(type=ComponentType.FILE, name=name, hashes=hashes, bom_ref=f"file:{name}")


def _builder(name: str, licence: str) -> Component:
    """What made the files; `excluded`: not installed with them."""
    parts = "; compiler-rt and, for Windows, mingw-w64's start-up code become part of the libraries"
    return Component(
        type=ComponentType.APPLICATION,
        name=name,
        version=version(name),
        purl=PackageURL("pypi", name=name, version=version(name)),
        licenses=[LicenseFactory().make_from_string(licence)],
        description=f"C compiler: {compiler()}{parts}" if name == "ziglang" else "Packs the archives.",
        scope=ComponentScope.EXCLUDED,
        bom_ref=f"{name}=={version(name)}",
    )


def compiler() -> str:
    """Return what the C compiler says of its version, in one line."""
    command = [sys.executable, "-m", "ziglang", "cc", "--version"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return f"ziglang {version('ziglang')}, {answer.splitlines()[0].partition('(')[0].strip()}"
