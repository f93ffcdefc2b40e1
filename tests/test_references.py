"""Reference results that FMUs carry (FMI-LS-REF): listed, run again, and judged; wrong ones found, hostile ones told.

The truth is written here: Euler's method in Python for the co-simulation that integrates by it, and what is true of it
beside an accurate solution.
"""

from __future__ import annotations

import hashlib
import math
import platform
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from control import ss

from tests.lying_fmus import build_lying, reference_files
from tests.reference_fmus import build_reference
from workbench.build.request import export
from workbench.errors import BuildError
from workbench.health.check.request import check
from workbench.health.check.result import HealthCard, HealthLine
from workbench.health.info.request import info
from workbench.health.info.result import FmuInfo
from workbench.health.references import declared
from workbench.jobs.options import Workers

HERE = Workers(in_process=True)
FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"
STEP, STEPS = 0.01, 200
EXPERIMENT = 'name="run" startTime="0" stopTime="2" stepSize="0.01"'
STIMULI = "time,u\n" + "".join(f"{k * STEP!r},{math.sin(0.4 * k)!r}\n" for k in range(STEPS + 1))
Rows = list[list[str]]


def euler() -> Rows:
    """Return what the FMU "euler" computes, with its input held over each step: time, y, f."""
    x = v = 0.0
    rows = [["time", "y", "f"]]
    for k in range(STEPS + 1):
        u = math.sin(0.4 * k)
        rows.append([repr(k * STEP), repr(x), repr(v + 0.5 * u)])
        x, v = x + STEP * v, v + STEP * (u - 40.0 * x - 0.8 * v)
    return rows


def text_of(rows: Rows, separator: str = ",") -> str:
    return "".join(f"{separator.join(row)}\n" for row in rows)


def fmu(folder: Path, rows: Rows | str, experiment: str = EXPERIMENT, more: Mapping[str, str] = {}) -> Path:
    text = rows if isinstance(rows, str) else text_of(rows)
    files = reference_files({"y.csv": text}, experiment, u=STIMULI)
    return build_lying(folder, "euler", {**files, **{FOLDER + n: t.encode() for n, t in more.items()}})


def card(path: Path) -> HealthCard:
    return check(path, only=["references"], workers=HERE)


def line(path: Path, interface: str = "cs") -> HealthLine:
    return card(path).line("references", interface)


def carrying(path: Path, files: Mapping[str, bytes]) -> Path:
    """Add files to an FMU."""
    with ZipFile(path, "a") as archive:
        for name, data in files.items():
            archive.writestr(FOLDER + name, data)
    return path


# -- right ones ----------------------------------------------------------------------------------


def test_what_the_exporter_computed_is_reproduced(tmp_path: Path) -> None:
    """Co-simulation to the last bits; model exchange only within the error that the reference has itself."""
    path = fmu(tmp_path, euler())
    cs, me = card(path).derived()["reference_results"][::-1]
    assert (cs["interface"], cs["passed"], cs["step"], cs["worst"] < 1e-12) == ("cs", True, STEP, True)
    assert (me["interface"], me["passed"]) == ("me", None)
    assert 0.1 < me["worst"] == me["explained"]  # of an oscillator that Euler's method hardly damps
    assert "says nothing against the FMU" in me["problem"]
    assert card(path).worst == "good"
    facts = info(path, probe=False)
    assert isinstance(facts, FmuInfo)
    (listed,) = facts.reference_results
    assert (listed.name, listed.step, listed.results) == ("run", STEP, f"{FOLDER}y.csv")


