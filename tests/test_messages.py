"""Messages about a command line: each names the flag or the file, what is wrong with it, and what to do."""

from __future__ import annotations

import ast
import cmath
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.cli.command_line import complaint, keep, spoken
from workbench.cli.program import options_of, program
from workbench.core.values.margins import UNSTABLE, GainCrossover, Margins, PhaseCrossover
from workbench.loops.loop.page import _crossovers

LOOP = """
[components]
lag = "fmu:FirstOrderLag"
error = {sum = "+-"}
[connections]
"error.u2" = "lag.y"
"lag.u" = "error.y"
[inputs]
r = "error.u1"
[outputs]
y = "lag.y"
"""
LAG = "fmu:FirstOrderLag"


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("loop loop.toml --open lag.y --band 1:5", ["--band: ", "--amplitude"]),
        (f"lin {LAG} --input u", ["--input: 'u'", "did you mean --inputs?"]),
        ("run nosuch.toml", ["nosuch.toml: no such file", "study:NAME"]),
        ("run lop.toml", ["did you mean loop.toml?"]),
        ("run loop.toml", ["loop.toml: is a system, not a study", "simulate"]),
        (f"simulate {LAG} --stop 1s", ["--stop: '1s' is not a number", "in s, without a unit"]),
        (f"nfr {LAG} --input u --output y --amplitude 1 --band 0.5Hz:2", ["--band: '0.5Hz'", "in Hz, without a unit"]),
        (f"simulate {LAG} --stop 1 --at loop.toml", ["--at: loop.toml: is not JSON (line 2", "trim"]),
        (
            f"simulate {LAG} --stop 1 --at notes.md",
            ["notes.md: is not JSON", "as an operating point is", "trim --json"],
        ),
        ("run text.zip", ["text.zip: is an FMU or another archive", "workbench info text.zip", "run --example"]),
        ("run study:ruder", ["did you mean rudder_loop, ", "rudder_specification"]),
        (
            "info .",
            ["no modelDescription.xml in this folder, so it is not an unpacked FMU", "name a model in it: text.fmu"],
        ),
        ("info empty", ["no modelDescription.xml in this folder, so it is not an unpacked FMU", "give an .fmu"]),
        ("info open.toml", ["open.toml: is not TOML: line 1: a text in quotes has no end"]),
        ("info single.toml", ["single.toml: is not TOML: a text in quotes has no end"]),
        (f"simulate {LAG} --stop 1 --input u=head.csv", ["head.csv: has no row below its headings", "time [s]"]),
        (f"simulate {LAG} --stop 1 --input u=nothing.csv", ["nothing.csv: has no row in it"]),
        ("identify head.csv", ["head.csv: has headings (time, u) and no row of numbers below them"]),
        (f"simulate {LAG} --points 9", ["No such option '--points'; only Python has it: wb.simulate(…, points=…)"]),
        (f"nfr {LAG} --inptu u", ["No such option '--inptu'; did you mean --input?", "nfr --help-all lists all"]),
        (f"nfr {LAG} --input u --output y --amplitude 1", ["--freq: ", "or --band, the lowest", "neither is given"]),
        (f"simulate {LAG} --stop 1 --input u=[1,2]", ["--input: 'u' of FirstOrderLag is not an array", "CSV file"]),
        ("info notes.md", ["notes.md: is not an FMU, a system or an SSP", ".toml", ".ssp"]),
        ("info nosuch.fmu", ["nosuch.fmu: no such file", ".toml", ".ssp"]),
        ("info text.fmu", ["text.fmu: not a zip archive or damaged"]),
        (f"simulate {LAG} --stop 1 --set V=1", ["--set: ", "no variable 'V'"]),
        (f"simulate {LAG} --stop 1 --set u=abc", ["--set: u: 'abc'"]),
        ("simulate loop.toml --stop 1 --set V=1", ["--set: ", "no variable 'V'"]),
        (f"lin {LAG} --u0 u=abc", ["--u0: u: 'abc'"]),
        (
            "simulate loop.toml --stop 1 --output nosuchname",
            ["--output: ", "its outputs are: y", "its states are: lag.x"],
        ),
    ],
)
def test_a_message_says_where_and_what_to_do(
    line: str, parts: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.toml").write_text(LOOP, encoding="utf-8")
    Path("pyproject.toml").write_text("", encoding="utf-8")
    for name in ("notes.md", "text.fmu"):
        Path(name).write_text("words", encoding="utf-8")
    Path("text.zip").write_bytes(b"PK\x03\x04")
    Path("empty").mkdir()
    texts = {"open.toml": 'name = "x\n', "single.toml": "name = 'x\n", "head.csv": "time,u\n", "nothing.csv": ""}
    for name, text in texts.items():
        Path(name).write_text(text, encoding="utf-8")
    assert run(line.split()) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert all(part in said for part in parts)
    assert "pyproject" not in said
    assert "Expecting" not in said


MISTAKES = f"""
description = \"\"\"
[models]
other = a text [ no key\"\"\"
models.other = "nosuch.fmu"
models."lag" = "{LAG}"
[analyses.response]
command = "nfr"
model = "lag"
inptu = "u"
frq = [
  1,
  [2],
]
max-periods = "x"
amplitude = [1, "two"]
[analyses]
step = {{command = "simulat", model = "other"}}
[[requirements]]
name = "gain"
analysis = "respons"
kind = "gain"
frequency = "0.1"
min = -10
[[requirements]]
name = "about an analysis that cannot be read"
analysis = "response"
kind = "gain"
frequenzy = 0.1
mini = -10
"""


def test_a_study_tells_all_its_mistakes_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = tmp_path / "study.toml"
    study.write_text(MISTAKES, encoding="utf-8")
    assert run(["run", str(study)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    before, *each = re.split(r";? ?\(\d+\) (?=line)", said)
    assert before == f"workbench: {study}: 10 mistakes:"
    last = '[[requirements]] "about an analysis that cannot be read"'
    for number, (line, text) in enumerate(
        (
            (5, "[models] other: no such file: "),
            (10, "[analyses.response]: key 'inptu' is not an option of 'nfr'; did you mean input?"),
            (11, "[analyses.response]: key 'frq' is not an option of 'nfr'; did you mean freq?"),
            (15, "[analyses.response]: key 'max-periods': 'x' is not a whole number"),
            (16, "[analyses.response]: key 'amplitude': 'two' is not a number"),
            (18, "[analyses.step]: command 'simulat' is unknown; did you mean simulate?"),
            (23, "[[requirements]] \"gain\": key 'frequency' must be a number, not '0.1'"),
            (21, "[[requirements]] \"gain\": analysis 'respons' is unknown; did you mean response?"),
            (29, f"{last}: key 'frequenzy' is unknown; did you mean frequency?"),
            (30, f"{last}: key 'mini' is unknown; did you mean min"),
        )
    ):
        assert each[number].startswith(f"line {line}: {text}"), each[number]


def test_python_names_options_as_python_has_them() -> None:
    with wb.load(LAG) as lag:
        with pytest.raises(wb.InputError, match="or `band`, the lowest and the highest") as wrong:
            wb.nfr(lag, "u", "y", amplitudes=[1.0])
        assert "--" not in str(wrong.value)
        with pytest.raises(wb.InputError, match=r"'u' of FirstOrderLag is not an array.* wb\.Table\(times, values\)"):
            wb.simulate(lag, stop=1.0, inputs={"u": [1, 2]})
        with pytest.raises(wb.InputError, match="or `vary` something else"):
            wb.branches(lag, "u", "y", amplitudes=[1.0])


def test_python_says_what_was_given_and_what_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with wb.load(LAG) as lag:
        said: Any = lag  # what is wrong for a type checker, too
        with pytest.raises(wb.InputError, match=r"^band: falls from 5 to 1 Hz; give the lower frequency first"):
            wb.nfr(lag, "u", "y", band=(5, 1), amplitudes=[1.0])
        with pytest.raises(wb.InputError, match=r"^u0: '\[1.0\]' does not say of what .* give a name with each$"):
            wb.trim(said, u0=[1.0])  # type: ignore[arg-type]
        with pytest.raises(wb.InputError, match=r"^x0: the model has no state or input 'z'; known: u, x$"):
            wb.trim(lag, x0={"z": 1.0})
        with pytest.raises(wb.InputError, match=r"^u0: the model has no state or input 'z'; known: u, x$"):
            wb.trim(lag, u0={"z": 1.0})
        assert wb.simulate(lag, points=[0.1, 0.25]).time.tolist() == [0.0, 0.1, 0.25]
        with pytest.raises(
            wb.InputError, match=r"^points: are times .* 100 s is after the stop at 1 s; .*interval=0.01"
        ):
            wb.simulate(lag, stop=1.0, points=100)
        with pytest.raises(
            wb.InputError, match=r"^points: times to record must rise and lie in \(0, 1\] s, not 2 from"
        ):
            wb.simulate(lag, stop=1.0, points=[0.5, 0.2])
        found = {"command": "trim", **wb.trim(lag).to_dict()}
    Path("trim.json").write_text(json.dumps(found), encoding="utf-8")
    with pytest.raises(
        wb.InputError, match=r"^trim.json: is not a linear model: it is a result of trim; workbench lin"
    ):
        wb.LinResult.read("trim.json")
    Path("empty.json").write_text("{}", encoding="utf-8")
    with pytest.raises(wb.InputError, match=r"^empty.json: is not a linear model: 'A' is missing; workbench lin"):
        wb.LinResult.read("empty.json")
    Path("model.fmu").write_bytes(b"PK\x03\x04\xd6")
    with pytest.raises(wb.InputError, match=r"^model.fmu: is not JSON, nor another text$"):
        wb.LinResult.read("model.fmu")
    with pytest.raises(wb.InputError, match=r"^state_names: 1 given \(x\), but the matrices have 2 states$"):
        wb.Linear(np.eye(2), np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)), state_names=("x",))


def test_python_says_what_it_takes_where_an_error_of_its_own_would_come(tmp_path: Path) -> None:
    """A TypeError from pathlib, or the options of a connection whose two ends are letters of a name, help nobody."""
    from matplotlib.figure import Figure

    rng = np.random.default_rng(0)
    data = wb.make_experiment(0.1, u=rng.standard_normal(200), y=rng.standard_normal(200))
    axes = Figure().subplots()
    pairs = r"give pairs \(source, destination\)"
    with wb.load(LAG) as model:
        run = wb.simulate(model, stop=0.1, inputs={"u": 1})
        lines: list[tuple[Callable[[], object], str]] = [
            (lambda: wb.identify(data, order="two"), "order: 'two' is neither auto nor ask nor a number of states"),  # type: ignore[arg-type]
            (lambda: wb.identify(np.ones((9, 2))), "class ndarray is not the name of a file; wb.make_experiment makes"),  # type: ignore[arg-type]
            (lambda: wb.calibrate(model, np.ones((9, 2)), free=["tau"]), "is not the name of a file; wb.make_exp"),  # type: ignore[arg-type]
            (lambda: wb.calibrate(model, [data], free={"tau": 2}), "tau: 2 is not a pair of limits, as in"),  # type: ignore[dict-item]
            (lambda: wb.nfr(model, "u", "y", [1.0], [1, 1]), "amplitudes: 1 is given twice"),
            (lambda: run.plot(axes), "class Axes is not the name of a file; give axes of your own as `axes`"),  # type: ignore[arg-type]
            (lambda: run.report(axes), "class Axes is not the name of a file"),  # type: ignore[arg-type]
            (lambda: run.to_csv(axes), "class Axes is not the name of a file"),  # type: ignore[arg-type]
            (lambda: wb.connect({"a": LAG, "k": 2.0}, ["a.y", "k.u"]), pairs),  # type: ignore[list-item]
            (lambda: wb.connect({"a": LAG, "k": 2.0}, {"a.y": "k.u"}), pairs),  # type: ignore[arg-type]
            (lambda: wb.connect({"a": LAG, "k": 2.0}, [("a.y", "k.u", "x")]), "options are a dictionary"),  # type: ignore[list-item]
        ]
        for call, words in lines:
            with pytest.raises(wb.InputError, match=words):
                call()


def test_signals_say_that_they_take_their_values_by_name() -> None:
    with pytest.raises(TypeError, match=r"^Step takes its values by name: wb\.Step\(time=…, value=…, initial=…\)$"):
        wb.Step(1, 2)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"^Sine takes its values by name: wb\.Sine\("):
        wb.Sine(1.0)  # type: ignore[call-arg]
    assert wb.Step(time=1.0, value=2.0) == wb.Step(time=1.0, value=2.0)


