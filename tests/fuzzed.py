"""Files that are almost what the workbench reads, and how it reads them.

Each reader takes bytes: valid ones with some of their words replaced, or bytes out of place. It returns, or raises the
workbench's own error in one line; anything else is a finding. What it returns is written by the workbench, or as
plainly as the format allows, and read again: it must be the same, or something was accepted that means nothing.
"""

from __future__ import annotations

import csv
import io
import json
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import strategies as st

import workbench as wb
from tests.record_examples import Maker
from workbench.data.experiment.formats import DataTable, read_table
from workbench.errors import UNSEEN
from workbench.fmi.archive import unpack
from workbench.fmi.bundled import bundled_path
from workbench.fmi.reading import read_description
from workbench.jobs.options import Limits
from workbench.jobs.store import _check_sum
from workbench.point.lin.result import LinResult
from workbench.point.trim.result import TrimResult
from workbench.response.nfr.point import NfrPoint
from workbench.response.nfr.result import NfrResult
from workbench.response.nfr.store import NfrStore
from workbench.response.simulate.result import SimulationResult
from workbench.show.result import Result
from workbench.signals.file import read_table as read_signal
from workbench.signals.kinds import Table
from workbench.study.read import read_study
from workbench.system.description import SystemDescription
from workbench.system.files.read import read_system
from workbench.system.files.toml_write import write_toml

__all__ = ["READERS", "Reader", "finding"]

Names = Sequence[bytes]

# In place of a word of any format.
_ANY = (
    b"", b"0", b"-1", b"1e999", b"-1e999", b"NaN", b"nan", b"inf", b"1" + b"0" * 400, b"9" * 5000,
    b"99999999999999999999", b"4294967296", b"1e-400", b"true", b"null", b"\x00", b"\xff\xfe", b"\x1b[31m",
    b"\xe2\x80\xae", b"\xc2\x9b", b"$",
    b"=cmd", b"../../x", b"/dev/zero", b"fmu:", b"x" * 70000, b"\n", b"\r", b"'", b'"', b"%s", b"{}",
    b"[]", b"1970-01-01", b"0x10",
)  # fmt: skip
_NESTED = (b"[" * 100_000, b'{"a":' * 5000, b"[" * 150 + b"]" * 150, b"<a>" * 5000, b"{a=" * 2000)
_XML = (b"<a>" * 5000, b"&x;", b"<!DOCTYPE x [<!ENTITY x 'y'>]>", b"]]>", b"<!--", b"/>", b'"<Real/>"')
_WORD = re.compile(rb'"[^"]*"|[\w.+-]+|\S')


@dataclass(frozen=True)
class Reader:
    """One thing that is read.

    Attributes:
        read: reads a file of the folder that it gets, made of the bytes.
        seeds: makes valid ones.
        words: that are put in place of others, besides those for all formats.
        write: writes into a file of the folder what was read, for `again`; a WorkbenchError: it cannot be written.
        again: reads that file.
        same: what must be the same of both, as a value that can be compared.
    """

    read: Callable[[Path, bytes], object]
    seeds: Callable[[], Names]
    words: Names = ()
    write: Callable[[Path, Any], Path] | None = None
    again: Callable[[Path], object] | None = None
    same: Callable[[Any], object] = repr

    def bytes(self) -> st.SearchStrategy[bytes]:
        """Return what hypothesis draws from."""
        return _changed(self.seeds(), (*_ANY, *_NESTED, *self.words))


@st.composite
def _changed(draw: st.DrawFn, seeds: Names, words: Names) -> bytes:
    data = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.integers(0, 3)):
            spans = [found.span() for found in _WORD.finditer(data)] or [(0, 0)]
            begin, end = spans[draw(st.integers(0, len(spans) - 1))]
            new = draw(st.sampled_from(words))
            data = data[:begin] + (b'"' + new + b'"' if draw(st.booleans()) else new) + data[end:]
        else:
            begin = draw(st.integers(0, len(data)))
            data = data[:begin] + draw(st.binary(max_size=8)) + data[begin + draw(st.integers(0, 60)) :]
    return data