def test_other_ways_to_write_the_same(tmp_path: Path) -> None:
    """Semicolons and tabs, units, few digits, a draft's form of the manifest, a checksum, further files."""
    rows = euler()
    inside = f'<Experiment {EXPERIMENT}><Stimuli source="u.csv"/><References source="y.csv"/></Experiment>'
    total = hashlib.sha3_256(text_of(rows).encode()).hexdigest()
    manifests = {
        "draft": f"<fmiReferences>{inside}</fmiReferences>",
        "both": '<fmiReferences><Related source="runs.exp" role="experiment"/>'
        f'<Related source="./y.csv" role="result" checksum="{total}"/></fmiReferences>',
        "transient": '<fmiReferences><Experiment name="run"><TransientSimulation stopTime="2" stepSize="1e-2"/>'
        '<Stimuli source="u.csv"/><References type="text/csv" source="%79.csv"/></Experiment></fmiReferences>',
    }
    ways: dict[str, tuple[Rows | str, Mapping[str, str]]] = {
        "semicolons": (text_of(rows, ";"), {}),
        "tabs, a mark, carriage returns": ("\ufeff" + text_of(rows, "\t").replace("\n", "\r\n"), {}),
        "milliseconds": ([["time [ms]", "y", "f"], *([repr(1e3 * float(r[0])), *r[1:]] for r in rows[1:])], {}),
        "six digits": ([rows[0], *([r[0], *(f"{float(c):.6g}" for c in r[1:])] for r in rows[1:])], {}),
        **{name: (rows, {"fmi-ls-manifest.xml": text}) for name, text in manifests.items()},
    }
    for name, (table, more) in ways.items():
        found = line(fmu(tmp_path, table, more=more))
        assert (name, found.verdict, found.evidence.count("reproduced")) == (name, "good", 1)
        assert len(found.numbers["reference_results"]) == 1


def test_what_an_fmu_ends_itself_is_not_cut_off(tmp_path: Path) -> None:
    """The counter of "stair" ends its run at 9 s of 12 s; "space" has three numbers in a cell."""
    stair = carrying(
        build_reference(tmp_path, "stair", 3),
        {
            "fmi-ls-manifest.xml": b'<fmiReferences><Related source="out.csv" role="result"/></fmiReferences>',
            "out.csv": ("time,counter\n" + "".join(f"{k / 4},{min(k // 4 + 1, 10)}\n" for k in range(37))).encode(),
        },
    )
    assert {c.verdict for c in card(stair).checks} == {"good"}
    short = carrying(
        build_reference(tmp_path / "short", "stair", 3),
        {
            "fmi-ls-manifest.xml": b'<fmiReferences><Related source="out.csv" role="result"/></fmiReferences>',
            "out.csv": ("time,counter\n" + "".join(f"{k / 4},{k // 4 + 1}\n" for k in range(21))).encode(),
        },
    )
    assert "it ends at 5 s, and the experiment at 12 s: it was cut off" in line(short).evidence


# -- wrong ones -----------------------------------------------------------------------------------


def column(number: int, change: Callable[[float, float], float]) -> Callable[[Rows], Rows]:
    """Return what changes a column: of (time, value)."""

    def changed(rows: Rows) -> Rows:
        return [
            rows[0],
            *([*r[:number], repr(change(float(r[0]), float(r[number]))), *r[number + 1 :]] for r in rows[1:]),
        ]

    return changed


def shifted(rows: Rows, by: int) -> Rows:
    last = len(rows) - 1
    return [rows[0], *([r[0], *rows[min(max(1, k - by), last)][1:]] for k, r in enumerate(rows[1:], 1))]


def cell(text: str) -> Callable[[Rows], Rows]:
    return lambda rows: [*rows[:50], [rows[50][0], text, "1"], *rows[51:]]