def test_an_unstable_loop_shows_no_margin() -> None:
    """L(jω) is −2 and e^(j 1.1°): the phase and the gain of L, and no word of a margin."""
    nothing = float("nan")
    crossover = GainCrossover.of(1.0, cmath.rect(1.0, math.radians(1.1)))
    found = Margins(
        verdict=UNSTABLE, words="", phase_crossovers=(PhaseCrossover(2.0, 0.5),), gain_crossovers=(crossover,),
        disk=None, peak_sensitivity=nothing, peak_sensitivity_hz=nothing, peak_complementary=nothing,
        peak_complementary_hz=nothing,
    )  # fmt: skip
    (table,) = _crossovers(found)
    assert [row[2] for row in table.rows] == ["phase 1.1°", "gain 6.021 dB"]


# A flag among other words; alone it declares an option.
FLAG = re.compile(r"(?<=[^\w-])--[a-z]|--[a-z][\w-]*[^\w=…-]")
SHELL = re.compile(r"\b(?:workbench|dask|pip|check|lin|trim) [^;]*--")  # a line for a shell
# What only a command line can ask for: files of a result, and requests without a function in Python.
OF_COMMANDS = ("written.py", "cases.py", "serve.py", "compare_linear/request.py", "structures/request.py")
HEADINGS = ("Settling times, with --settle", "One simulation, with --gain", "Simulations, with --input")  # of help


