"""The corpus that `scripts/zoo.py` is tried on in CI: one row for each FMU, where it comes from, what it mimics.

FMUs of other people are taken from packages where those are installed; the rest is built for this machine.
"""

from __future__ import annotations

import shutil
import sys
import tarfile
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.fmi1_fmus import build_fmi1
from tests.fmi3_fmus import build_aliased
from tests.foreign_fmus import build_foreign, build_shy
from tests.hostile_fmus import BROKEN_FILES, HOSTILE, build_broken, build_hostile
from tests.lying_fmus import LIES, build_lying
from tests.mimic_fmus import MIMICS, build_mimic
from tests.reference_fmus import SUBJECTS, build_reference
from workbench.core.machine.files import pack

__all__ = ["CORPUS", "Exhibit", "build_corpus"]

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True)
class Exhibit:
    """An FMU of the corpus.

    Attributes:
        name: of its file, without the suffix.
        source: where it comes from.
        mimics: whose behaviour, or what it does, in words.
        build: writes it into a folder and returns the file.
    """

    name: str
    source: str
    mimics: str
    build: Callable[[Path], Path]


def _references() -> Iterator[Exhibit]:
    for fmi, subjects in SUBJECTS.items():
        for subject in subjects:
            interfaces = ("",) if fmi > 1 else ("cs",) if subject == "resource" else ("me", "cs")
            for interface in interfaces:
                build = partial(build_reference, subject=subject, fmi=fmi, interface=interface)
                name = f"{subject}{fmi}{interface}"
                yield Exhibit(name, f"tests/c/reference{2 if fmi < 3 else 3}", f"Reference FMUs: {subject}", build)


def _mimics() -> Iterator[Exhibit]:
    yield Exhibit("second-names", "fmus", "Dymola: FMI 3.0 with an alias of each variable", build_aliased)
    for name, mimic in MIMICS.items():
        yield Exhibit(name, "tests/c/mimics", mimic.mimics, partial(build_mimic, name=name))


_FOREIGN = {
    "plain": "nothing unusual",
    "strict": "Dymola: refuses the time outside continuous-time mode",
    "event": "ends its run with an event (terminateSimulation; in co-simulation it discards and says terminated)",
    "step": "ends its run with a completed step",
}
_SHY = {
    "works": "event mode in co-simulation, with an event of its own",
    "instantiate": "declares event mode, but needs eventModeUsed = false",
    "update": "declares event mode and refuses its first event iteration",
    "ends": "ends its run, returning early",
}


def _manners() -> Iterator[Exhibit]:
    for name, does in _FOREIGN.items():
        yield Exhibit(name, "tests/c/foreign", does, partial(build_foreign, name=name))
    for name, does in _SHY.items():
        yield Exhibit(name, "tests/c/shy", does, partial(build_shy, name=name))


def _hostile() -> Iterator[Exhibit]:
    for name, hostile in HOSTILE.items():
        yield Exhibit(f"hostile-{name}", "tests/c/hostile", hostile.does, partial(build_hostile, name=name))
    for name in BROKEN_FILES:
        yield Exhibit(f"broken-{name}", "tests/hostile_fmus.py", name, partial(build_broken, name=name))
    for name, lie in LIES.items():
        yield Exhibit(
            f"lying-{name}", "tests/c/lying", f"breaks a promise: {lie.check}", partial(build_lying, name=name)
        )


def _modelica() -> Iterator[Exhibit]:
    for model in ("FirstOrderLag", "Hybrid"):
        for interface in ("me", "cs"):
            build = partial(build_fmi1, model=model, interface=interface)
            yield Exhibit(f"{model}_{interface}", "modelica_src and tests/modelica, tests/c/fmi1*.c", "FMI 1.0", build)
    yield Exhibit(
        "OnlyNominal", "modelica_src, tests/c/fmi1*.c", "FMI 1.0 with nominal values for starts", _only_nominal
    )


def _only_nominal(folder: Path) -> Path:
    """Write an FMU of FMI 1.0 whose variables have a nominal value and no start value."""
    file = build_fmi1(folder, "FirstOrderLag", "me")
    with zipfile.ZipFile(file) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    root = ET.fromstring(contents["modelDescription.xml"])  # noqa: S314  written by us
    for real in root.iter("Real"):
        real.attrib.pop("start", None)
        real.set("nominal", "2.0")
    pack(file, contents | {"modelDescription.xml": ET.tostring(root)})
    return file


def _bundled() -> Iterator[Exhibit]:
    for version in (2, 3):
        for name in ("Duffing", "FirstOrderLag", "Hysteresis", "Rudder", "TwoRateQuantizer"):
            file = ROOT / "fmus" / f"fmi{version}" / f"{name}.fmu"
            if file.exists():
                yield Exhibit(f"{name}{version}", "fmus", "this project's own exporter", partial(_copied, file))


# Packages with FMUs inside: module → where they lie in it.
_PACKAGES = {"gemseo_fmu": "problems/fmu_files/linux", "modestpy": "test/resources"}


def _packages() -> Iterator[Exhibit]:
    """Yield those of installed packages, and of source archives that `scripts/dev.py` has fetched."""
    for module, folder in _PACKAGES.items():
        spec = find_spec(module)
        for root in (spec.submodule_search_locations or ()) if spec is not None else ():
            for file in sorted((Path(root) / folder).rglob("*.fmu")):
                if "win" not in file.stem:
                    yield Exhibit(file.stem, f"package {module}", "itself", partial(_copied, file))
    for path in sorted((Path(sys.prefix) / "foreign").glob("*.tar.gz")):
        with tarfile.open(path) as archive:
            names = [n for n in archive.getnames() if n.endswith(".fmu") and "/tests/" in n and "win" not in n]
        for name, member in _by_stem(names).items():
            yield Exhibit(name, f"archive {path.name}", "itself", partial(_unpacked, path, member))


def _by_stem(members: list[str]) -> dict[str, str]:
    """Return a name for each FMU of an archive, with its folder where others are called the same."""
    stems = [Path(m).stem for m in members]
    return {
        f"{Path(m).parent.name}-{stem}" if stems.count(stem) > 1 else stem: m
        for m, stem in zip(members, stems, strict=True)
    }


def _unpacked(archive: Path, member: str, folder: Path) -> Path:
    file = folder / Path(member).name
    with tarfile.open(archive) as opened:
        inside = opened.extractfile(member)
        assert inside is not None
        file.write_bytes(inside.read())
    return file


def _copied(file: Path, folder: Path) -> Path:
    return Path(shutil.copy(file, folder / file.name))


CORPUS: tuple[Exhibit, ...] = (
    *_references(), *_mimics(), *_manners(), *_hostile(), *_modelica(), *_bundled(), *_packages(),
)  # fmt: skip


def build_corpus(folder: Path, exhibits: Iterable[Exhibit] = CORPUS) -> dict[str, Exhibit]:
    """Write FMUs, each as ``folder/NAME.fmu``; return file name → its row."""
    found = {}
    for exhibit in exhibits:
        with TemporaryDirectory(dir=folder) as temporary:
            built = exhibit.build(Path(temporary))
            found[built.replace(folder / f"{exhibit.name}.fmu").name] = exhibit
    return found