WRONG: dict[str, tuple[Callable[[Rows], Rows], str]] = {
    "gain of 2 %": (column(1, lambda t, y: 1.02 * y), "y is .* % of its range off"),
    "gain of 0.1 % in the other": (column(2, lambda t, y: 1.001 * y), "f is .* % of its range off"),
    "offset": (column(1, lambda t, y: y + 3e-4), "y is .* % of its range off"),
    "drift": (column(1, lambda t, y: y + 1e-4 * t), "y is .* % of its range off at t = 2 s"),
    "sign": (column(2, lambda t, y: -y), "f is .* % of its range off"),
    "one wrong value": (column(1, lambda t, y: y + 1e-3 * (t == 1.0)), "y is .* % of its range off at t = 1 s"),
    "another unit": (column(1, lambda t, y: 1e3 * y), "y is .* % of its range off"),
    "nothing moves": (column(1, lambda t, y: 0.0), "y is .* % of its range off"),
    "one step late": (lambda rows: shifted(rows, 1), "% of its range off"),
    "one step early": (lambda rows: shifted(rows, -1), "% of its range off"),
    "time in other steps": (column(0, lambda t, y: 1.01 * t), "% of its range off"),
    "swapped columns": (lambda rows: [["time", "f", "y"], *rows[1:]], "% of its range off"),
    "wrong variable": (lambda rows: [["time", "x", "v"], *rows[1:]], "v is .* % of its range off"),
    "no variable of it": (lambda rows: [["time", "y", "speed"], *rows[1:]], "not variables of this FMU: speed"),
    "none of its variables": (
        lambda rows: [["time", "h", "w2"], *rows[1:]],
        "none of its columns is a number that the FMU computes: h, w2",
    ),
    "cut off": (lambda rows: rows[:120], "it ends at 1.18 s, and the experiment at 2 s: it was cut off"),
    "cut off in a row": (lambda rows: [*rows[:120], rows[120][:2]], "row 121 has 2 cells, its headings are 3"),
    "cut off in a number": (lambda rows: [*rows[:-1], [*rows[-1][:2], rows[-1][2][:4]]], "f is .* at t = 2 s"),
    "rows missing": (lambda rows: rows[:50] + rows[60:], "rows are missing between t = 0.48 s and 0.59 s"),
    "rows in another order": (lambda rows: [*rows[:50], *rows[100:], *rows[50:100]], "its times fall after t = 2 s"),
    "a column twice": (lambda rows: [["time", "y", "y"], *rows[1:]], "two of its columns are called y"),
    "a text": (cell("—"), "column y: '—' is not a number"),
    "not a number": (cell("nan"), "y is not a finite number in row 51"),
    "beyond numbers": (cell("1e999"), "y is not a finite number"),
    "no headings": (lambda rows: rows[1:], "has no line of headings"),
    "no rows": (lambda rows: rows[:1], "has no row below its headings"),
    "time that is none": (lambda rows: [["time [m]", "y", "f"], *rows[1:]], "do not convert to s"),
    "decimal commas": (
        lambda rows: [[c.replace(".", ",") for c in r] for r in rows],
        "6 cells below 3 headings; decimals follow a point",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_reference_is_found(tmp_path: Path, name: str) -> None:
    change, words = WRONG[name]
    found = line(fmu(tmp_path, change(euler())))
    assert found.verdict in ("watch", "broken")
    assert re.search(words, found.evidence), found.evidence
    assert found.consequence


def test_model_exchange_finds_what_no_integrator_explains(tmp_path: Path) -> None:
    """The first values carry no error of integration yet."""
    assert "cannot" not in (found := line(fmu(tmp_path, column(2, lambda t, y: y + 0.02)(euler())), "me")).evidence
    assert found.verdict == "watch"


# -- hostile ones ----------------------------------------------------------------------------------

BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]><fmiReferences>&b;</fmiReferences>'


def related(source: str, more: str = "") -> str:
    return f'<fmiReferences><Related source="{source}" role="result" {more}/></fmiReferences>'


def experiment(settings: str, inside: str = "") -> bytes:
    text = f'<Experiment name="e" {settings}>{inside}<References source="y.csv"/></Experiment>'
    return f"<fmiReferences>{text}</fmiReferences>".encode()


HOSTILE: dict[str, tuple[bytes, str]] = {
    "a bomb": (BOMB.encode(), "declares a document type, as XML bombs do"),
    "no XML": (b"\x00\x01\x02", "is not well-formed XML"),
    "empty": (b"", "is not well-formed XML"),
    "another root": (b"<html/>", "the root is 'html'"),
    "out of the FMU": (related("../../../../etc/passwd").encode(), "leads out of the package"),
    "an absolute path": (related("/etc/passwd").encode(), "leads out of the package"),
    "hidden dots": (related("%2e%2e/%2e%2e/%2e%2e/etc/passwd").encode(), "leads out of the package"),
    "another machine": (related("https://example.org/y.csv").encode(), "is not a file in the package"),
    "a broken address": (related("http://[y.csv").encode(), "is not the name of a file"),
    "a zero in a name": (related("y%00.csv").encode(), "is not the name of a file"),
    "a long name": (related("y" * 5000).encode(), "is not the name of a file"),
    "a folder": (related("../../").encode(), "is not a file"),
    "nothing": (related("").encode(), "is not a file"),
    "not there": (related("z.csv").encode(), "the file 'z.csv' is missing"),
    "a changed file": (related("y.csv", 'checksum="00"').encode(), "its checksum is another"),
    "an unknown checksum": (
        related("y.csv", 'checksum="00" checksumType="shake_128"').encode(),
        "is of type 'shake_128'",
    ),
    "another format": (related("y.csv", 'type="application/hdf5"').encode(), "application/hdf5 is not read"),
    "a step of nothing": (experiment('stepSize="0"'), "stepSize='0' cannot be used"),
    "a time that is none": (experiment('stopTime="nan"'), "stopTime='nan' cannot be used"),
    "not over time": (experiment("", "<Linearization/>"), "is a Linearization; only runs over time are replayed"),
    "inputs that are none": (experiment("", '<Stimuli source="y.csv"/>'), "not inputs that a signal can force: "),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_manifest_gets_a_line(tmp_path: Path, name: str) -> None:
    data, words = HOSTILE[name]
    path = build_lying(
        tmp_path, "euler", {f"{FOLDER}fmi-ls-manifest.xml": data, f"{FOLDER}y.csv": text_of(euler()).encode()}
    )
    found = line(path)
    assert (found.verdict, words in found.evidence) == ("watch", True), found.evidence
    assert len(found.evidence) < 400
    notes = info(path, probe=False).notes  # what only a run can tell is not among them
    assert any(words in note for note in notes) or name == "inputs that are none"


@pytest.mark.parametrize("data", [b"\xff\xfet\x00i\x00", b"time,y\n0,\xe9\n", b"\x00" * 100, b'time,y\n"0,1\n'])
def test_a_table_that_is_none_gets_a_line(tmp_path: Path, data: bytes) -> None:
    path = build_lying(
        tmp_path, "euler", {f"{FOLDER}fmi-ls-manifest.xml": related("y.csv").encode(), f"{FOLDER}y.csv": data}
    )
    found = line(path)
    assert found.verdict == "watch"
    assert f"{FOLDER}y.csv: " in found.evidence
    assert str(tmp_path) not in found.evidence


def test_a_giant_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(declared, "MAX_BYTES", 1000)
    assert "larger than" in line(fmu(tmp_path, euler())).evidence


def test_parameters_are_set(tmp_path: Path) -> None:
    """An .ssv file starts the motion elsewhere; a name that the FMU does not have is told."""
    root = '<ParameterSet xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="p">'
    given = f'{root}<Parameters><Parameter name="{{}}"><Real value="0.1"/></Parameter></Parameters></ParameterSet>'
    manifest = (
        f'<fmiReferences><Experiment {EXPERIMENT}><Parameters source="p.ssv"/><References source="y.csv"/></Experiment>'
        "</fmiReferences>"
    )
    x, v, rows = 0.1, 0.0, [["time", "y"]]
    for k in range(STEPS + 1):
        rows.append([repr(k * STEP), repr(x)])
        x, v = x + STEP * v, v + STEP * (-40.0 * x - 0.8 * v)
    for name, words in (("x", "reproduced"), ("mass", "p.ssv: 'mass' is not a parameter of this FMU")):
        more = {"fmi-ls-manifest.xml": manifest, "p.ssv": given.format(name)}
        assert words in line(fmu(tmp_path, rows, more=more)).evidence
    assert np.ptp([float(r[1]) for r in rows[1:]]) > 0.15


def test_built_fmus_carry_results_with_their_error(tmp_path: Path) -> None:
    """dx/dt = −2 x + u after a step of u: the stated error holds the truth, and the co-simulation reproduces it."""
    foreign = "aarch64-linux" if platform.machine() == "x86_64" else "x86_64-linux"
    file = tmp_path / "lag.fmu"
    export(ss([[-2.0]], [[1.0]], [[1.0]], [[0.0]]), file, platforms=["host"], reference_results=True)
    assert [c.verdict for c in card(file).checks] == ["good", "good"]
    with ZipFile(file) as archive:
        experiment = archive.read(f"{FOLDER}reference.exp").decode()
        rows = [r.split(",") for r in archive.read(f"{FOLDER}response.csv").decode().split()]
        level = float(archive.read(f"{FOLDER}inputs.csv").decode().split(",")[-1])
    stated = re.search(r'tolerance="(.+?)"', experiment)
    assert stated is not None
    time, y = (np.array([float(r[k]) for r in rows[1:]]) for k in (0, 1))  # the output, then the state
    truth = 0.5 * level * (1.0 - np.exp(-2.0 * time))
    assert np.abs(y - truth).max() / np.ptp(truth) < float(stated[1]) < 1e-6
    with pytest.raises(BuildError, match="its reference results cannot be computed"):
        export(ss([[-2.0]], [[1.0]], [[1.0]], [[0.0]]), file, platforms=[foreign], reference_results=True)
