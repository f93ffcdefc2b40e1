"""Whatever a file says, no terminal, spreadsheet or picture takes it for a command: every command, every output."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.foreign_text import NAMES, SYSTEM, build_commanding
from workbench.cli.app import run
from workbench.errors import UNSEEN, unbroken
from workbench.requests.progress_bar import Bar
from workbench.show.figure import literal

U, X, Y, CLOCK = (NAMES[key] for key in ("u", "x", "y", "clock"))
GAIN = "c\x9b"
RECORDED = Y.replace("\n", " ")  # a heading is a line

# Name → words after the command ({fmu}, {system}, {data}), and the files that it writes besides JSON.
LINES: dict[str, tuple[list[str], str]] = {
    "info": (["{fmu}"], "html"),
    "info of a system": (["{system}"], "html"),
    "simulate": (["{fmu}", "--stop", "1", "--input", f"{U}=2", "--set", f"{X}=0.5"], "csv svg html"),
    "nfr": (["{fmu}", "--input", U, "--output", Y, "--freq", "1", "--amplitude", "1"], "csv svg html"),
    "branches": (["{fmu}", "--input", U, "--output", Y, "--band", "1:2", "--amplitude", "1", "--seeds", "0"],
                 "csv svg html"),
    "trim": (["{fmu}"], "csv svg html"),
    "lin": (["{fmu}"], "csv svg html"),
    "excite": ([
        "{fmu}", "--input", U, "--output", Y, "--prbs", "amplitude=1", "--step", "0.1", "--samples", "100",
        "--validation", "0",
    ], "csv svg html"),
    "bla": ([
        "{fmu}", "--input", U, "--output", Y, "--rms", "1", "--band", "0.5:4", "--step", "0.05", "--realisations", "2",
    ], "csv svg html"),
    "modes": (["{fmu}", "--vary", f"{U}=0:1"], "csv html"),
    "simulate two": (["{fmu}", "{fmu}", "--output", Y, "--window", "0:1"], "csv svg html"),
    "loop": (["{system}", "--open", f"{SYSTEM}.{Y}"], "csv html"),
    "check --delays": (["{system}", "--delays"], "html"),
    "check": (["{fmu}", "--only", "validation,runs"], "html"),
    "identify": (["{data}", "--input", U, "--output", RECORDED, "--order", "1"], "svg html"),
    "run": (["{study}", "--no-store"], "csv html"),
}  # fmt: skip
OPTIONS = {"csv": "--csv", "svg": "--plot", "html": "--report"}


def _key(text: str) -> str:
    return json.dumps(text)  # the same in TOML


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("foreign")
    build_commanding(folder)
    (folder / "system.toml").write_text(
        f'[components]\n{_key(SYSTEM)} = "commanding.fmu"\n{_key(GAIN)} = {{gain = -0.5}}\n'
        f"[connections]\n{_key(f'{GAIN}.u')} = {_key(f'{SYSTEM}.{Y}')}\n"
        f"{_key(f'{SYSTEM}.{U}')} = {_key(f'{GAIN}.y')}\n[outputs]\n{_key(f'o{Y}')} = {_key(f'{SYSTEM}.{Y}')}\n"
    )
    (folder / "study.toml").write_text(
        f'models.{_key(GAIN)} = "commanding.fmu"\n'
        f'analyses.{_key("a" + GAIN)} = {{command = "trim", model = {_key(GAIN)}}}\n'
        f'[[requirements]]\nname = {_key("r" + U + "[red][/]")}\nanalysis = {_key("a" + GAIN)}\nkind = "value"\n'
        f'path = "time"\nmax = -1.0\n'
    )
    with (folder / "data.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["time", U, RECORDED])
        state = 0.0
        for k, u in enumerate(np.random.default_rng(1).choice([-1.0, 1.0], 300)):
            rows.writerow([0.1 * k, u, state])
            state += 0.1 * (u - state)
    names = {"fmu": "commanding.fmu", "system": "system.toml", "data": "data.csv", "study": "study.toml"}
    return {key: str(folder / name) for key, name in names.items()}


@pytest.mark.parametrize("line", LINES)
def test_nothing_that_a_file_says_commands_anything(
    line: str, files: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, suffixes = LINES[line]
    written = {suffix: tmp_path / f"out.{suffix}" for suffix in ("json", *suffixes.split())}
    words = [word.format(**files) if word.startswith("{") else word for word in words]
    words += [f"{OPTIONS.get(suffix, '--json')}={file}" for suffix, file in written.items()]
    code = run([line.split(maxsplit=1)[0], *words])
    shown = capsys.readouterr()
    assert code in (0, 1), shown.err
    texts = {"out": shown.out, "err": shown.err, **{k: f.read_text(encoding="utf-8") for k, f in written.items()}}
    for where, text in texts.items():
        found = UNSEEN.search(text)
        assert found is None, f"{where}: {text[max(0, found.start() - 60) : found.end() + 20]!r}"
    assert not re.search("^(note: a line of its own|workbench: all)", shown.out + shown.err, re.MULTILINE)
    assert "<script>alert" not in texts["html"]
    assert "<img src=x" not in texts["html"]
    json.loads(texts["json"])
    for cell in (cell for row in csv.reader(texts.get("csv", "").splitlines()) for cell in row):
        assert cell[:1] not in tuple("=@+-") or _is_number(cell), cell


LONG = {key: f"{key} {key * 50_000}" for key in NAMES}  # with a blank, and a word without one


@pytest.mark.parametrize("line", ["info", "simulate", "nfr", "lin", "wrong name", "wrong file", "wrong number"])
def test_endless_names_are_shortened_where_a_person_reads(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not where a program does: the JSON has them in full."""
    fmu = str(build_commanding(tmp_path, LONG, "m" * 100_000, "said " * 20_000))
    data, page, picture = (tmp_path / f"out.{suffix}" for suffix in ("json", "html", "svg"))
    u, y = LONG["u"], LONG["y"]
    words, code = {
        "info": (["info", fmu, "--json", str(data), "--report", str(page)], 0),
        "simulate": (["simulate", fmu, "--stop", "1", "--input", f"{u}=2", "--plot", str(picture), "--json", str(data),
                      "--report", str(page)], 0),
        "nfr": (["nfr", fmu, "--input", u, "--output", y, "--freq", "1", "--amplitude", "1", "--json", str(data)], 0),
        "lin": (["lin", fmu, "--json", str(data), "--plot", str(picture)], 0),
        "wrong name": (["nfr", fmu, "--input", y + "z", "--output", y, "--freq", "1", "--amplitude", "1"], 2),
        "wrong file": (["info", "m" * 100_000], 2),
        "wrong number": (["simulate", fmu, "--stop", "m" * 100_000], 2),
    }[line]  # fmt: skip
    assert run(words) == code
    shown = capsys.readouterr()
    assert len(shown.out) < 30_000
    assert len(shown.err) < 10_000
    assert "more)…" in shown.out + shown.err or line == "wrong file"
    if code == 0:
        assert y in json.dumps(json.loads(data.read_text(encoding="utf-8")))
    if picture.exists():
        assert picture.stat().st_size < 500_000