def finding(reader: Reader, data: bytes) -> str:
    """Read once; return what is wrong with how it went, empty: nothing."""
    with TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return _differs(reader, Path(name), reader.read(Path(name), data))
        except wb.WorkbenchError as error:
            text = str(error)
            return f"not one line: {text[:300]!r}" if "\n" in text or UNSEEN.search(text) else ""
        except Exception as error:  # noqa: BLE001 - that is what is looked for
            import traceback

            last = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)][-4:]
            return f"{type(error).__name__}: {str(error)[:200]} ({' '.join(last)})"


def _differs(reader: Reader, folder: Path, read: object) -> str:
    """Write what was read and read it again; return what differs, empty: nothing."""
    if reader.write is None or reader.again is None:
        return ""
    try:
        file = reader.write(folder, read)
    except wb.WorkbenchError:
        return ""  # said, not silent
    try:
        second = reader.again(file)
    except wb.WorkbenchError as error:
        return f"read, but not once it is written: {str(error).replace(str(folder), '')[:200]}"
    return "" if reader.same(read) == reader.same(second) else "read, but another once it is written"


# -- readers -----------------------------------------------------------------------------------


def _file(suffix: str, read: Callable[[Path], object]) -> Callable[[Path, bytes], object]:
    def of(folder: Path, data: bytes) -> object:
        path = folder / f"file{suffix}"
        path.write_bytes(data)
        return read(path)

    return of


def _unpack(path: Path) -> object:
    with unpack(path) as unpacked:
        return read_description(unpacked.folder, source=path.name)


def _description(folder: Path, data: bytes) -> object:
    (folder / "modelDescription.xml").write_bytes(data)
    return read_description(folder, source="fuzzed.fmu")


def _zipped(**files: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            archive.writestr(name.replace("__", "."), content)
    return buffer.getvalue()


def _inside(suffix: str, name: str, read: Callable[[Path], object]) -> Callable[[Path, bytes], object]:
    return _file(suffix, lambda path: read(_put(path, name)))


def _put(path: Path, name: str) -> Path:
    data = path.read_bytes()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, data)
        archive.writestr("resources/p.fmu", _BUNDLED.read_bytes())
    return path


_BUNDLED = bundled_path("fmu:FirstOrderLag")


def _xml_of(name: str) -> bytes:
    with zipfile.ZipFile(bundled_path(name)) as archive:
        return archive.read("modelDescription.xml")


_SHORT = b"""<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="M" guid="{g}" numberOfEventIndicators="1">
<ModelExchange modelIdentifier="m" /><CoSimulation modelIdentifier="m" />
<UnitDefinitions><Unit name="deg"><BaseUnit rad="1" factor="0.0174" /></Unit></UnitDefinitions>
<TypeDefinitions>
<SimpleType name="E"><Enumeration><Item name="a" value="1" /></Enumeration></SimpleType></TypeDefinitions>
<DefaultExperiment startTime="0" stopTime="1" tolerance="1e-4" stepSize="0.01" />
<ModelVariables>
<ScalarVariable name="u" valueReference="0" causality="input"><Real start="1" unit="deg" min="0" max="2" nominal="3" />
</ScalarVariable>
<ScalarVariable name="x" valueReference="1" initial="exact"><Real start="0" /></ScalarVariable>
<ScalarVariable name="der(x)" valueReference="2"><Real derivative="2" /></ScalarVariable>
<ScalarVariable name="n" valueReference="3" causality="parameter" variability="fixed"><Integer start="3" />
</ScalarVariable>
<ScalarVariable name="e" valueReference="4"><Enumeration declaredType="E" start="1" /></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2" dependencies="1" dependenciesKind="fixed" /></Outputs>
<Derivatives><Unknown index="3" /></Derivatives></ModelStructure></fmiModelDescription>"""

