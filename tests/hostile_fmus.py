"""FMUs that misbehave, built for this machine: one library (tests/c/hostile), many archives around it.

Those in `NEEDS_WORKER` end, block or fill the process that runs them; the others must end in one clear
line. All misbehave from t = 0.5 s on, in Model Exchange and in Co-Simulation. Those that hang can tell when they do:
see tests/c/hostile.
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.stub_fmus import stub_fmu, write_stub
from workbench.core.machine.files import pack
from workbench.jobs.worker_process import WorkerProcess


def lose_patience_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a time limit be over as soon as an FMU hangs, and not before, however slow the machine is.

    The limit itself can be generous then; with one job at a time it is that of the FMU that hangs.

    Args:
        folder: where the FMU tells.
        monkeypatch: of the test.
    """
    tells, late = folder / "tells", WorkerProcess.is_late
    monkeypatch.setenv("HOSTILE_TELLS", str(tells))

    def hangs() -> bool:
        text = tells.read_text(encoding="ascii") if tells.exists() else ""
        return text.endswith("\n") and _lives(int(text))

    monkeypatch.setattr(WorkerProcess, "is_late", lambda worker: hangs() or late(worker))


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@dataclass(frozen=True)
class Hostile:
    """What an FMU does.

    Attributes:
        does: in words.
        message: what the error message must contain when it runs in this process (a regular expression);
            empty where it runs to its end, or where a worker process is needed.
        needs_worker: it would take this process with it, or block it.
    """

    does: str
    message: str = ""
    needs_worker: bool = False


HOSTILE = {
    "nothing": Hostile("behaves well"),
    "segfault": Hostile("segmentation fault in doStep and getDerivatives", needs_worker=True),
    "segfault-at-start": Hostile("segmentation fault when it is instantiated", needs_worker=True),
    "abort": Hostile("calls abort()", needs_worker=True),
    "exit": Hostile("calls exit(3)", needs_worker=True),
    "hang": Hostile("never returns", needs_worker=True),
    "hang-at-start": Hostile("never returns when it is instantiated", needs_worker=True),
    "memory": Hostile("takes 3 GiB of memory with every step", needs_worker=True),
    "chatter": Hostile("writes to standard output", needs_worker=True),
    "nan-output": Hostile("the output is not a number", r"y is nan, not a finite number \(at t = 0\.5"),
    # A solver first tries shorter and shorter steps towards such a wall.
    "nan-state": Hostile(
        "the derivative is not a number", r"not a finite number|step became too small|more than \d+ steps needed"
    ),
    "error": Hostile("returns error and says why", r"returned error.*the pump ran dry.*\(at t = 0\.5"),
    "fatal": Hostile("returns fatal and says why", r"returned fatal error.*the pump ran dry.*\(at t = 0\.5"),
    "lazy-restore": Hostile("claims to restore its state and does nothing"),
    "wrong-restore": Hostile("restores its state a little wrong"),
    "random": Hostile("gives other numbers with every run"),
    "once": Hostile("can be instantiated once per process"),
}
NEEDS_WORKER = tuple(name for name, hostile in HOSTILE.items() if hostile.needs_worker)


def description(guid: str, *, once: bool = False) -> str:
    """Return a model description of FMI 2.0 that asks the library for the behaviour in `guid`."""
    flags = 'modelIdentifier="hostile" canGetAndSetFMUstate="true"'
    flags += ' canBeInstantiatedOnlyOncePerProcess="true"' if once else ""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Hostile" guid="{guid}" numberOfEventIndicators="0">
  <ModelExchange {flags} />
  <CoSimulation {flags} canHandleVariableCommunicationStepSize="true" />
  <LogCategories><Category name="logStatusError" /></LogCategories>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.01" />
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="1" /></ScalarVariable>
    <ScalarVariable name="x" valueReference="1" causality="local" initial="exact"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="2" causality="local"><Real derivative="2" /></ScalarVariable>
    <ScalarVariable name="y" valueReference="3" causality="output"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="4" /></Outputs>
    <Derivatives><Unknown index="3" /></Derivatives>
    <InitialUnknowns><Unknown index="3" /><Unknown index="4" /></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def build_hostile(folder: Path, name: str) -> Path:
    """Write ``folder/NAME.fmu`` for a name in HOSTILE."""
    return write_stub(folder / f"{name}.fmu", "hostile", description(f"{{hostile-{name}}}", once=name == "once"))


# Files that are wrong before anything runs: name → (how it is made, what the message must contain).


def _wrong_guid(file: Path) -> None:
    write_stub(file, "hostile", description("{of-another-model}"))


def _missing_binary(file: Path) -> None:
    pack(file, {"modelDescription.xml": description("{hostile-nothing}").encode(), "binaries/riscv64-plan9/x.so": b""})


def _broken_binary(file: Path) -> None:
    (binary,) = stub_fmu("hostile", 2)
    write_stub(file, "hostile", description("{hostile-nothing}"), more={binary: b"this is no library"})


def _zip_slip(file: Path) -> None:
    write_stub(file, "hostile", description("{hostile-nothing}"))
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("resources/../../../../escaped.txt", "out")


def _xml_bomb(file: Path) -> None:
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    bomb = f'<!DOCTYPE bomb [<!ENTITY e0 "boom">{levels}]>\n<fmiModelDescription'
    text = description("{hostile-nothing}").replace("<fmiModelDescription", bomb)
    write_stub(file, "hostile", text.replace('modelName="Hostile"', 'modelName="&e9;"'))


def _external_entity(file: Path) -> None:
    entity = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/hostname">]>\n<fmiModelDescription'
    text = description("{hostile-nothing}").replace("<fmiModelDescription", entity)
    write_stub(file, "hostile", text.replace("</fmiModelDescription>", "&e;</fmiModelDescription>"))


def _zip_bomb(file: Path) -> None:
    write_stub(file, "hostile", description("{hostile-nothing}"))
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/zeros.bin", bytes(100 << 20))


def _truncated(file: Path) -> None:
    write_stub(file, "hostile", description("{hostile-nothing}"))
    file.write_bytes(file.read_bytes()[:-200])


BROKEN_FILES = {
    "wrong-guid": (_wrong_guid, r"cannot be instantiated.*the GUID is not that of this model"),
    "missing-binary": (_missing_binary, r"no binary hostile for this platform .*\(has: "),
    "broken-binary": (_broken_binary, r"cannot load this FMU's binary"),
    "zip-slip": (
        _zip_slip,
        r"entry 'resources/\.\./\.\./\.\./\.\./escaped\.txt' would leave the target folder; refused",
    ),
    "xml-bomb": (_xml_bomb, r"modelDescription\.xml"),
    "external-entity": (_external_entity, r"modelDescription\.xml"),
    "zip-bomb": (_zip_bomb, r"unpacks \d+ times larger, as zip bombs do; refused"),
    "truncated": (_truncated, r"not a zip archive or damaged"),
}


def build_broken(folder: Path, name: str) -> Path:
    """Write ``folder/NAME.fmu`` for a name in BROKEN_FILES."""
    file = folder / f"{name}.fmu"
    BROKEN_FILES[name][0](file)
    return file
