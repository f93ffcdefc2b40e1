"""Binaries for an FMU that comes with its sources."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import fmpy

from workbench.build.source_lists import ListedLibrary, SourceFile, every_interface, listed_libraries
from workbench.build.toolchain import CFile, Platform, chosen_platforms, compile_files, require
from workbench.core.machine.files import file_to_write, replacing
from workbench.errors import BuildError, InputError
from workbench.fmi.archive import extract, locate
from workbench.fmi.description import ModelDescription
from workbench.fmi.library import functions_of
from workbench.fmi.platforms import folders_of
from workbench.fmi.reading import read_description
from workbench.jobs.job import Job
from workbench.show.result import Result

__all__ = ["CompiledFmu", "add_binaries"]

_HEADERS = "fmi-standard-headers"  # in the folder of the sources
_MADE = (1980, 1, 1, 0, 0, 0)  # the first date that zip knows: the same sources give the same bytes
# What shows that a library is what FMI means: one of these is what every importer calls first.
_FIRST = {
    (1, "me"): "{name}_fmiInstantiateModel",
    (1, "cs"): "{name}_fmiInstantiateSlave",
    (2, "me"): "fmi2Instantiate",
    (2, "cs"): "fmi2Instantiate",
    (3, "me"): "fmi3InstantiateModelExchange",
    (3, "cs"): "fmi3InstantiateCoSimulation",
    (3, "se"): "fmi3InstantiateScheduledExecution",
}


@dataclass(frozen=True)
class CompiledFmu(Result):
    """An FMU whose sources were compiled.

    Attributes:
        model: name of the model.
        fmi: FMI version, as written in the FMU.
        file: the FMU that was written.
        platforms: for which it has new binaries, as FMI 3.0 names platforms.
        sources: the files that were compiled.
        binaries: the new files inside.
        notes: what of the FMU's wishes was left out, one line each.
    """

    _page = "workbench.build.page:compiled_page"

    model: str
    fmi: str
    file: Path
    platforms: tuple[str, ...]
    sources: tuple[str, ...]
    binaries: tuple[str, ...]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a compiled FMU", "build"


def add_binaries(
    path: str | Path, out: str | Path | None, platforms: Sequence[str] | None = None, job: Job | None = None
) -> CompiledFmu:
    """Compile the sources of an FMU, and write the FMU with the binaries.

    Args:
        path: an `.fmu` file.
        out: the FMU to write; None: `path`, which must not have these binaries yet.
        platforms: see `chosen_platforms`; None: this machine's.
        job: is told how far it is, and what takes long.

    Raises:
        InputError: no such file, an unknown platform, binaries that are there already.
        FmuError: it is not an FMU.
        BuildError: it has no sources, or they cannot be compiled.
    """
    source, chosen, job = locate(path), chosen_platforms(platforms, usual="host"), job or Job()
    if source.is_dir():
        raise InputError(f"{path}: this is a folder; compile takes an .fmu file")
    target = source if out is None else file_to_write(out, ".fmu", option="out")
    require("ziglang")
    with tempfile.TemporaryDirectory(prefix="workbench-compile-") as temporary:
        folder = Path(temporary) / "fmu"
        folder.mkdir()
        left = extract(source, folder, wanted=_wanted)
        if not (folder / "modelDescription.xml").is_file():
            raise BuildError(f"{path}: no modelDescription.xml inside; this is not an FMU")
        description = read_description(folder, source=str(path))
        if out is None:
            _refuse_present(left, description, chosen, str(path))
        made: dict[str, Path] = {}
        used: list[str] = []
        notes: list[str] = []
        for number, platform in enumerate(chosen):
            if number:  # who interrupts what is compiled once loses nothing
                job.done(f"compiling for {platform.name}", number, len(chosen))
            for library in listed_libraries(folder, description, platform.name, source=str(path)):
                output = Path(temporary) / "lib" / platform.name / f"{library.identifier}{platform.suffix}"
                try:
                    _compile(folder / "sources", library, description.major, platform, output=output, job=job)
                except BuildError as error:
                    raise BuildError(f"{path}: {error}") from None
                made[_place(library.identifier, description, platform)] = output
                used += [f.name for f in library.files]
                notes += library.notes
        _write(source, target, made)
    return CompiledFmu(
        model=description.model_name,
        fmi=description.fmi_version,
        file=target,
        platforms=tuple(p.name for p in chosen),
        sources=tuple(dict.fromkeys(used)),
        binaries=tuple(made),
        notes=tuple(dict.fromkeys(notes)),
    )


def _wanted(file: PurePosixPath) -> bool:
    return file.parts[0] == "sources" or str(file) == "modelDescription.xml"


def _place(identifier: str, description: ModelDescription, platform: Platform) -> str:
    folder = platform.name if description.major >= 3 else platform.name_2
    return f"binaries/{folder}/{identifier}{platform.suffix}"


def _refuse_present(
    left: Sequence[PurePosixPath], description: ModelDescription, platforms: Sequence[Platform], source: str
) -> None:
    """Refuse to replace what the FMU came with, unless another file is written."""
    names = {claims.identifier for claims in every_interface(description).values()}
    for platform in platforms:
        there = {f"binaries/{folder}/{n}{platform.suffix}" for folder in folders_of(platform.name) for n in names}
        if result := sorted(there & {str(file) for file in left}):
            raise InputError(
                f"{source}: it has {result[0]} already; to compile it anew, name another file to write (`out`)"
            )


def _compile(sources: Path, library: ListedLibrary, major: int, platform: Platform, *, output: Path, job: Job) -> None:
    """Compile one library for one platform."""
    _give_headers(sources)
    general = _definitions(library, major)
    files = [_with(file, general) for file in library.files]
    compile_files(sources, files, platform, output, install_stem=library.identifier, say=job.say)
    contents = output.read_bytes()
    for interface in library.interfaces:
        first = _FIRST[major, interface].format(name=library.identifier)
        if first.encode() + b"\0" not in contents:
            raise BuildError(f"the sources were compiled, but they do not define {first}, which FMI wants")


def _with(file: SourceFile, general: Sequence[str]) -> CFile:
    own = {d.partition("=")[0] for d in file.definitions}
    defined = (*file.definitions, *(d for d in general if d.partition("=")[0] not in own))
    return CFile(file.name, defined, (".", *file.folders, _HEADERS))


def _definitions(library: ListedLibrary, major: int) -> list[str]:
    """Return macros that give functions the names that FMI wants in a shared library.

    FMI 1.0 wants the model identifier before each; from 2.0 on that is for static linking alone. Sources often have
    the prefix all the same, and headers before 2.0.4 no macro against it: then the prefixed names are renamed, which
    works as the standard's headers paste them together from two macros.
    """
    if major == 1:
        kind = "FMI_COSIMULATION" if library.interfaces == ("cs",) else "FMI_MODEL_EXCHANGE"
        return [f"MODEL_IDENTIFIER={library.identifier}", kind]
    renamed = [f"{library.identifier}_{n}={n}" for n in functions_of(major)]
    return [f"FMI{major}_OVERRIDE_FUNCTION_PREFIX", *renamed]


def _give_headers(sources: Path) -> None:
    """Put the standard's headers where they are found last: many FMUs do not bring them."""
    folder = sources / _HEADERS
    if folder.is_dir():
        return
    folder.mkdir()
    for files in ((Path(fmpy.__file__).parent / "c-code").glob("fmi[23]*.h"), _OWN.glob("*.h")):
        for header in files:
            shutil.copyfile(header, folder / header.name)