def texts_of(node: ast.AST) -> Iterator[str]:
    """Yield the texts of a module that are not docstrings and do not declare options or commands."""
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") in {"option", "replace"}:
        return
    if isinstance(node, ast.JoinedStr):
        yield "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)  # type: ignore[misc]
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for inner in ast.iter_child_nodes(node):
        declares = isinstance(node, ast.ClassDef) and isinstance(inner, ast.Assign)
        documents = isinstance(inner, ast.Expr) and isinstance(inner.value, ast.Constant)
        if not (declares or documents):
            yield from texts_of(inner)


def test_the_library_speaks_of_options_by_their_names_in_python() -> None:
    """The command line turns them into flags, see `workbench.cli.command_line`."""
    root = Path(wb.__file__).parent
    files = [p for p in sorted(root.rglob("*.py")) if "cli" not in p.parts and not p.as_posix().endswith(OF_COMMANDS)]
    texts = [(p.relative_to(root).as_posix(), t) for p in files for t in texts_of(ast.parse(p.read_text("utf-8")))]
    assert len(texts) > 10_000
    assert [
        (name, text) for name, text in texts if FLAG.search(text) and not SHELL.search(text) and text not in HEADINGS
    ] == []


@pytest.mark.parametrize(
    ("said", "typed"),
    [
        ("`step` changes it", "--step changes it"),
        ("use `step=0.01`, or `step=0.02`", "use --step 0.01, or --step 0.02"),
        ("longer: `max_periods`", "longer: --max-periods"),
        ("wait longer: max_periods", "wait longer: --max-periods"),
        ("`drift_check=False`, `branches=True`", "--no-drift-check, --branches"),
        ("`wb.delays` or `wb.limit_cycle`", "workbench check --delays or workbench limit-cycle"),
        ("`start_values` of 'max_periods'", "--set of 'max_periods'"),
        ("`nothing` and `nothing=3`", "nothing and nothing=3"),
    ],
)
def test_on_the_command_line_they_are_flags(said: str, typed: str) -> None:
    keep(["nfr"], options_of(program("nfr")), "workbench")
    assert spoken(said) == typed


def test_how_a_model_is_opened_is_said_in_the_words_of_a_command_with_an_option_of_that_name() -> None:
    keep(["modes"], options_of(program("modes")), "workbench")  # its own tolerance is --precision
    assert spoken("`tolerance` changes it") == "--tolerance changes it"
    assert complaint("tolerance: 'x' is not a number") == "--precision: 'x' is not a number"


def test_notes_and_pages_of_a_command_have_flags_and_the_record_has_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["nfr", "fmu:Duffing", "--input", "u", "--output", "y", "--freq", "0.1,0.17,0.3", "--amplitude", "0.001"]
    report = tmp_path / "report.html"
    assert run([*line, "--in-process", "--report", str(report)]) == 0
    page, notes = capsys.readouterr()
    assert "--bandwidth measures there" in page
    assert "give a smaller --ratio" in notes
    written = report.read_text(encoding="utf-8")
    assert "--bandwidth measures there" in written
    assert "give a smaller --ratio" in written
    with wb.load("fmu:Duffing") as model:
        found = wb.nfr(model, "u", "y", frequencies=[0.1, 0.17, 0.3], amplitudes=[0.001])
    assert any("give a smaller `ratio`" in text for text in found.warnings)
