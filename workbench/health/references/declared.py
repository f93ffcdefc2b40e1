"""The experiments and results that an FMU carries, by the layered standard FMI-LS-REF, in its folder extra.

Read are the manifest, the experiments files that it names (format MA-HS-Experiments), and experiments inside the
manifest, as drafts of the standard had them. What is wrong in one experiment is told of that one; the others remain.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from workbench.core.machine.files import content_of
from workbench.core.records.record import RecordPart
from workbench.errors import InputError
from workbench.system.files.ssp_xml import Element, Package, children, descend, parse, tag

__all__ = ["EXPERIMENTS", "FOLDER", "MANIFEST", "MAX_BYTES", "ROLE", "ReferenceResult", "references_in"]

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = "fmi-ls-manifest.xml"
EXPERIMENTS = "application/x-ma-hs-experiments"
ROLE = "result"
MAX_BYTES = 64 << 20  # of a file that is read
_CSV, _SSV = "text/csv", "application/x-ssp-parameter-set"
_ANY = "application/octet-stream"  # where a manifest names no type
_UNDESCRIBED = "experiments.xml"  # that is read even if the manifest does not name it
_NAMED = 4  # files in a note
_NOT_UNPACKED = re.compile(r"(\.\./)+(documentation|sources)/")
_BITS = (224, 256, 384, 512)


@dataclass(frozen=True, kw_only=True)
class ReferenceResult(RecordPart):
    """An experiment with results that the FMU's exporter has computed.

    Attributes:
        name: of the experiment; where a result stands alone, of its file.
        description: as declared; None where nothing is.
        results, stimuli, parameters: files inside the FMU; empty: none.
        start_time, stop_time, step: of the experiment [s]; None: those of the default experiment count.
        tolerance: relative, likewise.
        problem: why it cannot be run; empty: nothing is known against it.
    """

    name: str
    description: str | None = None
    results: str = ""
    stimuli: str = ""
    parameters: str = ""
    start_time: float | None = None
    stop_time: float | None = None
    step: float | None = None
    tolerance: float | None = None
    problem: str = ""


def references_in(folder: Path) -> tuple[tuple[ReferenceResult, ...], tuple[str, ...]]:
    """Return the reference results of an unpacked FMU, and remarks on files that belong to none.

    Source: FMI-LS-REF 1.0 (Layered Standard References) and MA-HS-Experiments of the Modelica Association.

    Args:
        folder: where it is unpacked.
    """
    home = folder / FOLDER
    if not home.is_dir():
        return (), ()
    reading = _Reading(folder.resolve(), home.resolve())
    for file in (home / MANIFEST, home / _UNDESCRIBED):
        try:
            reading.file(file.resolve())
        except InputError as error:
            reading.found.append(ReferenceResult(name=file.name, problem=str(error)))
    left = sorted(p.name for p in home.rglob("*.csv") if p.resolve() not in reading.seen)
    if left:
        some = ", ".join(left[:_NAMED]) + (", …" if len(left) > _NAMED else "")
        reading.notes.append(f"{FOLDER}: no experiment or result tells of {some}; not replayed")
    return tuple(reading.found), tuple(reading.notes)


class _Reading:
    """What has been found so far."""

    def __init__(self, folder: Path, home: Path) -> None:
        self.folder, self.home = folder, home
        self.found: list[ReferenceResult] = []
        self.notes: list[str] = []
        self.seen: set[Path] = set()

    def file(self, path: Path) -> None:
        """Read the manifest, or an experiments file, once."""
        if path in self.seen or (path.name == _UNDESCRIBED and not path.is_file()):
            return
        self.seen.add(path)
        root = parse(path, "fmiReferences" if path.name == MANIFEST else "Experiments")
        for element in children(root, "Experiment"):
            self.found.append(self._experiment(element, path))
        related = list(children(root, "Related"))
        for element in related:
            if (element.get("role") or "").partition("/")[0] == "experiment":
                self._try(self._experiments, element, path)
        for element in related:  # after the experiments, which may have the same results
            if element.get("role") == ROLE:
                self._try(self._result, element, path)

    def _try(self, read: Callable[[Element, Path], None], element: Element, manifest: Path) -> None:
        name = (element.get("source") or "").rpartition("/")[2] or "result"
        try:
            read(element, manifest)
        except InputError as error:
            self.found.append(ReferenceResult(name=name, description=element.get("description"), problem=str(error)))

    def _experiments(self, element: Element, manifest: Path) -> None:
        file = self._named(element, manifest)
        _check_sum(element, file)
        self.file(file)

    def _result(self, element: Element, manifest: Path) -> None:
        file = self._named(element, manifest)
        if file in self.seen:
            return
        _check_type(element, _CSV, file)
        _check_sum(element, file)
        self.seen.add(file)
        self.found.append(
            ReferenceResult(name=file.stem, description=element.get("description"), results=self._inside(file))
        )

    def _experiment(self, element: Element, owner: Path) -> ReferenceResult:
        name = element.get("name") or "experiment"
        try:
            kind = next((tag(e) for e in element if tag(e) in _OTHER_KINDS), None)
            if kind:
                raise InputError(f"experiment '{name}' is a {kind}; only runs over time are replayed")
            settings = descend(element, "TransientSimulation")
            times = {key: _time(element, settings, key) for key in ("startTime", "stopTime", "stepSize", "tolerance")}
            files = {key: self._of(element, key, owner) for key in ("References", "Stimuli", "Parameters")}
            if not files["References"]:
                raise InputError(f"experiment '{name}' has no reference results")
            return ReferenceResult(
                name=name,
                description=element.get("description"),
                results=files["References"],
                stimuli=files["Stimuli"],
                parameters=files["Parameters"],
                start_time=times["startTime"],
                stop_time=times["stopTime"],
                step=times["stepSize"],
                tolerance=times["tolerance"],
            )
        except InputError as error:
            return ReferenceResult(name=name, description=element.get("description"), problem=str(error))

    def _of(self, element: Element, key: str, owner: Path) -> str:
        given = descend(element, key)
        if given is None:
            return ""
        file = self._named(given, owner)
        _check_type(given, _SSV if key == "Parameters" else _CSV, file)
        self.seen.add(file)
        return self._inside(file)

    def _named(self, element: Element, owner: Path) -> Path:
        """Return the file that an element names, inside the FMU."""
        source = element.get("source") or ""
        if _NOT_UNPACKED.match(source):
            raise InputError(f"{owner.name}: '{source}' is in a folder that is not unpacked here; pack it in {FOLDER}")
        file = Package(owner.parent, within=self.folder).file(source, owner.name)
        if not file.is_file():
            raise InputError(f"{owner.name}: '{source}' is not a file")
        if file.stat().st_size > MAX_BYTES:
            raise InputError(f"{owner.name}: '{source}' is larger than {MAX_BYTES >> 20} MiB; not read")
        return file

    def _inside(self, file: Path) -> str:
        return file.relative_to(self.folder).as_posix()


_CHECKSUMS = {
    f"{family}-{bits}": f"{name}{bits}" for family, name in (("SHA3", "sha3_"), ("SHA", "sha")) for bits in _BITS
}
_OTHER_KINDS = (
    "SteadyState",
    "ParameterOptimization",
    "SetPointOptimization",
    "SensitivityAnalysis",
    "TrajectoryOptimization",
    "Linearization",
)


def _time(element: Element, settings: Element | None, key: str) -> float | None:
    """Return a number of an experiment, from itself or from what says that it is a run over time."""
    text = element.get(key) if settings is None else settings.get(key, element.get(key))
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (key in ("stepSize", "tolerance") and value <= 0.0):
        raise InputError(f"experiment '{element.get('name')}': {key}='{text}' cannot be used; export the FMU again")
    return value


def _check_type(element: Element, wanted: str, file: Path) -> None:
    given = element.get("type") or wanted
    if given not in (wanted, _ANY):
        raise InputError(f"{file.name}: {given} is not read; {wanted} is")


def _check_sum(element: Element, file: Path) -> None:
    """Compare a file with the digest that the manifest has."""
    given, kind = element.get("checksum"), element.get("checksumType") or "SHA3-256"
    if given is None:
        return
    if kind not in _CHECKSUMS:
        raise InputError(f"{file.name}: its checksum is of type '{kind}'; known are {', '.join(_CHECKSUMS)}")
    if hashlib.new(_CHECKSUMS[kind], content_of(file)).hexdigest() != given.strip().lower():
        raise InputError(f"{file.name}: was changed after the FMU was exported: its checksum is another")