_OWN = Path(__file__).parent / "fmi1_headers"


def _write(source: Path, target: Path, made: Mapping[str, Path]) -> None:
    """Write the FMU anew with the binaries; all else in it stays as it is."""
    with (
        replacing(target) as part,
        zipfile.ZipFile(source) as old,  # closed before it is replaced, as Windows wants it
        zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for entry in old.infolist():
            if entry.filename.replace("\\", "/") not in made:
                with old.open(entry) as contents, new.open(_copy(entry), "w") as sink:
                    shutil.copyfileobj(contents, sink)
        for name, file in made.items():
            added = zipfile.ZipInfo(name, _MADE)
            added.compress_type = zipfile.ZIP_DEFLATED
            added.external_attr = 0o100755 << 16
            new.writestr(added, file.read_bytes())


def _copy(entry: zipfile.ZipInfo) -> zipfile.ZipInfo:
    """Return the entry for the new archive: what says where it stands in the old one is left out."""
    copied = zipfile.ZipInfo(entry.filename, entry.date_time)
    copied.compress_type = zipfile.ZIP_STORED if entry.compress_type == zipfile.ZIP_STORED else zipfile.ZIP_DEFLATED
    copied.create_system, copied.external_attr = entry.create_system, entry.external_attr
    copied.file_size = entry.file_size
    return copied