_STRUCTURE = b"""<?xml version="1.0"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="s" version="1.0"><ssd:System name="s">
<ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real unit="deg" /></ssd:Connector></ssd:Connectors>
<ssd:Elements><ssd:Component name="p" source="resources/p.fmu" type="application/x-fmu-sharedlibrary">
<ssd:Connectors><ssd:Connector name="u" kind="input" /><ssd:Connector name="y" kind="output" /></ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet name="a" version="1.0"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters><ssv:Parameter name="tau">
<ssv:Real value="2.0" /></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>
</ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component></ssd:Elements><ssd:Connections>
<ssd:Connection startConnector="u" endElement="p" endConnector="u"><ssc:LinearTransformation factor="2" offset="1" />
</ssd:Connection></ssd:Connections></ssd:System><ssd:DefaultExperiment startTime="0" stopTime="1" />
</ssd:SystemStructureDescription>"""

_SYSTEM = b"""name = "loop"
[components]
plant = "fmu:FirstOrderLag"
lag = {model = "fmu:FirstOrderLag", set = {tau = 2.0}, interface = "me"}
sum = {sum = "+-"}
gain = {gain = -2.0}
g = {A = [[-1.0]], B = [[1.0]], C = [[1.0]], D = [[0.0]]}
[connections]
"plant.u" = {from = "gain.y", gain = -1.0, unit = "deg", closes_at = 2.0}
"gain.u" = "plant.y"
[inputs]
r = "lag.u"
[outputs]
y = "plant.y"
[experiment]
start = 0.0
stop = 1.0
step = 0.01
tolerance = 1e-6
"""

_STUDY = b"""name = "s"
[models]
lag = "fmu:FirstOrderLag"
two = {model = "fmu:FirstOrderLag", set = {tau = 2.0}}
[grid]
"lag.tau" = [0.5, 1.0]
[configurations.worn]
lag = {set = {tau = 3.0}}
[analyses.rest]
command = "trim"
model = "lag"
u0 = {u = 2.0}
[analyses.response]
command = "nfr"
model = "lag"
input = "u"
output = "y"
band = "0.1:1"
amplitude = 1.0
[[requirements]]
name = "gain"
analysis = "rest"
kind = "value"
path = "y.y"
equal = 2.0
tolerance = 1e-9
"""

_RECORDS = (SimulationResult, LinResult, TrimResult, NfrResult)


@cache
def _records() -> Names:
    kinds = [
        json.dumps({"kind": kind.__name__, "data": Maker(empty=False).record(kind).to_dict()}) for kind in _RECORDS
    ]
    return tuple(text.encode() for text in kinds)


def _record(path: Path) -> object:
    from workbench.core.records.record import read_json

    whole = read_json(path)
    if not isinstance(whole, dict):
        raise wb.InputError("no record")
    kind = next((k for k in _RECORDS if k.__name__ == whole.get("kind")), LinResult)
    data: Any = whole.get("data")
    return kind.from_dict(data)


_SETTINGS: dict[str, object] = {"u": "y"}


@contextmanager
def _kept(folder: Path | str) -> Iterator[NfrStore]:
    """Yield the measurements of a folder, whose store is open."""
    with wb.load("fmu:FirstOrderLag") as model:
        kept = NfrStore.open(folder, model, settings=_SETTINGS, effort={}, limits=Limits())
        with kept.store:
            yield kept


@cache
def _stored() -> tuple[str, str, bytes]:
    """Return point and value of the one measurement in a store, and the store's file."""
    point = Maker(empty=False).record(NfrPoint)
    with TemporaryDirectory() as name:
        with _kept(name) as kept:
            kept.store.save(repr((1.0, 1.0)), {"point": point.to_dict(), "lost_under": None})
            ((place, value),) = kept.store._database.execute("SELECT point, value FROM measurements")
        return str(place), str(value), (Path(name) / "measurements.sqlite").read_bytes()


def _rows() -> Names:
    value = _stored()[1].encode()
    rows = [column + b":" + value for column in (b"value", b"blob", b"point")]
    return (*rows, b'text:{"subject": {"u": "y"}, "effort": {"errcrit": 0.01}}')