@pytest.mark.parametrize("option", ["--set=tau", "--bias=u", "--input=u", "--stop"])
def test_a_number_beyond_all_floats_is_one_line(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "fmu:FirstOrderLag", "--stop=1", f"{option}=1{'0' * 400}"]) == 2
    assert len(capsys.readouterr().err.splitlines()[-1]) < 500


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def test_json_holds_the_names_as_they_are(files: dict[str, str], tmp_path: Path) -> None:
    assert run(["info", files["fmu"], "--json", str(tmp_path / "out.json")]) == 0
    found = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert [v["name"] for v in found["inputs"] + found["outputs"]] == [U, Y, CLOCK]


@pytest.mark.parametrize("word", ["simulate", "trim", "lin"])
def test_errors_are_one_line(files: dict[str, str], word: str, capsys: pytest.CaptureFixture[str]) -> None:
    more = ["--stop", "1"] if word == "simulate" else []
    assert run([word, files["fmu"], *more, "--set", "nosuch=1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert not UNSEEN.search(line)


def test_names_beside_ticks_are_no_formulas(tmp_path: Path) -> None:
    figure = Figure()
    axes = figure.add_subplot()
    axes.bar(["$a_1$", "b\x9b"], [1.0, 2.0])
    axes.set_yticks([1.0, 2.0], ["$cse1_x$", "\\frac$ $"])
    literal(figure).savefig(tmp_path / "picture.svg")
    literal(figure).savefig(tmp_path / "picture.svg")  # drawn twice, the same
    text = (tmp_path / "picture.svg").read_text(encoding="utf-8")
    assert {"<!-- $cse1_x$ -->", "<!-- $a_1$ -->", "<!-- b\\x9b -->", "<!-- \\frac$ $ -->"} <= {
        line.strip().replace("\\$", "$") for line in text.splitlines()
    }
    assert not any("\x9b" in t.get_text() for t in figure.findobj(Text))


def test_a_bar_takes_no_markup(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with Bar(1.0) as bar:
        bar._begin = -1e9
        bar.update(0.5, "[/]\x1b[31m[red]name")
        assert bar._progress is not None
        assert bar._progress.tasks[0].description == "[/]\\x1b[31m[red]name"


def test_unbroken() -> None:
    assert unbroken("a\nb\tc\x1b\u202e") == "a\\nb\\tc\\x1b\\u202e"