def _store(folder: Path, data: bytes) -> object:
    """Read a store whose row holds the bytes, as text or as they are, and whose settings hold them next."""
    point, whole, _ = _stored()
    column, _, content = data.partition(b":")
    value: object = content if column == b"blob" else content.decode("utf-8", "replace")
    with _kept(folder) as kept:
        store = kept.store
        given = {"point": point, "value": whole} | ({"point": value} if column == b"point" else {})
        given |= {"value": value} if column in (b"value", b"blob") else {}
        text = value if column == b"text" else store._text
        texts = [store._settings, given["point"], given["value"], ""]
        sound = _check_sum(*(str(t) for t in (text, *texts[1:])))  # as who changes it on purpose may, too
        row = "INSERT INTO measurements (settings, point, value, made, sha256) VALUES (?, ?, ?, ?, ?)"
        store._database.execute(row, (*texts, sound))
        if column == b"text":
            store._database.execute("UPDATE settings SET text = ?", (value,))
        return kept.finished(()), kept.finished(("failed",))


def _store_file(path: Path) -> object:
    folder = path.parent / "store"
    folder.mkdir()
    path.rename(folder / "measurements.sqlite")
    with _kept(folder) as kept:
        return kept.finished(())


def _write_record(folder: Path, read: Result) -> Path:
    path = folder / "again.json"
    path.write_text(json.dumps({"kind": type(read).__name__, "data": read.to_dict()}, allow_nan=False))
    return path


def _same_record(read: Result) -> object:
    """All of a record; what is computed of its numbers, as decibels of a gain, has rounding errors."""
    whole = json.loads(json.dumps(read.to_dict()), parse_float=lambda text: f"{float(text):.12g}")
    return json.dumps(whole)


def _write_system(folder: Path, read: SystemDescription) -> Path:
    path = folder / "again.toml"
    write_toml(read, path)
    return path


def _same_system(read: SystemDescription) -> object:
    return [repr(c) for c in read.components], set(read.connections), dict(read.inputs), dict(read.outputs)


def _write_table(folder: Path, names: Sequence[str], columns: Sequence[Sequence[float]]) -> Path:
    path = folder / "again.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(names)
        rows.writerows([repr(float(x)) for x in row] for row in zip(*columns, strict=True))
    return path


def _write_csv(folder: Path, read: DataTable) -> Path:
    names = [f"column {k} [{u}]" if u else f"column {k}" for k, u in enumerate(read.units)]
    return _write_table(folder, names, read.values.T.tolist())


def _same_csv(read: DataTable) -> object:
    return read.units, repr(read.values.tolist())  # NaN, which is a missing value, is the same as itself


def _same_signal(read: Table) -> object:
    return [float(t) for t in read.times], [float(x) for x in read.values]


def _write_signal(folder: Path, read: Table) -> Path:
    return _write_table(folder, ["time", "value"], [read.times, read.values])


_CSV = (
    b"# recorded\ntime [s],u [deg],y\n0,1,2\n0.1,1,3\n0.2,-1,1\n0.3,1,0\n",
    b"time;u;y\n0,0;1,5;2\n0,1;1,5;3\n",
    b"t u\n0 1\n1 2\n",
)

READERS: Mapping[str, Reader] = {
    "archive": Reader(
        _file(".fmu", _unpack),
        lambda: (_zipped(modelDescription__xml=_SHORT), _zipped(modelDescription__xml=_SHORT, other__txt=b"x" * 100)),
    ),
    "description": Reader(_description, lambda: (_SHORT, _SHORT, _xml_of("fmu:FirstOrderLag@3")), _XML),
    "ssp": Reader(
        _inside(".ssp", "SystemStructure.ssd", read_system), lambda: (_STRUCTURE,), _XML,
        _write_system, read_system, _same_system,
    ),
    "system": Reader(
        _file(".toml", read_system), lambda: (_SYSTEM,), (), _write_system, read_system, _same_system
    ),
    "study": Reader(_file(".toml", read_study), lambda: (_STUDY,)),
    "record": Reader(_file(".json", _record), _records, (), _write_record, _record, _same_record),
    "store": Reader(_store, _rows),
    "store file": Reader(_file(".sqlite", _store_file), lambda: (_stored()[2],)),
    "csv": Reader(_file(".csv", read_table), lambda: _CSV, (), _write_csv, read_table, _same_csv),
    "signal": Reader(
        _file(".csv", read_signal), lambda: (b"t,u\n0,1\n1,2\n", b"0;1.5\n1;2.5\n"), (),
        _write_signal, read_signal, _same_signal,
    ),
}  # fmt: skip
